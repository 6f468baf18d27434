//! Prophesee EVK4 (sensor IMX636, 1280×720), and cameras with the same board: EVK3 HD, CenturyArks SilkyEvCam HD.
//!
//! Facts and their sources: `docs/reference/event-cameras.md`.

mod bias;
mod bias_file;
mod board;
mod config;
mod filter;
mod identify;
mod knobs;
mod monitor;
mod rate;
mod region;
mod sequence;
#[allow(dead_code, reason = "the protocol has properties that the driver does not ask for")]
mod treuzell;

use std::{sync::Arc, time::Duration};

use erfgs_events::EventEncoding;
use erfgs_session::source::{Encoding, Knob};
use serde_json::{Map, Value, json};

pub use config::{
    AntiFlicker, AntiFlickerMode, BiasOffsets, Evk4Config, Format, MaskRows, RateLimit, Region, RegionMode, SyncRole,
    TrailFilter, TrailKind, TriggerInput,
};
pub(super) use identify::Found;

use self::{board::Board, sequence::play};
use super::{Driver, EventError, StreamConfig};
use crate::{
    not_applied::NotApplied,
    usb::{Identity, Transport, cameras},
};

pub(super) const MODEL: &str = "Prophesee EVK4";
/// Columns of the sensor.
pub const WIDTH: u16 = 1280;
/// Rows of the sensor.
pub const HEIGHT: u16 = 720;

const TIME_BASE: u32 = 0x9008;
const SYNC_PAD: u32 = 0x0044;
const PIPELINE: u32 = 0x7000;
const OUTPUT: u32 = 0x8000;
const TRIGGER: u32 = 0x7004;
const TRIGGER_ON: u32 = 1 << 10;

/// An opened EVK4.
pub struct Evk4 {
    board: Board,
    found: Found,
    config: Evk4Config,
    /// Biases as the unit was trimmed; read when it is configured.
    trim: Option<[u8; 6]>,
    settings: Map<String, Value>,
}

impl sequence::Registers for &Board {
    type Error = EventError;
    fn write(&mut self, address: u32, value: u32) -> Result<(), EventError> {
        Board::write(self, address, value)
    }
    fn change(&mut self, address: u32, mask: u32, value: u32) -> Result<(), EventError> {
        Board::change(self, address, mask, value)
    }
    fn wait(&mut self, duration: Duration) {
        self.transport.wait(duration);
    }
}

impl Evk4 {
    fn play(&self, steps: &[sequence::Op]) -> Result<(), EventError> {
        play(steps, &mut &self.board)
    }

    /// Format of the events: bit 1 of the pipeline's register and bits 6 and 7 of the output's (OpenEB,
    /// `imx636_tz_device.cpp`, `set_output_format`).
    fn write_format(&self) -> Result<(), EventError> {
        let (pipeline, output) = match self.config.format {
            Format::Evt3 => (0, 2),
            Format::Evt21 => (1, 0),
        };
        self.board.change(PIPELINE, 1 << 1, pipeline << 1)?;
        self.board.change(OUTPUT, 0b11 << 6, output << 6)
    }

    /// Role in a chain: bits 1 to 3 of the time base and the direction of the sync pad (OpenEB, `time_base_config`).
    /// Bits 4 to 10 hold 100, which makes a tick one microsecond.
    fn write_sync(&self) -> Result<(), EventError> {
        // Bit 0 of a role: external time base; bit 1: master; bit 2: external mode enabled.
        let (role, pad) = match self.config.sync {
            SyncRole::Standalone => (0b010, None),
            SyncRole::Master => (0b111, Some(0b1100)),
            SyncRole::Slave => (0b101, Some(0b1111)),
        };
        self.board.change(TIME_BASE, 0b111 << 1 | 0x7F << 4, role << 1 | 100 << 4)?;
        if let Some(pad) = pad {
            self.board.change(SYNC_PAD, 0xF << 16, pad << 16)?;
        }
        Ok(())
    }

    /// Reads back what the camera has now.
    fn read_settings(&self, biases: Value, mut missed: NotApplied) -> Result<Map<String, Value>, EventError> {
        let board = &self.board;
        let trigger_on = board.read(TRIGGER)? & TRIGGER_ON != 0;
        missed.compare("external_trigger", self.config.external_trigger == TriggerInput::On, trigger_on);
        let limit = rate::read(board)?;
        let per_period = |limit: &Value| limit["events_per_period"].as_u64().unwrap_or(0);
        if let Some(wanted) = &self.config.rate_limit {
            missed.compare("rate_limit (events a period)", u64::from(rate::target(wanted)), per_period(&limit));
        }
        let mut registers = Map::new();
        for address in [
            0x0004, SYNC_PAD, 0x6008, 0x600C, 0x6050, PIPELINE, TRIGGER, OUTPUT, TIME_BASE, 0xB028, 0xC000, 0xC008,
            0xD000, 0xD004, 0xD008, 0xD00C, 0xD0C0,
        ] {
            registers.insert(format!("{address:#06x}"), format!("{:#010x}", board.read(address)?).into());
        }
        let identity = board.transport.identity();
        let value = json!({
            "board": self.found.board,
            "compatible": self.found.compatible,
            "firmware": self.found.firmware(),
            "firmware_built": self.found.build_date,
            "usb": { "device": identity.to_string(), "link": identity.speed.to_string() },
            "format": self.config.format,
            "biases": biases,
            "rate_limit": limit,
            "region": self.config.region,
            "masked_pixels": self.config.masked_pixels,
            "mask_rows": self.config.mask_rows,
            "anti_flicker": self.config.anti_flicker,
            "trail_filter": self.config.trail_filter,
            "external_trigger": trigger_on,
            "sync": self.config.sync,
            "burst_writes": board.bursts(),
            "registers": registers,
        });
        let mut settings = if let Value::Object(map) = value { map } else { Map::new() };
        missed.tell(&mut settings);
        Ok(settings)
    }
}

