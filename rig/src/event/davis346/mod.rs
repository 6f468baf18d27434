//! iniVation DAVIS346 (346×260): events, frames, inertial samples and external edges in one stream of words.
//!
//! Facts and their sources: `docs/reference/event-cameras.md`.

mod bias;
mod config;
mod knobs;
#[allow(dead_code, reason = "the table names all parameters of the device")]
mod spi;

use std::{sync::Arc, time::Duration};

use erfgs_events::EventEncoding;
use erfgs_session::source::{Encoding, Knob};
use serde_json::{Map, Value, json};

pub use bias::BiasCurrents;
pub use config::{Davis346Config, Events, ExternalInput, Frames, Imu, OnStall, Shutter, Timestamps};

use self::{
    config::range_code,
    spi::{Parameter, Spi},
};
use super::{Driver, EventError, StreamConfig, Window};
use crate::{
    not_applied::NotApplied,
    usb::{Identity, Transport, cameras},
};

const MODEL: &str = "iniVation DAVIS346";
/// Columns of the sensor.
pub const WIDTH: u16 = 346;
/// Rows of the sensor.
pub const HEIGHT: u16 = 260;

/// Where data comes from.
const DATA: u8 = 0x82;
/// Logic that this driver knows, and its oldest patch level (libcaer, `davis.h`: 18 and 1 for the FX3).
const LOGIC: u32 = 18;
const PATCH: u32 = 1;
/// Oldest firmware, in the low byte of `bcdDevice`.
const FIRMWARE: u16 = 6;

/// Everything that runs, in the order in which it is stopped.
const RUNNING: [Parameter; 11] = [
    spi::DVS_RUN,
    spi::APS_RUN,
    spi::IMU_ACCELEROMETER,
    spi::IMU_GYROSCOPE,
    spi::IMU_THERMOMETER,
    spi::EXTERNAL_RUN,
    spi::EXTERNAL_GENERATOR,
    spi::MUX_RUN,
    spi::MUX_TIMESTAMP_RUN,
    spi::USB_RUN,
    spi::MUX_CHIP_RUN,
];

/// The chip's multiplexers and test circuits, all out of the way; a Gray counter for the ADC (libcaer).
#[rustfmt::skip]
const CHIP: [(Parameter, u32); 15] = [
    (Parameter(5, 128), 0), (Parameter(5, 129), 0), (Parameter(5, 130), 0), (Parameter(5, 131), 0),
    (Parameter(5, 132), 0), (Parameter(5, 133), 0), (Parameter(5, 134), 0), (Parameter(5, 135), 0),
    (Parameter(5, 136), 1), (Parameter(5, 137), 0), (Parameter(5, 138), 1), (Parameter(5, 140), 0),
    (Parameter(5, 141), 0), (Parameter(5, 143), 1), (Parameter(5, 144), 0),
];

/// What the camera says of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Features {
    logic: u32,
    patch: u32,
    master: bool,
    /// Cycles a microsecond.
    adc_clock: f64,
    usb_clock: f64,
    dvs_orientation: u32,
    aps_orientation: u32,
    imu_orientation: u32,
    imu_type: u32,
    mask: bool,
    activity: bool,
    region: bool,
    skip: bool,
    polarity: bool,
    global_shutter: bool,
    statistics: bool,
}

/// An opened DAVIS346.
pub struct Davis346 {
    spi: Spi,
    serial: String,
    features: Features,
    config: Davis346Config,
    settings: Map<String, Value>,
    lost: u64,
}

fn cycles(microseconds: u32, clock: f64) -> u32 {
    (f64::from(microseconds) * clock).round() as u32
}

