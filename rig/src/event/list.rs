//! Which event cameras are plugged in.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

#[cfg(feature = "davis346")]
use super::davis346::Davis346;
#[cfg(feature = "evk4")]
use super::evk4::Evk4;
use super::{Driver, EventError};
use crate::usb::{Bus, Fault, Identity, LibusbBus, TransportError};

/// Kinds of device that the drivers recognise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Prophesee EVK4, or a camera with the same board.
    Evk4,
    /// iniVation DAVIS346.
    Davis346,
    /// A device with the identifiers of one of these that is something else, or that did not say what it is.
    Unknown,
}

/// An event camera, or something that may be one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FoundDevice {
    /// What it is.
    pub kind: Kind,
    /// Maker and model, or what was expected.
    pub model: String,
    /// Serial number; empty where it is not known.
    pub serial: String,
    /// Vendor and product.
    pub usb_id: (u16, u16),
    /// Bus and address, now.
    pub bus_address: (u8, u8),
    /// The port it is plugged into.
    pub port: String,
    /// Speed of the link.
    pub link: String,
    /// Why it cannot be used, or what is not as it should be.
    pub problem: Option<String>,
}

/// What a device on the bus may be, of the kinds whose drivers were built.
fn candidate(identity: &Identity) -> Option<Kind> {
    #[cfg(feature = "evk4")]
    if Evk4::is_candidate(identity) {
        return Some(Kind::Evk4);
    }
    #[cfg(feature = "davis346")]
    if Davis346::is_candidate(identity) {
        return Some(Kind::Davis346);
    }
    None
}

/// The event cameras of this machine, of the kinds whose drivers were built. Opens each for a moment to read its serial number; those in use by another
/// program are listed with that problem.
///
/// # Errors
/// If the system does not list its USB devices.
pub fn list() -> Result<Vec<FoundDevice>, TransportError> {
    list_on(&LibusbBus)
}

/// The event cameras on `bus`.
///
/// # Errors
/// If the bus does not list its devices.
pub fn list_on(bus: &dyn Bus) -> Result<Vec<FoundDevice>, TransportError> {
    let mut found: Vec<_> = bus
        .list()?
        .iter()
        .filter_map(|identity| match candidate(identity)? {
            #[cfg(feature = "evk4")]
            kind @ Kind::Evk4 => Some(look::<Evk4>(bus, identity, kind)),
            #[cfg(feature = "davis346")]
            kind @ Kind::Davis346 => Some(look::<Davis346>(bus, identity, kind)),
            _ => None,
        })
        .collect();
    found.sort_by(|a, b| a.port.cmp(&b.port));
    Ok(found)
}

fn look<D: Driver>(bus: &dyn Bus, identity: &Identity, kind: Kind) -> FoundDevice {
    let mut device = FoundDevice {
        kind,
        model: D::MODEL.into(),
        serial: String::new(),
        usb_id: (identity.vendor, identity.product),
        bus_address: (identity.bus, identity.address),
        port: identity.port.clone(),
        link: identity.speed.to_string(),
        problem: None,
    };
    let transport = match bus.open(identity) {
        Ok(transport) => transport,
        Err(error) => {
            device.problem = Some(error.to_string());
            return device;
        }
    };
    match D::connect(Arc::clone(&transport)) {
        Ok(driver) => {
            device.serial = driver.serial().into();
            device.problem = identity.speed.advice();
        }
        Err(error) => {
            if matches!(error, EventError::WrongDevice { .. }) {
                device.kind = Kind::Unknown;
            }
            if error.fault() == Some(&Fault::Busy) {
                device.serial = transport.serial().unwrap_or_default().into();
            }
            device.problem = Some(error.to_string());
        }
    }
    device
}
