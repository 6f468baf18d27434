//! The descriptors of a camera of the USB Video Class 1.0 with one bulk stream. Layout: UVC 1.0 and its payload
//! specifications; compared with a capture of a Logitech C310.

use crate::usb::{
    Speed,
    standard::{Descriptors, Identity, bulk_endpoint, interface},
};

use super::{Format, UvcOptions};

/// The camera terminal.
pub const CAMERA: u8 = 1;
/// The processing unit.
pub const PROCESSING: u8 = 2;
const OUTPUT: u8 = 3;
const CLASS: u8 = 0x24;
const VIDEO: u8 = 0x0e;

impl Format {
    /// The GUID of an uncompressed format: its code, then what all have in common.
    fn guid(self) -> Option<[u8; 16]> {
        let code = match self {
            Self::Mjpeg => return None,
            Self::Yuyv => b"YUY2",
            Self::Nv12 => b"NV12",
            Self::Grey => b"Y800",
        };
        let mut guid = [0, 0, 0, 0, 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71];
        guid[..4].copy_from_slice(code);
        Some(guid)
    }
}

/// The intervals between frames that a camera offers, units of 100 ns.
pub(super) fn intervals(options: &UvcOptions) -> Vec<u32> {
    options.rates_hz.iter().map(|&rate| (1e7 / rate.max(0.01)).round() as u32).collect()
}

pub(super) fn descriptors(options: &UvcOptions) -> Descriptors {
    let identity = Identity {
        vendor: options.vendor,
        product: options.product,
        release: 0x0100,
        class: [0xef, 2, 1],
        maker: "erfgs".into(),
        name: options.name.clone(),
        serial: options.serial.clone(),
    };
    let association = vec![8, 11, 0, 2, VIDEO, 3, 0, 0];
    let body = [association, control_interface(), streaming_interface(options)].concat();
    identity.with_interfaces(options.speed, 2, &body)
}

fn control_interface() -> Vec<u8> {
    // Controls: automatic exposure mode (bit 1) and exposure time (bit 3) of the camera; brightness (0), white balance
    // (6), gain (9) and automatic white balance (12) of the processing.
    let units = [
        vec![18, CLASS, 2, CAMERA, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, 0x0a, 0, 0],
        vec![11, CLASS, 5, PROCESSING, CAMERA, 0, 0, 2, 0x41, 0x12, 0],
        vec![9, CLASS, 3, OUTPUT, 0x01, 0x01, 0, PROCESSING, 0],
    ]
    .concat();
    let [low, high] = ((13 + units.len()) as u16).to_le_bytes();
    let clock = super::CLOCK_HZ.to_le_bytes();
    let header = [&[13, CLASS, 1, 0x00, 0x01, low, high][..], &clock, &[1, 1]].concat();
    [interface(0, 0, 0, [VIDEO, 1, 0]), header, units].concat()
}

fn streaming_interface(options: &UvcOptions) -> Vec<u8> {
    let formats: Vec<u8> = options
        .formats
        .iter()
        .enumerate()
        .flat_map(|(index, &format)| format_block(options, index as u8 + 1, format))
        .collect();
    let count = options.formats.len() as u8;
    let header = 13 + options.formats.len();
    let [low, high] = ((header + formats.len()) as u16).to_le_bytes();
    let mut body = interface(1, 0, 1, [VIDEO, 2, 0]);
    body.extend([header as u8, CLASS, 1, count, low, high, super::STREAM, 0, OUTPUT, 0, 0, 0, 1]);
    body.extend(options.formats.iter().map(|_| 0));
    body.extend(formats);
    body.extend(bulk_endpoint(options.speed, super::STREAM));
    body
}

fn format_block(options: &UvcOptions, index: u8, format: Format) -> Vec<u8> {
    let sizes = options.sizes.len() as u8;
    let (mut bytes, frame_kind) = match format.guid() {
        Some(guid) => {
            let head = [&[27, CLASS, 4, index, sizes][..], &guid, &[format.bits_per_pixel(), 1, 0, 0, 0, 0]];
            (head.concat(), 5)
        }
        None => (vec![11, CLASS, 6, index, sizes, 0, 1, 0, 0, 0, 0], 7),
    };
    let intervals = intervals(options);
    for (number, &(width, height)) in options.sizes.iter().enumerate() {
        let largest = format.largest_frame(width, height);
        let bits = |interval: Option<&u32>| {
            let rate = 1e7 / f64::from(interval.copied().unwrap_or(333_333));
            ((f64::from(largest) * 8.0 * rate) as u32).to_le_bytes()
        };
        bytes.extend([26 + 4 * intervals.len() as u8, CLASS, frame_kind, number as u8 + 1, 0]);
        bytes.extend((width as u16).to_le_bytes());
        bytes.extend((height as u16).to_le_bytes());
        bytes.extend(bits(intervals.iter().max()));
        bytes.extend(bits(intervals.iter().min()));
        bytes.extend(largest.to_le_bytes());
        bytes.extend(intervals.first().copied().unwrap_or(333_333).to_le_bytes());
        bytes.push(intervals.len() as u8);
        bytes.extend(intervals.iter().flat_map(|interval| interval.to_le_bytes()));
    }
    // Colours: primaries and transfer of BT.709, matrix of BT.601.
    bytes.extend([6, CLASS, 13, 1, 1, 4]);
    bytes
}

/// The largest payload of a transfer, bytes: what `uvcvideo` takes with one URB at either speed.
pub(super) fn payload_bytes(_speed: Speed) -> u32 {
    16 * 1024
}