impl Davis346 {
    fn read_features(spi: &Spi) -> Result<Features, EventError> {
        let deviation = f64::from(spi.read(spi::SYSTEM_DEVIATION)?) / 1000.0;
        Ok(Features {
            logic: spi.read(spi::SYSTEM_LOGIC)?,
            patch: spi.read(spi::SYSTEM_PATCH)?,
            master: spi.has(spi::SYSTEM_MASTER)?,
            adc_clock: f64::from(spi.read(spi::SYSTEM_ADC_CLOCK)?) * deviation,
            usb_clock: f64::from(spi.read(spi::SYSTEM_USB_CLOCK)?) * deviation,
            dvs_orientation: spi.read(spi::DVS_ORIENTATION)?,
            aps_orientation: spi.read(spi::APS_ORIENTATION)?,
            imu_orientation: spi.read(spi::IMU_ORIENTATION)?,
            imu_type: spi.read(spi::IMU_TYPE)?,
            mask: spi.has(spi::DVS_HAS_MASK)?,
            activity: spi.has(spi::DVS_HAS_ACTIVITY)?,
            region: spi.has(spi::DVS_HAS_REGION)?,
            skip: spi.has(spi::DVS_HAS_SKIP)?,
            polarity: spi.has(spi::DVS_HAS_POLARITY)?,
            global_shutter: spi.has(spi::APS_HAS_GLOBAL)?,
            statistics: spi.has(spi::MUX_HAS_STATISTICS)?,
        })
    }

    fn stop_all(&self) -> Result<(), EventError> {
        RUNNING.iter().try_for_each(|&parameter| self.spi.write(parameter, 0))
    }

    /// Filters of the events, as far as the camera has them.
    fn write_event_filters(&self) -> Result<(), EventError> {
        let Events { background_activity_us, refractory_us, masked_pixels, region, .. } = &self.config.events;
        let exchanged = self.features.dvs_orientation & 0b100 != 0;
        let (columns, rows) = if exchanged { (HEIGHT, WIDTH) } else { (WIDTH, HEIGHT) };
        let missing = |name: &str| {
            Err(EventError::setting(format!("events.{name}"), "set", "nothing: this camera has no such filter"))
        };
        if self.features.mask {
            for slot in 0..8_u8 {
                // A pixel outside of the chip masks nothing.
                let (column, row) = match masked_pixels.get(usize::from(slot)) {
                    Some(&[x, y]) if exchanged => (y, x),
                    Some(&[x, y]) => (x, y),
                    None => (columns, rows),
                };
                self.spi.write(spi::DVS_MASK.after(2 * slot), row.into())?;
                self.spi.write(spi::DVS_MASK.after(2 * slot + 1), column.into())?;
            }
        } else if !masked_pixels.is_empty() {
            return missing("masked_pixels");
        }
        if self.features.activity {
            self.spi.write_each(&[
                (spi::DVS_ACTIVITY, u32::from(*background_activity_us > 0)),
                (spi::DVS_ACTIVITY_TIME, (background_activity_us / 250).max(1)),
                (spi::DVS_REFRACTORY, u32::from(*refractory_us > 0)),
                (spi::DVS_REFRACTORY_TIME, (refractory_us / 250).max(1)),
            ])?;
        } else if *refractory_us > 0 {
            return missing("refractory_us");
        }
        if self.features.region {
            let whole = Window { x: 0, y: 0, width: WIDTH, height: HEIGHT };
            let Window { x, y, width, height } = region.unwrap_or(whole);
            let [left, top, columns, rows] = if exchanged { [y, x, height, width] } else { [x, y, width, height] };
            self.spi.write_each(&[
                (spi::DVS_REGION, left.into()),
                (spi::DVS_REGION.after(1), top.into()),
                (spi::DVS_REGION.after(2), u32::from(left + columns) - 1),
                (spi::DVS_REGION.after(3), u32::from(top + rows) - 1),
            ])?;
        } else if region.is_some() {
            return missing("region");
        }
        if self.features.skip {
            self.spi.write(spi::DVS_SKIP, 0)?;
        }
        if self.features.polarity {
            self.spi.write_each(&[
                (spi::DVS_POLARITY, 0),
                (spi::DVS_POLARITY.after(1), 0),
                (spi::DVS_POLARITY.after(2), 0),
            ])?;
        }
        Ok(())
    }

