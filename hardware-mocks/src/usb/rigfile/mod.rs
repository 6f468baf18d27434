//! A rig of emulated devices, described in TOML.
//!
//! ```toml
//! [trigger]                    # optional: a train of pulses on the trigger line
//! period_us = 33333
//! high_us = 5000
//!
//! [[device]]
//! name = "left"
//! kind = "evk4"
//! serial = "00051234"
//! rate_hz = 100000             # the pattern; or what it looks at instead, one of:
//! # stage = true               # the stage
//! # raw = "take.raw"           # EVT3 words, sent as they are (evk4)
//! # events = "take.aedat4"     # the events of any file that erfgs reads, again and again (evk4, davis346)
//! # dataset = "ds"             # a camera of a dataset: its events, or its frames (uvc, u3v), again and again
//! # camera = "event00"
//! sync = "chain"               # devices that name the same wire share a clock if their driver asks for it
//! latency_ms = 20              # holds data back until edges of a board in another process have arrived
//! queue_mib = 256              # how much waits for a slow host before it is lost (default: 4 for an evk4, 8 for a davis346)
//!
//! # blocks = { lost_packets = [[3, 1]] }   # what goes wrong inside a u3v: `U3vFaults`
//!
//! [device.faults]
//! jitter_mean_us = 200
//! clock = { offset_ppm = 50, drift_ppm_per_min = 1 }
//! schedule = [ { at_ms = 5000, kind = "unplug", for_ms = 2000 } ]
//! ```

mod sight;

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use erfgs_dataset::DatasetError;
use serde::Deserialize;
use thiserror::Error;

use super::{
    Davis346, Davis346Options, Evk4, Evk4Options, Faults, Plug, SharedCounts, Speed, TriggerLine, U3v, U3vFaults,
    U3vOptions, UsbDevice, Uvc, UvcOptions,
    clock::SyncWire,
    evk4::Stimulus,
    front::{monotonic_ns, usbip::Device},
    line::PulseTrain,
    scene::{RecordedWords, RecordingError},
    uvc::Format,
};
use erfgs_stage::StageError;

/// Why a rig cannot be built.
#[derive(Debug, Error)]
pub enum RigError {
    /// The file cannot be read.
    #[error("cannot read the rig {path}: {source}; check the path")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not a description of a rig.
    #[error("{path} is no description of a rig: {source}")]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where and why.
        source: Box<toml::de::Error>,
    },
    /// A device's serial number is not one that it can have.
    #[error("device {name}: the serial number {serial:?} is not of up to 8 hexadecimal digits; correct it")]
    Serial {
        /// The device.
        name: String,
        /// Its serial number.
        serial: String,
    },
    /// Two devices have one name.
    #[error("two devices are named {name}; give each its own name")]
    Twice {
        /// The name.
        name: String,
    },
    /// The fields of a device do not go together.
    #[error("device {name}: {what}")]
    Field {
        /// The device.
        name: String,
        /// What is wrong and what to do.
        what: String,
    },
    /// What a device should look at is not for it.
    #[error("cannot play {path}: {what}")]
    Unsuited {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        what: String,
    },
    /// A dataset cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A recording cannot be played.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The stage cannot be filmed.
    #[error(transparent)]
    Stage(#[from] StageError),
}

/// The file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// The pulses on the trigger line, if something else does not push them.
    pub trigger: Option<TrainFile>,
    /// The devices.
    #[serde(default, rename = "device")]
    pub devices: Vec<DeviceFile>,
}

/// A train of pulses.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainFile {
    /// From one pulse to the next, microseconds.
    pub period_us: i64,
    /// How long the level is high, microseconds.
    pub high_us: i64,
}

/// What a device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A Prophesee EVK4.
    Evk4,
    /// An iniVation DAVIS346.
    Davis346,
    /// A UVC camera.
    Uvc,
    /// A USB3 Vision camera.
    U3v,
}

