//! USB3 Vision cameras: listed, chosen, and as a link.

use std::{collections::VecDeque, sync::Arc, time::Duration};

use serde_json::{Map, Value, json};

use super::{
    choose::{Named, choose},
    link::{Device, Identity, Intake, Link},
};
use crate::{
    frame::{FoundCamera, FrameConfig, FrameError},
    genicam::{
        Block, Features, GenicamConfig, GenicamError, Order,
        u3v::{self, Found},
    },
    not_applied::NotApplied,
    usb::{Bus, LibusbBus},
};

/// The clock of these cameras counts nanoseconds.
const TICK_HZ: u64 = 1_000_000_000;

/// The USB3 Vision cameras of this machine.
///
/// # Errors
/// If the system does not list its USB devices.
pub fn list() -> Result<Vec<FoundCamera>, FrameError> {
    list_on(&LibusbBus)
}

/// The USB3 Vision cameras on a bus.
///
/// # Errors
/// If it does not list its devices.
pub fn list_on(bus: &dyn Bus) -> Result<Vec<FoundCamera>, FrameError> {
    let found = u3v::find(bus).map_err(|error| FrameError::List { reason: error.to_string() })?;
    Ok(found.iter().map(listed).collect())
}

fn listed(found: &Found) -> FoundCamera {
    let named = if found.name.is_empty() { String::new() } else { format!(" \"{}\"", found.name) };
    FoundCamera {
        name: format!("{}{named}", found.label()),
        serial: found.serial.clone(),
        bus: found.identity.port.clone(),
        node: format!("{:03}:{:03}", found.identity.bus, found.identity.address).into(),
        driver: "u3v".into(),
        formats: Vec::new(),
        link: Some(found.identity.speed.to_string()),
        problem: found.problem.clone(),
    }
}

/// A bus of this machine, or an emulated one.
pub struct U3vLink(pub Arc<dyn Bus>);

impl Link for U3vLink {
    const BACKEND: &'static str = "u3v";
    const ORDER: Order = Order::Little;
    type Device = U3vDevice;

    fn open(&self, config: &FrameConfig) -> Result<U3vDevice, FrameError> {
        let fail = |camera: String| {
            |source: GenicamError| FrameError::Genicam { id: config.id.clone(), camera, source: source.into() }
        };
        let wanted = config.camera.as_str();
        let found = u3v::find(&*self.0).map_err(GenicamError::from).map_err(fail(wanted.to_owned()))?;
        let found = choose(&config.id, wanted, found)?;
        let device = u3v::Device::open(&*self.0, &found).map_err(fail(identity(&found).full()))?;
        Ok(U3vDevice { found, device })
    }
}

impl Named for Found {
    const KIND: &'static str = "USB3 Vision camera";
    const NONE: &'static str = "no USB3 Vision camera is plugged in";

    fn names(&self) -> [String; 5] {
        let id = format!("{:04x}:{:04x}", self.identity.vendor, self.identity.product);
        [self.serial.clone(), self.identity.port.clone(), self.name.clone(), self.label(), id]
    }

    fn description(&self) -> String {
        format!("{} (serial {}, at {})", self.label(), self.serial, self.identity.port)
    }
}

fn identity(found: &Found) -> Identity {
    Identity {
        label: found.label(),
        serial: found.serial.clone(),
        place: found.identity.port.clone(),
        lasting: found.identity.port.clone(),
    }
}

/// A camera under control.
pub struct U3vDevice {
    found: Found,
    device: u3v::Device,
}

impl Device for U3vDevice {
    type Intake = U3vIntake;

    fn identity(&self) -> Identity {
        identity(&self.found)
    }

    fn features(&mut self) -> &mut Features {
        &mut self.device.features
    }

    fn tick_hz(&self) -> u64 {
        TICK_HZ
    }

    fn lost(&self) -> Option<String> {
        self.device.channel.silent()
    }

    fn prepare(&self, config: &GenicamConfig, frame_bytes: usize) -> Result<U3vIntake, GenicamError> {
        Ok(U3vIntake { intake: self.device.prepare(config, frame_bytes)?, warnings: VecDeque::new() })
    }

    fn tell(
        &self,
        intake: &U3vIntake,
        config: &GenicamConfig,
        settings: &mut Map<String, Value>,
        missed: &mut NotApplied,
    ) {
        let (identity, intake) = (&self.found.identity, &intake.intake);
        let link_settings = json!({
            "port": identity.port,
            "usb": { "device": identity.to_string(), "link": identity.speed.to_string() },
            "user_name": self.found.name,
            "stream": {
                "transfers": intake.flight.transfers,
                "transfer_bytes": intake.flight.bytes,
                "wanted_transfers": intake.wanted.transfers,
            },
        });
        if let Value::Object(link_settings) = link_settings {
            settings.extend(link_settings);
        }
        if let Some(asked) = config.transfers {
            missed.compare("genicam.transfers", asked, intake.flight.transfers);
        }
    }

    fn begin(&mut self, intake: &mut U3vIntake) -> Result<(), GenicamError> {
        self.device.begin(&mut intake.intake)?;
        intake.warnings = intake.intake.shortage().into_iter().chain(self.found.identity.speed.advice()).collect();
        Ok(())
    }

    fn end(&mut self, intake: &mut U3vIntake) -> Result<(), GenicamError> {
        self.device.end(&mut intake.intake)
    }
}

/// Transfers in flight, and what puts them together.
pub struct U3vIntake {
    intake: u3v::Intake,
    warnings: VecDeque<String>,
}

impl Intake for U3vIntake {
    fn receive(&mut self, wait: Duration) -> Result<(), String> {
        self.intake.wait(wait);
        Ok(())
    }

    fn lost(&mut self) -> Option<String> {
        self.intake.lost()
    }

    fn next_block(&mut self) -> Option<Block> {
        self.intake.next_block()
    }

    fn warning(&mut self) -> Option<String> {
        self.warnings.pop_front()
    }

    fn end(&mut self) {
        self.intake.end();
    }

    fn is_busy(&self) -> bool {
        self.intake.is_busy()
    }

    fn finish(&mut self) {
        self.intake.finish();
    }

    fn lost_blocks(&self) -> u64 {
        self.intake.counts().lost
    }

    fn counts(&self, into: &mut Vec<(&'static str, u64)>) {
        let counts = self.intake.counts();
        into.extend([
            ("missing_packets", counts.missing),
            ("frames_without_end", counts.endless),
            ("untaken_frames", counts.untaken),
            ("strange_transfers", counts.strange),
        ]);
    }

    fn silence(&self) -> &'static str {
        "unplug it and plug it in again, and look whether its cable is too long or its hub has no power of its own"
    }
}
