//! What a device delivers while it records, and the trait behind which drivers, replays and emulated devices stand.
//!
//! A [`Source`] is one stream: an event camera, a frame camera or a trigger board. Once started it pushes [`Packet`]s
//! from its own threads into an [`Outlet`], which the recorder, the live page or a test provides. An outlet never
//! blocks: what it cannot take is dropped and counted there, so that no device stalls because a disk does.

use std::{error::Error, sync::Arc};

use bytes::Bytes;
use erfgs_base::plausible::{Implausible, check_sensor, check_size};
use erfgs_scene::pixel::{FrameFormat, RawLook};
use serde::{Deserialize, Serialize};

pub use crate::encoding::{Encoding, UnknownEncoding, names};

/// What a stream is: written once into a recording, before its packets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// Name within the rig, unique: letters, digits, `-` and `_`.
    pub id: String,
    /// Maker and model, as users know it: "Prophesee EVK4".
    pub model: String,
    /// Serial number as the device reports it; empty where it has none.
    pub serial: String,
    /// How the payloads are encoded.
    pub encoding: Encoding,
    /// Columns, pixels; 0 for a trigger board.
    pub width: u32,
    /// Rows, pixels; 0 for a trigger board.
    pub height: u32,
    /// Sources start in order of this number (slaves of a clock first, then their master, the trigger board last).
    pub start_order: i32,
    /// Settings as read back from the device after they were set: biases, exposure, firmware, transfers in flight.
    pub settings: serde_json::Map<String, serde_json::Value>,
}

impl Description {
    /// A trigger board, whose packets are lines.
    #[must_use]
    pub fn trigger_board(id: &str, settings: serde_json::Map<String, serde_json::Value>) -> Self {
        Self {
            id: id.into(),
            model: "erfgs trigger board".into(),
            serial: String::new(),
            encoding: Encoding::TriggerLines,
            width: 0,
            height: 0,
            start_order: 100,
            settings,
        }
    }

    /// Whether a sensor can have such a size; sides of 0 say nothing.
    ///
    /// # Errors
    /// Which number cannot be, and what can.
    pub fn check(&self) -> Result<(), Implausible> {
        let size = [self.width, self.height];
        if self.encoding.is_events() { check_sensor(size) } else { check_size(size.map(|side| side.max(1))) }.map(drop)
    }

    /// How the stream's frames are to be decoded; `None` where its packets are no frames.
    #[must_use]
    pub fn frame_format(&self) -> Option<FrameFormat> {
        let pixels = self.encoding.frames()?;
        let look = RawLook::of_settings(&self.settings, pixels);
        Some(FrameFormat { pixels, width: self.width, height: self.height, look })
    }

    /// The exposure that a frame camera was set to, nanoseconds: its setting `exposure_us`. `None` where it has none, or
    /// one that is no length of time.
    #[must_use]
    pub fn exposure_ns(&self) -> Option<i64> {
        let exposure_us = self.settings.get("exposure_us").and_then(serde_json::Value::as_f64)?;
        (exposure_us > 0.0 && exposure_us <= 1e-3 * LONGEST_EXPOSURE_NS).then(|| (1e3 * exposure_us).round() as i64)
    }

    /// The event cameras whose trigger inputs the camera's strobe goes to: its setting `strobe_to`; none where that is not
    /// said. `None` where the camera has no strobe: no setting `strobe_line`.
    #[must_use]
    pub fn strobe(&self) -> Option<Vec<&str>> {
        self.settings.get("strobe_line")?.as_str().filter(|line| !line.is_empty())?;
        let names = self.settings.get("strobe_to").and_then(serde_json::Value::as_array);
        Some(names.into_iter().flatten().filter_map(serde_json::Value::as_str).collect())
    }

    /// Whether each frame is taken at a pulse of the trigger board: the setting `triggered`.
    #[must_use]
    pub fn is_triggered(&self) -> bool {
        self.settings.get("triggered").and_then(serde_json::Value::as_bool) == Some(true)
    }
}

/// No frame of a video is exposed for longer, nanoseconds: an hour.
const LONGEST_EXPOSURE_NS: f64 = 3.6e12;

