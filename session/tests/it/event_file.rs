//! Event files as recordings.

use std::{fs, path::Path};

use erfgs_events::EventEncoding;
use erfgs_events::{CSV_HEADER, CdEvent, Columns, CsvEncoder};
use erfgs_session::{
    container::{Entry, Recording, Session, import_events},
    source::{Encoding, Packet},
};

/// Three seconds of events, each of which goes back by a little now and then.
fn write_csv(path: &Path) -> Vec<CdEvent> {
    let event = |n: u64| CdEvent {
        t_us: 7_000_000 + n * 100 - n % 7 * 20,
        x: (n % 31) as u16,
        y: (n % 17) as u16,
        on: n.is_multiple_of(2),
    };
    let events: Vec<CdEvent> = (0..30_000).map(event).collect();
    let mut csv = CSV_HEADER.to_vec();
    events.iter().for_each(|&event| CsvEncoder.event(event, &mut csv));
    fs::write(path, csv).unwrap();
    events
}

fn packets(recording: &mut Recording, from_host_ns: Option<i64>) -> Vec<Packet> {
    let packet = |entry| match entry {
        Ok(Entry::Packet { packet, .. }) => packet,
        other => panic!("{other:?}"),
    };
    recording.messages(from_host_ns).map(packet).collect()
}

#[test]
fn a_file_and_its_session_have_the_same_packets_and_events() {
    let folder = tempfile::tempdir().unwrap();
    let (csv, out) = (folder.path().join("e.csv"), folder.path().join("e.mcap"));
    let events = write_csv(&csv);
    let mut file = Recording::open(&csv, None).unwrap();
    let Recording::EventFile(of_file) = &file else { panic!("no event file") };
    let totals = import_events(of_file, &out, |_| {}).unwrap();
    let mut session = Recording::open(&out, None).unwrap();
    let description = file.summary().streams[0].description.clone();
    assert_eq!(session.summary().streams[0].description, description);
    assert_eq!(
        (description.encoding, description.width, description.height),
        (Encoding::Events(EventEncoding::Aedat4), 31, 17)
    );
    let of_file = packets(&mut file, None);
    assert_eq!(of_file, packets(&mut session, None));
    assert_eq!(totals.streams["e"].packets, of_file.len() as u64);
    assert!((500..=620).contains(&of_file.len()), "{} packets of 5 ms", of_file.len());
    assert!(of_file.is_sorted_by_key(|packet| packet.host_ns));
    for recording in [&mut file, &mut session] {
        let mut columns = Columns::default();
        recording.decode_events(0, &mut columns, |_| {}).unwrap().unwrap();
        assert!(columns.iter().eq(events.iter().copied()));
    }
    let late = packets(&mut file, Some(2_000_000_000));
    assert!(late.len() > 150 && late.iter().all(|packet| packet.host_ns >= 2_000_000_000));
    // Who does not want the rest of the packets leaves them.
    assert_eq!(file.messages(None).take(3).count(), 3);
}

#[test]
fn a_window_of_packets_of_aedat4_is_decoded_from_any_packet_on() {
    let folder = tempfile::tempdir().unwrap();
    let (csv, out) = (folder.path().join("e.csv"), folder.path().join("e.mcap"));
    let events = write_csv(&csv);
    let Recording::EventFile(file) = Recording::open(&csv, None).unwrap() else { panic!("no event file") };
    import_events(&file, &out, |_| {}).unwrap();
    let mut session = Session::open(&out).unwrap();
    let mut columns = Columns::default();
    session.decode_events(0, Some([1_500_000_000, 1_600_000_000]), &mut columns, |_| {}).unwrap();
    assert!((900..=1100).contains(&columns.len()), "{} events", columns.len());
    let first = events.iter().position(|event| *event == columns.iter().next().unwrap()).unwrap();
    assert!(columns.iter().eq(events[first..].iter().copied().take(columns.len())));
}

#[test]
fn times_that_no_clock_has_become_no_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    for (t_us, is_taken) in [(1_700_000_000_000_000, true), (1_700_000_000_000_000_000, false), (i64::MAX, false)] {
        let mut events = erfgs_events::Events::new(4, 4);
        events.push(erfgs_events::Event { t_us, x: 1, y: 2, on: true });
        erfgs_events::npz::write_events(&path, &events).unwrap();
        let opened = Recording::open(&path, None).map(drop).map_err(|error| error.to_string());
        assert_eq!(opened.is_ok(), is_taken, "{t_us}: {opened:?}");
        let is_clear = |message: &String| message.contains("a.npz") && message.contains("plausible");
        assert!(opened.is_ok() || opened.as_ref().is_err_and(is_clear), "{opened:?}");
    }
}
