//! What goes wrong, and what must hold all the same: nothing is lost without being counted, memory stays bounded,
//! what was written stays, and the user is told.

use std::{
    io::{self, Cursor, Write},
    path::Path,
    sync::{Arc, Mutex, atomic::Ordering::SeqCst},
    time::Duration,
};

use erfgs_recorder::{
    Input, Level, OpenSession, RecordError, Recorder, SessionFiles, SessionInfo, SessionSink, SinkError, StreamState,
};
use erfgs_session::{
    container::{Entry, Session, Settings, recover},
    source::{Description, Incident},
};

use crate::record::support::{Disk, Opener, Puppet, one, options, packet, wait_until};

const PATH: &str = "session.mcap";

fn has_message(recorder: &Recorder, level: Level, text: &str) -> bool {
    recorder.messages().iter().any(|message| message.level == level && message.text.contains(text))
}

#[test]
fn a_slow_disk_costs_counted_packets_and_bounded_memory() {
    const LIMIT: usize = 1 << 20;
    let (recorder, handle, disk) = one(LIMIT);
    let tokens = disk.gated();
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new(PATH)).unwrap();
    let taken = (0..2000).filter(|&sequence| handle.send(packet(sequence, 10_000))).count();
    assert!((90..=110).contains(&taken), "{taken} packets of 10 kB found room in 1 MiB");
    wait_until("drops shown", || recorder.status().streams[0].drops.queue == 2000 - taken as u64);
    wait_until("a word to the user", || has_message(&recorder, Level::Error, "disk is slower"));
    drop(tokens);
    wait_until("the queue emptied", || recorder.status().streams[0].waiting_bytes == 0);
    assert!(handle.send(packet(2000, 10)), "the stream goes on after the drops");
    let summary = recorder.stop_recording("done").unwrap();
    let stream = &summary.streams[0];
    assert!(stream.peak_waiting_bytes <= LIMIT as u64);
    assert_eq!((stream.written, stream.drops.queue, stream.drops.writer), (taken as u64 + 1, 2000 - taken as u64, 0));
    assert_eq!(stream.drops.queue_bytes, 10_000 * stream.drops.queue);
    let shelf = disk.shelf.lock().unwrap();
    let last = &shelf.packets.last().unwrap().1;
    assert!(last.discontinuity && last.sequence == 2000, "the first packet after a gap says so");
    assert!(shelf.incidents.iter().any(|(stream, _)| *stream == Some(0)), "the session itself tells of the drops");
    assert!(shelf.finished && summary.failure.is_none());
}

#[test]
fn a_full_disk_ends_the_recording_and_keeps_what_was_written() {
    let (recorder, handle, disk) = one(1 << 20);
    disk.room.store(10, SeqCst);
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new(PATH)).unwrap();
    for sequence in 0..30 {
        assert!(handle.send(packet(sequence, 100)));
    }
    wait_until("the recording ended by itself", || !recorder.is_recording());
    let summary = recorder.last().unwrap();
    assert!(summary.failure.as_ref().is_some_and(|failure| failure.contains("is full")), "{summary:?}");
    assert_eq!(disk.sequences(0), (0..10).collect::<Vec<u64>>());
    assert_eq!((summary.streams[0].written, summary.streams[0].drops.writer), (10, 20));
    assert!(!disk.shelf.lock().unwrap().finished, "a file that failed is not written to again");
    assert!(has_message(&recorder, Level::Error, "is full"));
    // The cameras go on for whoever watches, and another disk can be recorded to.
    wait_until("the stream still runs", || recorder.status().streams[0].state == StreamState::Running);
    disk.room.store(0, SeqCst);
    recorder.start_recording(Path::new("other.mcap")).unwrap();
    assert!(handle.send(packet(30, 100)));
    assert!(recorder.stop_recording("done").unwrap().failure.is_none());
}

/// A file on a disk with room for some bytes.
struct Tiny {
    bytes: Arc<Mutex<Vec<u8>>>,
    room: usize,
}

