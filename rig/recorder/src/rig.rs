//! Opens the devices that a `RIG.toml` names.

use std::{sync::Arc, time::Duration};

use erfgs_session::source::{Source, SourceError};

use super::{
    config::{DeviceConfig, DeviceSettings, RigConfig},
    pattern::Pattern,
    recorder::Input,
};
use erfgs_rig::{
    event::{Davis346Source, Evk4Source},
    frame,
    trigger::TriggerBoard,
    usb::{Bus, LibusbBus},
};

/// A device that cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("cannot open '{id}': {source}")]
pub struct OpenError {
    /// The device.
    pub id: String,
    /// What its driver says.
    pub source: SourceError,
}

/// Opens all devices of a rig and gives them their settings.
///
/// # Errors
/// The first device that cannot be opened.
pub fn open(rig: &RigConfig) -> Result<Vec<Input>, OpenError> {
    open_on(rig, &(Arc::new(LibusbBus) as _))
}

/// As [`open`], with the USB devices of `bus`.
///
/// # Errors
/// The first device that cannot be opened.
pub fn open_on(rig: &RigConfig, bus: &Arc<dyn Bus>) -> Result<Vec<Input>, OpenError> {
    rig.devices.iter().map(|device| input(rig, device, bus)).collect()
}

fn input(rig: &RigConfig, device: &DeviceConfig, bus: &Arc<dyn Bus>) -> Result<Input, OpenError> {
    let source = source(device, bus).map_err(|source| OpenError { id: device.id.clone(), source })?;
    // A camera that waits for its trigger may be silent for long.
    let waits = matches!(&device.settings, DeviceSettings::Camera(config) if config.triggered);
    let stall_seconds = device.stall_seconds.unwrap_or(if waits { 0 } else { rig.record.stall_seconds });
    Ok(Input {
        source,
        queue_bytes: device.queue_mib.unwrap_or(rig.record.queue_mib) << 20,
        stall_after: (stall_seconds > 0).then(|| Duration::from_secs(stall_seconds.into())),
    })
}

fn source(device: &DeviceConfig, bus: &Arc<dyn Bus>) -> Result<Box<dyn Source>, SourceError> {
    Ok(match &device.settings {
        DeviceSettings::Evk4(config) => {
            Box::new(Evk4Source::open(Arc::clone(bus), &device.id, config.as_ref().clone())?)
        }
        DeviceSettings::Davis346(config) => {
            Box::new(Davis346Source::open(Arc::clone(bus), &device.id, config.as_ref().clone())?)
        }
        DeviceSettings::Camera(config) => frame::open_on(config, bus)?,
        DeviceSettings::Trigger(config) => Box::new(TriggerBoard::open(config)?),
        DeviceSettings::Pattern(config) => Box::new(Pattern::open(&device.id, config.clone())?),
    })
}
