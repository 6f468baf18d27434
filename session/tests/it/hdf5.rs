//! HDF5 files against h5py and hdf5plugin, which scripts/setup.sh --oracles installs.
//!
//! `cargo test -p erfgs-session --features hdf5 --test it hdf5`, or with all others by `scripts/test.sh`; the environment variable
//! `ERFGS_ORACLES` names another Python that has h5py and hdf5plugin.

use std::{
    path::Path,
    process::Command,
    sync::{LazyLock, Mutex, MutexGuard, PoisonError},
};

use erfgs_events::{
    Anomalies, CdEvent, Columns, Edge, EventEncoding, SensorSize, Sink,
    hdf5::{self, Hdf5Error, Hdf5Layout},
};
use erfgs_session::container::{Recording, import_events};

/// Runs `tests/oracles/hdf5_files.py`, which must succeed, and gives what it prints.
fn python(verb: &str, path: &Path) -> Vec<u8> {
    let output = Command::new(erfgs_recordings::python())
        .arg(erfgs_recordings::root().join("tests/oracles/hdf5_files.py"))
        .arg(verb)
        .arg(path)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

/// Tests take turns: libhdf5 locks the files that it has open, and a Python that another test starts meanwhile would inherit
/// such a lock.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

static FILES: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    python("write", folder.path());
    folder
});

const COUNT: i64 = 40_000;
const OFFSET: u64 = 1_234_567_890_123;

/// The events of `hdf5_files.py`.
fn events(offset: u64) -> impl Iterator<Item = CdEvent> {
    (0..COUNT).map(move |n| CdEvent {
        t_us: offset + (n * n / 400 + n / 9000 * 70_000) as u64,
        x: (if n % 5 < 3 { n / 7 * 7 + n % 5 } else { n * 7 } % 640) as u16,
        y: (n / 40 * 3 % 480) as u16,
        on: n / 3 % 2 == 1,
    })
}

fn decode(
    name: &str,
    size: Option<SensorSize>,
) -> Result<(Hdf5Layout, Option<SensorSize>, Columns, Anomalies), Hdf5Error> {
    let file = hdf5::open(&FILES.path().join(name))?;
    let mut columns = Columns::default();
    let anomalies = file.decode(size, &mut columns)?;
    Ok((file.layout(), file.size(), columns, anomalies))
}

#[test]
fn files_of_dsecs_layout_are_read_with_every_filter() {
    let _turn = turn();
    for name in ["zstd", "zstd_bits", "zstd_plain", "lz4", "stored", "gzip"] {
        let (layout, size, columns, anomalies) = decode(&format!("{name}.h5"), None).unwrap();
        assert_eq!((layout, size, anomalies), (Hdf5Layout::Dsec, None, Anomalies::default()), "{name}");
        assert!(columns.iter().eq(events(OFFSET)), "{name}");
    }
}

#[test]
fn files_of_metavision_are_read_with_and_without_its_filter() {
    let _turn = turn();
    for name in ["metavision_plain", "metavision_runs", "metavision_packed"] {
        let (layout, size, columns, anomalies) = decode(&format!("{name}.h5"), None).unwrap();
        assert_eq!((layout, anomalies), (Hdf5Layout::Metavision, Anomalies::default()), "{name}");
        assert_eq!(size, Some(SensorSize { width: 640, height: 480 }));
        assert_eq!(columns.len(), COUNT as usize, "{name}");
        assert!(columns.iter().eq(events(0)), "{name}");
        let edge = |t_us, rising| Edge { t_us, channel: 1, rising };
        assert_eq!(columns.edges, [edge(500, true), edge(700, false)]);
    }
}

#[test]
fn files_are_played_and_imported_with_their_edges_between_their_events() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    for (name, offset, encoding) in
        [("zstd", OFFSET, EventEncoding::Aedat4), ("metavision_runs", 0, EventEncoding::Evt2)]
    {
        let path = FILES.path().join(format!("{name}.h5"));
        let Recording::EventFile(file) = Recording::open(&path, None).unwrap() else { panic!("no event file") };
        assert_eq!(file.summary().streams[0].description.encoding, encoding.into());
        let out = folder.path().join(format!("{name}.mcap"));
        import_events(&file, &out, |_| {}).unwrap();
        let mut columns = Columns::default();
        Recording::open(&out, None).unwrap().decode_events(0, &mut columns, |_| {}).unwrap().unwrap();
        assert!(columns.iter().eq(events(offset)), "{name}");
        let edges: Vec<u64> = columns.edges.iter().map(|edge| edge.t_us).collect();
        assert_eq!(edges, if encoding == EventEncoding::Evt2 { vec![500, 700] } else { vec![] });
    }
}

