//! Any bytes as an archive of events, or as the arrays in one. What is read is written as an archive that reads the same.
//!
//! The first byte's bit 0 says what the rest is: an archive, or arrays, each with its length in 16 bits before it, for an
//! archive that is made of them. (Its checksums keep the fuzzer from reaching what lies behind by itself.) Bits 1 to 7: so
//! many bytes are read at a time.

use std::{
    io::{Cursor, Write},
    path::Path,
};

use erfgs_events::npz;
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

use crate::{Trickle, memory};

fn archive(mut arrays: &[u8]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for name in ["t", "x", "y", "p", "width", "height", "luma"] {
        let Some((&length, rest)) = arrays.split_first_chunk() else { break };
        let (array, rest) = rest.split_at(usize::from(u16::from_le_bytes(length)).min(rest.len()));
        arrays = rest;
        zip.start_file(format!("{name}.npy"), options).expect("an entry");
        zip.write_all(array).expect("in memory");
    }
    zip.finish().expect("an archive").into_inner()
}

/// Checks one input.
pub fn npz(input: &[u8]) {
    let Some((&options, rest)) = input.split_first() else { return };
    let made = archive(rest);
    let bytes = if options & 1 == 0 { rest } else { &made };
    let path = Path::new("fuzz.npz");
    let peak = memory::peak(|| {
        let read = [None, Some([640, 480])].map(|size| npz::read_events_from(Cursor::new(bytes), path, size));
        for (size, read) in [None, Some([640, 480])].into_iter().zip(read) {
            let trickled = npz::read_events_from(Trickle::new(bytes, usize::from(options >> 1)), path, size);
            match (read, trickled) {
                (Ok(events), Ok(again)) => {
                    assert!(events.t_us.is_sorted(), "times decrease");
                    assert!(events.x.iter().all(|&x| u32::from(x) < events.width));
                    assert!(events.y.iter().all(|&y| u32::from(y) < events.height));
                    assert_eq!(events, again);
                }
                (read, again) => assert!(read.is_err() && again.is_err(), "{read:?} and {again:?}"),
            }
        }
        let _ = npz::read_luma_from(Cursor::new(bytes), path);
    });
    // A deflated byte stands for 1032 bytes at most, of which a column makes numbers of 8 bytes.
    let limit = (1 << 20) + 64_000 * bytes.len();
    assert!(peak <= limit, "{peak} bytes of memory for an archive of {} bytes", bytes.len());
}
