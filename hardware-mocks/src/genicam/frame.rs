//! A frame as the payload of a block: the image, and the chunks behind it.

use super::{
    Exposed,
    registers::{CHUNKS, FORMATS, Features, IMAGE_CHUNK, Layout, feature},
};
use crate::usb::{scene::Picture, uvc::FrameTruth};

/// Payload types of blocks: an image, and an image with chunks.
const KINDS: [u16; 2] = [1, 0x4001];

fn format(features: &Features) -> (u32, Layout, bool) {
    let code = features.get(feature::PIXEL_FORMAT);
    let found = FORMATS.iter().find(|(_, known, _)| *known == code).unwrap_or(&FORMATS[0]);
    (found.1, found.2, found.0.starts_with("Bayer"))
}

fn chunks(features: &Features) -> Option<Vec<(u32, usize)>> {
    let enabled = |index: usize| features.get(feature::CHUNK_ENABLE + 4 * index as u32) != 0;
    let chosen = CHUNKS.iter().enumerate().filter(|(index, _)| enabled(*index));
    (features.get(feature::CHUNK_ACTIVE) != 0).then(|| chosen.map(|(_, (_, id, length))| (*id, *length)).collect())
}

/// The code of the pixel format.
pub(crate) fn code(features: &Features) -> u32 {
    format(features).0
}

/// Whether chunks lie behind the image.
pub(crate) fn has_chunks(features: &Features) -> bool {
    chunks(features).is_some()
}

/// The payload type of a block.
pub(crate) fn kind(features: &Features) -> u16 {
    KINDS[usize::from(has_chunks(features))]
}

fn image_bytes(features: &Features) -> u32 {
    features.get(feature::WIDTH) * features.get(feature::HEIGHT) * (code(features) >> 16 & 0xff) / 8
}

/// Bytes of a block with these settings.
pub(crate) fn payload_bytes(features: &Features) -> u32 {
    let behind = chunks(features).map(|chunks| 8 + chunks.iter().map(|(_, length)| *length as u32 + 8).sum::<u32>());
    image_bytes(features) + behind.unwrap_or(0)
}

/// Frames a second that these settings allow: by the exposure, by the readout of so many rows, by the throughput.
pub(crate) fn most_rate_hz(features: &Features) -> f64 {
    let exposure_s = f64::from(features.get(feature::EXPOSURE_US)) * 1e-6;
    let readout_s = f64::from(features.get(feature::HEIGHT)) * 5e-6;
    let transfer_s = f64::from(payload_bytes(features)) / f64::from(features.get(feature::THROUGHPUT));
    1.0 / exposure_s.max(readout_s).max(transfer_s)
}

/// The image: luma or the colour behind each filter, with the truth in its first pixels.
fn image(features: &Features, picture: &Picture, truth: FrameTruth) -> Vec<u8> {
    let (_, layout, bayer) = format(features);
    let width = picture.width as usize;
    let mut values = if bayer {
        let colour = |at: usize| [[0, 1], [1, 2]][at / width % 2][at % width % 2];
        picture.rgb.as_chunks::<3>().0.iter().enumerate().map(|(at, pixel)| pixel[colour(at)]).collect()
    } else {
        picture.luma()
    };
    for (value, byte) in values.iter_mut().zip(truth.bytes()) {
        *value = byte;
    }
    match layout {
        Layout::Byte => values,
        Layout::Word => values.into_iter().flat_map(|value| (u16::from(value) << 4).to_le_bytes()).collect(),
        Layout::Bits => values.as_chunks::<2>().0.iter().flat_map(|[a, b]| [a << 4, a >> 4, *b]).collect(),
        Layout::Around => values.as_chunks::<2>().0.iter().flat_map(|[a, b]| [*a, 0, *b]).collect(),
    }
}

/// The payload of a frame's block.
pub(crate) fn payload(features: &Features, frame: &Exposed) -> Vec<u8> {
    let order = features.order();
    let mut payload = image(features, &frame.picture, frame.truth);
    let Some(chunks) = chunks(features) else { return payload };
    let exposure_us = f64::from(features.get(feature::EXPOSURE_US));
    let mut tag = |data: &[u8], id: u32, length: usize| {
        payload.extend(data);
        payload.extend(order.word(id));
        payload.extend(order.word(length as u32));
    };
    tag(&[], IMAGE_CHUNK, image_bytes(features) as usize);
    for (id, length) in chunks {
        let data = match id {
            0x1001 => frame.clock_ns,
            0x1002 => exposure_us.to_bits(),
            _ => frame.truth.number,
        };
        tag(&order.double(data), id, length);
    }
    payload
}