    fn write_frames(&self) -> Result<(), EventError> {
        let Frames { exposure_us, interval_us, shutter, .. } = self.config.frames;
        let exchanged = self.features.aps_orientation & 0b100 != 0;
        let (columns, rows) = if exchanged { (HEIGHT, WIDTH) } else { (WIDTH, HEIGHT) };
        let global = u32::from(shutter == Shutter::Global && self.features.global_shutter);
        self.spi.write_each(&[
            (spi::APS_WAIT, 1),
            (spi::APS_GLOBAL, global),
            (spi::CHIP_GLOBAL, global),
            (spi::APS_REGION, 0),
            (spi::APS_REGION.after(1), 0),
            (spi::APS_REGION.after(2), u32::from(columns) - 1),
            (spi::APS_REGION.after(3), u32::from(rows) - 1),
            (spi::APS_EXPOSURE, cycles(exposure_us, self.features.adc_clock)),
            (spi::APS_INTERVAL, cycles(interval_us, self.features.adc_clock)),
        ])
    }

    fn write_imu(&self) -> Result<(), EventError> {
        let Imu { accelerometer_g, gyroscope_dps, divider, .. } = self.config.imu;
        self.spi.write_each(&[
            (spi::IMU_DIVIDER, divider - 1),
            (spi::IMU_LOW_PASS, 1),
            (spi::IMU_ACCELEROMETER_RANGE, range_code(accelerometer_g, 2).unwrap_or(1)),
            (spi::IMU_GYROSCOPE_RANGE, range_code(gyroscope_dps, 250).unwrap_or(1)),
        ])?;
        if self.features.imu_type == 2 {
            self.spi.write(spi::IMU_GYROSCOPE_LOW_PASS, 1)?;
        }
        Ok(())
    }

    /// Reads back what the camera has now.
    fn read_settings(&self, biases: Value) -> Result<Map<String, Value>, EventError> {
        let (spi, features) = (&self.spi, &self.features);
        let identity = spi.transport.identity();
        let microseconds = |parameter| -> Result<f64, EventError> {
            Ok((f64::from(spi.read(parameter)?) / features.adc_clock * 1000.0).round() / 1000.0)
        };
        let global = spi.has(spi::APS_GLOBAL)?;
        let value = json!({
            "firmware": identity.version & 0xFF,
            "logic": features.logic,
            "logic_patch": features.patch,
            "clock_master": features.master,
            "usb": { "device": identity.to_string(), "link": identity.speed.to_string() },
            "orientation": {
                "events": features.dvs_orientation,
                "frames": features.aps_orientation,
                "imu": features.imu_orientation,
            },
            "imu_type": features.imu_type,
            "adc_clock_mhz": features.adc_clock,
            "biases": biases,
            "events": self.config.events,
            "drops_events_on_stall": spi.has(spi::MUX_DROP_EVENTS)?,
            "drops_edges_on_stall": spi.has(spi::MUX_DROP_EXTERNAL)?,
            "frames": {
                "enabled": self.config.frames.enabled,
                "exposure_us": microseconds(spi::APS_EXPOSURE)?,
                "interval_us": microseconds(spi::APS_INTERVAL)?,
                "shutter": if global { Shutter::Global } else { Shutter::Rolling },
            },
            "imu": {
                "enabled": self.config.imu.enabled,
                "accelerometer_g": 2 << (spi.read(spi::IMU_ACCELEROMETER_RANGE)? & 3),
                "gyroscope_dps": 250 << (spi.read(spi::IMU_GYROSCOPE_RANGE)? & 3),
                "divider": spi.read(spi::IMU_DIVIDER)?.saturating_add(1),
            },
            "external_input": {
                "rising": spi.has(spi::EXTERNAL_RISING)?,
                "falling": spi.has(spi::EXTERNAL_FALLING)?,
            },
            "timestamps": self.config.timestamps,
            "counts_drops": features.statistics,
        });
        let mut settings = if let Value::Object(map) = value { map } else { Map::new() };
        self.not_applied(global).tell(&mut settings);
        Ok(settings)
    }

    /// What was asked for and this camera cannot do. Filters that are not there are refused instead, where they are not
    /// on by default.
    fn not_applied(&self, global: bool) -> NotApplied {
        let mut missed = NotApplied::default();
        let Davis346Config { events, frames, imu, .. } = &self.config;
        if events.background_activity_us > 0 && !self.features.activity {
            missed.because("events.background_activity_us", "the camera has no such filter");
        }
        if frames.shutter == Shutter::Global && !global {
            missed.because("frames.shutter = \"global\"", "the camera's shutter rolls");
        }
        if imu.enabled && self.features.imu_type == 0 {
            missed.because("imu", "the camera has no inertial unit");
        }
        missed
    }

