//! A session in several files is read as the one that it is.

use std::{
    fs::{self, File},
    path::{Path, PathBuf},
};

use erfgs_events::{CdEvent, Columns, EventEncoding};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    Session, SessionWriter,
    container::{
        ContainerError, Entry, Recording, SessionId, Settings, Split, Status, StreamId, Totals, part_path,
        recover_in_place, write_excerpt,
    },
    source::{Encoding, Incident, Packet},
};
use proptest::prelude::*;

use crate::common::{self, START_NS, plain};

const ID: SessionId = SessionId([7; 16]);

/// A session that is written in one file, or goes on in others by `split`.
struct Take {
    first: PathBuf,
    writer: SessionWriter<File>,
    split: Option<Split>,
    streams: [StreamId; 2],
}

impl Take {
    fn new(first: &Path, split: Option<Split>, id: SessionId) -> Self {
        let settings = Settings { chunk_bytes: 30_000, ..Settings::default() };
        let file = File::create_new(first).unwrap();
        let mut writer = match split {
            Some(_) => SessionWriter::in_parts(file, first, common::start(), "name = \"rig\"\n", settings, id),
            None => SessionWriter::new(file, first, common::start(), "name = \"rig\"\n", settings),
        }
        .unwrap();
        let mut add = |id, encoding| writer.add_stream(&common::description(id, encoding)).unwrap();
        let streams =
            [add("ev0", Encoding::Events(EventEncoding::Evt3)), add("cam0", Encoding::Frames(PixelFormat::Mjpeg))];
        Self { first: first.to_owned(), writer, split, streams }
    }

    fn packet(&mut self, stream: usize, packet: &Packet) {
        if self.split.is_some_and(|split| self.writer.is_full(split, packet)) {
            self.change();
        }
        self.writer.packet(self.streams[stream], packet).unwrap();
    }

    fn change(&mut self) {
        let path = part_path(&self.first, self.writer.part_number() + 1);
        let next = self.writer.next_part(File::create_new(&path).unwrap(), &path).unwrap();
        self.writer.change_to(next).unwrap();
    }

    /// Ends it; how many files there are.
    fn finish(self) -> u32 {
        let files = self.writer.part_number() + 1;
        self.writer.finish().unwrap();
        files
    }
}

/// Events, with frames and all else beside.
fn fill(take: &mut Take) {
    for packet in common::event_packets() {
        let Packet { sequence, host_ns, .. } = packet;
        take.packet(0, &packet);
        if sequence.is_multiple_of(10) {
            take.packet(1, &plain(sequence / 10, host_ns + 5, vec![sequence as u8; 700]));
        }
        if sequence.is_multiple_of(97) {
            let [events, frames] = take.streams;
            take.writer.status(&Status { host_ns, written_bytes: sequence, ..Status::default() }).unwrap();
            take.writer.clock(events, host_ns, &common::fit(sequence as i64)).unwrap();
            let changed = serde_json::json!({ "bias_fo": sequence, "region": { "x": 3 } }).as_object().unwrap().clone();
            take.writer.incident(Some(frames), host_ns, &Incident::Adjusted { changed }).unwrap();
        }
    }
}

/// The same session whole and in parts; how many these are.
fn whole_and_in_parts(folder: &Path, split: Split) -> (PathBuf, PathBuf, u32) {
    let [whole, parts] = ["whole.mcap", "take.mcap"].map(|name| folder.join(name));
    let mut files = 0;
    for (path, split) in [(&whole, None), (&parts, Some(split))] {
        let mut take = Take::new(path, split, ID);
        fill(&mut take);
        files = take.finish();
    }
    (whole, parts, files)
}

/// Everything but the states of decoders, which lie where files begin, too.
fn entries(session: &mut Session) -> Vec<Entry> {
    let entries = session.messages(None).map(|entry| entry.unwrap());
    entries.filter(|entry| !matches!(entry, Entry::DecoderState(_))).collect()
}

fn events(session: &mut Session, window: Option<[i64; 2]>) -> Vec<CdEvent> {
    let mut events = Columns::default();
    let decoded = session.decode_events(0, window, &mut events, |_| {}).unwrap().unwrap();
    assert_eq!(decoded.damage, [""; 0]);
    events.iter().collect()
}

