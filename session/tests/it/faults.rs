//! Chunks that lack or come twice, bits that flipped, recordings of ROS that are cut: nothing is silent, and nothing is left in
//! a copy that a check complains of.

use std::{fs, io::Cursor, path::Path};

use erfgs_session::container::{Entry, Session, recover, recover_in_place};
use mcap::{Compression::Zstd, records::MessageHeader};

use crate::common::{self, compressed_ros_recording, event_packet};

fn open(bytes: &[u8]) -> Session<Cursor<&[u8]>> {
    Session::read(Cursor::new(bytes), Path::new("s.mcap")).unwrap()
}

/// Every complaint of a check.
fn check(bytes: &[u8]) -> Vec<String> {
    let mut session = open(bytes);
    let mut damage = session.summary().damage.clone();
    damage.extend(session.check(|_| {}).unwrap());
    damage
}

/// Where the chunks with messages lie, with the index of their messages.
fn chunks(bytes: &[u8]) -> Vec<[usize; 2]> {
    let chunks = mcap::Summary::read(bytes).unwrap().unwrap().chunk_indexes;
    let with_messages = chunks.iter().filter(|chunk| chunk.message_end_time > 0);
    let place = |chunk: &mcap::records::ChunkIndex| {
        let end = chunk.chunk_start_offset + chunk.chunk_length;
        [chunk.chunk_start_offset as usize, (end + chunk.message_index_length) as usize]
    };
    with_messages.map(place).collect()
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap())
    }

    /// The repaired copy of a session, or `None` if it is whole; fails if a check complains of it, or a second repair finds
    /// anything.
    fn recovered(&self, bytes: &[u8]) -> Option<Vec<u8>> {
        let [source, out] = ["s.mcap", "out.mcap"].map(|name| self.0.path().join(name));
        fs::write(&source, bytes).unwrap();
        if recover(&source, &out).unwrap().was_whole {
            return None;
        }
        let copy = fs::read(&out).unwrap();
        assert_eq!(check(&copy), Vec::<String>::new());
        assert!(open(&copy).summary().complete);
        assert!(recover_in_place(&out).unwrap().was_whole);
        fs::remove_file(out).unwrap();
        Some(copy)
    }
}

#[test]
fn a_chunk_that_lacks_is_told_whatever_the_index_says() {
    let folder = Folder::new();
    let session = common::small_session();
    let ros = compressed_ros_recording("evt3", None);
    for (bytes, totals) in [(&session, true), (&ros, false)] {
        for [from, to] in chunks(bytes) {
            let without = [&bytes[..from], &bytes[to..]].concat();
            let damage = check(&without);
            let what = if totals { "of the 12 that were recorded" } else { "the end of the file counts 5" };
            assert!(damage.iter().any(|message| message.contains(what)), "{damage:?}");
            let copy = folder.recovered(&without).expect("the copy says what there is");
            assert_eq!(common::entries(&copy), common::entries(&without));
        }
    }
    // Without totals the numbers of the packets tell.
    let places = chunks(&session);
    let [from, to] = places[1];
    let cut = places.last().unwrap()[1];
    let without = [&session[..from], &session[to..cut]].concat();
    assert!(
        check(&without).iter().any(|message| message.contains("missing by their sequence numbers")),
        "{:?}",
        check(&without)
    );
    assert_eq!(check(&session[..cut]), Vec::<String>::new());
}

#[test]
fn a_chunk_that_comes_twice_is_told_and_read_once() {
    let folder = Folder::new();
    for bytes in
        [common::small_session(), compressed_ros_recording("evt3", None), compressed_ros_recording("evt3", Some(Zstd))]
    {
        let all = common::entries(&bytes);
        let places = chunks(&bytes);
        for [from, to] in places.clone() {
            for at in [to, places.last().unwrap()[1]] {
                let twice = [&bytes[..at], &bytes[from..to], &bytes[at..]].concat();
                assert_eq!(common::entries(&twice), all);
                assert!(
                    check(&twice).iter().any(|message| message.contains("repeats that of byte")),
                    "{:?}",
                    check(&twice)
                );
                assert_eq!(common::entries(&folder.recovered(&twice).unwrap()), all);
            }
        }
    }
}

