//! The cameras on a bus.

use std::sync::Arc;

use super::{Channel, gencp::register};
use crate::{
    genicam::GenicamError,
    usb::{Bus, Identity, Interface, Transport, TransportError, cameras::u3v_control},
};

/// Class, subclass and protocol of the interface that streams.
const STREAM: (u8, u8, u8) = (0xef, 5, 2);

/// A camera on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// The device.
    pub identity: Identity,
    /// Maker.
    pub maker: String,
    /// Model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// The name that its user gave it.
    pub name: String,
    /// Why it cannot be used, and what to do, if it cannot.
    pub problem: Option<String>,
}

impl Found {
    /// Maker and model.
    #[must_use]
    pub fn label(&self) -> String {
        format!("{} {}", self.maker, self.model).trim().to_owned()
    }
}

/// A camera that is open, and ours.
pub struct Opened {
    /// Its registers.
    pub channel: Arc<Channel>,
    /// The interface that streams.
    pub stream: Interface,
}

/// Opens a camera.
///
/// # Errors
/// If it may not be opened, another program has it, or it does not answer.
pub(super) fn open(bus: &dyn Bus, identity: &Identity) -> Result<Opened, GenicamError> {
    let transport: Arc<dyn Transport> = bus.open(identity)?;
    let interfaces = transport.interfaces();
    let stream = interfaces.iter().find(|interface| interface.class == STREAM);
    let (Some(control), Some(stream)) = (u3v_control(interfaces), stream) else {
        return Err(GenicamError::Usb3 { reason: "it has no interfaces for control and stream".into() });
    };
    let (control, stream) = (control.clone(), stream.clone());
    Ok(Opened { channel: Arc::new(Channel::open(transport, &control)?), stream })
}

/// The USB3 Vision cameras on a bus. Each is opened for a moment; one that cannot be is there with its problem, and with what the
/// system tells of it.
///
/// # Errors
/// If the bus does not list its devices.
pub fn find(bus: &dyn Bus) -> Result<Vec<Found>, TransportError> {
    let mut cameras = Vec::new();
    for identity in bus.list()? {
        // One that is unplugged meanwhile is no camera.
        let Ok(described) = bus.describe(&identity) else { continue };
        if u3v_control(&described.interfaces).is_none() {
            continue;
        }
        let mut found = Found {
            maker: described.maker,
            model: described.product,
            serial: described.serial,
            name: String::new(),
            problem: None,
            identity,
        };
        let result = open(bus, &found.identity).and_then(|opened| ask(&opened.channel, &mut found));
        found.problem = match result {
            Ok(()) => found.identity.speed.advice(),
            Err(error) => Some(error.to_string()),
        };
        cameras.push(found);
    }
    cameras.sort_by(|a, b| a.identity.port.cmp(&b.identity.port));
    Ok(cameras)
}

/// Asks a camera what it is.
fn ask(channel: &Channel, found: &mut Found) -> Result<(), GenicamError> {
    let [maker, model, serial, name] = register::TEXTS;
    for (at, text) in [(maker, &mut found.maker), (model, &mut found.model), (serial, &mut found.serial)] {
        let value = channel.text(at)?;
        if !value.is_empty() {
            *text = value;
        }
    }
    if channel.double(register::CAPABILITY)? & 1 == 1 {
        found.name = channel.text(name)?;
    }
    Ok(())
}