fn refused(path: &Path) -> ContainerError {
    Session::open(path).err().expect("the session is refused")
}

#[test]
fn what_was_recorded_in_parts_is_read_as_what_was_recorded_whole() {
    let folder = tempfile::tempdir().unwrap();
    for (split, some) in [(Split::Time(7_000_000_000), 6), (Split::Bytes(150_000), 6)] {
        let folder = folder.path().join(format!("{some}-{split:?}"));
        fs::create_dir(&folder).unwrap();
        let (whole, parts, files) = whole_and_in_parts(&folder, split);
        assert!(files >= some, "{files}");
        let (mut whole, mut parts) = (Session::open(&whole).unwrap(), Session::open(&parts).unwrap());
        assert_eq!(parts.summary().files.len(), files as usize);
        assert!(parts.summary().complete && parts.summary().faults().is_empty());
        let bytes: u64 = (0..files).map(|part| part_path(parts.path(), part).metadata().unwrap().len()).sum();
        assert_eq!(parts.summary().file_bytes, bytes);
        assert_eq!(parts.summary().streams, whole.summary().streams);
        let totals = |session: &Session| Totals { continues: false, ..session.summary().totals.clone() };
        assert_eq!(totals(&parts), totals(&whole));
        assert_eq!(parts.summary().rig, whole.summary().rig);
        assert_eq!(parts.check(|_| {}).unwrap(), [""; 0]);
        assert!(entries(&mut parts) == entries(&mut whole));
        assert!(entries(&mut parts) == entries(&mut whole), "a second time");
        assert!(events(&mut parts, None) == events(&mut whole, None));
        for tenths in (0..400_i64).step_by(7) {
            let from = START_NS + tenths * 100_000_000;
            let window = Some([from, from + 900_000_000]);
            assert!(events(&mut parts, window) == events(&mut whole, window), "{tenths}");
            let heard = |session: &mut Session| {
                session.restrict(window);
                let packets = session.messages(None).filter(|e| matches!(e, Ok(Entry::Packet { .. }))).count();
                session.restrict(None);
                packets
            };
            assert_eq!(heard(&mut parts), heard(&mut whole), "{tenths}");
        }
    }
}

#[test]
fn each_part_is_a_whole_file_for_any_reader_and_is_decoded_from_its_start() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, first, files) = whole_and_in_parts(folder.path(), Split::Time(7_000_000_000));
    let all = events(&mut Session::open(&whole).unwrap(), None);
    let mut alone = Vec::new();
    let mut packets = 0;
    for part in 0..files {
        let path = part_path(&first, part);
        let bytes = fs::read(&path).unwrap();
        let index = mcap::Summary::read(&bytes).unwrap().unwrap();
        let messages = mcap::MessageStream::new(&bytes).unwrap().filter(|message| message.is_ok()).count();
        assert_eq!(index.stats.unwrap().message_count, messages as u64);
        // A copy, which has no other beside it.
        let copy = folder.path().join(format!("copy-{part}.mcap"));
        fs::copy(&path, &copy).unwrap();
        let mut session = Session::open(&copy).unwrap();
        let summary = session.summary();
        assert!(summary.rig.is_some() && summary.start == common::start());
        packets += summary.streams[0].totals.packets;
        if part > 0 {
            assert!(summary.complete, "{:?}", summary.faults());
            assert_eq!(summary.part.as_ref().map(|part| (part.session, part.number)), Some((ID, part)));
            let first = &summary.totals.incidents[0];
            assert!(first.stream == "cam0" && matches!(first.incident, Incident::Adjusted { .. }), "{first:?}");
            assert_eq!(summary.totals.incident_count as usize, summary.totals.incidents.len());
            assert_eq!(session.check(|_| {}).unwrap(), [""; 0]);
        }
        let events = events(&mut session, None);
        let span = session.summary().span_ns().unwrap();
        let late = self::events(&mut session, Some([span[0] + 500_000_000, span[1]]));
        assert!(events.ends_with(&late) && !late.is_empty());
        alone.extend(events);
    }
    assert_eq!(packets, Session::open(&whole).unwrap().summary().streams[0].totals.packets);
    // A state has the half of a word that the part before ends with.
    assert!(alone == all, "{} events of {}", alone.len(), all.len());
}

