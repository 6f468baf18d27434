//! Starting, stopping, and one recording after another.

use std::{
    path::Path,
    sync::{Arc, Mutex},
};

use erfgs_recorder::{RecordError, Recorder, StreamState};
use erfgs_rig::host_time::host_ns;

use crate::record::support::{Disk, Opener, Puppet, one, options, packet, wait_until};

#[test]
fn sources_start_by_their_order_and_stop_in_reverse() {
    let journal = Arc::new(Mutex::new(Vec::new()));
    let inputs = [("board", 9), ("slave", -1), ("master", 3)]
        .map(|(id, order)| Puppet::new(id, order).0.journalled(&journal).input(1 << 20));
    let recorder = Recorder::new(inputs.into(), options(Opener(Arc::default()))).unwrap();
    recorder.start_sources().unwrap();
    recorder.stop_sources();
    assert_eq!(
        *journal.lock().unwrap(),
        ["start slave", "start master", "start board", "stop board", "stop master", "stop slave"]
    );
}

#[test]
fn a_device_that_refuses_to_start_stops_those_before_it_and_is_named() {
    let journal = Arc::new(Mutex::new(Vec::new()));
    let inputs = vec![
        Puppet::new("good", 0).0.journalled(&journal).input(1 << 20),
        Puppet::new("bad", 1).0.journalled(&journal).refusing().input(1 << 20),
        Puppet::new("later", 2).0.journalled(&journal).input(1 << 20),
    ];
    let recorder = Recorder::new(inputs, options(Opener(Arc::default()))).unwrap();
    let error = recorder.start_sources().unwrap_err();
    assert!(error.to_string().contains("'bad'") && error.to_string().contains("does not want to"), "{error}");
    assert_eq!(*journal.lock().unwrap(), ["start good", "start bad", "stop good"]);
    // And so they stay: what the watchdog finds at its next look is the same.
    // (The first one after the refusal may have begun before it.)
    for look in ["a look after the refusal", "a second look"] {
        let before = host_ns();
        wait_until(look, || recorder.status().host_ns > before);
    }
    let states: Vec<StreamState> = recorder.status().streams.iter().map(|stream| stream.state).collect();
    assert_eq!(states, [StreamState::Stopped; 3]);
}

#[test]
fn names_are_checked_before_anything_starts() {
    let recorder = |ids: &[&str]| {
        let inputs = ids.iter().map(|id| Puppet::new(id, 0).0.input(1 << 20)).collect();
        Recorder::new(inputs, options(Opener(Arc::default())))
    };
    assert!(matches!(recorder(&[]), Err(RecordError::NoDevices)));
    assert!(matches!(recorder(&["a", "b", "a"]), Err(RecordError::DuplicateId(id)) if id == "a"));
    for id in ["", "a/b", "..", "a b", &"x".repeat(65)] {
        assert!(matches!(recorder(&[id]), Err(RecordError::BadId(_))), "{id}");
    }
}

#[test]
fn a_second_recording_begins_with_counts_of_its_own_and_claims_no_loss() {
    let (recorder, handle, disk) = one(1 << 20);
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new("first.mcap")).unwrap();
    handle.send(packet(0, 10));
    assert!(matches!(recorder.start_recording(Path::new("other.mcap")), Err(RecordError::Busy(_))));
    assert_eq!(recorder.stop_recording("done").unwrap().streams[0].written, 1);
    handle.send(packet(1, 10));
    recorder.start_recording(Path::new("second.mcap")).unwrap();
    handle.send(packet(2, 10));
    handle.send(packet(3, 10));
    assert_eq!(recorder.stop_recording("done").unwrap().streams[0].written, 2);
    assert!(matches!(recorder.stop_recording("again"), Err(RecordError::NotRecording)));
    let shelf = disk.shelf.lock().unwrap();
    let marks: Vec<(u64, bool)> =
        shelf.packets.iter().map(|(_, packet)| (packet.sequence, packet.discontinuity)).collect();
    assert_eq!(marks, [(0, false), (2, false), (3, false)]);
}

#[test]
fn the_file_is_brought_into_a_readable_state_again_and_again() {
    let (recorder, handle, disk) = one(1 << 20);
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new("session.mcap")).unwrap();
    let flushes = || disk.shelf.lock().unwrap().flushes;
    for sequence in 0..3 {
        let before = flushes();
        handle.send(packet(sequence, 10));
        wait_until("a flush after the packet", || flushes() > before);
    }
    recorder.stop_recording("done").unwrap();
}

#[test]
fn a_dropped_recorder_completes_its_file_and_stops_its_devices() {
    let journal = Arc::new(Mutex::new(Vec::new()));
    let (puppet, handle) = Puppet::new("one", 0);
    let disk = Arc::new(Disk::default());
    let input = puppet.journalled(&journal).input(1 << 20);
    let recorder = Recorder::new(vec![input], options(Opener(Arc::clone(&disk)))).unwrap();
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new("session.mcap")).unwrap();
    handle.send(packet(0, 10));
    drop(recorder);
    assert_eq!(*journal.lock().unwrap(), ["start one", "stop one"]);
    assert!(disk.shelf.lock().unwrap().finished && disk.sequences(0) == [0]);
}
