use std::{fs, path::Path};

use erfgs_session::container::{ContainerError, Session, recover, recover_in_place};

use crate::common;

/// Fails unless the `mcap` crate reads the file by its index and linearly, and finds the same messages both ways.
fn check_with_mcap(bytes: &[u8]) -> usize {
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

fn check_recovered(path: &Path, cut: &[u8]) {
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
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("s.mcap"), folder.path().join("out.mcap"));
    // Every byte would wait for the disk thousands of times: the places around the ends of chunks, and some in between.
    let ends = mcap::Summary::read(&bytes).unwrap().unwrap().chunk_indexes;
    let ends = ends.iter().map(|chunk| (chunk.chunk_start_offset + chunk.chunk_length) as usize);
    let cuts = ends.flat_map(|end| [end - 1, end, end + 1, end + 30, end + 90]);
    for cut in cuts.chain((8..bytes.len()).step_by(997)).chain([bytes.len() - 1]) {
        fs::write(&source, &bytes[..cut]).unwrap();
        if Session::open(&source).is_err() {
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
        damaged[(end - 60) as usize] ^= 1;
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