/// The clock that a frame was stamped with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StampClock {
    /// `CLOCK_MONOTONIC`, the clock of [`Packet::host_ns`].
    Monotonic,
    /// The camera's own, which counts from a moment of its own choice.
    Camera,
    /// Another clock, which the driver does not name.
    Unknown,
}

/// What of a frame was stamped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StampPoint {
    /// The start of the exposure (in truth, with most UVC cameras, the first packet of the transfer).
    StartOfExposure,
    /// The end of the transfer.
    EndOfFrame,
}

/// What the kernel says of a frame, or the camera itself ([`StampClock::Camera`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameStamp {
    /// The time stamp, nanoseconds.
    pub kernel_ns: i64,
    /// Which clock it was taken from.
    pub clock: StampClock,
    /// What it marks.
    pub point: StampPoint,
    /// The driver's or the camera's count of frames; a gap means that some were lost.
    pub sequence: u32,
}

/// How late a packet may be, nanoseconds: the most by which its arrival ([`Packet::host_ns`]) follows what it holds, and by
/// which it lies out of the order of arrival in a file.
///
/// Who looks for what was seen within a window of time reads on until so much after its end. Devices hand events over within
/// milliseconds; a frame comes after its exposure, readout and a queue of frames, which at a low rate takes seconds. What is
/// too long costs reading, what is too short costs data.
pub const LATE_NS: i64 = 5_000_000_000;

/// One transfer of a device, as it arrived.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// Counts the packets of a stream since it started, from 0. Packets that were lost on the way leave a gap.
    pub sequence: u64,
    /// Host time of arrival: `CLOCK_MONOTONIC`, nanoseconds, taken first thing on arrival.
    pub host_ns: i64,
    /// Data of the device was lost or cut before this packet (overflow, restart, reconnection): decoders start anew.
    pub discontinuity: bool,
    /// The device or the kernel marked the data as damaged (V4L2's error flag, a short JPEG).
    pub damaged: bool,
    /// The kernel's stamp, for frames that have one.
    pub stamp: Option<FrameStamp>,
    /// The bytes, exactly as the device sent them.
    pub payload: Bytes,
}

/// What happens to a source between packets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Incident {
    /// The device is gone or fails; the source tries to come back.
    Lost {
        /// What happened and what to do.
        reason: String,
    },
    /// The device is back and streams again.
    Back,
    /// Something that the user should know and that does not stop the stream.
    Warning {
        /// What it is and what to do.
        message: String,
    },
    /// Settings of the device were changed while it ran.
    Adjusted {
        /// What was changed, as in the rig's configuration: biases, regions, filters.
        changed: serde_json::Map<String, serde_json::Value>,
    },
    /// The recording ended as it should, or was ended: of the recorder itself, and the last of a session.
    Ended {
        /// Why.
        reason: String,
    },
}

/// Where packets go. Shared by the threads of all sources; never blocks.
pub trait Outlet: Send + Sync {
    /// Takes a packet. `false` says that there was no room: the packet is dropped, and counted by the outlet.
    fn send(&self, packet: Packet) -> bool;

    /// Takes note of what happened to the source.
    fn report(&self, incident: Incident);
}

/// Totals of a source since it started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Packets that arrived.
    pub packets: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Packets or frames known to be lost before they reached us: in the device, the kernel or the driver's own queue.
    pub lost: u64,
    /// Packets that the outlet did not take.
    pub refused: u64,
    /// Transfers that failed and were repeated.
    pub errors: u64,
    /// How often the device was lost and came back.
    pub reconnections: u64,
}

impl Counters {
    /// Counts a frame of so many bytes: whether it is damaged, and whether the outlet took it.
    pub fn deliver(&mut self, bytes: u64, is_damaged: bool, is_taken: bool) {
        self.packets += 1;
        self.bytes += bytes;
        self.errors += u64::from(is_damaged);
        self.refused += u64::from(!is_taken);
    }
}

/// An error of a source: the message says which device, what was being done, and what to do next.
pub type SourceError = Box<dyn Error + Send + Sync>;

/// One stream of a rig.
pub trait Source: Send {
    /// What the stream is.
    fn description(&self) -> &Description;

    /// Starts streaming into `outlet`, from threads of the source's own. Returns once the device has accepted.
    ///
    /// # Errors
    /// If the device refuses or is gone.
    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError>;

