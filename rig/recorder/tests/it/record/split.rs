//! Recordings in several files.

use std::{
    fs,
    path::{Path, PathBuf},
};

use erfgs_events::Columns;
use erfgs_recorder::{
    Level, OpenSession, Options, RecordError, Recorder, RigConfig, SessionFiles, SessionInfo, SessionSink, SinkError,
    Status, open_on,
};
use erfgs_rig::host_time::host_ns;
use erfgs_session::{
    Session,
    container::{Entry, Settings, Split, part_path},
    source::{Description, Incident, Packet},
};
use serde_json::json;

use crate::record::support::{Puppet, evk4_and_davis346, options, packet, wait_until};

const RIG: &str = "[rig]\nname = \"lab\"\n\n[[evk4]]\nid = \"left\"\n\n[[davis346]]\nid = \"davis\"\n";

fn in_parts(ms: i64) -> SessionFiles {
    SessionFiles { split: Some(Split::Time(ms * 1_000_000)), ..SessionFiles::default() }
}

/// Writes every session twice: as it is told, and in parts.
struct Twice {
    parts: PathBuf,
}

struct Both([Box<dyn SessionSink>; 2]);

impl OpenSession for Twice {
    fn open(
        &self,
        path: &Path,
        info: &SessionInfo,
        streams: &[Description],
    ) -> Result<Box<dyn SessionSink>, SinkError> {
        let info = SessionInfo { begin_host_ns: Some(host_ns()), ..info.clone() };
        let whole = SessionFiles::default().open(path, &info, streams)?;
        Ok(Box::new(Both([whole, in_parts(150).open(&self.parts, &info, streams)?])))
    }
}

impl SessionSink for Both {
    fn packet(&mut self, stream: usize, packet: &Packet) -> Result<(), SinkError> {
        self.0.iter_mut().try_for_each(|sink| sink.packet(stream, packet))
    }

    fn incident(&mut self, stream: Option<usize>, host_ns: i64, incident: &Incident) -> Result<(), SinkError> {
        self.0.iter_mut().try_for_each(|sink| sink.incident(stream, host_ns, incident))
    }

    fn status(&mut self, status: &Status) -> Result<(), SinkError> {
        self.0.iter_mut().try_for_each(|sink| sink.status(status))
    }

    fn flush(&mut self) -> Result<(), SinkError> {
        self.0.iter_mut().try_for_each(|sink| sink.flush())
    }

    fn bytes_written(&self) -> u64 {
        self.0[1].bytes_written()
    }

    fn files(&self) -> u32 {
        self.0[1].files()
    }

    fn news(&mut self) -> Vec<(Level, String)> {
        self.0[1].news()
    }

    fn finish(self: Box<Self>) -> Result<u64, SinkError> {
        let [whole, parts] = self.0;
        whole.finish()?;
        parts.finish()
    }
}

/// All but the states of decoders, which lie where files begin, too, and the bytes written.
fn entries(session: &mut Session) -> Vec<Entry> {
    let entries = session.messages(None).filter_map(|entry| match entry.unwrap() {
        Entry::DecoderState(_) => None,
        Entry::Status(status) => Some(Entry::Status(erfgs_session::container::Status { written_bytes: 0, ..status })),
        entry => Some(entry),
    });
    entries.collect()
}

fn events(session: &mut Session, id: &str) -> Columns {
    let (stream, _) = session.stream(id).unwrap();
    let mut events = Columns::default();
    session.decode_events(stream, None, &mut events, |_| {}).unwrap().unwrap();
    events
}

#[test]
fn an_emulated_rig_recorded_whole_and_in_parts_is_the_same_session() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("RIG.toml");
    fs::write(&file, RIG).unwrap();
    let bus = evk4_and_davis346();
    let rig = RigConfig::load(&file).unwrap();
    let [whole, parts] = ["whole.mcap", "take.mcap"].map(|name| folder.path().join(name));
    let options = Options { folder: folder.path().into(), ..options(Twice { parts: parts.clone() }) };
    let recorder = Recorder::new(open_on(&rig, &bus).unwrap(), options).unwrap();
    recorder.start_recording(&whole).unwrap();
    recorder.start_sources().unwrap();
    let files = || recorder.status().recording.as_ref().map_or(0, |recording| recording.files);
    wait_until("two files", || files() >= 2);
    recorder.adjust("left", json!({ "biases": { "diff_on": 12 } }).as_object().unwrap()).unwrap();
    wait_until("files", || files() >= 9);
    recorder.stop_sources();
    let summary = recorder.stop_recording("enough").unwrap();
    assert!(summary.failure.is_none() && summary.files >= 9, "{summary:?}");

    let (mut whole, mut read) = (Session::open(&whole).unwrap(), Session::open(&parts).unwrap());
    assert!(read.summary().complete && read.summary().files.len() == summary.files as usize);
    assert_eq!(read.summary().file_bytes, summary.bytes);
    assert_eq!(read.summary().streams, whole.summary().streams);
    assert_eq!(read.summary().totals.incidents, whole.summary().totals.incidents);
    assert_eq!(read.check(|_| {}).unwrap(), [""; 0]);
    assert!(entries(&mut read) == entries(&mut whole), "the same messages in the same order");
    for id in ["left", "davis"] {
        let (found, expected) = (events(&mut read, id), events(&mut whole, id));
        assert!(!expected.is_empty() && found == expected, "{id}: {} events of {}", found.len(), expected.len());
    }
    // The last part by itself has what was changed before it, and gives the last of the events.
    let last = folder.path().join("alone.mcap");
    fs::copy(part_path(&parts, summary.files - 1), &last).unwrap();
    let mut last = Session::open(&last).unwrap();
    let adjusted = |entry: &erfgs_session::container::IncidentEntry| {
        entry.stream == "left" && matches!(entry.incident, Incident::Adjusted { .. })
    };
    assert!(last.summary().totals.incidents.iter().any(adjusted));
    for id in ["left", "davis"] {
        let all: Vec<_> = events(&mut whole, id).iter().collect();
        let alone: Vec<_> = events(&mut last, id).iter().collect();
        assert!(all.ends_with(&alone), "{id}: {} events by themselves", alone.len());
    }
}