/// A device.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceFile {
    /// Its name among the emulated devices.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// Serial number; for an EVK4 up to 8 hexadecimal digits.
    pub serial: String,
    /// Events a second of the pattern.
    #[serde(default = "default_rate")]
    pub rate_hz: u64,
    /// A file of EVT3 words to play instead (EVK4).
    pub raw: Option<PathBuf>,
    /// A file of events to play instead, in any format that erfgs reads (EVK4, DAVIS346).
    pub events: Option<PathBuf>,
    /// A dataset to play instead, the folder or its `dataset.json`.
    pub dataset: Option<PathBuf>,
    /// The camera of the dataset.
    pub camera: Option<String>,
    /// Whether it films the stage instead.
    #[serde(default)]
    pub stage: bool,
    /// The wire of clocks that it is on.
    pub sync: Option<String>,
    /// Whether its clock input is connected (DAVIS346).
    #[serde(default)]
    pub slave: bool,
    /// Whether the trigger line makes it take frames (UVC), or is at its input (U3V).
    #[serde(default)]
    pub triggered: bool,
    /// Formats (UVC).
    #[serde(default)]
    pub formats: Vec<Format>,
    /// Sizes (UVC), the default first; of a U3V camera the first is its sensor's.
    #[serde(default)]
    pub sizes: Vec<(u32, u32)>,
    /// Frame rates (UVC), hertz, the default first.
    #[serde(default)]
    pub rates_hz: Vec<f64>,
    /// What goes wrong inside the camera (U3V).
    #[serde(default)]
    pub blocks: U3vFaults,
    /// How long data is held back, milliseconds.
    #[serde(default)]
    pub latency_ms: i64,
    /// How much waits for the host at most, MiB (EVK4, DAVIS346); without it, what its options have.
    pub queue_mib: Option<u16>,
    /// What goes wrong.
    #[serde(default)]
    pub faults: Faults,
}

fn default_rate() -> u64 {
    100_000
}

/// A device, ready to be served.
pub struct BuiltDevice {
    /// Its name.
    pub name: String,
    /// The device.
    pub device: Device,
    /// What it counts.
    pub counts: SharedCounts,
}

/// A rig of devices that share wires.
pub struct BuiltRig {
    /// The devices, in the order of the file.
    pub devices: Vec<BuiltDevice>,
    /// The line to the trigger inputs of the event sensors.
    pub events_line: TriggerLine,
    /// The line to the triggers of the frame cameras.
    pub frames_line: TriggerLine,
}

impl RigFile {
    /// Reads a description.
    ///
    /// # Errors
    /// If the file cannot be read or is not a description of a rig.
    pub fn open(path: &Path) -> Result<Self, RigError> {
        let text = fs::read_to_string(path).map_err(|source| RigError::Read { path: path.to_owned(), source })?;
        toml::from_str(&text).map_err(|source| RigError::Parse { path: path.to_owned(), source: Box::new(source) })
    }

    /// Builds the devices.
    ///
    /// # Errors
    /// If a serial number is not one, a name is there twice, or a recording or the stage cannot be had.
    pub fn build(&self) -> Result<BuiltRig, RigError> {
        let line = || match self.trigger {
            Some(train) => TriggerLine::train(PulseTrain {
                first_ns: monotonic_ns(),
                period_ns: train.period_us.max(1) * 1000,
                high_ns: train.high_us.max(1) * 1000,
            }),
            None => TriggerLine::new(),
        };
        let (events_line, frames_line) = (line(), line());
        let mut wires: BTreeMap<&str, SyncWire> = BTreeMap::new();
        let mut devices: Vec<BuiltDevice> = Vec::new();
        for (number, file) in self.devices.iter().enumerate() {
            if devices.iter().any(|device| device.name == file.name) {
                return Err(RigError::Twice { name: file.name.clone() });
            }
            file.check()?;
            let sync = file.sync.as_deref().map(|name| wires.entry(name).or_default().clone()).unwrap_or_default();
            let (device, counts) = match file.kind {
                Kind::Evk4 => file.evk4(number, sync, events_line.clone())?,
                Kind::Davis346 => file.davis346(number, sync, events_line.clone())?,
                Kind::Uvc => file.uvc(number, frames_line.clone())?,
                Kind::U3v => file.u3v(number, frames_line.clone())?,
            };
            devices.push(BuiltDevice { name: file.name.clone(), device: Plug::new(device, &file.faults), counts });
        }
        Ok(BuiltRig { devices, events_line, frames_line })
    }
}