#[test]
fn packets_that_come_twice_in_other_chunks_are_told_and_read_once() {
    let folder = Folder::new();
    let bytes = common::small_session();
    let all = common::entries(&bytes);
    let mut out = Vec::new();
    let mut writer =
        mcap::WriteOptions::new().compression(None).chunk_size(Some(700)).create(Cursor::new(&mut out)).unwrap();
    let records: Vec<_> = mcap::read::ChunkFlattener::new(&bytes).unwrap().map(Result::unwrap).collect();
    for (at, record) in records.iter().enumerate() {
        use mcap::records::Record;
        match record {
            Record::Schema { header, data } => {
                writer.add_schema_with_id(header.id, &header.name, &header.encoding, data).unwrap();
            }
            Record::Channel(of) => {
                writer.add_channel_with_id(of.id, of.schema_id, &of.topic, &of.message_encoding, &of.metadata).unwrap();
            }
            Record::Message { header, data } => {
                writer.write_to_known_channel(header, data).unwrap();
                // Every packet comes again, ten records later.
                if let Some(Record::Message { header, data }) = at.checked_sub(10).map(|at| &records[at])
                    && data.starts_with(&[0, 1, 0, 0])
                {
                    writer.write_to_known_channel(header, data).unwrap();
                }
            }
            Record::Metadata(metadata) => writer.write_metadata(metadata).unwrap(),
            Record::DataEnd(_) => break,
            _ => {}
        }
    }
    writer.finish().unwrap();
    drop(writer);
    assert!(check(&out).iter().any(|message| message.contains("duplicates")), "{:?}", check(&out));
    assert_eq!(common::entries(&out), all);
    assert_eq!(common::entries(&folder.recovered(&out).unwrap()), all);
}

#[test]
fn a_bit_that_flipped_costs_nothing_where_a_checksum_tells_which() {
    let folder = Folder::new();
    let bytes = common::small_session();
    let all = common::entries(&bytes);
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    for chunk in chunks.iter().filter(|chunk| chunk.message_end_time > 0) {
        let (from, length) = (chunk.chunk_start_offset as usize, chunk.chunk_length as usize);
        for place in (0..8 * length).step_by(61) {
            // The times of a chunk's messages are told by nothing.
            if (9..25).contains(&(place / 8)) {
                continue;
            }
            let mut damaged = bytes.clone();
            damaged[from + place / 8] ^= 1 << (place % 8);
            assert_eq!(common::entries(&damaged), all, "bit {place}");
            assert!(!check(&damaged).is_empty(), "bit {place}");
            if place % 5 == 0 {
                assert_eq!(common::entries(&folder.recovered(&damaged).unwrap()), all, "bit {place}");
                let path = folder.0.path().join("p.mcap");
                fs::write(&path, &damaged).unwrap();
                recover_in_place(&path).unwrap();
                assert_eq!(check(&fs::read(&path).unwrap()), Vec::<String>::new());
                assert!(!folder.0.path().join("p.mcap.before").exists());
            }
        }
    }
}

/// Of a recording of ROS no chunk has a checksum, so that damage shows where a record is none.
fn without_checksums(mut bytes: Vec<u8>) -> Vec<u8> {
    for chunk in mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes {
        bytes[chunk.chunk_start_offset as usize + 33..][..4].fill(0);
    }
    bytes
}

#[test]
fn records_that_are_none_cost_the_messages_around_them() {
    let folder = Folder::new();
    let mut bytes = Vec::new();
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(1 << 20));
    let mut writer = options.create(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("event_camera_msgs/msg/EventPacket", "ros2msg", b"").unwrap();
    let channel_id = writer.add_channel(schema, "/events", "cdr", &Default::default()).unwrap();
    for sequence in 0..40 {
        let time = 1_744_000_000_000_000_000 + u64::from(sequence) * 1_000_000;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &event_packet(sequence.into(), "evt3", &[7; 200])).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let bytes = without_checksums(bytes);
    let all = common::entries(&bytes);
    let at = chunks(&bytes)[0][0] + 5000;
    for (from, to, at_most) in [(at, at + 1, 1), (at, at + 700, 5)] {
        let mut damaged = bytes.clone();
        // Zeros, as a file system leaves them; where a single byte lies in a message's events nothing is seen.
        damaged[from..to].fill(0);
        let found = common::entries(&damaged);
        assert!(found.len() + at_most >= all.len(), "{} of {}", found.len(), all.len());
        if let Some(copy) = folder.recovered(&damaged) {
            assert_eq!(common::entries(&copy), found);
        } else {
            assert_eq!(to - from, 1);
        }
        // Cut off besides.
        let end = chunks(&bytes)[0][1] - 20;
        let copy = folder.recovered(&damaged[..end]).unwrap();
        assert_eq!(common::entries(&copy), common::entries(&damaged[..end]));
    }
}

