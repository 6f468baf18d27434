//! Any bytes as a session file: reading gives errors, never a panic, and never more memory than the file is long.

#![no_main]

use std::{io::Cursor, path::Path};

use erfgs_session::{
    codec::Columns,
    container::{Entry, Session},
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(mut session) = Session::read(Cursor::new(bytes), Path::new("fuzz.mcap")) else { return };
    let packets = session.messages(None).filter(|entry| matches!(entry, Ok(Entry::Packet { .. }))).count();
    let summary = session.summary().clone();
    assert!(summary.whole_bytes <= summary.file_bytes);
    if let Some([first, last]) = summary.span_ns() {
        let from = session.messages(Some(i64::midpoint(first, last))).filter(Result::is_ok).count();
        assert!(from <= packets + bytes.len());
    }
    for stream in 0..summary.streams.len() {
        let _ = session.decode_events(stream, summary.span_ns().map(|[first, _]| first), &mut Columns::default(), |_| {});
    }
});
