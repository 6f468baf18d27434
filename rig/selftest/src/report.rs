//! The report: one file that can be passed on.

use std::{collections::BTreeMap, io, path::Path};

use erfgs_base::{FileError, atomic};
use erfgs_events::Anomalies;
use erfgs_session::source::{Counters, Description, Incident};
use serde::{Deserialize, Serialize};

use crate::{
    check::Check,
    error::SelftestError,
    histogram::Intervals,
    observe::{Observed, Recording},
    rate::RateFit,
};

/// Version of the file.
pub const VERSION: u32 = 1;

/// What a rig found of itself. Its fields are described in `docs/reference/selftest.md`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What the file is: `erfgs-selftest`.
    pub kind: String,
    /// Version of the file.
    pub version: u32,
    /// The program and its version.
    pub program: String,
    /// When the test began, `YYYY-MM-DD hh:mm:ss` in UTC.
    pub made_utc: String,
    /// The machine, without its name.
    pub machine: BTreeMap<String, String>,
    /// Name of the rig.
    pub rig: String,
    /// The rig's file.
    pub configuration: String,
    /// How long each recording was to be, seconds.
    pub seconds: f64,
    /// What was found: device by device in the order of the rig, then what concerns all.
    pub checks: Vec<Check>,
    /// The devices, in the order of the rig.
    pub devices: Vec<DeviceReport>,
}

/// A device, and what it sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceReport {
    /// Its id in the rig.
    pub id: String,
    /// What it is, with its settings and registers as read back; absent where it could not be opened.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub description: Option<Description>,
    /// What it measures of itself, read while it ran.
    pub readings: BTreeMap<String, f64>,
    /// Its recording without the others; absent where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alone: Option<RecordedReport>,
    /// Its part in the recording of all; absent where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub together: Option<RecordedReport>,
}

/// What a recording has of a device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordedReport {
    /// Length of the recording, seconds.
    pub seconds: f64,
    /// Packets.
    pub packets: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Bytes a second between the first and the last packet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_per_s: Option<f64>,
    /// Frames a second, by their stamps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames_per_s: Option<f64>,
    /// Packets that the sequence numbers show as missing.
    pub missing: u64,
    /// Frames that the camera or the kernel counted and that did not come.
    pub missing_frames: u64,
    /// Packets before which data was lost or cut.
    pub discontinuities: u64,
    /// Packets that are damaged.
    pub damaged: u64,
    /// What the driver counted.
    pub counters: Counters,
    /// Packets that the recorder dropped, by the stage at which it did.
    pub dropped: BTreeMap<String, u64>,
    /// Of an event camera: events.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub events: Option<u64>,
    /// Of an event camera: edges at its trigger input, rising and falling.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub edges: Option<[u64; 2]>,
    /// Of an event camera: its first and its last time, microseconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range_us: Option<[u64; 2]>,
    /// Of an event camera: what was wrong with its words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub anomalies: Option<Anomalies>,
    /// Of a trigger board: pulses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulses: Option<u64>,
    /// The device's clock against the host's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock: Option<ClockReport>,
    /// What the intervals are between: `frames`, `pulses`, `rising-edges` or `packets`.
    pub intervals_between: String,
    /// Those intervals.
    pub intervals: Intervals,
    /// The intervals between the arrivals of packets.
    pub packet_intervals: Intervals,
    /// What the driver reported.
    pub incidents: Vec<Incident>,
}

/// A device's clock against the host's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "fit")]
pub enum ClockReport {
    /// It runs evenly.
    Even {
        /// How much faster than it should, parts per million.
        ppm: f64,
        /// The truth is farther off by chance alone in one of ten thousand recordings.
        uncertainty_ppm: f64,
    },
    /// It jumped.
    Stepped {
        /// How far, microseconds; positive: ahead.
        by_us: f64,
    },
    /// Too little came to tell.
    TooFew,
}

impl From<RateFit> for ClockReport {
    fn from(fit: RateFit) -> Self {
        match fit {
            RateFit::Even(rate) => Self::Even { ppm: rate.ppm, uncertainty_ppm: rate.uncertainty_ppm },
            RateFit::Stepped { by_ns } => Self::Stepped { by_us: by_ns / 1e3 },
            RateFit::TooFew => Self::TooFew,
        }
    }
}

impl RecordedReport {
    /// Of a stream of a recording.
    #[must_use]
    pub fn of(recording: &Recording, observed: &Observed) -> Self {
        let (between, intervals) = observed.intervals();
        let events = observed.events.as_ref();
        let board = observed.board.as_ref().and_then(|lines| lines.board.as_ref());
        Self {
            seconds: recording.seconds,
            packets: observed.totals.packets,
            bytes: observed.totals.bytes,
            bytes_per_s: observed.bytes_per_s(),
            frames_per_s: observed.frames_per_s().filter(|_| observed.is_frames()),
            missing: observed.totals.missing,
            missing_frames: observed.missing_frames,
            discontinuities: observed.totals.discontinuities,
            damaged: observed.totals.damaged,
            counters: observed.counters,
            dropped: observed.dropped.clone(),
            events: events.map(|events| events.events),
            edges: events.map(|events| events.edge_counts()),
            range_us: events.and_then(|events| events.range_us),
            anomalies: events.map(|events| events.anomalies),
            pulses: observed.board.is_some().then(|| board.map_or(0, |board| board.pulses.len() as u64)),
            clock: observed.clock.map(ClockReport::from),
            intervals_between: between.to_owned(),
            intervals,
            packet_intervals: observed.packet_intervals(),
            incidents: observed.incidents.clone(),
        }
    }
}

impl Report {
    /// What reports are.
    pub const KIND: &'static str = "erfgs-selftest";

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), SelftestError> {
        let failed = FileError::when("write the report", path);
        let written =
            serde_json::to_vec_pretty(self).map_err(io::Error::from).and_then(|bytes| atomic::write(path, &bytes));
        written.map_err(|source| SelftestError::Report(failed(source)))
    }
}
