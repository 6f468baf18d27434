//! Real recordings: the digests of every field (`digests.json`) are those that faery's tests give.

use erfgs_events::{Anomalies, Columns, Digests, EventFile, SensorSize};
use erfgs_recordings::fetched;

fn check(file: &str, format: &str, size: SensorSize, events: u64) {
    let references: serde_json::Value = serde_json::from_str(include_str!("digests.json")).unwrap();
    let expected = references[file].as_object().unwrap();
    let recording = EventFile::open(&fetched(file)).unwrap();
    assert_eq!((recording.format.name(), recording.size), (format, Some(size)));
    let mut digests = Digests::new();
    let anomalies = recording.decode(&mut digests).unwrap();
    assert!(anomalies.is_empty(), "{anomalies:?}");
    assert_eq!(digests.events, events);
    let found = digests.finish();
    for (field, digest) in expected {
        let found = found.iter().find(|(name, _)| name == field).map(|(_, digest)| digest.as_str());
        assert_eq!(found, digest.as_str(), "{file}, {field}");
    }
}

const HD: SensorSize = SensorSize { width: 1280, height: 720 };

#[test]
fn an_evk4_recording_decodes_as_in_faery() {
    check("evt3.raw", "evt3", HD, 1_218_618);
}

#[test]
fn a_generation_3_recording_decodes_as_in_faery_and_its_size_follows_from_the_system() {
    check("evt2.raw", "evt2", SensorSize { width: 640, height: 480 }, 521_252);
}

#[test]
fn a_dat_file_decodes_as_in_faery() {
    check("gen4.dat", "dat2", HD, 1_218_618);
}

#[test]
fn a_davis346_recording_decodes_as_in_faery_with_its_frames_samples_and_triggers() {
    check("davis346.aedat4", "aedat4", SensorSize { width: 346, height: 260 }, 78_830);
}

#[test]
fn frames_of_16_bits_are_read_and_unknown_ones_counted() {
    for (file, damaged) in [("test_data_gray16.aedat4", 0), ("test_data_unknown_then_gray16.aedat4", 1)] {
        let mut columns = Columns::default();
        let anomalies = EventFile::open(&fetched(file)).unwrap().decode(&mut columns).unwrap();
        assert_eq!(anomalies, Anomalies { damaged, ..Anomalies::default() });
        let [frame] = &columns.frames[..] else { panic!("{} frames", columns.frames.len()) };
        assert_eq!((frame.width, frame.height, frame.channels, frame.bits), (2, 2, 1, 16));
        assert_eq!((frame.exposure_start_us, frame.exposure_end_us), (950, 1050));
        assert_eq!(frame.pixels, [1, 2, 3, 1023]);
    }
}
