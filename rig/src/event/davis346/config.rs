//! Settings of a DAVIS346.

use serde::{Deserialize, Serialize};

use super::{HEIGHT, WIDTH, bias::BiasCurrents};
use crate::event::{EventError, StreamConfig, Window};

/// Settings of a DAVIS346. All have defaults, the maker's where it has any.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Davis346Config {
    /// Serial number, as `erfgs devices` shows it. Empty: the only DAVIS346 there is.
    pub serial: String,
    /// Currents of the biases.
    pub biases: BiasCurrents,
    /// Events.
    pub events: Events,
    /// Frames of the sensor's own pixels, stamped with the clock of the events.
    pub frames: Frames,
    /// Inertial unit.
    pub imu: Imu,
    /// Edges at the external input.
    pub external_input: ExternalInput,
    /// Time stamps.
    pub timestamps: Timestamps,
    /// How data is fetched.
    pub stream: StreamConfig,
}

/// Events of a DAVIS346.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Events {
    /// Whether events are sent.
    pub enabled: bool,
    /// What happens while USB does not keep up.
    pub on_stall: OnStall,
    /// Events without a neighbour within this long are dropped, 250 µs to 1 s in steps of 250 µs; `0`: none.
    pub background_activity_us: u32,
    /// A pixel is silent for this long after an event, 250 µs to 1 s in steps of 250 µs; `0`: not.
    pub refractory_us: u32,
    /// Pixels (column, row) that must stay silent: at most 8.
    pub masked_pixels: Vec<[u16; 2]>,
    /// Part of the image that events come from; all of it by default.
    pub region: Option<Window>,
}

impl Default for Events {
    fn default() -> Self {
        Self {
            enabled: true,
            on_stall: OnStall::Drop,
            background_activity_us: 2000,
            refractory_us: 0,
            masked_pixels: Vec::new(),
            region: None,
        }
    }
}

/// What a DAVIS346 does with events that USB does not take in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnStall {
    /// Drop and count them; time stamps stay true.
    #[default]
    Drop,
    /// Hold them back, and with them everything else.
    Wait,
}

/// Frames of a DAVIS346.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Frames {
    /// Whether frames are sent.
    pub enabled: bool,
    /// Exposure, 1 µs to 1 s.
    pub exposure_us: u32,
    /// Time between the starts of two frames, up to 8 s; longer than exposure and read-out.
    pub interval_us: u32,
    /// Shutter.
    pub shutter: Shutter,
}

impl Default for Frames {
    fn default() -> Self {
        Self { enabled: true, exposure_us: 4000, interval_us: 40_000, shutter: Shutter::Global }
    }
}

/// Shutter of the frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shutter {
    /// All pixels are exposed at once.
    #[default]
    Global,
    /// Column after column.
    Rolling,
}

/// Inertial unit of a DAVIS346.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Imu {
    /// Whether its samples are sent.
    pub enabled: bool,
    /// Range of the accelerometer: 2, 4, 8 or 16 g.
    pub accelerometer_g: u32,
    /// Range of the gyroscope: 250, 500, 1000 or 2000 °/s.
    pub gyroscope_dps: u32,
    /// Its rate, 1 kHz, is divided by this, 1 to 256.
    pub divider: u32,
}

impl Default for Imu {
    fn default() -> Self {
        Self { enabled: true, accelerometer_g: 4, gyroscope_dps: 500, divider: 1 }
    }
}

/// External input of a DAVIS346.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExternalInput {
    /// Whether rising edges are in the stream.
    pub rising: bool,
    /// Whether falling edges are in the stream.
    pub falling: bool,
}

impl Default for ExternalInput {
    fn default() -> Self {
        Self { rising: true, falling: true }
    }
}

/// Time stamps of a DAVIS346.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Timestamps {
    /// The master of a chain, and a camera on its own, sets all its slaves' and its own to zero when it starts.
    #[default]
    Reset,
    /// They go on.
    Keep,
}