    /// Stops streaming; returns when no packet will follow. Stopping what is stopped does nothing.
    ///
    /// # Errors
    /// If the device does not answer; it is stopped on our side all the same.
    fn stop(&mut self) -> Result<(), SourceError>;

    /// Totals since the start.
    fn counters(&self) -> Counters;

    /// Measurements of the device at this moment for the status line and the recording: temperature, event-rate
    /// controller counts. Empty where the device has none.
    fn readings(&mut self) -> Vec<(String, f64)> {
        Vec::new()
    }

    /// What of the device can be changed while it runs, and stands how now. Empty where nothing can.
    fn knobs(&self) -> Vec<Knob> {
        Vec::new()
    }

    /// Changes settings while the device runs: those of `changed`, as in the rig's configuration; what it does not name
    /// stays. [`Source::description`] tells the settings as read back.
    ///
    /// # Errors
    /// If a setting cannot be changed so or is out of range, or the device does not take it; what stands is told by
    /// [`Source::knobs`].
    fn adjust(&mut self, changed: &serde_json::Map<String, serde_json::Value>) -> Result<(), SourceError> {
        let names: Vec<&str> = changed.keys().map(String::as_str).collect();
        Err(format!("{} has nothing that can be changed while it runs ({})", self.description().id, names.join(", "))
            .into())
    }
}

/// A setting that can be changed while a device runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Knob {
    /// Where it lies in the device's configuration: `biases.diff_on`.
    pub path: &'static str,
    /// What it is, for people.
    pub label: &'static str,
    /// What it is set to; `null` where it is off, or the maker's default.
    pub value: serde_json::Value,
    /// What it can be set to.
    pub kind: KnobKind,
    /// The setting without which it is off, or left to the maker, where it can be: `rate_limit`.
    pub off: Option<&'static str>,
}

/// What a setting can be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum KnobKind {
    /// A whole number.
    Number {
        /// The smallest.
        least: i64,
        /// The largest.
        most: i64,
        /// From one to the next.
        step: i64,
    },
    /// A window of the sensor (`x`, `y`, `width`, `height`), or all of it.
    Window {
        /// Columns of the sensor.
        columns: u16,
        /// Its rows.
        rows: u16,
        /// Whether the setting is a list of windows.
        list: bool,
    },
    /// One of several words.
    Choice {
        /// The choices.
        choices: &'static [&'static str],
    },
}

/// Takes settings that were changed later over earlier ones.
pub fn merge_settings(
    into: &mut serde_json::Map<String, serde_json::Value>,
    changed: &serde_json::Map<String, serde_json::Value>,
) {
    for (name, value) in changed {
        match (into.get_mut(name), value) {
            (Some(serde_json::Value::Object(into)), serde_json::Value::Object(changed)) => {
                merge_settings(into, changed)
            }
            (_, value) => drop(into.insert(name.clone(), value.clone())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_of_events_and_lines_have_no_frames() {
        for encoding in Encoding::all() {
            let (id, model, serial, settings) = ("cam".into(), String::new(), String::new(), serde_json::Map::new());
            let stream = Description { id, model, serial, encoding, width: 2, height: 1, start_order: 0, settings };
            assert_eq!(stream.frame_format().is_some(), encoding.is_frames(), "{encoding}");
        }
    }

    #[test]
    fn an_exposure_is_a_length_of_time() {
        let camera = |settings: serde_json::Value| Description {
            id: "cam".into(),
            model: String::new(),
            serial: String::new(),
            encoding: Encoding::TriggerLines,
            width: 2,
            height: 1,
            start_order: 0,
            settings: settings.as_object().unwrap().clone(),
        };
        let exposure_ns = |exposure_us| camera(serde_json::json!({ "exposure_us": exposure_us })).exposure_ns();
        assert_eq!(exposure_ns(serde_json::json!(5000)), Some(5_000_000));
        assert_eq!(exposure_ns(serde_json::json!(5020.3)), Some(5_020_300));
        for wrong in [serde_json::json!(0), serde_json::json!(-3), serde_json::json!(1e300), serde_json::json!("5")] {
            assert_eq!(exposure_ns(wrong.clone()), None, "{wrong}");
        }
        assert!(camera(serde_json::json!({ "triggered": true })).is_triggered());
        assert!(!camera(serde_json::json!({ "triggered": "yes" })).is_triggered());
    }
}
