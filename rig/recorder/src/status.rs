//! The state of a rig and its recording at one moment: what the status line, the live page and the session file show.

use std::{collections::BTreeMap, path::PathBuf};

use erfgs_session::{
    Session,
    clock::ClockFit,
    source::{Counters, Description, Encoding},
};
use serde::{Deserialize, Serialize};

use super::stream_queue::Drops;

/// How a stream fares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StreamState {
    /// Not started, or stopped.
    #[default]
    Stopped,
    /// Started; nothing came yet.
    Waiting,
    /// Data come.
    Running,
    /// Nothing came for longer than its `stall_seconds`.
    Stalled,
    /// The device is gone; its driver tries to get it back.
    Lost,
}

/// How well a stream's device clock is known on the host's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ClockStatus {
    /// What the figure rests on: "usb arrival", "kernel stamp".
    pub basis: String,
    /// Rate of the device clock against the host's, less 1, in millionths.
    pub rate_ppm: f64,
    /// Median of how far arrivals lie from the fit, microseconds.
    pub residual_p50_us: f64,
    /// 95th percentile of the same.
    pub residual_p95_us: f64,
    /// Samples that the fit rests on.
    pub samples: u64,
    /// The fit that all this is said of, from nanoseconds of the device to those of the host.
    #[serde(skip)]
    pub fit: Option<ClockFit>,
}

impl ClockStatus {
    /// What a fit says, from nanoseconds of the device to those of the host.
    #[must_use]
    pub fn of(basis: &str, fit: ClockFit) -> Self {
        Self {
            basis: basis.to_owned(),
            // The fit says how slow the device is.
            rate_ppm: -fit.rate_error_ppm(1.0),
            residual_p50_us: fit.residuals.p50_ns / 1e3,
            residual_p95_us: fit.residuals.p95_ns / 1e3,
            samples: fit.samples,
            fit: Some(fit),
        }
    }
}

/// One stream.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StreamStatus {
    /// Name within the rig.
    pub id: String,
    /// Maker and model.
    pub model: String,
    /// Serial number, or empty.
    pub serial: String,
    /// Encoding of the payloads.
    pub encoding: Encoding,
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// How it fares.
    pub state: StreamState,
    /// Packets a second; for frame cameras, frames a second.
    pub packets_per_s: f64,
    /// Bytes a second.
    pub bytes_per_s: f64,
    /// Events a second, extrapolated from the share of packets that was decoded; absent for frames.
    pub events_per_s: Option<f64>,
    /// Share of the bytes that was decoded for [`StreamStatus::events_per_s`], 0 to 1.
    pub decoded_share: Option<f64>,
    /// Losses since the recording started (since the rig started, where nothing is recorded).
    pub drops: Drops,
    /// Totals that the driver gives.
    pub counters: Counters,
    /// Bytes that wait for the disk.
    pub waiting_bytes: u64,
    /// The most that ever waited in this recording.
    pub peak_waiting_bytes: u64,
    /// Bytes that may wait.
    pub queue_bytes: u64,
    /// Packets in the session file.
    pub written: u64,
    /// Their bytes.
    pub written_bytes: u64,
    /// Measurements of the device: temperature, counts of its event-rate controller.
    pub readings: BTreeMap<String, f64>,
    /// The device clock, where it can be estimated.
    pub clock: Option<ClockStatus>,
}

/// The recording that runs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RecordingStatus {
    /// The session file, or the first of several.
    pub path: PathBuf,
    /// Since it started.
    pub seconds: f64,
    /// Bytes of all files by now.
    pub bytes: u64,
    /// Files that it is in.
    #[serde(default)]
    pub files: u32,
    /// Bytes a second, over the last second.
    pub bytes_per_s: f64,
    /// Longest that one write took, milliseconds.
    pub slowest_write_ms: f64,
}

/// The past that is held in memory while nothing is recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeldStatus {
    /// How much there is, seconds.
    pub seconds: f64,
    /// How much is wanted, seconds.
    pub of_seconds: f64,
    /// Memory that it takes, bytes.
    pub bytes: u64,
    /// Memory that it may take, bytes.
    pub of_bytes: u64,
}