#[test]
fn a_recording_that_was_cut_anywhere_is_read_up_to_there_and_repaired_part_by_part() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, first, files) = whole_and_in_parts(folder.path(), Split::Time(9_000_000_000));
    let all = entries(&mut Session::open(&whole).unwrap());
    let kept: Vec<Vec<u8>> = (0..files).map(|part| fs::read(part_path(&first, part)).unwrap()).collect();
    let restore = || (0..files).for_each(|part| fs::write(part_path(&first, part), &kept[part as usize]).unwrap());
    for part in 0..files {
        let path = part_path(&first, part);
        let bytes = &kept[part as usize];
        // Within the first records, with zeros after a power cut (1), within the data, within the index, and without a byte.
        let cuts =
            [0, 1, 7, 8, 9, 100, 600, 3000, bytes.len() / 3, bytes.len() / 2, bytes.len() - 100, bytes.len() - 1];
        for cut in cuts {
            restore();
            ((part + 1)..files).for_each(|later| fs::remove_file(part_path(&first, later)).unwrap());
            fs::write(&path, if cut == 1 { &[0; 5000] } else { &bytes[..cut] }).unwrap();
            let opened = Session::open(&first);
            if part == 0 && cut < 600 {
                // As of a recording in one file, of which nothing is left.
                assert!(opened.is_err() || opened.is_ok_and(|session| !session.summary().complete), "{cut}");
                continue;
            }
            let mut session = opened.unwrap_or_else(|error| panic!("part {part} cut at {cut}: {error}"));
            let summary = session.summary();
            assert!(!summary.complete && !summary.faults().is_empty(), "part {part} cut at {cut}");
            assert!(
                summary.faults()[0].contains(path.file_name().unwrap().to_str().unwrap()),
                "{:?}",
                summary.faults()
            );
            let found = entries(&mut session);
            assert!(all.starts_with(&found), "part {part} cut at {cut}");
            if let Ok(repaired) = recover_in_place(&path) {
                assert!(!repaired.was_whole);
                let mut session = Session::open(&first).unwrap();
                let faults = session.summary().faults();
                // Its end is lost, or says that there is more.
                assert!(faults.iter().all(|fault| fault.contains("missing") && part + 1 < files), "{faults:?}");
                assert!(session.summary().files[part as usize].complete);
                assert!(entries(&mut session) == found && session.check(|_| {}).unwrap().is_empty());
            } else {
                assert!(cut < 3000, "part {part} cut at {cut} can be repaired");
            }
        }
    }
    // What is whole to its end, and goes on in a file that is not there.
    restore();
    fs::remove_file(part_path(&first, files - 1)).unwrap();
    let mut session = Session::open(&first).unwrap();
    let faults = session.summary().faults();
    assert!(!session.summary().complete && faults.len() == 1 && faults[0].contains("missing"), "{faults:?}");
    let found = entries(&mut session);
    assert!(all.starts_with(&found) && found.len() > all.len() / 2);
}

#[test]
fn a_part_that_is_cut_in_the_middle_costs_its_end_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, first, _) = whole_and_in_parts(folder.path(), Split::Time(9_000_000_000));
    let second = part_path(&first, 1);
    let bytes = fs::read(&second).unwrap();
    fs::write(&second, &bytes[..bytes.len() / 2]).unwrap();
    let mut session = Session::open(&first).unwrap();
    let faults = session.summary().faults();
    assert!(!session.summary().complete && faults.len() == 1 && faults[0].contains("take.001.mcap"), "{faults:?}");
    let missing = session.summary().streams[0].totals.missing;
    let all = entries(&mut Session::open(&whole).unwrap());
    let found = entries(&mut session);
    assert!(missing > 100 && found.len() < all.len() && found.last() == all.last(), "{missing}");
    recover_in_place(&second).unwrap();
    let session = Session::open(&first).unwrap();
    assert!(session.summary().complete && session.summary().streams[0].totals.missing == missing);
}

