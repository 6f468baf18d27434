//! Ranges of recordings: as sessions of their own, and for every reader.

use std::{fs, path::Path};

use erfgs_events::{CSV_HEADER, CdEvent, Columns, CsvEncoder, EventEncoding, Evt3Encoder};
use erfgs_session::{
    container::{ContainerError, Entry, Recording, Session, SessionWriter, Settings, write_excerpt},
    source::{Encoding, Incident, Packet},
};

use crate::common::{START_NS, description, packet, start};

/// Two seconds of words of an EVT 3 sensor, twenty events in a packet each millisecond, and frames beside them.
fn write(path: &Path) -> Vec<CdEvent> {
    let settings = Settings { chunk_bytes: 20_000, ..Settings::default() };
    let mut writer = SessionWriter::create(path, start(), "[rig]\n", settings).unwrap();
    let camera = writer.add_stream(&description("ev0", Encoding::Events(EventEncoding::Evt3))).unwrap();
    let frames = writer.add_stream(&description("cam0", Encoding::TriggerLines)).unwrap();
    let mut encoder = Evt3Encoder::default();
    let mut events = Vec::new();
    let changed = serde_json::from_str(r#"{"biases": {"diff_on": 3}}"#).unwrap();
    writer.incident(Some(camera), START_NS + 5, &Incident::Adjusted { changed }).unwrap();
    for ms in 0..2000_u64 {
        let mut words = Vec::new();
        for n in 0..20 {
            // The device's clock rolls over within the recording.
            let t_us = (1 << 24) - 1_000_000 + ms * 1000 + n * 50;
            let event = CdEvent { t_us, x: (ms % 1280) as u16, y: n as u16, on: n % 2 == 0 };
            encoder.event(event, &mut words).unwrap();
            events.push(event);
        }
        encoder.finish(&mut words);
        let host_ns = START_NS + (ms as i64 + 1) * 1_000_000;
        let whole = Packet {
            sequence: 70 + ms,
            host_ns,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload: words.into(),
        };
        writer.packet(camera, &whole).unwrap();
        if ms % 100 == 99 {
            writer.packet(frames, &Packet { host_ns, discontinuity: false, ..packet(ms / 100, 30) }).unwrap();
        }
    }
    writer.finish().unwrap();
    events
}

fn packets(recording: &mut Recording) -> Vec<(usize, Packet)> {
    let packet = |entry| match entry {
        Ok(Entry::Packet { stream, packet }) => Some((stream, packet)),
        Ok(_) => None,
        Err(error) => panic!("{error}"),
    };
    recording.messages(None).filter_map(packet).collect()
}

#[test]
fn an_excerpt_is_a_whole_session_of_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("s.mcap"), folder.path().join("cut.mcap"));
    write(&path);
    let mut recording = Recording::open(&path, None).unwrap();
    let all = packets(&mut recording);
    let span = [500_000_000, 1_250_000_000];
    let totals = write_excerpt(&mut recording, span, None, &out, &mut Vec::new(), |_| {}).unwrap();
    let within = |packet: &Packet| (START_NS + span[0]..=START_NS + span[1]).contains(&packet.host_ns);
    let wanted: Vec<_> = all.iter().filter(|(_, packet)| within(packet)).cloned().collect();
    assert_eq!(totals.streams["ev0"].packets, 751);
    assert_eq!(totals.streams["cam0"].packets, 8);
    let mut cut = Session::open(&out).unwrap();
    assert_eq!(cut.check(|_| {}).unwrap(), Vec::<String>::new());
    let summary = cut.summary();
    assert!(summary.complete && summary.damage.is_empty());
    assert_eq!(summary.rig.as_deref(), Some("[rig]\n"));
    assert_eq!(summary.start.host_ns, START_NS + span[0]);
    assert_eq!(summary.start.epoch_ns, start().epoch_ns + span[0]);
    assert!(summary.start.machine["excerpt"].contains("0.500000 s to 1.250000 s of s.mcap"));
    assert_eq!(summary.streams[0].description, description("ev0", Encoding::Events(EventEncoding::Evt3)));
    assert_eq!(summary.streams[0].totals.missing, 0);
    let incidents: Vec<&Incident> = summary.totals.incidents.iter().map(|entry| &entry.incident).collect();
    assert!(matches!(incidents[..], [Incident::Adjusted { .. }, Incident::Ended { .. }]), "{incidents:?}");
    assert_eq!(packets(&mut Recording::open(&out, None).unwrap()), wanted);
    // The recording itself is whole again.
    assert_eq!(packets(&mut recording).len(), all.len());

    let again = write_excerpt(&mut recording, span, None, &out, &mut Vec::new(), |_| {});
    assert!(matches!(again, Err(ContainerError::Exists { .. })));
    let nowhere = folder.path().join("none.mcap");
    let nothing = write_excerpt(&mut recording, [0, 90_000_000], Some(&[1]), &nowhere, &mut Vec::new(), |_| {});
    assert!(matches!(nothing, Err(ContainerError::NothingWithin { .. })) && !nowhere.exists());
    let one = folder.path().join("one.mcap");
    write_excerpt(&mut recording, span, Some(&[1]), &one, &mut Vec::new(), |_| {}).unwrap();
    assert_eq!(Session::open(&one).unwrap().summary().streams.len(), 1);
}

#[test]
fn events_of_a_range_have_the_times_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    let events = write(&path);
    let mut recording = Recording::open(&path, None).unwrap();
    // Behind the roll-over of the device's clock.
    recording.restrict(Some([1_400_000_000, 1_700_000_000]));
    let mut columns = Columns::default();
    recording.decode_events(0, &mut columns, |_| {}).unwrap().unwrap();
    assert_eq!(columns.t_us.len(), 20 * 301);
    let at = events.iter().position(|event| event.t_us == columns.t_us[0]).unwrap();
    assert!(columns.iter().eq(events[at..at + columns.t_us.len()].iter().copied()));
    recording.restrict(None);
    let mut columns = Columns::default();
    recording.decode_events(0, &mut columns, |_| {}).unwrap();
    assert_eq!(columns.t_us.len(), events.len());
}

#[test]
fn an_event_file_is_cut_to_the_microsecond() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.csv");
    let mut csv = CSV_HEADER.to_vec();
    for n in 0..20_000 {
        CsvEncoder.event(CdEvent { t_us: 7_000_000 + n * 100, x: (n % 31) as u16, y: 3, on: true }, &mut csv);
    }
    fs::write(&path, csv).unwrap();
    let mut recording = Recording::open(&path, None).unwrap();
    recording.restrict(Some([500_000_000, 700_000_000]));
    let mut columns = Columns::default();
    recording.decode_events(0, &mut columns, |_| {}).unwrap();
    let times: Vec<u64> = (5000..=7000).map(|n| 7_000_000 + n * 100).collect();
    assert_eq!(columns.t_us, times);
    recording.restrict(None);
    let out = folder.path().join("e.mcap");
    write_excerpt(&mut recording, [500_000_000, 700_000_000], None, &out, &mut Vec::new(), |_| {}).unwrap();
    let mut columns = Columns::default();
    Recording::open(&out, None).unwrap().decode_events(0, &mut columns, |_| {}).unwrap();
    // Packets of five milliseconds are whole.
    assert!((1950..=2051).contains(&columns.t_us.len()) && columns.t_us.contains(&7_600_000), "{}", columns.t_us.len());
}
