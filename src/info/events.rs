//! `erfgs info` of event files.

use std::{collections::BTreeMap, path::Path};

use erfgs_events::{Anomalies, Digests, EventBatch, EventFile, SensorSize, Sink, hdf5, npz};
use serde::Serialize;

use crate::terminal::{Terminal, table, thousands};

#[derive(Serialize)]
struct EventFileSummary<'a> {
    kind: &'static str,
    file: &'a Path,
    format: &'static str,
    width: Option<u32>,
    height: Option<u32>,
    events: u64,
    on: u64,
    off: u64,
    frames: u64,
    imu_samples: u64,
    triggers: u64,
    edges: u64,
    first_us: Option<i64>,
    last_us: Option<i64>,
    /// Events a second, all pixels together.
    rate_hz: Option<f64>,
    /// Whether some event is earlier than the one before it.
    unordered: bool,
    anomalies: Anomalies,
    header: BTreeMap<&'a str, &'a str>,
    /// Of each field, SHA3-224, hexadecimal.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    sha3_224_of_field: BTreeMap<&'static str, String>,
}

/// Decodes the file and describes it; with `digest`, digests each field.
pub fn describe(file: &EventFile, digest: bool, terminal: &Terminal) -> anyhow::Result<()> {
    let mut found = if digest { Digests::new() } else { Digests::default() };
    let anomalies = file.decode(&mut found)?;
    let range_us = found.range_us.map(|(first, last)| [microseconds(first), microseconds(last)]);
    let summary = EventFileSummary {
        width: file.size.map(|size| size.width.into()),
        height: file.size.map(|size| size.height.into()),
        anomalies,
        header: file.header.iter().map(|(key, value)| (key.as_str(), value.as_str())).collect(),
        ..summary(&file.path, file.format.name(), range_us, &found)
    };
    terminal.result(&summary, || text(&summary))?;
    let items = found.events + found.edges + found.frames + found.imu_samples + found.marks;
    if anomalies.are_all(items) {
        anyhow::bail!("nothing in {} can be read: {anomalies}", file.path.display());
    }
    Ok(())
}

/// Reads an archive of NumPy arrays or a structured array and describes it; with `digest`, digests each field.
pub fn describe_arrays(path: &Path, size: Option<SensorSize>, digest: bool, terminal: &Terminal) -> anyhow::Result<()> {
    let size = size.map(|size| [size.width.into(), size.height.into()]);
    let is_npy = path.extension().is_some_and(|extension| extension == "npy");
    let events = if is_npy { npz::read_structured(path, size)? } else { npz::read_events(path, size)? };
    let mut found = if digest { Digests::new() } else { Digests::default() };
    // Times before zero have the bytes that they have in the file.
    let t_us: Vec<u64> = events.t_us.iter().map(|t_us| t_us.cast_unsigned()).collect();
    found.events(EventBatch { t_us: &t_us, x: &events.x, y: &events.y, on: &events.on });
    // Times are in order, or the file is refused.
    let range_us = events.t_us.first().zip(events.t_us.last()).map(|(&first, &last)| [first, last]);
    let summary = EventFileSummary {
        width: Some(events.width),
        height: Some(events.height),
        unordered: false,
        ..summary(path, if is_npy { "npy" } else { "npz" }, range_us, &found)
    };
    terminal.result(&summary, || text(&summary))
}

/// Decodes an HDF5 file of DSEC's or Metavision's layout and describes it; with `digest`, digests each field.
pub fn describe_hdf5(path: &Path, size: Option<SensorSize>, digest: bool, terminal: &Terminal) -> anyhow::Result<()> {
    let file = hdf5::open(path)?;
    let mut found = if digest { Digests::new() } else { Digests::default() };
    let anomalies = file.decode(size, &mut found)?;
    let size = size.or(file.size());
    let range_us = found.range_us.map(|(first, last)| [microseconds(first), microseconds(last)]);
    let summary = EventFileSummary {
        width: size.map(|size| size.width.into()),
        height: size.map(|size| size.height.into()),
        anomalies,
        ..summary(path, file.layout().name(), range_us, &found)
    };
    terminal.result(&summary, || text(&summary))
}

fn microseconds(t_us: u64) -> i64 {
    i64::try_from(t_us).unwrap_or(i64::MAX)
}

/// What the digests say; the file's size, header and anomalies are left open.
fn summary<'a>(
    path: &'a Path,
    format: &'static str,
    range_us: Option<[i64; 2]>,
    found: &Digests,
) -> EventFileSummary<'a> {
    let seconds =
        range_us.map(|[first, last]| last.saturating_sub(first) as f64 * 1e-6).filter(|&seconds| seconds > 0.0);
    EventFileSummary {
        kind: "events",
        file: path,
        format,
        width: None,
        height: None,
        events: found.events,
        on: found.on_events,
        off: found.events - found.on_events,
        frames: found.frames,
        imu_samples: found.imu_samples,
        triggers: found.marks,
        edges: found.edges,
        first_us: range_us.map(|[first, _]| first),
        last_us: range_us.map(|[_, last]| last),
        rate_hz: seconds.map(|seconds| found.events as f64 / seconds),
        unordered: found.unordered,
        anomalies: Anomalies::default(),
        header: BTreeMap::new(),
        sha3_224_of_field: found.finish().into_iter().collect(),
    }
}

fn text(summary: &EventFileSummary<'_>) -> String {
    let mut rows = Vec::new();
    let mut row = |key: &str, value: String| rows.push(vec![key.to_owned(), value]);
    row("format", summary.format.to_owned());
    let size = summary.width.zip(summary.height);
    row("sensor", size.map_or("size unknown; give --size WxH".into(), |(width, height)| format!("{width} x {height}")));
    let (events, on, off) = (thousands(summary.events), thousands(summary.on), thousands(summary.off));
    row("events", format!("{events} ({on} ON, {off} OFF)"));
    if let Some((first, last)) = summary.first_us.zip(summary.last_us) {
        let order = if summary.unordered { ", not in order" } else { "" };
        row("time", format!("{first} to {last} us{order}"));
    }
    if let Some(rate) = summary.rate_hz {
        row("rate", format!("{} events a second", thousands(rate as u64)));
    }
    let counts = [
        ("frames", summary.frames),
        ("inertial", summary.imu_samples),
        ("triggers", summary.triggers),
        ("edges", summary.edges),
    ];
    counts.into_iter().filter(|count| count.1 > 0).for_each(|(name, count)| row(name, thousands(count)));
    row("anomalies", summary.anomalies.to_string());
    summary.header.iter().for_each(|(key, value)| row(&format!("% {key}"), (*value).to_owned()));
    summary.sha3_224_of_field.iter().for_each(|(field, digest)| row(&format!("sha3-224 {field}"), digest.clone()));
    table(&rows)
}
