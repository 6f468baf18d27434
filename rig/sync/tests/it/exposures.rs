//! A camera that exposes while its trigger is high, on a board whose pulses are not all of one width.

use std::path::Path;

use erfgs_dataset::import::session::{SessionNote, SessionOptions, import_recording};
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose, pixel::PixelFormat, rig_file::RigCamera, rig_file::RigFile};
use erfgs_session::{
    container::{Session, SessionStart, SessionWriter, Settings},
    source::{Description, Encoding, FrameStamp, Packet, StampClock, StampPoint},
    trigger::protocol::{Command, line},
};
use erfgs_sync::{SyncNote, Synchronisation, Tier, of_session};

const START_NS: i64 = 40_000_000_000_000;
const MS: i64 = 1_000_000;
const PERIOD_NS: i64 = 1_000_000_000 / 30;
const PULSES: i64 = 120;

fn rise_ns(index: i64) -> i64 {
    500 * MS + index * PERIOD_NS
}

fn width_ns(index: i64, widths_ms: [i64; 2]) -> i64 {
    widths_ms[(index % 2) as usize] * MS
}

/// Packets with the stream that each is of.
fn packets(widths_ms: [i64; 2]) -> Vec<(usize, Packet)> {
    let ticks = |ns: i64| (ns as f64 / 62.5).round() as u64;
    let mut packets: Vec<(usize, i64, Option<i64>, Vec<u8>)> = Vec::new();
    for index in 0..PULSES {
        let (rise, width) = (rise_ns(index), width_ns(index, widths_ms));
        let bytes = line(&format!("p {index:x} {:x} {:x}", ticks(rise), ticks(width)));
        packets.push((0, rise + bytes.len() as i64 * 20_000 + 60_000, None, bytes));
        // The transfer begins after the exposure, by up to half a millisecond late.
        let stamp = rise + width + 300_000 + index * 7919 % 200_000;
        packets.push((1, stamp + 4 * MS, Some(stamp), vec![90; 256]));
    }
    for second in 0..PULSES / 30 {
        let sent = second * 1000 * MS + 310 * MS;
        let token = (START_NS + sent).cast_unsigned();
        let received = sent + Command::Clock(token).encode().len() as i64 * 20_000 + 60_000;
        let bytes = line(&format!("+clock {token:x} {:x}", ticks(received)));
        packets.push((0, received + bytes.len() as i64 * 20_000 + 60_000, None, bytes));
    }
    packets.sort();
    let mut counts = [0_u64; 2];
    let numbered = packets.into_iter().map(|(stream, arrival, stamp, payload)| {
        let sequence = counts[stream];
        counts[stream] += 1;
        let stamp = stamp.map(|stamp| FrameStamp {
            kernel_ns: START_NS + stamp,
            clock: StampClock::Monotonic,
            point: StampPoint::EndOfFrame,
            sequence: sequence as u32,
        });
        let (host_ns, payload) = (START_NS + arrival, payload.into());
        (stream, Packet { sequence, host_ns, discontinuity: false, damaged: false, stamp, payload })
    });
    numbered.collect()
}

/// `settings` are those of the camera.
fn write(path: &Path, widths_ms: [i64; 2], settings: &serde_json::Value) {
    let start = SessionStart { host_ns: START_NS, ..SessionStart::default() };
    let mut writer = SessionWriter::create(path, start, "", Settings::default()).unwrap();
    let description = |id: &str, encoding, side, settings: &serde_json::Value| Description {
        id: id.into(),
        model: "simulated".into(),
        serial: String::new(),
        encoding,
        width: side,
        height: side,
        start_order: 0,
        settings: settings.as_object().unwrap().clone(),
    };
    let streams = [
        description("board", Encoding::TriggerLines, 0, &serde_json::json!({})),
        description("camera", Encoding::Frames(PixelFormat::Grey8), 16, settings),
    ]
    .map(|description| writer.add_stream(&description).unwrap());
    packets(widths_ms).iter().for_each(|(stream, packet)| writer.packet(streams[*stream], packet).unwrap());
    writer.finish().unwrap();
}

fn rig() -> RigFile {
    let (f, c) = (20.0, 8.0);
    let intrinsics = Intrinsics { width: 16, height: 16, fx: f, fy: f, cx: c, cy: c, distortion: Distortion::None };
    let camera = |name| RigCamera::new(name, Modality::Rgb, intrinsics, Some(Pose::IDENTITY));
    RigFile::new("test", true, vec![camera("camera"), camera("another")])
}

