//! Any bytes as a session that is to be repaired. What comes out is whole, holds the messages that could be read before,
//! and is left alone when it is repaired again; where nothing is damaged within, repairing in place gives the same bytes.

use std::{fs, io::Cursor, path::Path};

use erfgs_session::container::{ContainerError, Entry, Session, recover, recover_in_place};

/// The messages of a session, with the names of the streams of packets: their order may be another in a copy.
fn entries(bytes: &[u8]) -> Option<Vec<(Option<String>, Entry)>> {
    let mut session = Session::read(Cursor::new(bytes), Path::new("fuzz.mcap")).ok()?;
    let names: Vec<String> = session.summary().streams.iter().map(|stream| stream.topic.clone()).collect();
    let named = |entry| match entry {
        Entry::Packet { stream, packet } => (Some(names[stream].clone()), Entry::Packet { stream: 0, packet }),
        entry => (None, entry),
    };
    Some(session.messages(None).filter_map(Result::ok).map(named).collect())
}

/// Checks one input.
pub fn repair(bytes: &[u8]) {
    // In memory nobody waits for a disk.
    let folder = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a temporary folder");
    let [source, out] = ["source.mcap", "out.mcap"].map(|name| folder.path().join(name));
    fs::write(&source, bytes).expect("written");
    // A copy that would hold less is refused, and not left there.
    let Ok(report) = recover(&source, &out) else {
        assert!(!out.exists());
        assert_eq!(fs::read(&source).expect("read"), bytes, "the original is left alone");
        return;
    };
    assert_eq!(fs::read(&source).expect("read"), bytes, "the original is left alone");
    let in_place = recover_in_place(&source);
    if report.was_whole {
        assert!(!out.exists());
        assert!(in_place.expect("a whole file").was_whole);
        return;
    }
    let repaired = fs::read(&out).expect("a copy");
    // Nothing may be left of a session, not even what makes it one.
    let [before, after] = [bytes, &repaired].map(|bytes| entries(bytes).unwrap_or_default());
    // A damaged index may have hidden some that are found now.
    let mut found = after.iter();
    let lost = before.iter().find(|&entry| !found.any(|after| after == entry));
    assert!(lost.is_none(), "{lost:?} of {} messages is not among {} in the copy", before.len(), after.len());
    let again = recover_in_place(&out).expect("the copy");
    assert!(again.was_whole, "{report:?}, then {again:?}");
    match in_place {
        Ok(in_place) => {
            assert_eq!(in_place, report);
            assert!(fs::read(&source).expect("read") == repaired, "in place, and as a copy");
        }
        Err(error) => {
            assert!(matches!(error, ContainerError::DamagedWithin { .. }) && !report.damaged.is_empty(), "{error}");
        }
    }
}