    /// Sets the time stamps of this camera and of the slaves chained to it to zero.
    ///
    /// # Errors
    /// If it does not answer.
    pub fn reset_timestamps(&self) -> Result<(), EventError> {
        self.spi.write_together(&[(spi::MUX_TIMESTAMP_RESET, 1), (spi::MUX_TIMESTAMP_RESET, 0)])
    }
}

impl Driver for Davis346 {
    type Config = Davis346Config;
    const MODEL: &'static str = MODEL;
    const ADJUSTABLE: &'static [&'static str] = &["biases", "events", "frames"];

    fn is_candidate(identity: &Identity) -> bool {
        cameras::is_davis346(identity)
    }

    fn connect(transport: Arc<dyn Transport>) -> Result<Self, EventError> {
        let identity = transport.identity().clone();
        let place = format!("{}:{}", identity.bus, identity.address);
        let wrong = |found: String| EventError::WrongDevice { device: identity.to_string(), model: MODEL, found };
        let interface = transport
            .interfaces()
            .iter()
            .find(|interface| interface.endpoints.iter().any(|endpoint| endpoint.bulk && endpoint.address == DATA))
            .ok_or_else(|| wrong("it has no bulk endpoint 0x82".into()))?
            .number;
        let mut spi = Spi { name: format!("{MODEL} at {place}"), transport };
        spi.transport.claim(interface, false).map_err(|source| EventError::Transport {
            camera: spi.name.clone(),
            step: "take the data interface".into(),
            source,
        })?;
        let serial = spi.transport.serial().unwrap_or("00000000").to_owned();
        spi.name = format!("{MODEL} {serial} at {place}");
        if identity.version & 0xFF < FIRMWARE {
            return Err(EventError::Firmware {
                camera: spi.name,
                part: "firmware",
                found: (identity.version & 0xFF).to_string(),
                needed: "6 or later",
            });
        }
        let (logic, patch) = (spi.read(spi::SYSTEM_LOGIC)?, spi.read(spi::SYSTEM_PATCH)?);
        if logic != LOGIC || patch < PATCH {
            return Err(EventError::Firmware {
                camera: spi.name,
                part: "logic",
                found: format!("{logic} patch {patch}"),
                needed: "version 18, patch 1 or later,",
            });
        }
        // A DAVIS240 or 640 has the same identifiers.
        let (columns, rows) = (spi.read(spi::DVS_COLUMNS)?, spi.read(spi::DVS_ROWS)?);
        let ours = (u32::from(WIDTH), u32::from(HEIGHT));
        if (columns, rows) != ours && (rows, columns) != ours {
            return Err(wrong(format!("its sensor has {columns} by {rows} pixels")));
        }
        let features = Self::read_features(&spi)?;
        Ok(Self { spi, serial, features, config: Davis346Config::default(), settings: Map::new(), lost: 0 })
    }

    fn serial(&self) -> &str {
        &self.serial
    }

    fn wanted_serial(config: &Davis346Config) -> &str {
        &config.serial
    }

    fn validate(config: &Davis346Config) -> Result<(), EventError> {
        config.validate()
    }

    fn stream_config(config: &Davis346Config) -> StreamConfig {
        config.stream
    }

    fn transport(&self) -> &Arc<dyn Transport> {
        &self.spi.transport
    }

    fn name(&self) -> &str {
        &self.spi.name
    }

    fn endpoint(&self) -> u8 {
        DATA
    }

    fn configure(&mut self, config: &Davis346Config) -> Result<(), EventError> {
        self.config = config.clone();
        self.lost = 0;
        self.stop_all()?;
        self.spi.transport.wait(Duration::from_millis(100));
        let biases = bias::write(&self.spi, &config.biases)?;
        self.spi.write_each(&CHIP)?;
        self.spi.transport.wait(Duration::from_millis(10));
        self.spi.write(spi::MUX_CHIP_RUN, 1)?;
        // An unfinished transfer is sent after 1 ms, so that a quiet scene is seen at once.
        self.spi.write(spi::USB_DELAY, cycles(1000, self.features.usb_clock))?;
        self.spi.transport.wait(Duration::from_millis(200));
        let ExternalInput { rising, falling } = config.external_input;
        let wait = u32::from(config.events.on_stall == OnStall::Wait);
        self.spi.write_each(&[
            (spi::MUX_DROP_EVENTS, 1 - wait),
            // Edges carry the clock of the rig: they are never dropped.
            (spi::MUX_DROP_EXTERNAL, 0),
            (spi::DVS_WAIT, wait),
            (spi::DVS_EXTERNAL_CONTROL, 0),
            (spi::EXTERNAL_RISING, rising.into()),
            (spi::EXTERNAL_FALLING, falling.into()),
            (spi::EXTERNAL_PULSES, 0),
        ])?;
        self.write_event_filters()?;
        self.write_frames()?;
        self.write_imu()?;
        self.settings = self.read_settings(biases)?;
        Ok(())
    }

    fn adjust(&mut self, config: &Davis346Config) -> Result<(), EventError> {
        let before = std::mem::replace(&mut self.config, config.clone());
        if before.events != config.events {
            self.write_event_filters()?;
        }
        if before.frames != config.frames {
            self.write_frames()?;
        }
        let biases = bias::write(&self.spi, &config.biases)?;
        self.settings = self.read_settings(biases)?;
        Ok(())
    }

    fn knobs(config: &Davis346Config) -> Vec<Knob> {
        config.knobs()
    }

    fn settings(&self) -> &Map<String, Value> {
        &self.settings
    }

    fn encoding(&self) -> Encoding {
        Encoding::Events(EventEncoding::Davis)
    }

    fn size(&self) -> (u32, u32) {
        (WIDTH.into(), HEIGHT.into())
    }

    /// Slaves start first: the master's reset of time stamps then reaches them while they run.
    fn start_order(&self) -> i32 {
        if self.features.master { 10 } else { -10 }
    }

    fn run(&mut self) -> Result<(), EventError> {
        let Davis346Config { events, frames, imu, external_input, .. } = &self.config;
        let has_imu = imu.enabled && self.features.imu_type != 0;
        self.spi.write_each(&[(spi::USB_RUN, 1), (spi::MUX_TIMESTAMP_RUN, 1), (spi::MUX_RUN, 1)])?;
        self.spi.transport.wait(Duration::from_millis(50));
        // Before anything is dated: the recording has one time from its first event on.
        if self.config.timestamps == Timestamps::Reset && self.features.master {
            self.reset_timestamps()?;
        }
        self.spi.write_each(&[
            (spi::DVS_RUN, events.enabled.into()),
            (spi::APS_RUN, frames.enabled.into()),
            (spi::IMU_ACCELEROMETER, has_imu.into()),
            (spi::IMU_GYROSCOPE, has_imu.into()),
            (spi::IMU_THERMOMETER, has_imu.into()),
            (spi::EXTERNAL_RUN, (external_input.rising || external_input.falling).into()),
        ])
    }

    fn halt(&mut self) -> Result<(), EventError> {
        self.stop_all()?;
        // The chip stays powered, so that its photoreceptors are settled when it runs again.
        self.spi.write(spi::MUX_CHIP_RUN, 1)
    }

    fn shut_down(&mut self) -> Result<(), EventError> {
        self.stop_all()
    }

    fn readings(&mut self) -> Result<Vec<(String, f64)>, EventError> {
        if !self.features.statistics {
            return Ok(Vec::new());
        }
        let external = self.spi.read_long(spi::MUX_EXTERNAL_DROPPED)?;
        let events = self.spi.read_long(spi::MUX_EVENTS_DROPPED)?;
        self.lost = external.saturating_add(events);
        Ok(vec![("dropped_edges".into(), external as f64), ("dropped_events".into(), events as f64)])
    }

    fn lost(&self) -> u64 {
        self.lost
    }
}
