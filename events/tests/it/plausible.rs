//! Sizes that headers say, plausible and not, in every format that says one.

use std::path::Path;

use erfgs_events::{Event, EventFile, Events, SensorSize, npz};
use proptest::prelude::*;

/// The name of a file and its bytes, with a header that says the size.
type Write = fn([u16; 2]) -> (&'static str, Vec<u8>);

const FORMATS: [Write; 5] = [
    |[width, height]| ("a.raw", format!("% evt 3.0\n% geometry {width}x{height}\n% end\n").into_bytes()),
    |[width, height]| {
        let text =
            format!("% Data file containing CD events.\n% Version 2\n% Height {height}\n% Width {width}\n% end\n");
        ("a.dat", [text.as_bytes(), &[0x0C, 8], &[0; 8]].concat())
    },
    |[width, height]| {
        let sides = [width.to_le_bytes(), height.to_le_bytes()].concat();
        ("a.es", [&b"Event Stream"[..], &[2, 0, 0, 1], &sides].concat())
    },
    |[width, height]| ("a.csv", format!("%geometry:{width},{height}\n1,2,1,100\n3,4,0,200\n").into_bytes()),
    |[width, height]| ("a.txt", format!("{width} {height}\n0.000100 1 2 1\n0.000205 3 4 0\n").into_bytes()),
];

fn opened(folder: &Path, (name, bytes): (&str, Vec<u8>)) -> Result<Option<SensorSize>, String> {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    EventFile::open(&path).map(|file| file.size).map_err(|error| error.to_string())
}

proptest! {
    #[test]
    fn sizes_that_sensors_have_are_read_and_others_are_refused_by_name(
        sides in prop::array::uniform2(64..=8192_u16),
        beyond in prop::array::uniform2(13_000..=u16::MAX),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let [width, height] = sides;
        for write in FORMATS {
            prop_assert_eq!(opened(folder.path(), write(sides)), Ok(Some(SensorSize { width, height })));
            let (name, bytes) = write(beyond);
            let message = opened(folder.path(), (name, bytes)).unwrap_err();
            prop_assert!(message.contains(name) && message.contains("event sensor") && message.contains("1.5e8 px"), "{}", message);
        }
    }
}

#[test]
fn archives_that_say_or_need_a_size_that_no_sensor_has_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut events = Events::new(65_535, 65_535);
    events.push(Event { t_us: 1, x: 5, y: 6, on: true });
    npz::write_events(&path, &events).unwrap();
    let message = npz::read_events(&path, None).unwrap_err().to_string();
    assert!(message.contains("a.npz") && message.contains("plausible"), "{message}");
    let mut events = Events::new(1280, 720);
    events.push(Event { t_us: 1, x: 5, y: 6, on: true });
    npz::write_events(&path, &events).unwrap();
    assert_eq!(npz::read_events(&path, None).unwrap().width, 1280);
}
