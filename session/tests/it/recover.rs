use std::{fs, path::Path};

use erfgs_session::container::{ContainerError, Session, recover, recover_in_place};

use crate::common;

/// Fails unless the `mcap` crate reads the file by its index and linearly, and finds the same messages both ways.
pub fn check_with_mcap(bytes: &[u8]) -> usize {
    let linear = mcap::MessageStream::new(bytes).unwrap().map(Result::unwrap).count();
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    let mut indexed = 0;
    // Chunks that declare streams hold no messages and have no index of them.
    for chunk in summary.chunk_indexes.iter().filter(|chunk| chunk.message_end_time > 0) {
        for (channel, messages) in summary.read_message_indexes(bytes, chunk).unwrap() {
            for entry in messages {
                let message = summary.seek_message(bytes, chunk, &entry).unwrap();
                assert_eq!((message.channel.id, message.log_time), (channel.id, entry.log_time));
                indexed += 1;
            }
        }
    }
    assert_eq!(indexed, linear);
    assert_eq!(summary.stats.as_ref().unwrap().message_count, linear as u64);
    for index in &summary.metadata_indexes {
        mcap::read::metadata(bytes, index).unwrap();
    }
    for index in &summary.attachment_indexes {
        mcap::read::attachment(bytes, index).unwrap();
    }
    linear
}

pub fn check_recovered(path: &Path, cut: &[u8]) {
    let recovered = fs::read(path).unwrap();
    assert_eq!(check_with_mcap(&recovered), common::entries(cut).len());
    assert_eq!(common::entries(&recovered), common::entries(cut));
    let session = Session::open(path).unwrap();
    assert!(session.summary().complete && session.summary().damage.is_empty());
    let before = Session::read(std::io::Cursor::new(cut), path).unwrap().summary().clone();
    assert_eq!(session.summary().totals, before.totals);
    assert_eq!(session.summary().rig, before.rig);
}

#[test]
fn a_session_cut_at_any_byte_is_repaired_to_its_whole_chunks() {
    let bytes = common::small_session();
    // In memory, where there is such a folder: every repair waits for its disk.
    let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    // The places around the ends of chunks, and many in between; the fuzz target `repair` takes the others.
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let ends: Vec<usize> =
        chunks.iter().map(|chunk| (chunk.chunk_start_offset + chunk.chunk_length) as usize).collect();
    let cuts = ends.iter().flat_map(|end| [end - 1, *end, end + 1, end + 30, end + 90]);
    for cut in cuts.chain((8..bytes.len()).step_by(41)).chain([bytes.len() - 1]) {
        fs::write(&source, &bytes[..cut]).unwrap();
        // What begins it is before the first chunk.
        if let Err(error) = Session::open(&source) {
            assert!((cut as u64) < chunks[0].chunk_start_offset, "cut at {cut}: {error}");
            continue;
        }
        let report = recover(&source, &out).unwrap();
        assert!(!report.was_whole && report.damaged.is_empty());
        check_recovered(&out, &bytes[..cut]);
        let report_in_place = recover_in_place(&source).unwrap();
        assert_eq!(report_in_place, report);
        assert_eq!(fs::read(&source).unwrap(), fs::read(&out).unwrap(), "cut at {cut}");
        fs::remove_file(&out).unwrap();
        assert!(recover_in_place(&source).unwrap().was_whole, "once is enough");
    }
}

#[test]
fn a_whole_session_is_left_alone() {
    let bytes = common::small_session();
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    fs::write(&source, &bytes).unwrap();
    assert!(recover(&source, &out).unwrap().was_whole);
    assert!(!out.exists());
    assert!(recover_in_place(&source).unwrap().was_whole);
    assert_eq!(fs::read(&source).unwrap(), bytes);
}

#[test]
fn a_damaged_chunk_is_left_out_of_the_copy_and_forbids_repair_in_place() {
    let bytes = common::small_session();
    let ends: Vec<u64> = mcap::Summary::read(&bytes)
        .unwrap()
        .unwrap()
        .chunk_indexes
        .iter()
        .filter(|chunk| chunk.message_end_time > 0)
        .map(|chunk| chunk.chunk_start_offset + chunk.chunk_length)
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    for end in ends {
        let mut damaged = bytes.clone();
        damaged[(end - 60) as usize] ^= 0x55;
        for length in [damaged.len(), damaged.len() - 9] {
            fs::write(&source, &damaged[..length]).unwrap();
            let error = recover_in_place(&source).unwrap_err();
            assert!(matches!(error, ContainerError::DamagedWithin { places: 1, .. }), "{error}");
            let report = recover(&source, &out).unwrap();
            assert_eq!(report.damaged.len(), 1);
            let recovered = fs::read(&out).unwrap();
            assert_eq!(check_with_mcap(&recovered), common::entries(&damaged).len());
            assert_eq!(common::entries(&recovered), common::entries(&damaged));
            fs::remove_file(&out).unwrap();
        }
    }
}

