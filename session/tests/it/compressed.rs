//! Chunks as other programs compress them, written by the `mcap` crate with the C libraries of LZ4 and Zstandard.

use std::{fs, io::Cursor, ops::Range, path::Path};

use erfgs_events::Columns;
use erfgs_session::container::{ContainerError, Entry, Session, recover, recover_in_place};
use mcap::Compression::{Lz4, Zstd};

use crate::{
    common::{self, compressed_ros_recording, repacked},
    recover::{check_recovered, check_with_mcap},
};

fn open(bytes: &[u8]) -> Result<Session<Cursor<&[u8]>>, ContainerError> {
    Session::read(Cursor::new(bytes), Path::new("packed.mcap"))
}

/// Where the chunks lie that hold messages, and how they are compressed.
fn chunks(bytes: &[u8]) -> Vec<(Range<usize>, String)> {
    let chunks = mcap::Summary::read(bytes).unwrap().unwrap().chunk_indexes.into_iter();
    let range = |at, length| at as usize..(at + length) as usize;
    chunks.map(|chunk| (range(chunk.chunk_start_offset, chunk.chunk_length), chunk.compression)).collect()
}

// Fields of a chunk's record, from its beginning.
const RECORD_LENGTH: usize = 1;
const UNCOMPRESSED_SIZE: usize = 9 + 16;
const CRC: usize = 9 + 24;
const NAME_LENGTH: usize = 9 + 28;
const NAME: usize = 9 + 32;

fn put(bytes: &mut [u8], at: usize, number: u64) {
    bytes[at..at + 8].copy_from_slice(&number.to_le_bytes());
}