#[test]
fn events_outside_the_sensor_are_counted() {
    let _turn = turn();
    let size = SensorSize { width: 640, height: 240 };
    let outside = events(0).filter(|event| event.y >= 240).count();
    for name in ["zstd.h5", "metavision_runs.h5"] {
        let (.., columns, anomalies) = decode(name, Some(size)).unwrap();
        assert_eq!((columns.len(), anomalies.outside), (COUNT as usize - outside, outside as u64), "{name}");
    }
}

#[test]
fn what_is_not_read_is_named_with_a_remedy() {
    let _turn = turn();
    let message = |name: &str| decode(name, None).unwrap_err().to_string();
    for (name, words) in [
        ("blosclz.h5", ["BloscLZ", "h5repack"]),
        ("zstd_filter.h5", ["filter 32015", "h5repack"]),
        ("other.h5", ["temperature", "/CD/events"]),
        ("none.h5", ["none.h5", "No such file"]),
    ] {
        let text = message(name);
        assert!(words.iter().all(|word| text.contains(word)), "{name}: {text}");
    }
    let folder = FILES.path();
    let whole = std::fs::read(folder.join("zstd.h5")).unwrap();
    std::fs::write(folder.join("cut.h5"), &whole[..whole.len() / 2]).unwrap();
    assert!(message("cut.h5").contains("cut.h5"));
    std::fs::write(folder.join("text.h5"), "no HDF5").unwrap();
    assert!(message("text.h5").contains("text.h5"));
}

#[test]
fn what_is_written_is_read_by_h5py_and_here() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/events.h5");
    let mut writer = hdf5::create(&path, Some(SensorSize { width: 640, height: 480 })).unwrap();
    // More than a chunk.
    let written: Vec<CdEvent> = (0..3)
        .flat_map(|n| events(OFFSET + n * 5_000_000).map(move |e| CdEvent { on: e.on ^ (n == 1), ..e }))
        .collect();
    written.iter().for_each(|&event| writer.event(event));
    assert!(!path.exists(), "not before it is whole");
    assert_eq!(writer.finish().unwrap(), written.len() as u64);
    assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1, "nothing is left beside it");

    let found: serde_json::Value = serde_json::from_slice(&python("read", &path)).unwrap();
    let column = |name: &str| -> Vec<u64> { serde_json::from_value(found[name].clone()).unwrap() };
    let t: Vec<u64> = written.iter().map(|event| event.t_us - OFFSET).collect();
    assert_eq!(column("t"), t);
    assert!(column("x").into_iter().eq(written.iter().map(|event| u64::from(event.x))));
    assert!(column("y").into_iter().eq(written.iter().map(|event| u64::from(event.y))));
    assert!(column("p").into_iter().eq(written.iter().map(|event| u64::from(event.on))));
    assert_eq!(found["types"], serde_json::json!({"t": "<u4", "x": "<u2", "y": "<u2", "p": "|u1"}));
    assert_eq!((&found["t_offset"], &found["size"]), (&OFFSET.into(), &serde_json::json!([640, 480])));
    let first_of = |ms: u64| t.partition_point(|&t| t < ms * 1000) as u64;
    let milliseconds: Vec<u64> = (0..=t[t.len() - 1] / 1000).map(first_of).collect();
    assert_eq!(column("ms_to_idx"), milliseconds);

    let file = hdf5::open(&path).unwrap();
    assert_eq!(file.size(), Some(SensorSize { width: 640, height: 480 }));
    let mut columns = Columns::default();
    assert!(file.decode(None, &mut columns).unwrap().is_empty());
    assert!(columns.iter().eq(written));
}

#[test]
fn a_file_without_events_is_one() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.h5");
    assert_eq!(hdf5::create(&path, None).unwrap().finish().unwrap(), 0);
    let mut columns = Columns::default();
    hdf5::open(&path).unwrap().decode(None, &mut columns).unwrap();
    assert!(columns.is_empty());
}

#[test]
fn what_the_layout_cannot_hold_is_refused_and_leaves_no_file() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.h5");
    let event = |t_us| CdEvent { t_us, x: 0, y: 0, on: true };
    for (times, word) in [([50, 49], "back in time"), ([50, 50 + (1 << 32)], "71 minutes"), ([1 << 63, 0], "offset")] {
        let mut writer = hdf5::create(&path, None).unwrap();
        times.into_iter().for_each(|t_us| writer.event(event(t_us)));
        let error = writer.finish().unwrap_err();
        assert!(matches!(error, Hdf5Error::Events { .. }) && error.to_string().contains(word), "{error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