/// The disk that recordings go to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DiskStatus {
    /// Bytes left above the reserve.
    pub free: u64,
    /// Size of the file system.
    pub total: u64,
    /// How long the room lasts at the present rate; absent where nothing arrives.
    pub seconds_left: Option<f64>,
}

/// How much a message matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// Good to know.
    Info,
    /// Something to look after; the recording goes on.
    Warning,
    /// The recording ended, or data are lost.
    Error,
}

/// What happened, for the user.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// Counts messages, from 1.
    pub number: u64,
    /// Host time, nanoseconds.
    pub host_ns: i64,
    /// Weight.
    pub level: Level,
    /// Stream that it is about, or empty.
    pub stream: String,
    /// The message.
    pub text: String,
}

/// How a recording ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// The session file, or the first of several.
    pub path: PathBuf,
    /// Its length, seconds.
    pub seconds: f64,
    /// Its size in all files, bytes.
    pub bytes: u64,
    /// Files that it is in.
    #[serde(default)]
    pub files: u32,
    /// Why it ended.
    pub reason: String,
    /// What went wrong at its end, if anything: the file can be read, and `erfgs recover` completes it.
    pub failure: Option<String>,
    /// The streams at the end.
    pub streams: Vec<StreamStatus>,
}

impl Summary {
    /// Counts the packets that the file holds, where writing it failed: what was handed over last may never have come there.
    pub(crate) fn count_what_is_there(&mut self) {
        let Ok(file) = std::fs::metadata(&self.path) else { return };
        let session = Session::open(&self.path).ok();
        self.bytes = session.as_ref().map_or(file.len(), |session| session.summary().file_bytes);
        for stream in &mut self.streams {
            let found = session.as_ref().and_then(|session| session.summary().stream(&stream.id));
            let totals = found.map(|(_, found)| found.totals).unwrap_or_default();
            stream.drops.writer += stream.written.saturating_sub(totals.packets);
            (stream.written, stream.written_bytes) = (totals.packets, totals.bytes);
        }
    }

    /// Packets lost at any stage.
    #[must_use]
    pub fn drops(&self) -> u64 {
        self.streams.iter().map(|stream| stream.drops.total()).sum()
    }
}

/// Everything at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Name of the rig.
    pub rig: String,
    /// Whether a recording is played, and no camera is there.
    pub replay: bool,
    /// Host time, nanoseconds.
    pub host_ns: i64,
    /// The recording that runs, if one does.
    pub recording: Option<RecordingStatus>,
    /// The past that a recording would begin with, where it is held.
    pub held: Option<HeldStatus>,
    /// The session file that is being completed, if one is.
    pub finishing: Option<PathBuf>,
    /// The recording before.
    pub last: Option<Summary>,
    /// The streams in the order of the rig.
    pub streams: Vec<StreamStatus>,
    /// What is left of the disk of the recordings.
    pub disk: DiskStatus,
    /// The latest messages, oldest first.
    pub messages: Vec<Message>,
    /// Warnings and errors that nobody has marked as read, oldest first.
    pub unread: Vec<Message>,
}

impl Status {
    /// Bytes a second of all streams together.
    #[must_use]
    pub fn bytes_per_s(&self) -> f64 {
        self.streams.iter().map(|stream| stream.bytes_per_s).sum()
    }

    /// Packets lost at any stage in all streams.
    #[must_use]
    pub fn drops(&self) -> u64 {
        self.streams.iter().map(|stream| stream.drops.total()).sum()
    }
}

/// The status of a stream that nothing is known of yet.
pub(super) fn blank(description: &Description) -> StreamStatus {
    StreamStatus {
        id: description.id.clone(),
        model: description.model.clone(),
        serial: description.serial.clone(),
        encoding: description.encoding,
        width: description.width,
        height: description.height,
        state: StreamState::Stopped,
        packets_per_s: 0.0,
        bytes_per_s: 0.0,
        events_per_s: None,
        decoded_share: None,
        drops: Drops::default(),
        counters: Counters::default(),
        waiting_bytes: 0,
        peak_waiting_bytes: 0,
        queue_bytes: 0,
        written: 0,
        written_bytes: 0,
        readings: BTreeMap::new(),
        clock: None,
    }
}