#[test]
fn a_file_that_cannot_be_made_costs_nothing_and_is_tried_again() {
    let folder = tempfile::tempdir().unwrap();
    let (puppet, handle) = Puppet::new("one", 0);
    let recorder = Recorder::new(vec![puppet.input(1 << 20)], options(in_parts(1000))).unwrap();
    let first = folder.path().join("take.mcap");
    recorder.start_sources().unwrap();
    recorder.start_recording(&first).unwrap();
    let begun = host_ns();
    let send = |sequence, after_s: f64| {
        let host_ns = begun + (after_s * 1e9) as i64;
        assert!(handle.send(Packet { host_ns, ..packet(sequence, 100) }));
    };
    send(0, 0.0);
    // Somebody else's, who took the name in the meantime.
    let wait_written = |count| wait_until("written", || recorder.status().streams[0].written == count);
    wait_written(1);
    fs::write(part_path(&first, 1), b"precious").unwrap();
    send(1, 1.5);
    send(2, 3.0);
    let has_message = |level, text: &str| {
        recorder.messages().iter().any(|message| message.level == level && message.text.contains(text))
    };
    wait_until("a warning", || has_message(Level::Warning, "take.001.mcap' exists already"));
    wait_written(3);
    assert_eq!(fs::read(part_path(&first, 1)).unwrap(), b"precious");
    fs::remove_file(part_path(&first, 1)).unwrap();
    send(3, 12.0);
    wait_until("the next file", || has_message(Level::Info, "goes on in"));
    let summary = recorder.stop_recording("done").unwrap();
    assert_eq!((summary.files, summary.failure), (2, None));
    let mut session = Session::open(&first).unwrap();
    let packets = session.messages(None).filter(|entry| matches!(entry, Ok(Entry::Packet { .. }))).count();
    assert!(packets == 4 && session.summary().complete && session.summary().files.len() == 2);
    let incident = &session.summary().totals.incidents[0].incident;
    assert!(
        matches!(incident, Incident::Warning { message } if message.contains("takes more than it should")),
        "{incident:?}"
    );
}

#[test]
fn files_of_another_session_are_never_taken_for_parts() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("take.mcap");
    let (puppet, _) = Puppet::new("one", 0);
    let recorder = Recorder::new(vec![puppet.input(1 << 20)], options(in_parts(1000))).unwrap();
    fs::write(part_path(&first, 3), b"precious").unwrap();
    let error = recorder.start_recording(&first).unwrap_err();
    assert!(matches!(&error, RecordError::Sink(SinkError::Exists(path)) if *path == part_path(&first, 3)), "{error}");
    assert!(!first.exists() && !recorder.is_recording());
}

#[test]
fn sizes_hold_for_every_file_of_a_take_by_size() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("take.mcap");
    let (puppet, handle) = Puppet::new("one", 0);
    let settings = Settings { chunk_bytes: 20_000, ..Settings::default() };
    let limit = 200_000;
    let files = SessionFiles { settings, split: Some(Split::Bytes(limit)) };
    let recorder = Recorder::new(vec![puppet.input(8 << 20)], options(files)).unwrap();
    recorder.start_sources().unwrap();
    recorder.start_recording(&first).unwrap();
    for sequence in 0..300 {
        assert!(handle.send(packet(sequence, 5000)));
    }
    recorder.stop_sources();
    let summary = recorder.stop_recording("done").unwrap();
    assert!(summary.files >= 8, "{}", summary.files);
    let lengths: Vec<u64> = (0..summary.files).map(|part| part_path(&first, part).metadata().unwrap().len()).collect();
    assert!(lengths.iter().all(|&length| length <= limit), "{lengths:?}");
    assert_eq!(lengths.iter().sum::<u64>(), summary.bytes);
    assert_eq!(Session::open(&first).unwrap().summary().streams[0].totals.packets, 300);
}