/// What waits for the host at most, bytes.
fn queue_bytes(mib: Option<u16>, default: usize) -> usize {
    mib.map_or(default, |mib| usize::from(mib) << 20)
}

/// A device and what it counts.
type Built = (Box<dyn UsbDevice>, SharedCounts);

impl DeviceFile {
    fn evk4(&self, number: usize, sync: SyncWire, trigger: TriggerLine) -> Result<Built, RigError> {
        let serial = u32::from_str_radix(&self.serial, 16)
            .map_err(|_| RigError::Serial { name: self.name.clone(), serial: self.serial.clone() })?;
        let default = Evk4Options::default();
        let options = Evk4Options {
            serial,
            sync,
            trigger,
            latency_ns: self.latency_ms * 1_000_000,
            queue_bytes: queue_bytes(self.queue_mib, default.queue_bytes),
            faults: self.faults.clone(),
            ..default
        };
        let stimulus = match &self.raw {
            Some(path) => Stimulus::Words(RecordedWords::open(path)?),
            None => Stimulus::Scene(self.event_scene(number, [1280, 720])?),
        };
        let device = Evk4::new(options, stimulus);
        let counts = device.counts();
        Ok((Box::new(device), counts))
    }

    fn davis346(&self, number: usize, sync: SyncWire, trigger: TriggerLine) -> Result<Built, RigError> {
        let default = Davis346Options::default();
        let options = Davis346Options {
            serial: self.serial.clone(),
            master: !self.slave,
            sync,
            trigger,
            latency_ns: self.latency_ms * 1_000_000,
            queue_bytes: queue_bytes(self.queue_mib, default.queue_bytes),
            faults: self.faults.clone(),
            ..default
        };
        let mut device =
            Davis346::new(options, self.event_scene(number, [346, 260])?, self.frame_scene(number, [346, 260])?);
        device.prepare();
        let counts = device.counts();
        Ok((Box::new(device), counts))
    }

    fn uvc(&self, number: usize, trigger: TriggerLine) -> Result<Built, RigError> {
        let or = |given: &[Format], default: Vec<Format>| if given.is_empty() { default } else { given.to_vec() };
        let default = UvcOptions::default();
        let sizes = if self.sizes.is_empty() { default.sizes.clone() } else { self.sizes.clone() };
        let side = |length: u32| u16::try_from(length).unwrap_or(u16::MAX);
        let size = [side(sizes[0].0), side(sizes[0].1)];
        let options = UvcOptions {
            name: format!("Emulated camera {}", self.name),
            serial: self.serial.clone(),
            speed: Speed::High,
            formats: or(&self.formats, default.formats.clone()),
            sizes,
            rates_hz: if self.rates_hz.is_empty() { default.rates_hz.clone() } else { self.rates_hz.clone() },
            trigger: self.triggered.then_some(trigger),
            faults: self.faults.clone(),
            ..default
        };
        let mut device = Uvc::new(options, self.frame_scene(number, size)?);
        device.prepare();
        let counts = device.counts();
        Ok((Box::new(device), counts))
    }

    fn u3v(&self, number: usize, trigger: TriggerLine) -> Result<Built, RigError> {
        let default = U3vOptions::default();
        let sensor = self.sizes.first().map_or(default.sensor, |&(width, height)| [width, height]);
        let side = |length: u32| u16::try_from(length).unwrap_or(u16::MAX);
        let options = U3vOptions {
            serial: self.serial.clone(),
            name: self.name.clone(),
            sensor,
            trigger: self.triggered.then_some(trigger),
            clock: self.faults.clock,
            faults: self.blocks.clone(),
            ..default
        };
        let device = U3v::new(options, self.frame_scene(number, sensor.map(side))?);
        let counts = device.counts();
        Ok((Box::new(device), counts))
    }
}