#[test]
fn parts_that_lack_or_belong_elsewhere_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, first, files) = whole_and_in_parts(folder.path(), Split::Time(9_000_000_000));
    let [one, two, last] = [1, 2, files - 1].map(|part| part_path(&first, part));
    let aside = folder.path().join("aside");
    fs::create_dir(&aside).unwrap();

    fs::rename(&one, aside.join("one")).unwrap();
    let error = refused(&first);
    assert!(matches!(&error, ContainerError::MissingPart { path, later } if *path == one && *later == two), "{error}");
    assert!(error.to_string().contains("move it beside the others"));

    // In the wrong order.
    fs::rename(&two, &one).unwrap();
    fs::rename(aside.join("one"), &two).unwrap();
    let error = refused(&first);
    assert!(matches!(&error, ContainerError::ForeignPart { path, .. } if *path == one), "{error}");
    assert!(error.to_string().contains("number 2"), "{error}");
    fs::rename(&one, aside.join("two")).unwrap();
    fs::rename(&two, &one).unwrap();
    fs::rename(aside.join("two"), &two).unwrap();
    assert!(Session::open(&first).unwrap().summary().complete);

    // Of another session, a session of its own, another recording, no recording.
    let other = aside.join("take.mcap");
    let mut take = Take::new(&other, Some(Split::Time(1)), SessionId([8; 16]));
    take.packet(0, &plain(0, START_NS, vec![0; 4]));
    take.packet(0, &plain(1, START_NS + 1, vec![0; 4]));
    take.finish();
    let behind = part_path(&first, files);
    let with = |bytes: Vec<u8>, what: &str| {
        for path in [&one, &last, &behind] {
            let before = fs::read(path).ok();
            fs::write(path, &bytes).unwrap();
            let error = refused(&first);
            assert!(matches!(&error, ContainerError::ForeignPart { path: of, .. } if of == path), "{what}: {error}");
            assert!(error.to_string().contains(what), "{error}");
            match before {
                Some(before) => fs::write(path, before).unwrap(),
                None => fs::remove_file(path).unwrap(),
            }
        }
    };
    with(fs::read(part_path(&other, 1)).unwrap(), "another session");
    with(fs::read(&whole).unwrap(), "recording of its own");
    with(fs::read(&first).unwrap(), "number 0");
    with(common::ros_recording("evt3"), "recording of its own");
    with(b"these are no records".to_vec(), "not an MCAP file");
    let cut = fs::read(part_path(&other, 1)).unwrap();
    with(cut[..cut.len() / 2].to_vec(), "another session");
    // In the middle what holds nothing is as good as missing.
    let before = fs::read(&one).unwrap();
    fs::write(&one, b"").unwrap();
    assert!(
        matches!(refused(&first), ContainerError::ForeignPart { path, what, .. } if path == one && what.contains("nothing"))
    );
    fs::write(&one, before).unwrap();
    assert!(Session::open(&first).unwrap().summary().complete);

    // What is no part of anything is nobody's.
    fs::copy(&last, part_path(&whole, 1)).unwrap();
    let session = Session::open(&whole).unwrap();
    assert!(session.summary().complete && session.summary().files.is_empty());
}

#[test]
fn a_stream_that_is_another_in_a_later_part_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("take.mcap");
    let mut take = Take::new(&first, Some(Split::Time(1)), ID);
    take.packet(0, &plain(0, START_NS, vec![0; 4]));
    take.packet(0, &plain(1, START_NS + 1, vec![0; 4]));
    take.finish();
    let second = part_path(&first, 1);
    let bytes = fs::read(&second).unwrap();
    let mut changed = bytes.clone();
    let places: Vec<usize> = (0..bytes.len() - 12).filter(|&at| &bytes[at..at + 12] == b"\"width\":1280").collect();
    places.into_iter().for_each(|at| changed[at + 8..at + 12].copy_from_slice(b"1281"));
    // Its index alone is read, which has no checksum then.
    let checksum = changed.len() - 12;
    changed[checksum..checksum + 4].fill(0);
    fs::write(&second, changed).unwrap();
    let error = refused(&first);
    assert!(matches!(&error, ContainerError::ForeignPart { .. }) && error.to_string().contains("'ev0'"), "{error}");
}

