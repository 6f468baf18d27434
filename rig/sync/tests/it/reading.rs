//! Recordings read with times of the session clock: spans, slices and frames agree with the whole and with the truth.

use std::path::{Path, PathBuf};

use erfgs_events::{CSV_HEADER, Event, EventEncoding, EventFileHints};
use erfgs_scene::pixel::PixelFormat;
use erfgs_session::{
    container::{SessionStart, SessionWriter, Settings},
    source::{Encoding, Packet},
};
use erfgs_sync::reading::{ALWAYS_NS, Depth, EventClock, FrameLook, Samples, SliceOptions, TimedFrame, TimedRecording};

use crate::breaks::support::{MS, START_NS, board, camera, description, part};

const EVT3: Encoding = Encoding::Events(EventEncoding::Evt3);
/// Frames are triggered by the pulses of the board.
const PERIOD_NS: i64 = 1_000_000_000 / 30;
const SIZE: [u32; 2] = [8, 4];

fn open(path: &Path) -> TimedRecording {
    TimedRecording::open(path, &EventFileHints::default()).unwrap()
}

/// One frame for each pulse, of the level of its number, that arrives 11 ms after the middle of its exposure; number 7 is cut.
fn frames(count: u64) -> Vec<Packet> {
    let frame = |n: u64| {
        let mid = 500 * MS + n as i64 * PERIOD_NS + 2 * MS;
        let pixels = SIZE[0] * SIZE[1] - u32::from(n == 7);
        let payload = vec![n as u8; pixels as usize].into();
        Packet {
            sequence: n,
            host_ns: START_NS + mid + 11 * MS,
            discontinuity: false,
            damaged: false,
            stamp: None,
            payload,
        }
    };
    (0..count).map(frame).collect()
}

