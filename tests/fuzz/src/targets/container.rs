//! Any bytes as a session file: opened, read through, sought in, decoded. Reading gives errors, never a panic, the same
//! however few bytes come at a time, and takes no more memory than the file is long, times what a number is written in.
//!
//! The first byte says how many bytes are read at a time.

use std::{
    io::{Cursor, Read, Seek},
    path::Path,
};

use erfgs_session::container::{Entry, Session};

use crate::{Nothing, Trickle, memory};

/// The shortest message is longer.
const SHORTEST_MESSAGE: usize = 9 + 22;

fn open<R: Read + Seek>(file: R) -> Option<Session<R>> {
    Session::read(file, Path::new("fuzz.mcap")).ok()
}

fn read(bytes: &[u8]) {
    let Some(mut session) = open(Cursor::new(bytes)) else { return };
    let summary = session.summary().clone();
    assert!(summary.whole_bytes <= summary.file_bytes && summary.file_bytes == bytes.len() as u64);
    let most = bytes.len() / SHORTEST_MESSAGE + 1;
    let all: Vec<Entry> = session.messages(None).filter_map(Result::ok).collect();
    assert!(all.len() <= most, "{} messages in {} bytes", all.len(), bytes.len());
    let streams = summary.streams.len();
    for entry in &all {
        assert!(!matches!(entry, Entry::Packet { stream, .. } if *stream >= streams), "{entry:?} of {streams} streams");
    }
    let middle = summary.span_ns().map(|[first, last]| i64::midpoint(first, last));
    if let Some(middle) = middle {
        let later = session.messages(Some(middle)).filter_map(Result::ok);
        let mut count = 0;
        for entry in later {
            count += 1;
            assert!(!matches!(entry, Entry::Packet { packet, .. } if packet.host_ns < middle), "too early");
        }
        assert!(count <= most);
    }
    for stream in 0..streams {
        let halves = middle.map(|middle| [[middle, i64::MAX], [i64::MIN, middle]]);
        for window in [None].into_iter().chain(halves.into_iter().flatten().map(Some)) {
            let _ = session.decode_events(stream, window, &mut Nothing, |_| {});
        }
    }
}

/// Checks one input.
pub fn container(input: &[u8]) {
    let Some((&most, bytes)) = input.split_first() else { return };
    let peak = memory::peak(|| read(bytes));
    // A frame of a DAVIS of any size that its words can name, decoded and handed on, is 64 MiB.
    let limit = (192 << 20) + 256 * bytes.len();
    assert!(peak <= limit, "{peak} bytes of memory for a file of {} bytes", bytes.len());

    let [whole, trickled] = [usize::MAX, most.into()].map(|most| open(Trickle::new(bytes, most)));
    let (Some(mut whole), Some(mut trickled)) = (whole, trickled) else { return };
    assert_eq!(whole.summary(), trickled.summary());
    let text = |session: &mut Session<Trickle<'_>>| -> Vec<String> {
        session.messages(None).map(|entry| format!("{entry:?}")).collect()
    };
    assert_eq!(text(&mut whole), text(&mut trickled));
}
