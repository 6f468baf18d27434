use std::{io::Cursor, path::Path};

use erfgs_events::EventEncoding;
use erfgs_session::{
    container::{ContainerError, Entry, Session, Settings},
    source::{Description, Encoding},
};

use crate::common::{self, START_NS};

fn open(bytes: &[u8]) -> Result<Session<Cursor<&[u8]>>, ContainerError> {
    Session::read(Cursor::new(bytes), Path::new("memory.mcap"))
}

/// Offsets of the ends of the chunks of a file, found with the `mcap` crate.
fn chunk_ends(bytes: &[u8]) -> Vec<u64> {
    let summary = mcap::Summary::read(bytes).unwrap().unwrap();
    summary.chunk_indexes.iter().map(|chunk| chunk.chunk_start_offset + chunk.chunk_length).collect()
}

#[test]
fn what_was_written_is_read_in_order() {
    let bytes = common::small_session();
    let mut session = open(&bytes).unwrap();
    let summary = session.summary().clone();
    assert!(summary.is_session && summary.complete && summary.damage.is_empty());
    assert_eq!(summary.start, common::start());
    assert_eq!(summary.rig.as_deref(), Some("name = \"rig\"\n"));
    assert_eq!(summary.streams.len(), 2);
    assert_eq!(summary.streams[0].totals.packets, 12);
    assert_eq!(summary.totals.incidents.len(), 3);
    assert_eq!(summary.totals.clocks["ev0"], common::fit(10));
    assert_eq!(summary.span_ns(), Some([START_NS, START_NS + 110_000_000]));
    let mut sequences = [0, 0];
    let mut others = 0;
    for entry in session.messages(None) {
        match entry.unwrap() {
            Entry::Packet { stream, packet } => {
                let bytes = if summary.streams[stream].description.id == "ev0" { 200 } else { 50 };
                assert_eq!(packet, common::packet(sequences[stream], bytes));
                sequences[stream] += 1;
            }
            _ => others += 1,
        }
    }
    assert_eq!((sequences, others), ([12, 12], 9));
}

#[test]
fn the_index_says_what_reading_through_finds() {
    let bytes = common::small_session();
    let indexed = open(&bytes).unwrap().summary().clone();
    let without_index = &bytes[..bytes.len() - 8];
    let scanned = open(without_index).unwrap().summary().clone();
    assert!(indexed.complete && !scanned.complete);
    assert_eq!((&indexed.streams, &indexed.totals), (&scanned.streams, &scanned.totals));
    assert_eq!((&indexed.start, &indexed.rig), (&scanned.start, &scanned.rig));
}

#[test]
fn a_file_cut_at_any_byte_gives_the_messages_of_its_whole_chunks() {
    let bytes = common::small_session();
    let all = common::entries(&bytes);
    let ends = chunk_ends(&bytes);
    assert!(ends.len() >= 6, "{ends:?}");
    // Messages up to and including each chunk.
    let counts: Vec<usize> = ends.iter().map(|&end| common::entries(&bytes[..end as usize]).len()).collect();
    assert_eq!(counts.last(), Some(&all.len()));
    for cut in 0..bytes.len() {
        match open(&bytes[..cut]) {
            Ok(mut session) => {
                let found: Vec<Entry> = session.messages(None).map(Result::unwrap).collect();
                let whole = ends.iter().filter(|&&end| end <= cut as u64).count();
                let expected = if whole == 0 { 0 } else { counts[whole - 1] };
                assert_eq!(found, all[..expected], "cut at {cut}");
                assert!(!session.summary().complete && session.summary().whole_bytes <= cut as u64);
                assert!(session.summary().damage.is_empty(), "a cut is no damage");
            }
            Err(ContainerError::Empty { .. }) => assert_eq!(cut, 0),
            Err(ContainerError::NotMcap { .. }) => assert!(cut < 8),
            Err(ContainerError::NotASession { .. }) => assert!(cut < ends[0] as usize),
            Err(other) => panic!("cut at {cut}: {other}"),
        }
    }
}