/// An event camera, a frame camera and a board over 8 s; the events' true times.
fn session(folder: &Path, encoding: Encoding) -> (PathBuf, Vec<i64>) {
    let path = folder.join("take.mcap");
    let (mut events, truth) = camera(encoding, &[part(0, 8, -3_000 * MS, 20.0)], true);
    // Packets of a stream arrive in their order.
    let mut last = i64::MIN;
    for packet in &mut events {
        last = packet.host_ns.max(last);
        packet.host_ns = last;
    }
    let start = SessionStart { host_ns: START_NS, ..SessionStart::default() };
    let mut writer = SessionWriter::create(&path, start, "", Settings::default()).unwrap();
    let eye = writer.add_stream(&description("eye", encoding, [1280, 720])).unwrap();
    let mut seeing = description("rgb", PixelFormat::Grey8.into(), SIZE);
    seeing.settings = serde_json::from_str(r#"{"triggered": true, "exposure_us": 4000}"#).unwrap();
    let rgb = writer.add_stream(&seeing).unwrap();
    let lines = writer.add_stream(&description("board", Encoding::TriggerLines, [0, 0])).unwrap();
    let tagged = |stream, packets: Vec<Packet>| packets.into_iter().map(move |packet| (stream, packet));
    let mut all: Vec<_> = tagged(eye, events).chain(tagged(rgb, frames(200))).chain(tagged(lines, board(8))).collect();
    all.sort_by_key(|(_, packet)| packet.host_ns);
    all.iter().for_each(|(stream, packet)| writer.packet(*stream, packet).unwrap());
    writer.finish().unwrap();
    (path, truth)
}

fn slices(recording: &mut TimedRecording, length_ns: i64, span_ns: [i64; 2]) -> (Vec<Event>, Vec<TimedFrame>) {
    let options = SliceOptions { length_ns, streams: None, span_ns, look: FrameLook::default() };
    let (mut events, mut frames, mut at_ns) = (Vec::new(), Vec::new(), span_ns[0]);
    let mut slices = recording.slices(&options).unwrap();
    for slice in slices.by_ref() {
        let slice = slice.unwrap();
        assert_eq!(slice.span_ns[0], at_ns, "one begins where the last ended");
        at_ns = slice.span_ns[1];
        for part in slice.parts {
            let within_us = slice.span_ns[0].div_euclid(1000)..(slice.span_ns[1] + 999) / 1000;
            assert!(part.events.iter().all(|event| within_us.contains(&event.t_us)), "{}", part.id);
            assert!(
                part.frames.iter().all(|frame| (slice.span_ns[0]..slice.span_ns[1]).contains(&frame.exposure.mid_ns))
            );
            events.extend(part.events.iter());
            frames.extend(part.frames);
        }
    }
    assert_eq!(at_ns, span_ns[1]);
    assert!(
        slices.take_damage().iter().all(|message| message.contains("1 frames of stream 'rgb'")),
        "nothing came too late"
    );
    (events, frames)
}

#[test]
fn spans_and_slices_hold_what_the_whole_holds_there_and_that_is_when_it_was() {
    for encoding in [EVT3, Encoding::Events(EventEncoding::Davis)] {
        let folder = tempfile::tempdir().unwrap();
        let (path, truth) = session(folder.path(), encoding);
        let mut recording = open(&path);
        let all = recording.events("eye", ALWAYS_NS, EventClock::Session).unwrap();
        assert!(all.damage.is_empty(), "{:?}", all.damage);
        let all: Vec<Event> = all.rows.iter().collect();
        assert_eq!(all.len(), truth.len());
        let off = std::iter::zip(&all, &truth).map(|(event, truth)| (event.t_us - truth / 1000).abs()).max();
        assert!(off <= Some(60), "{off:?} µs off: the camera's ticks and the board's offset");
        let device = recording.events("eye", ALWAYS_NS, EventClock::Device).unwrap().rows;
        assert!(device.iter().zip(&all).all(|(device, event)| device.t_us > event.t_us + 2_900_000));
        // At the beginning, before any state, where there is one, across chunks, at the end, and beyond.
        for span_us in
            [[0, 300_000], [900_000, 1_400_000], [5_000_001, 5_000_900], [3_000_000, 90_000_000], [-9, -5], [7, 7]]
        {
            let within = |event: &&Event| (span_us[0]..span_us[1]).contains(&event.t_us);
            let expected: Vec<Event> = all.iter().filter(within).copied().collect();
            let span_ns = span_us.map(|t_us| 1000 * t_us);
            let found = recording.events("eye", span_ns, EventClock::Session).unwrap().rows;
            assert!(
                found.iter().eq(expected.iter().copied()),
                "{encoding} {span_us:?}: {} of {}",
                found.len(),
                expected.len()
            );
            let device = recording.events("eye", span_ns, EventClock::Device).unwrap().rows;
            assert_eq!(device.len(), expected.len());
            if span_us[0] >= 0 && span_us[1] <= 8_000_000 {
                assert!(slices(&mut recording, 7 * MS, span_ns).0 == expected, "{encoding} {span_us:?}");
            }
        }
    }
}

#[test]
fn frames_come_with_their_exposures_and_those_that_are_cut_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = session(folder.path(), EVT3);
    let mut recording = open(&path);
    let mut reader = recording.frames("rgb", ALWAYS_NS, FrameLook::default()).unwrap();
    let all: Vec<TimedFrame> = reader.by_ref().map(Result::unwrap).collect();
    let damage = reader.take_damage();
    assert!(
        matches!(&damage[..], [one] if one.contains("1 frames of stream 'rgb'") && one.contains("cut")),
        "{damage:?}"
    );
    assert_eq!(all.len(), 199);
    for frame in &all {
        let truth = 500 * MS + frame.sequence as i64 * PERIOD_NS + 2 * MS;
        assert!((frame.exposure.mid_ns - truth).abs() < 60_000, "{} ns off", frame.exposure.mid_ns - truth);
        let [start, end] = frame.exposure.span_ns();
        assert_eq!((start.midpoint(end), end - start), (frame.exposure.mid_ns, 4 * MS));
        let picture = &frame.picture;
        assert_eq!(([picture.width, picture.height], picture.channels), (SIZE, 1));
        assert_eq!(picture.samples, Samples::Bits8(vec![frame.sequence as u8; 32]));
    }
    let span = [all[20].exposure.mid_ns, all[25].exposure.mid_ns];
    let found: Vec<TimedFrame> =
        recording.frames("rgb", span, FrameLook::default()).unwrap().map(Result::unwrap).collect();
    assert_eq!(found, all[20..25]);
    assert_eq!(slices(&mut recording, 10 * MS, span).1, all[20..25]);
    assert_eq!(slices(&mut recording, 10 * MS, [0, 8_000 * MS]).1, all, "whatever arrives when");
    let deep = FrameLook { depth: Depth::Bits16, bits: None };
    let deep = recording.frames("rgb", span, deep).unwrap().next().unwrap().unwrap();
    let level = 257 * all[20].sequence as u16;
    assert_eq!(deep.picture.samples, Samples::Bits16(vec![level; 32]));
    let of_camera = FrameLook { depth: Depth::OfCamera, bits: None };
    let shallow = recording.frames("rgb", span, of_camera).unwrap().next().unwrap().unwrap();
    assert!(matches!(shallow.picture.samples, Samples::Bits8(_)) && shallow.jpeg.is_none());
}