impl Driver for Evk4 {
    type Config = Evk4Config;
    const MODEL: &'static str = MODEL;
    const ADJUSTABLE: &'static [&'static str] =
        &["biases", "region", "masked_pixels", "rate_limit", "anti_flicker", "trail_filter"];

    fn is_candidate(identity: &Identity) -> bool {
        cameras::is_prophesee(identity)
    }

    fn connect(transport: Arc<dyn Transport>) -> Result<Self, EventError> {
        let (board, found) = identify::identify(transport)?;
        Ok(Self { board, found, config: Evk4Config::default(), trim: None, settings: Map::new() })
    }

    fn serial(&self) -> &str {
        &self.found.serial
    }

    fn wanted_serial(config: &Evk4Config) -> &str {
        &config.serial
    }

    fn validate(config: &Evk4Config) -> Result<(), EventError> {
        config.validate()
    }

    fn stream_config(config: &Evk4Config) -> StreamConfig {
        config.stream
    }

    fn transport(&self) -> &Arc<dyn Transport> {
        &self.board.transport
    }

    fn name(&self) -> &str {
        &self.board.name
    }

    fn endpoint(&self) -> u8 {
        self.board.endpoints.data
    }

    /// The order is OpenEB's: stop, destroy, init, then the monitors, then options. Takes 2.6 s, most of it the resets
    /// of the opening sequence.
    fn configure(&mut self, config: &Evk4Config) -> Result<(), EventError> {
        self.config = config.clone();
        self.play(sequence::STOP)?;
        self.play(sequence::DESTROY)?;
        self.play(sequence::INIT)?;
        monitor::enable(&self.board)?;
        let trim = bias::read_trim(&self.board)?;
        self.trim = Some(trim);
        rate::write(&self.board, config.rate_limit.as_ref())?;
        self.write_format()?;
        self.board.change(
            TRIGGER,
            TRIGGER_ON,
            if config.external_trigger == TriggerInput::On { TRIGGER_ON } else { 0 },
        )?;
        region::write(&self.board, config.region.as_ref(), config.mask_rows)?;
        region::write_pixels(&self.board, &config.masked_pixels, config.mask_rows)?;
        filter::write_anti_flicker(&self.board, config.anti_flicker.as_ref())?;
        filter::write_trail(&self.board, config.trail_filter.as_ref())?;
        self.write_sync()?;
        let mut missed = NotApplied::default();
        let biases = bias::write(&self.board, &trim, [&BiasOffsets::default(), &config.biases], &mut missed)?;
        self.settings = self.read_settings(biases, missed)?;
        Ok(())
    }

    /// What differs is written, in the order of the opening; a window of the sensor and a filter take some milliseconds in
    /// which events may be missing.
    fn adjust(&mut self, config: &Evk4Config) -> Result<(), EventError> {
        let before = std::mem::replace(&mut self.config, config.clone());
        if before.rate_limit != config.rate_limit {
            rate::write(&self.board, config.rate_limit.as_ref())?;
        }
        if before.region != config.region {
            region::write(&self.board, config.region.as_ref(), config.mask_rows)?;
        }
        if before.masked_pixels != config.masked_pixels {
            region::write_pixels(&self.board, &config.masked_pixels, config.mask_rows)?;
        }
        if before.anti_flicker != config.anti_flicker {
            filter::write_anti_flicker(&self.board, config.anti_flicker.as_ref())?;
        }
        if before.trail_filter != config.trail_filter {
            filter::write_trail(&self.board, config.trail_filter.as_ref())?;
        }
        let trim = match self.trim {
            Some(trim) => trim,
            None => bias::read_trim(&self.board)?,
        };
        let mut missed = NotApplied::default();
        let biases = bias::write(&self.board, &trim, [&before.biases, &config.biases], &mut missed)?;
        self.settings = self.read_settings(biases, missed)?;
        Ok(())
    }

    fn knobs(config: &Evk4Config) -> Vec<Knob> {
        config.knobs()
    }

    fn settings(&self) -> &Map<String, Value> {
        &self.settings
    }

    fn encoding(&self) -> Encoding {
        match self.config.format {
            Format::Evt3 => Encoding::Events(EventEncoding::Evt3),
            Format::Evt21 => Encoding::Events(EventEncoding::Evt21Legacy),
        }
    }

    fn size(&self) -> (u32, u32) {
        (WIDTH.into(), HEIGHT.into())
    }

    /// Slaves wait for the clock of their master, so that they start before it.
    fn start_order(&self) -> i32 {
        match self.config.sync {
            SyncRole::Slave => -10,
            SyncRole::Standalone => 0,
            SyncRole::Master => 10,
        }
    }

    fn run(&mut self) -> Result<(), EventError> {
        self.play(sequence::START)
    }

    fn halt(&mut self) -> Result<(), EventError> {
        self.play(sequence::STOP)
    }

    fn shut_down(&mut self) -> Result<(), EventError> {
        self.play(sequence::STOP)?;
        self.play(sequence::DESTROY)
    }

    fn readings(&mut self) -> Result<Vec<(String, f64)>, EventError> {
        let mut readings = Vec::new();
        if let Some(celsius) = monitor::temperature(&self.board)? {
            readings.push(("temperature_celsius".into(), celsius));
        }
        if let Some(lux) = monitor::illuminance(&self.board)? {
            readings.push(("illuminance_lux".into(), lux));
        }
        Ok(readings)
    }
}