#[test]
fn a_byte_that_flipped_loses_one_chunk_and_is_told() {
    let bytes = common::small_session();
    let all = common::entries(&bytes);
    let ends = chunk_ends(&bytes);
    let mut damaged = bytes.clone();
    // Chunks 0 to 2 declare schemas and streams.
    damaged[(ends[4] - 200) as usize] ^= 0x55;
    let mut session = open(&damaged).unwrap();
    let results: Vec<_> = session.messages(None).collect();
    let errors: Vec<_> = results.iter().filter_map(|result| result.as_ref().err()).collect();
    assert_eq!(errors.len(), 1);
    assert!(matches!(errors[0], ContainerError::Damaged { .. }), "{}", errors[0]);
    let lost = common::entries(&bytes[..ends[4] as usize]).len() - common::entries(&bytes[..ends[3] as usize]).len();
    assert!(lost > 0);
    assert_eq!(results.len() - 1, all.len() - lost);
}

#[test]
fn any_flipped_byte_gives_an_error_or_true_packets_but_never_a_false_one() {
    let bytes = common::small_session();
    let ends = chunk_ends(&bytes);
    for at in 0..*ends.last().unwrap() as usize {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x55;
        let Ok(mut session) = open(&damaged) else { continue };
        let streams = session.summary().streams.clone();
        for entry in session.messages(None).flatten() {
            if let Entry::Packet { stream, packet } = entry {
                let bytes = if streams[stream].description.id == "ev0" { 200 } else { 50 };
                assert_eq!(packet, common::packet(packet.sequence, bytes), "flipped at {at}");
            }
        }
    }
}

#[test]
fn reading_can_start_at_any_time() {
    let bytes = common::small_session();
    let all = common::entries(&bytes);
    let mut session = open(&bytes).unwrap();
    for from in [i64::MIN, START_NS - 1, START_NS + 55_000_000, START_NS + 110_000_000, START_NS + 111_000_000] {
        let time = |entry: &Entry| match entry {
            Entry::Packet { packet, .. } => packet.host_ns,
            Entry::DecoderState(state) => state.host_ns,
            Entry::Status(status) => status.host_ns,
            Entry::Incident(incident) => incident.host_ns,
            Entry::Clock { .. } => i64::MIN,
        };
        let found: Vec<Entry> = session.messages(Some(from)).map(Result::unwrap).collect();
        let clocks = |entry: &&Entry| !matches!(entry, Entry::Clock { .. });
        let expected: Vec<&Entry> = all.iter().filter(|entry| time(entry) >= from).collect();
        assert_eq!(
            found.iter().filter(clocks).collect::<Vec<_>>(),
            expected.into_iter().filter(clocks).collect::<Vec<_>>()
        );
    }
}

#[test]
fn files_that_are_something_else_are_told_apart() {
    assert!(matches!(open(b""), Err(ContainerError::Empty { .. })));
    assert!(matches!(open(b"% evt 3.0\n% end\n0123456789"), Err(ContainerError::NotMcap { .. })));
    let mut foreign = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut foreign)).unwrap();
    let channel = writer.add_channel(0, "/chatter", "json", &Default::default()).unwrap();
    let header = mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
    drop(writer);
    assert!(matches!(open(&foreign), Err(ContainerError::NotASession { .. })));
}

#[test]
fn a_session_of_a_newer_program_is_refused_with_its_version() {
    let mut bytes = common::small_session();
    let at = bytes.windows(12).position(|window| window == b"version\x01\x00\x00\x001").unwrap();
    bytes[at + 11] = b'9';
    let error = open(&bytes).err().unwrap();
    assert!(matches!(&error, ContainerError::Version { version, known: 1, .. } if version == "9"), "{error}");
}

#[test]
fn decoding_from_a_time_on_gives_the_same_events_as_from_the_beginning() {
    use erfgs_events::{Columns, Decoder, StreamDecoder};
    use erfgs_session::container::Settings;

    let settings = Settings { chunk_bytes: 30_000, ..Settings::default() };
    let (mut writer, stream, _) = common::writer(settings);
    let mut decoder = StreamDecoder::new(EventEncoding::Evt3, None);
    let mut before = Columns::default();
    let mut events_before = Vec::new();
    for packet in common::event_packets() {
        events_before.push((packet.host_ns, before.len()));
        decoder.decode(&packet.payload, &mut before);
        writer.packet(stream, &packet).unwrap();
    }
    decoder.finish(&mut before);
    let bytes = writer.finish().unwrap().sink;
    let states = common::entries(&bytes).iter().filter(|entry| matches!(entry, Entry::DecoderState(_))).count();
    assert!((20..45).contains(&states), "{states}");
    let mut session = open(&bytes).unwrap();
    for &(from, skipped) in events_before.iter().step_by(97) {
        let mut after = Columns::default();
        let decoded = session.decode_events(0, Some([from, i64::MAX]), &mut after, |_| {}).unwrap().unwrap();
        let expected = before.len() - skipped;
        assert_eq!(after.len(), expected, "from {from}");
        let differ =
            std::iter::zip(after.iter(), before.iter().skip(skipped)).find(|(found, expected)| found != expected);
        assert_eq!(differ, None, "from {from}");
        let all = events_before.len() as u64;
        assert!(decoded.packets < all || from < START_NS + 3_000_000_000, "it starts at a state");
    }
}

