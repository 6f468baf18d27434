//! The descriptors of a USB3 Vision camera: control and stream interfaces, and what it is. Layout: Wireshark's dissector, Aravis.

use super::U3vOptions;
use crate::usb::{
    Speed,
    standard::{Descriptors, Identity, bulk_endpoint, interface},
};

/// The endpoint that takes commands.
pub const COMMANDS: u8 = 0x01;
/// The endpoint that gives acknowledgements.
pub const ACKNOWLEDGEMENTS: u8 = 0x81;
/// The endpoint that streams.
pub const STREAM: u8 = 0x82;
/// Maker and model.
pub const NAMES: [&str; 2] = ["erfgs", "Emulated U3V"];

/// Class and subclass of all its interfaces; the last is its protocol.
const CONTROL: [u8; 3] = [0xef, 5, 0];
const STREAMS: [u8; 3] = [0xef, 5, 2];

pub fn descriptors(options: &U3vOptions) -> Descriptors {
    let identity = Identity {
        vendor: 0x1d6b,
        product: 0x0105,
        release: 0x0100,
        class: [0xef, 2, 1],
        maker: NAMES[0].into(),
        name: NAMES[1].into(),
        serial: options.serial.clone(),
    };
    // Two interfaces of the class belong together.
    let mut body = vec![8, 11, 0, 2, 0xef, 5, 0, 0];
    body.extend(interface(0, 0, 2, CONTROL));
    body.extend(information(options));
    body.extend(bulk_endpoint(options.speed, COMMANDS));
    body.extend(bulk_endpoint(options.speed, ACKNOWLEDGEMENTS));
    body.extend(interface(1, 0, 1, STREAMS));
    body.extend(bulk_endpoint(options.speed, STREAM));
    let mut descriptors = identity.with_interfaces(options.speed, 2, &body);
    descriptors.strings.extend(["1D6B00000001".into(), "1.0".into(), "model".into(), options.name.clone()]);
    descriptors
}

/// Versions of GenCP and of USB3 Vision, and the indices of strings: GUID, maker, model, family, version, information, serial number,
/// the user's name; then the speeds that it has.
fn information(options: &U3vOptions) -> Vec<u8> {
    let mut bytes = vec![20, 0x24, 1];
    bytes.extend(0x0001_0001_u32.to_le_bytes());
    bytes.extend(0x0001_0000_u32.to_le_bytes());
    let speeds = match options.speed {
        Speed::High => 0b0100,
        Speed::Super => 0b1100,
    };
    bytes.extend([4, 1, 2, 0, 5, 6, 3, if options.name.is_empty() { 0 } else { 7 }, speeds]);
    bytes
}