fn number(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// The errors that reading `bytes` to its end gives.
fn errors(bytes: &[u8]) -> Vec<ContainerError> {
    open(bytes).unwrap().messages(None).filter_map(Result::err).collect()
}

#[test]
fn a_session_that_was_compressed_is_the_same_session() {
    let bytes = common::small_session();
    for (compression, name) in [(Lz4, "lz4"), (Zstd, "zstd")] {
        let packed = repacked(&bytes, compression);
        assert!(chunks(&packed).len() > 2 && chunks(&packed).iter().all(|(_, found)| found == name));
        assert_eq!(common::entries(&packed), common::entries(&bytes));
        for packed in [&packed[..], &packed[..packed.len() - 8]] {
            let mut session = open(packed).unwrap();
            let (summary, plain) = (session.summary().clone(), open(&bytes).unwrap().summary().clone());
            assert_eq!((&summary.streams, &summary.totals), (&plain.streams, &plain.totals));
            assert_eq!((&summary.start, &summary.rig), (&plain.start, &plain.rig));
            assert!(summary.is_session && summary.damage.is_empty());
            assert_eq!(session.check(|_| {}).unwrap(), Vec::<String>::new());
            let from = common::START_NS + 60_000_000;
            let late: Vec<Entry> = session.messages(Some(from)).map(Result::unwrap).collect();
            let expected: Vec<Entry> = open(&bytes).unwrap().messages(Some(from)).map(Result::unwrap).collect();
            let packets = |entries: &[Entry]| entries.iter().filter(|e| matches!(e, Entry::Packet { .. })).count();
            assert_eq!((packets(&late), packets(&expected)), (12, 12));
        }
    }
}

#[test]
fn a_compressed_recording_of_ros_gives_the_same_events() {
    let plain = compressed_ros_recording("evt3", None);
    let decode = |bytes: &[u8]| {
        let mut columns = Columns::default();
        let decoded = open(bytes).unwrap().decode_events(0, None, &mut columns, |_| {}).unwrap().unwrap();
        assert!(decoded.damage.is_empty() && decoded.packets == 5);
        (columns, decoded)
    };
    for compression in [Lz4, Zstd] {
        let packed = compressed_ros_recording("evt3", Some(compression));
        assert_eq!(common::entries(&packed), common::entries(&plain));
        let (summary, expected) = (open(&packed).unwrap().summary().clone(), open(&plain).unwrap().summary().clone());
        assert!(summary.complete && summary.damage.is_empty());
        assert_eq!((summary.streams, summary.start), (expected.streams, expected.start));
        assert_eq!(decode(&packed), decode(&plain));
        assert_eq!(open(&packed).unwrap().check(|_| {}).unwrap(), Vec::<String>::new());
    }
}

#[test]
fn a_chunk_whose_length_is_a_lie_is_passed_over_and_told() {
    for compression in [Lz4, Zstd] {
        let bytes = compressed_ros_recording("evt3", Some(compression));
        let chunk = chunks(&bytes)[1].0.clone();
        let whole = number(&bytes, chunk.start + UNCOMPRESSED_SIZE);
        let lies = [
            (whole - 1, "holds more than"),
            (0, "holds more than"),
            (whole + 1, "bytes of the"),
            ((1 << 30) + 1, "longer than erfgs reads"),
            (u64::MAX, "longer than erfgs reads"),
        ];
        for (lie, what) in lies {
            for checksum in [true, false] {
                let mut lying = bytes.clone();
                put(&mut lying, chunk.start + UNCOMPRESSED_SIZE, lie);
                if !checksum {
                    lying[chunk.start + CRC..][..4].fill(0);
                }
                let found = errors(&lying);
                let [error @ ContainerError::Damaged { path, offset, .. }] = &found[..] else { panic!("{found:?}") };
                assert_eq!((path.as_path(), *offset), (Path::new("packed.mcap"), chunk.start as u64));
                assert!(error.to_string().contains(what) && error.to_string().contains("erfgs recover"), "{error}");
                assert_eq!(open(&lying).unwrap().summary().damage, [error.to_string()]);
                let (some, all) = (common::entries(&lying), common::entries(&bytes));
                assert!(!some.is_empty() && some.len() < all.len() && some.iter().all(|entry| all.contains(entry)));
            }
        }
    }
}

#[test]
fn a_compressed_chunk_that_does_not_match_its_checksum_is_damaged() {
    for compression in [Lz4, Zstd] {
        let mut bytes = compressed_ros_recording("evt3", Some(compression));
        let chunk = chunks(&bytes)[1].0.clone();
        bytes[chunk.start + CRC] ^= 1;
        let found = errors(&bytes);
        assert!(matches!(&found[..], [error] if error.to_string().contains("checksum")), "{found:?}");
    }
}

/// `bytes` without `count` bytes at the end of the chunk, which does not claim them either.
fn without_end(bytes: &[u8], chunk: &Range<usize>, count: usize) -> Vec<u8> {
    let mut out = [&bytes[..chunk.end - count], &bytes[chunk.end..]].concat();
    let packed = NAME + bytes[chunk.start + NAME_LENGTH] as usize;
    for field in [RECORD_LENGTH, packed] {
        let length = number(bytes, chunk.start + field) - count as u64;
        put(&mut out, chunk.start + field, length);
    }
    out
}

#[test]
fn a_compressed_chunk_that_lacks_its_end_is_damaged() {
    for compression in [Lz4, Zstd] {
        let bytes = compressed_ros_recording("evt3", Some(compression));
        let chunk = chunks(&bytes)[1].0.clone();
        let name = bytes[chunk.start + NAME_LENGTH] as usize;
        let (all, others) = (common::entries(&bytes), common::entries(&without_end(&bytes, &chunk, 20)));
        assert!(!others.is_empty() && others.len() < all.len());
        for count in 1..chunk.len() - NAME - name - 8 {
            let cut = without_end(&bytes, &chunk, count);
            let found = common::entries(&cut);
            // The end mark of LZ4 (and its checksum) says nothing that the length does not.
            let mark = count <= 8 && found == all && errors(&cut).is_empty();
            let damaged = matches!(errors(&cut)[..], [ContainerError::Damaged { .. }]);
            assert!(mark || (found == others && damaged), "{compression:?} without {count}");
        }
    }
}

/// `bytes` as if its chunks, which are compressed with zstd, were compressed with `name`, of as many letters.
fn renamed(mut bytes: Vec<u8>, name: &[u8; 4]) -> Vec<u8> {
    for (chunk, _) in chunks(&bytes) {
        bytes[chunk.start + NAME..][..4].copy_from_slice(name);
    }
    bytes
}

#[test]
fn what_chunks_are_compressed_with_that_erfgs_does_not_read_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    let assert_refused = |error: ContainerError| {
        assert!(matches!(error, ContainerError::Compression { .. }), "{error}");
        let error = error.to_string();
        assert!(error.contains(r#"compressed with "lzma""#) && error.contains(r#"reads "lz4" and "zstd""#), "{error}");
    };
    let ros = renamed(compressed_ros_recording("evt3", Some(Zstd)), b"lzma");
    assert_refused(open(&ros).err().unwrap());
    let session = renamed(repacked(&common::small_session(), Zstd), b"lzma");
    assert_refused(open(&session).unwrap().messages(None).next().unwrap().err().unwrap());
    assert_refused(open(&session).unwrap().check(|_| {}).err().unwrap());
    fs::write(&source, &ros).unwrap();
    assert_refused(recover(&source, &out).unwrap_err());
    assert!(!out.exists());
    assert!(matches!(recover_in_place(&source), Err(ContainerError::DamagedWithin { .. })));
    assert_eq!(fs::read(&source).unwrap(), ros, "nothing is cut off");
    // A longer name, and one that would not fit a terminal.
    for name in [&b"snappy"[..], &[b'\n'; 5000]] {
        let mut file = bytes_before_chunks(&ros);
        let body = [&[0; 28][..], &(name.len() as u32).to_le_bytes(), name, &0_u64.to_le_bytes()].concat();
        file.push(mcap::records::op::CHUNK);
        file.extend_from_slice(&(body.len() as u64).to_le_bytes());
        file.extend_from_slice(&body);
        let error = open(&file).err().unwrap().to_string();
        assert!(error.contains("compressed with") && error.len() < 400 && !error.contains('\n'), "{error}");
    }
}

fn bytes_before_chunks(bytes: &[u8]) -> Vec<u8> {
    let first = chunks(bytes)[0].0.start;
    bytes[..first].to_vec()
}

#[test]
fn a_compressed_session_that_was_cut_off_keeps_its_whole_chunks_as_they_are() {
    let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    for compression in [Lz4, Zstd] {
        let bytes = repacked(&common::small_session(), compression);
        let chunks_before = chunks(&bytes);
        let ends = chunks_before.iter().flat_map(|(chunk, _)| [chunk.end - 1, chunk.end, chunk.end + 1]);
        let after_first = chunks_before[0].0.end..bytes.len();
        for cut in ends.chain(after_first.step_by(37)).filter(|&cut| cut >= chunks_before[0].0.end) {
            fs::write(&source, &bytes[..cut]).unwrap();
            let report = recover(&source, &out).unwrap();
            assert!(!report.was_whole && report.damaged.is_empty());
            let whole = chunks_before.iter().filter(|(chunk, _)| chunk.end <= cut).count();
            assert_eq!(report.chunks as usize, whole);
            check_recovered(&out, &bytes[..cut]);
            let copy = fs::read(&out).unwrap();
            assert_eq!(chunks(&copy), chunks_before[..whole], "cut at {cut}");
            assert_eq!(recover_in_place(&source).unwrap(), report);
            assert_eq!(fs::read(&source).unwrap(), copy);
            assert!(recover_in_place(&source).unwrap().was_whole);
            fs::remove_file(&out).unwrap();
        }
    }
}

#[test]
fn a_compressed_recording_of_ros_that_was_cut_off_keeps_its_whole_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    for compression in [None, Some(Lz4), Some(Zstd)] {
        let bytes = compressed_ros_recording("evt3", compression);
        let last = chunks(&bytes).last().unwrap().0.clone();
        fs::write(&source, &bytes[..last.end - 10]).unwrap();
        recover(&source, &out).unwrap();
        let copy = fs::read(&out).unwrap();
        let (kept, all) = (common::entries(&copy), common::entries(&bytes));
        assert!(!kept.is_empty() && kept.len() < all.len() && all.starts_with(&kept));
        assert_eq!(check_with_mcap(&copy), kept.len());
        fs::remove_file(&out).unwrap();
    }
}

#[test]
fn a_damaged_compressed_chunk_is_left_out_of_the_copy() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    for compression in [Lz4, Zstd] {
        let bytes = repacked(&common::small_session(), compression);
        let chunk = chunks(&bytes)[1].0.clone();
        for place in [chunk.start + CRC, chunk.start + NAME, chunk.start + UNCOMPRESSED_SIZE, chunk.end - 30] {
            let mut damaged = bytes.clone();
            damaged[place] ^= 1;
            fs::write(&source, &damaged).unwrap();
            assert!(matches!(recover_in_place(&source), Err(ContainerError::DamagedWithin { places: 1, .. })));
            let report = recover(&source, &out).unwrap();
            assert!(!report.was_whole && report.damaged.len() == 1);
            let copy = fs::read(&out).unwrap();
            assert_eq!(check_with_mcap(&copy), common::entries(&damaged).len());
            assert_eq!(common::entries(&copy), common::entries(&damaged));
            fs::remove_file(&out).unwrap();
        }
    }
}

#[test]
fn no_damage_of_a_compressed_file_is_taken_for_data() {
    for compression in [Lz4, Zstd] {
        let bytes = repacked(&common::small_session(), compression);
        let all = common::entries(&bytes);
        for (chunk, _) in chunks(&bytes) {
            for place in chunk.start..chunk.end {
                let mut damaged = bytes.clone();
                damaged[place] ^= 1 << (place % 8);
                let Ok(mut session) = open(&damaged) else { continue };
                let found: Vec<Entry> = session.messages(None).filter_map(Result::ok).collect();
                // Times of the chunk and marks of the compression say nothing of the messages.
                assert!(found.len() <= all.len() && found.iter().all(|entry| all.contains(entry)), "{place}");
            }
        }
    }
}