#[test]
fn packets_of_a_stream_that_the_index_lost_are_told_as_damage() {
    let mut bytes = common::small_session();
    // Over the records, each an opcode and a length, to the channels (opcode 4) of the index behind the data's end (15).
    let (mut at, mut behind, mut renamed) = (8, false, 0);
    while at + 9 <= bytes.len() - 8 {
        behind |= bytes[at] == 15;
        let end = at + 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        for name in at..if behind && bytes[at] == 4 { end - 3 } else { at } {
            // The stream has another name and number in the index than in the chunks.
            if &bytes[name..name + 4] == b"cam0" {
                (bytes[name + 3], bytes[at + 9]) = (b'9', 0x40);
                renamed += 1;
            }
        }
        at = end;
    }
    assert!(renamed > 0, "the index declares the camera");
    // Without a checksum, which is the last thing in the footer, nobody notices.
    let checksum = bytes.len() - 12;
    bytes[checksum..checksum + 4].fill(0);
    let mut session = open(&bytes).unwrap();
    let streams = session.summary().streams.len();
    let (known, lost): (Vec<_>, Vec<_>) = session.messages(None).partition(Result::is_ok);
    assert!(known.iter().flatten().all(|e| !matches!(e, Entry::Packet { stream, .. } if *stream >= streams)));
    assert_eq!((streams, lost.len()), (2, 12));
    let message = lost[0].as_ref().unwrap_err().to_string();
    assert!(message.contains("erfgs recover") && message.contains("does not know"), "{message}");
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(300))]

    #[test]
    fn bytes_changed_cut_and_moved_about_give_errors_and_no_panic(
        changes in proptest::collection::vec((0_usize..12_000, 0_usize..12_000, 0_usize..40, 0_u8..4), 1..8),
    ) {
        let mut bytes = common::small_session();
        for (at, from, length, kind) in changes {
            let (at, from) = (at % bytes.len(), from % bytes.len());
            let length = length.min(bytes.len() - at.max(from));
            match kind {
                0 => bytes.copy_within(from..from + length, at),
                1 => bytes[at..at + length].fill(0xFF),
                2 => drop(bytes.drain(at..at + length)),
                _ => bytes[at] ^= length as u8,
            }
        }
        if let Ok(mut session) = open(&bytes) {
            for from in [None, Some(START_NS + 50_000_000)] {
                assert!(session.messages(from).count() < 10_000);
            }
        }
    }
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(40))]
    #[test]
    fn a_stream_whose_size_no_sensor_has_is_told_and_never_read(
        good in proptest::array::uniform2(1_u32..8192),
        bad in proptest::array::uniform2(13_000..=u32::MAX),
    ) {
        let session = |[width, height]: [u32; 2]| {
            let (mut writer, ..) = common::writer(Settings::default());
            let encoding = Encoding::Events(EventEncoding::Evt3);
            let late = writer.add_stream(&Description { width, height, ..common::description("late", encoding) }).unwrap();
            writer.packet(late, &common::packet(0, 10)).unwrap();
            writer.finish().unwrap().sink
        };
        let bytes = session(good);
        let read = open(&bytes).unwrap();
        proptest::prop_assert!(read.summary().streams.iter().any(|stream| stream.description.id == "late"));
        let bytes = session(bad);
        let message = match open(&bytes) {
            Ok(read) => {
                let ids: Vec<&str> = read.summary().streams.iter().map(|stream| stream.description.id.as_str()).collect();
                proptest::prop_assert!(!ids.contains(&"late"), "{:?}", ids);
                read.summary().damage.join("; ")
            }
            Err(error) => error.to_string(),
        };
        proptest::prop_assert!(message.contains("late") && message.contains("plausible"), "{}", message);
    }
}