#[test]
fn an_event_file_has_its_own_clock_which_begins_with_its_first_event() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    let times: Vec<u64> = (0..20_000).map(|n| 5_000_000 + n * 173).collect();
    let lines = times.iter().map(|t| format!("{t},{},{},1\n", t % 64, t % 48));
    std::fs::write(&path, String::from_utf8_lossy(CSV_HEADER).into_owned() + &lines.collect::<String>()).unwrap();
    let mut recording = open(&path);
    assert!(recording.synchronisation().unwrap().is_none());
    let device = recording.events("a", ALWAYS_NS, EventClock::Device).unwrap().rows;
    assert!(device.iter().zip(&times).all(|(event, &t)| event.t_us == t as i64) && device.len() == times.len());
    let all: Vec<Event> = recording.events("a", ALWAYS_NS, EventClock::Session).unwrap().rows.iter().collect();
    assert_eq!((all[0].t_us, all[19_999].t_us), (0, 19_999 * 173));
    let span = [1_000 * MS, 1_500 * MS];
    let within: Vec<Event> = all.iter().filter(|event| (1_000_000..1_500_000).contains(&event.t_us)).copied().collect();
    let found = recording.events("a", span, EventClock::Session).unwrap().rows;
    assert!(found.iter().eq(within.iter().copied()), "{} of {}", found.len(), within.len());
    assert!(slices(&mut recording, 3 * MS, span).0 == within);
    let whole = recording.span_ns();
    assert!(slices(&mut recording, 100 * MS, whole).0 == all, "the last event, too");
}

#[test]
fn what_a_stream_does_not_hold_is_refused_with_the_stream() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = session(folder.path(), EVT3);
    let mut recording = open(&path);
    let of = |id: &str| SliceOptions {
        length_ns: MS,
        streams: Some(vec![id.into()]),
        span_ns: [0, MS],
        look: FrameLook::default(),
    };
    let mut messages = vec![
        recording.events("rgb", ALWAYS_NS, EventClock::Session).unwrap_err().to_string(),
        recording.frames("eye", ALWAYS_NS, FrameLook::default()).err().unwrap().to_string(),
        recording.slices(&of("board")).err().unwrap().to_string(),
        recording.slices(&of("nobody")).err().unwrap().to_string(),
    ];
    messages.push(recording.slices(&SliceOptions { length_ns: 0, ..of("eye") }).err().unwrap().to_string());
    let wanted = ["'rgb' of", "'eye' of", "'board' of", "eye, rgb, board", "above 0"];
    for (message, wanted) in messages.iter().zip(wanted) {
        assert!(message.contains(wanted), "{message}");
    }
}