#[test]
fn streams_that_a_damaged_chunk_declared_are_known_from_the_index() {
    let bytes = common::small_session();
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    let declares = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let declares: Vec<_> = declares.iter().filter(|chunk| chunk.message_end_time == 0).collect();
    assert!(!declares.is_empty());
    let mut damaged = bytes.clone();
    for chunk in declares {
        damaged[(chunk.chunk_start_offset + chunk.chunk_length - 5) as usize] ^= 0x55;
    }
    fs::write(&source, &damaged).unwrap();
    recover(&source, &out).unwrap();
    let copy = fs::read(&out).unwrap();
    assert_eq!(common::entries(&copy), common::entries(&bytes));
    // Also for readers that go from message to message and know no index.
    assert_eq!(check_with_mcap(&copy), common::entries(&bytes).len());
}

#[test]
fn a_damaged_length_is_not_taken_for_the_place_where_the_recording_was_cut_off() {
    let bytes = common::small_session();
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let middle = chunks[chunks.len() / 2].chunk_start_offset as usize;
    // One field is told by the others; two are not, and what follows the chunk is found all the same.
    for (places, mended) in [(&[5][..], true), (&[5, 25 + 5, 41 + 5], false)] {
        let mut damaged = bytes.clone();
        places.iter().for_each(|place| damaged[middle + place] = 1);
        fs::write(&source, &damaged).unwrap();
        let report = recover(&source, &out).unwrap();
        assert_eq!(
            (report.mended.len(), report.damaged.len()),
            (usize::from(mended), usize::from(!mended)),
            "{report:?}"
        );
        let (copied, all) = (common::entries(&fs::read(&out).unwrap()), common::entries(&bytes));
        let after = copied.last() == all.last() && copied.iter().all(|entry| all.contains(entry));
        assert!(after && (copied == all) == mended, "{} of {}", copied.len(), all.len());
        if !mended {
            assert!(matches!(recover_in_place(&source), Err(ContainerError::DamagedWithin { places: 1, .. })));
            assert_eq!(fs::read(&source).unwrap(), damaged, "nothing is cut off");
        }
        fs::remove_file(&out).unwrap();
    }
}

#[test]
fn what_follows_a_chunk_whose_index_is_damaged_is_kept() {
    let bytes = common::small_session();
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let last = chunks.iter().filter(|chunk| chunk.message_end_time > 0).max_by_key(|chunk| chunk.chunk_start_offset);
    let index = last.unwrap().message_index_offsets.values().min().copied().unwrap();
    // The totals follow the last chunk; without its opcode, nobody knows what the record of its index is.
    let mut damaged = bytes[..bytes.len() - 9].to_vec();
    damaged[index as usize] = 0x81;
    fs::write(&source, &damaged).unwrap();
    let report = recover(&source, &out).unwrap();
    assert!(!report.was_whole && report.damaged.is_empty());
    check_recovered(&out, &damaged);
    assert_eq!(common::entries(&fs::read(&out).unwrap()), common::entries(&bytes));
}

#[test]
fn messages_outside_of_chunks_are_kept_and_counted_though_nothing_indexes_them() {
    let bytes = common::small_session();
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    let chunks = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let last = chunks.iter().max_by_key(|chunk| chunk.chunk_start_offset).unwrap();
    let end = (last.chunk_start_offset + last.chunk_length) as usize;
    let content = end - last.uncompressed_size as usize;
    let is_message = bytes[content] == mcap::records::op::MESSAGE;
    assert!(is_message, "the last chunk declares nothing");
    let record = 9 + u64::from_le_bytes(bytes[content + 1..content + 9].try_into().unwrap()) as usize;
    // The first message of the last chunk once more, behind the chunk, whose index is missing.
    let cut = [&bytes[..end], &bytes[content..content + record]].concat();
    let loose = common::entries(&bytes[..end]).len() + 1;
    assert_eq!(common::entries(&cut).len(), loose);
    fs::write(&source, &cut).unwrap();
    let report = recover(&source, &out).unwrap();
    assert_eq!((report.cut_bytes, report.messages as usize), (0, loose));
    let copy = fs::read(&out).unwrap();
    assert_eq!(common::entries(&copy), common::entries(&cut));
    let counted = mcap::Summary::read(&copy).unwrap().unwrap().stats.unwrap().message_count;
    assert_eq!(counted as usize, loose);
    assert!(recover_in_place(&out).unwrap().was_whole);
}

#[test]
fn zeros_that_a_power_cut_left_are_cut_off() {
    let mut bytes = common::small_session();
    bytes.truncate(bytes.len() - 400);
    let whole = common::entries(&bytes);
    bytes.extend_from_slice(&[0; 5000]);
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    fs::write(&source, &bytes).unwrap();
    recover(&source, &out).unwrap();
    assert_eq!(common::entries(&fs::read(&out).unwrap()), whole);
}