#[test]
fn a_recording_of_ros_whose_first_chunk_is_lost_is_read_with_what_the_index_declares() {
    let folder = Folder::new();
    for compression in [None, Some(Zstd)] {
        let bytes = compressed_ros_recording("evt3", compression);
        let all = common::entries(&bytes);
        let [from, to] = chunks(&bytes)[0];
        let without = [&bytes[..from], &bytes[to..]].concat();
        let mut damaged = bytes.clone();
        damaged[from + 33] ^= 0x55;
        for lost in [without, damaged] {
            let found = common::entries(&lost);
            assert!(!found.is_empty() && found.len() < all.len() && all.ends_with(&found));
            assert!(!check(&lost).is_empty());
            let copy = folder.recovered(&lost).unwrap();
            assert_eq!(common::entries(&copy), found);
            // Also for readers that know no index.
            assert_eq!(mcap::MessageStream::new(&copy).unwrap().map(Result::unwrap).count(), found.len());
        }
    }
}

#[test]
fn a_recording_of_ros_that_is_cut_anywhere_keeps_what_was_read() {
    let folder = Folder::new();
    let plain = compressed_ros_recording("evt3", None);
    // As the profile `fastwrite` has it: no chunks.
    let mut flat = Vec::new();
    let mut writer = mcap::WriteOptions::new().use_chunks(false).create(Cursor::new(&mut flat)).unwrap();
    let schema = writer.add_schema("event_camera_msgs/msg/EventPacket", "ros2msg", b"").unwrap();
    let channel_id = writer.add_channel(schema, "/events", "cdr", &Default::default()).unwrap();
    for sequence in 0..4 {
        let time = u64::from(sequence) + 5;
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &event_packet(sequence.into(), "evt3", &[7; 40])).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let path = folder.0.path().join("r.mcap");
    for bytes in [plain.clone(), without_checksums(plain), compressed_ros_recording("evt3", Some(Zstd)), flat] {
        for cut in (8..bytes.len()).step_by(29) {
            let cut = &bytes[..cut];
            let Ok(mut session) = Session::read(Cursor::new(cut), Path::new("r.mcap")) else { continue };
            let found: Vec<Entry> = session.messages(None).filter_map(Result::ok).collect();
            if found.is_empty() {
                continue;
            }
            let copy = folder.recovered(cut).unwrap();
            assert_eq!(common::entries(&copy), found);
            fs::write(&path, cut).unwrap();
            recover_in_place(&path).unwrap();
            assert_eq!(fs::read(&path).unwrap(), copy);
        }
    }
}

#[test]
fn what_a_repair_in_place_cuts_off_is_kept_meanwhile_and_never_written_over() {
    let folder = Folder::new();
    let bytes = common::small_session();
    let [path, kept] = ["s.mcap", "s.mcap.before"].map(|name| folder.0.path().join(name));
    fs::write(&path, &bytes[..bytes.len() - 30]).unwrap();
    fs::write(&kept, "of an earlier repair that was killed").unwrap();
    let error = recover_in_place(&path).unwrap_err().to_string();
    assert!(error.contains("s.mcap.before exists already") && error.contains("repair again"), "{error}");
    assert_eq!(fs::read(&path).unwrap(), &bytes[..bytes.len() - 30]);
    fs::remove_file(&kept).unwrap();
    recover_in_place(&path).unwrap();
    assert!(!kept.exists());
    assert_eq!(common::entries(&fs::read(&path).unwrap()), common::entries(&bytes));
}