impl Write for Tiny {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut held = self.bytes.lock().unwrap();
        let count = bytes.len().min(self.room - held.len());
        if count == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        held.extend_from_slice(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

struct OpenTiny(Arc<Mutex<Vec<u8>>>, usize);

impl OpenSession for OpenTiny {
    fn open(
        &self,
        path: &Path,
        info: &SessionInfo,
        streams: &[Description],
    ) -> Result<Box<dyn SessionSink>, SinkError> {
        let file = Tiny { bytes: Arc::clone(&self.0), room: self.1 };
        let settings = Settings { chunk_bytes: 20_000, ..Settings::default() };
        SessionFiles { settings, split: None }.write_to(file, path, info, streams)
    }
}

#[test]
fn a_session_file_cut_by_a_full_disk_holds_every_packet_but_those_of_the_chunk_that_was_cut() {
    let bytes = Arc::new(Mutex::new(Vec::new()));
    let (puppet, handle) = Puppet::new("one", 0);
    let recorder = Recorder::new(vec![puppet.input(1 << 24)], options(OpenTiny(Arc::clone(&bytes), 200_000))).unwrap();
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new(PATH)).unwrap();
    let mut sequence = 0;
    wait_until("the disk full", || {
        handle.send(packet(sequence, 1000));
        sequence += 1;
        !recorder.is_recording()
    });
    let summary = recorder.last().unwrap();
    assert!(summary.failure.as_ref().is_some_and(|failure| failure.contains("is full")), "{summary:?}");
    let bytes = bytes.lock().unwrap().clone();
    assert_eq!(bytes.len(), 200_000);
    let read = |bytes: Vec<u8>| -> u64 {
        let mut session = Session::read(Cursor::new(bytes), Path::new(PATH)).unwrap();
        let mut next = 0;
        for entry in session.messages(None).map_while(Result::ok) {
            let Entry::Packet { packet: found, .. } = entry else { continue };
            assert_eq!((found.sequence, &found.payload), (next, &packet(next, 1000).payload));
            next += 1;
        }
        next
    };
    // The chunk that was cut has 20 kB at most, and what is not packets takes a quarter of the rest at most.
    let held = read(bytes.clone());
    assert!(held >= 130, "{held} packets of 1000 bytes");
    let folder = tempfile::tempdir().unwrap();
    let [cut, whole] = ["cut.mcap", "whole.mcap"].map(|name| folder.path().join(name));
    std::fs::write(&cut, bytes).unwrap();
    assert!(!recover(&cut, &whole).unwrap().was_whole);
    assert_eq!(read(std::fs::read(&whole).unwrap()), held);
}

#[test]
fn a_panic_in_the_writer_is_told_and_hangs_nothing() {
    let (recorder, handle, disk) = one(1 << 20);
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new(PATH)).unwrap();
    disk.panics.store(true, SeqCst);
    handle.send(packet(0, 10));
    let summary = recorder.stop_recording("done").unwrap();
    assert!(summary.failure.is_some_and(|failure| failure.contains("bug")));
}

#[test]
fn a_device_that_is_lost_and_comes_back_is_shown_and_put_on_record() {
    let (recorder, handle, disk) = one(1 << 20);
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new(PATH)).unwrap();
    let state = || recorder.status().streams[0].state;
    handle.send(packet(0, 10));
    wait_until("running", || state() == StreamState::Running);
    let lost = Incident::Lost { reason: "unplugged".into() };
    handle.report(lost.clone());
    wait_until("lost", || state() == StreamState::Lost);
    assert!(has_message(&recorder, Level::Error, "unplugged"));
    handle.report(Incident::Back);
    handle.send(packet(1, 10));
    wait_until("running again", || state() == StreamState::Running);
    recorder.stop_recording("done").unwrap();
    let shelf = disk.shelf.lock().unwrap();
    let incidents: Vec<&Incident> =
        shelf.incidents.iter().filter(|(stream, _)| *stream == Some(0)).map(|(_, incident)| incident).collect();
    assert_eq!(incidents, [&lost, &Incident::Back]);
}

#[test]
fn a_silent_device_counts_as_stalled_until_it_speaks() {
    let (puppet, handle) = Puppet::new("one", 0);
    let disk = Arc::new(Disk::default());
    let input = Input { stall_after: Some(Duration::from_millis(600)), ..puppet.input(1 << 20) };
    let recorder = Recorder::new(vec![input], options(Opener(Arc::clone(&disk)))).unwrap();
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new(PATH)).unwrap();
    let state = || recorder.status().streams[0].state;
    wait_until("stalled", || state() == StreamState::Stalled);
    assert!(has_message(&recorder, Level::Warning, "no data"));
    wait_until("running", || {
        handle.send(packet(0, 10));
        state() == StreamState::Running
    });
    assert!(has_message(&recorder, Level::Info, "data come again"));
    recorder.stop_recording("done").unwrap();
    let shelf = disk.shelf.lock().unwrap();
    assert!(shelf.incidents.iter().any(|(stream, incident)| *stream == Some(0)
        && matches!(incident, Incident::Warning { message } if message.contains("no data"))));
}

#[test]
fn a_disk_down_to_its_reserve_ends_the_recording_in_good_order() {
    let (puppet, _handle) = Puppet::new("one", 0);
    let disk = Arc::new(Disk::default());
    let mut options = options(Opener(Arc::clone(&disk)));
    options.reserve_bytes = u64::MAX;
    let recorder = Recorder::new(vec![puppet.input(1 << 20)], options).unwrap();
    recorder.start_sources().unwrap();
    recorder.start_recording(Path::new(PATH)).unwrap();
    wait_until("the recording ended by itself", || !recorder.is_recording());
    let summary = recorder.last().unwrap();
    assert!(summary.failure.is_none() && summary.reason.contains("reserve"), "{summary:?}");
    assert!(disk.shelf.lock().unwrap().finished);
}

#[test]
fn what_a_driver_lost_is_counted_from_the_start_of_the_recording() {
    let (recorder, handle, _disk) = one(1 << 20);
    recorder.start_sources().unwrap();
    handle.lost.store(5, SeqCst);
    wait_until("the driver's count", || recorder.status().streams[0].counters.lost == 5);
    recorder.start_recording(Path::new(PATH)).unwrap();
    handle.lost.store(7, SeqCst);
    wait_until("the recording's count", || recorder.status().streams[0].drops.driver == 2);
    assert_eq!(recorder.stop_recording("done").unwrap().drops(), 2);
}

#[test]
fn recordings_are_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("take.mcap");
    std::fs::write(&path, b"precious").unwrap();
    let (puppet, _handle) = Puppet::new("one", 0);
    let recorder = Recorder::new(vec![puppet.input(1 << 20)], options(SessionFiles::default())).unwrap();
    let refused = recorder.start_recording(&path);
    assert!(matches!(refused, Err(RecordError::Sink(SinkError::Exists(_)))), "{refused:?}");
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
}