/// Code of a range among the four that the inertial unit has: 0 for `smallest`, 1 for twice that, and so on.
pub(super) fn range_code(value: u32, smallest: u32) -> Option<u32> {
    (0..4).find(|code| smallest << code == value)
}

impl Davis346Config {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`EventError::Setting`] names the first value out of range.
    pub fn validate(&self) -> Result<(), EventError> {
        let check = EventError::check::<u32>;
        self.biases.validate()?;
        for (name, time) in [
            ("events.background_activity_us", self.events.background_activity_us),
            ("events.refractory_us", self.events.refractory_us),
        ] {
            check(name, time, 0..=1_000_000)?;
            if !time.is_multiple_of(250) {
                return Err(EventError::setting(name, time, "a multiple of 250"));
            }
        }
        check("events.masked_pixels (how many)", u32::try_from(self.events.masked_pixels.len()).unwrap_or(9), 0..=8)?;
        for &[x, y] in &self.events.masked_pixels {
            check("events.masked_pixels (column)", x.into(), 0..=u32::from(WIDTH) - 1)?;
            check("events.masked_pixels (row)", y.into(), 0..=u32::from(HEIGHT) - 1)?;
        }
        if let Some(window) = &self.events.region {
            check("events.region.width", window.width.into(), 1..=WIDTH.into())?;
            check("events.region.height", window.height.into(), 1..=HEIGHT.into())?;
            check("events.region.x", window.x.into(), 0..=(WIDTH - window.width).into())?;
            check("events.region.y", window.y.into(), 0..=(HEIGHT - window.height).into())?;
        }
        check("frames.exposure_us", self.frames.exposure_us, 1..=1_000_000)?;
        check("frames.interval_us", self.frames.interval_us, self.frames.exposure_us..=8_000_000)?;
        if range_code(self.imu.accelerometer_g, 2).is_none() {
            return Err(EventError::setting("imu.accelerometer_g", self.imu.accelerometer_g, "2, 4, 8 or 16"));
        }
        if range_code(self.imu.gyroscope_dps, 250).is_none() {
            return Err(EventError::setting("imu.gyroscope_dps", self.imu.gyroscope_dps, "250, 500, 1000 or 2000"));
        }
        check("imu.divider", self.imu.divider, 1..=256)?;
        self.stream.validate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_table_is_the_default() {
        assert_eq!(toml::from_str::<Davis346Config>("").unwrap(), Davis346Config::default());
        Davis346Config::default().validate().unwrap();
    }

    #[test]
    fn a_full_table_reads_and_writes_back() {
        let text = r#"
            serial = "00000123"
            timestamps = "keep"
            biases = { on = 300000, off = 100 }
            events = { on_stall = "wait", refractory_us = 500, masked_pixels = [[345, 259]] }
            frames = { exposure_us = 2000, shutter = "rolling" }
            imu = { enabled = false, accelerometer_g = 16, gyroscope_dps = 2000 }
            external_input = { falling = false }
        "#;
        let config: Davis346Config = toml::from_str(text).unwrap();
        config.validate().unwrap();
        let again: Davis346Config = toml::from_str(&toml::to_string(&config).unwrap()).unwrap();
        assert_eq!(again, config);
    }

    #[test]
    fn unknown_fields_and_values_out_of_range_are_refused() {
        assert!(toml::from_str::<Davis346Config>("exposure_us = 3").is_err());
        for (text, named) in [
            ("biases = { on = 24800001 }", "biases.on"),
            ("events = { refractory_us = 100 }", "events.refractory_us"),
            ("events = { masked_pixels = [[346, 0]] }", "masked_pixels"),
            ("events = { region = { x = 0, y = 1, width = 346, height = 260 } }", "region.y"),
            ("frames = { exposure_us = 50000 }", "frames.interval_us"),
            ("imu = { accelerometer_g = 3 }", "imu.accelerometer_g"),
            ("imu = { divider = 0 }", "imu.divider"),
        ] {
            let error = toml::from_str::<Davis346Config>(text).unwrap().validate().unwrap_err().to_string();
            assert!(error.contains(named) && error.contains("allowed"), "{text}: {error}");
        }
    }
}