/// The synchronisation of a session, and what was noted.
fn of(path: &Path) -> (Synchronisation, Vec<SyncNote>) {
    let mut notes = Vec::new();
    let mut session = Session::open(path).unwrap();
    let sync = of_session(&mut session, &mut |note| notes.push(note), |_, _| {}).unwrap();
    (sync, notes)
}

#[test]
fn each_frame_is_exposed_as_long_as_its_own_pulse() {
    // The second pair differ by nearly a frame's time: each frame must find its own pulse all the same.
    for widths_ms in [[2, 6], [1, 28]] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.mcap");
        write(&path, widths_ms, &serde_json::json!({ "triggered": true }));
        let (sync, _) = of(&path);
        let camera = sync.stream("camera").unwrap();
        assert_eq!(camera.tier, Tier::HardwareTriggered, "{:?}", camera.notes);
        let exposures = camera.exposures.as_ref().unwrap();
        assert_eq!(exposures.pulse, (0..PULSES.cast_unsigned()).collect::<Vec<_>>(), "{widths_ms:?}");
        // Stamps are late by 0.2 ms more or less, whatever the exposure.
        assert!(exposures.residuals.max_ns < 250_000.0, "{:?}", exposures.residuals);
        assert!(camera.points.iter().all(|(_, off_ns)| off_ns.abs() < 250_000.0), "{:?}", camera.points);

        // From the file, too.
        sync.save(&Synchronisation::file_beside(&path)).unwrap();
        let (kept, notes) = of(&path);
        assert_eq!(kept.stream("camera").unwrap().exposures, camera.exposures);
        assert_eq!(notes, []);
        let mut session = Session::open(&path).unwrap();
        let (out, mut notes) = (folder.path().join("ds"), Vec::new());
        let options = SessionOptions::default();
        let dataset =
            import_recording(&mut session, &kept, &rig(), &options, &out, &mut |note| notes.push(note), &mut |_| {});
        let frames = &dataset.unwrap().manifest.cameras[0].frames;
        assert_eq!(frames.len() as i64, PULSES);
        for (index, frame) in (0..).zip(frames) {
            let [open, close] = frame.exposure_ns;
            assert_eq!(close - open, width_ns(index, widths_ms), "frame {index}");
            // Counted from the first exposure.
            assert!((open - (rise_ns(index) - rise_ns(0))).abs() < 20_000, "frame {index}: {open}");
            assert_eq!(frame.t_ns, open + (close - open) / 2);
        }
        assert_eq!(notes, [SessionNote::NoStream { camera: "another".into() }]);
    }
}

#[test]
fn a_camera_with_an_exposure_of_its_own_takes_the_pulses_for_starts_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path, [2, 6], &serde_json::json!({ "triggered": true, "exposure_us": 1500 }));
    let (sync, _) = of(&path);
    let exposures = sync.stream("camera").unwrap().exposures.clone().unwrap();
    assert!(exposures.exposure_ns.iter().all(|&length| length == 1_500_000));
}

#[test]
fn a_file_of_one_length_for_all_frames_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path, [5, 5], &serde_json::json!({ "triggered": true }));
    let (sync, _) = of(&path);
    let beside = Synchronisation::file_beside(&path);
    sync.save(&beside).unwrap();
    let text = std::fs::read_to_string(&beside).unwrap();
    assert!(text.contains(r#""exposure_ns":5000000,"#), "{text}");
    // As it was before frames had lengths at all.
    std::fs::write(&beside, text.replace(r#""exposure_ns":5000000,"#, "")).unwrap();
    assert_eq!(of(&path).0.stream("camera").unwrap().frames()[&3].length_ns, None);
}

#[test]
fn a_file_of_another_session_is_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.mcap");
    write(&path, [2, 6], &serde_json::json!({ "triggered": true }));
    let (sync, _) = of(&path);
    let beside = Synchronisation::file_beside(&path);
    let mut other = sync.clone();
    other.streams[1].id = "eye".into();
    let mut longer = sync.clone();
    let exposures = longer.streams[1].exposures.as_mut().unwrap();
    exposures.sequence.push(999);
    exposures.pulse.push(999);
    exposures.mid_ns.push(0);
    exposures.exposure_ns.push(0);
    for (stale, hint) in [(other, "board, eye"), (longer, "121 frames of camera, of which the session has 120")] {
        stale.save(&beside).unwrap();
        let (found, notes) = of(&path);
        assert_eq!(found.streams[1].exposures, sync.streams[1].exposures);
        let [note] = &notes[..] else { panic!("{notes:?}") };
        let message = note.to_string();
        assert!(message.contains("s.sync.json is not used") && message.contains(hint), "{message}");
    }
}