#[test]
fn streams_that_are_added_later_and_ranges_over_a_seam_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("take.mcap");
    let mut take = Take::new(&first, Some(Split::Time(50_000_000)), ID);
    for sequence in 0..8 {
        take.packet(1, &plain(sequence, START_NS + sequence as i64 * 10_000_000, vec![sequence as u8; 100]));
    }
    let late = common::description("late", Encoding::Frames(PixelFormat::Grey8));
    take.streams[0] = take.writer.add_stream(&late).unwrap();
    for sequence in 8..12 {
        let host_ns = START_NS + sequence as i64 * 10_000_000;
        take.packet(1, &plain(sequence, host_ns, vec![sequence as u8; 100]));
        take.packet(0, &plain(sequence, host_ns, vec![1; 10]));
    }
    assert_eq!(take.finish(), 3);
    let mut session = Session::open(&first).unwrap();
    let (late, stream) = session.stream("late").unwrap();
    assert_eq!((late, stream.totals.packets), (2, 4));
    let of_late = |entry: &Entry| matches!(entry, Entry::Packet { stream: 2, packet } if packet.payload.len() == 10);
    assert_eq!(entries(&mut session).iter().filter(|entry| of_late(entry)).count(), 4);

    let out = folder.path().join("range.mcap");
    let mut recording = Recording::open(&first, None).unwrap();
    let mut damage = Vec::new();
    let totals = write_excerpt(&mut recording, [30_000_000, 90_000_000], None, &out, &mut damage, |_| {}).unwrap();
    assert_eq!((totals.streams["cam0"].packets, totals.streams["late"].packets, damage.len()), (7, 2, 0));
}

#[test]
fn one_that_was_not_begun_in_parts_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut take = Take::new(&path, None, ID);
    take.packet(0, &plain(0, START_NS, vec![0; 4]));
    assert!(!take.writer.is_full(Split::Bytes(1), &plain(1, START_NS, vec![0; 4])));
    let next = take.writer.next_part(File::create_new(part_path(&path, 1)).unwrap(), &part_path(&path, 1));
    assert!(matches!(next.err(), Some(ContainerError::NotInParts { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn no_part_is_longer_than_it_may_be_and_nothing_is_lost_between_them(
        limit in 60_000_u64..400_000,
        packets in proptest::collection::vec((0_usize..2, 0_usize..20_000, 0_i64..80_000_000, 0_u8..20), 1..200),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let first = folder.path().join("take.mcap");
        let mut take = Take::new(&first, Some(Split::Bytes(limit)), ID);
        let (mut host_ns, mut written) = (START_NS, Vec::new());
        for (number, (stream, bytes, later_ns, note)) in packets.into_iter().enumerate() {
            host_ns += later_ns;
            let packet = plain(number as u64, host_ns, vec![number as u8; bytes]);
            take.packet(stream, &packet);
            written.push((stream, packet));
            match note {
                0 => take.writer.flush().unwrap(),
                1 => take.writer.incident(None, host_ns, &Incident::Warning { message: "x".repeat(200) }).unwrap(),
                _ => {}
            }
        }
        let files = take.finish();
        for part in 0..files {
            let bytes = part_path(&first, part).metadata().unwrap().len();
            prop_assert!(bytes <= limit, "part {} of {} has {} bytes of {}", part, files, bytes, limit);
        }
        let mut session = Session::open(&first).unwrap();
        prop_assert!(session.summary().complete && session.summary().files.len() == files as usize);
        let read: Vec<(usize, Packet)> = session
            .messages(None)
            .filter_map(|entry| match entry.unwrap() {
                Entry::Packet { stream, packet } => Some((stream, packet)),
                _ => None,
            })
            .collect();
        prop_assert!(read == written);
        // Filled, not one packet a file.
        let all: u64 = (0..files).map(|part| part_path(&first, part).metadata().unwrap().len()).sum();
        prop_assert!(u64::from(files) <= 1 + 2 * all / (limit - 50_000), "{} files of {} for {}", files, limit, all);
    }
}
