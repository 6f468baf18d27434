//! The camera's stream: frames as the packets of GVSP.

use super::registers::{CHUNKS, FORMATS, IMAGE_CHUNK, Layout, Memory, boot, feature};
use crate::usb::{scene::Picture, uvc::FrameTruth};

/// A frame to send.
pub struct Frame<'a> {
    /// Its block id.
    pub id: u16,
    /// The camera's clock when its exposure began, ticks.
    pub ticks: u64,
    /// The same in nanoseconds.
    pub ns: u64,
    /// What it shows.
    pub picture: &'a Picture,
    /// What it tells of itself.
    pub truth: FrameTruth,
}

fn format(memory: &Memory) -> (u32, Layout, bool) {
    let code = memory.feature(feature::PIXEL_FORMAT);
    let found = FORMATS.iter().find(|(_, known, _)| *known == code).unwrap_or(&FORMATS[0]);
    (found.1, found.2, found.0.starts_with("Bayer"))
}

fn chunks(memory: &Memory) -> Option<Vec<(u32, usize)>> {
    let enabled = |index: usize| memory.feature(feature::CHUNK_ENABLE + 4 * index as u32) != 0;
    let chosen = CHUNKS.iter().enumerate().filter(|(index, _)| enabled(*index));
    (memory.feature(feature::CHUNK_ACTIVE) != 0).then(|| chosen.map(|(_, (_, id, length))| (*id, *length)).collect())
}

/// Bytes of a block with these settings.
pub fn payload_bytes(memory: &Memory) -> u32 {
    let (code, ..) = format(memory);
    let image = memory.feature(feature::WIDTH) * memory.feature(feature::HEIGHT) * (code >> 16 & 0xff) / 8;
    let behind = chunks(memory).map(|chunks| 8 + chunks.iter().map(|(_, length)| *length as u32 + 8).sum::<u32>());
    image + behind.unwrap_or(0)
}

/// Frames a second that these settings allow: by the exposure, by the readout of so many rows, by the throughput.
pub fn most_rate_hz(memory: &Memory) -> f64 {
    let exposure_s = f64::from(memory.feature(feature::EXPOSURE_US)) * 1e-6;
    let readout_s = f64::from(memory.feature(feature::HEIGHT)) * 5e-6;
    let transfer_s = f64::from(payload_bytes(memory)) / f64::from(memory.feature(feature::THROUGHPUT));
    1.0 / exposure_s.max(readout_s).max(transfer_s)
}

/// The image: luma or the colour behind each filter, with the truth in its first pixels.
fn image(memory: &Memory, picture: &Picture, truth: FrameTruth) -> Vec<u8> {
    let (_, layout, bayer) = format(memory);
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

/// The packets of a frame by their numbers: leader, payload, trailer.
pub fn packets(memory: &Memory, frame: &Frame<'_>) -> Vec<(u32, Vec<u8>)> {
    let (code, ..) = format(memory);
    let chunks = chunks(memory);
    let kind: u16 = if chunks.is_some() { 0x4001 } else { 1 };
    let header = |format: u8, packet: u32| {
        let mut bytes = vec![0, 0];
        bytes.extend(frame.id.to_be_bytes());
        bytes.extend((u32::from(format) << 24 | packet).to_be_bytes());
        bytes
    };
    let mut leader = header(1, 0);
    leader.extend([0, 0]);
    leader.extend(kind.to_be_bytes());
    leader.extend(frame.ticks.to_be_bytes());
    let [width, height, x, y] =
        [feature::WIDTH, feature::HEIGHT, feature::OFFSET_X, feature::OFFSET_Y].map(|at| memory.feature(at));
    for word in [code, width, height, x, y, 0] {
        leader.extend(word.to_be_bytes());
    }
    let mut payload = image(memory, frame.picture, frame.truth);
    if let Some(chunks) = &chunks {
        let exposure_us = f64::from(memory.feature(feature::EXPOSURE_US));
        let mut tag = |data: &[u8], id: u32, length: usize| {
            payload.extend(data);
            payload.extend(id.to_be_bytes());
            payload.extend((length as u32).to_be_bytes());
        };
        tag(
            &[],
            IMAGE_CHUNK,
            (payload_bytes(memory) as usize) - 8 - chunks.iter().map(|(_, length)| length + 8).sum::<usize>(),
        );
        for (id, length) in chunks {
            let data = match id {
                0x1001 => frame.ns.to_be_bytes(),
                0x1002 => exposure_us.to_be_bytes(),
                _ => frame.truth.number.to_be_bytes(),
            };
            tag(&data, *id, *length);
        }
    }
    let slot = (memory.word(boot::PACKET_SIZE) & 0xffff).max(100) as usize - 36;
    let mut all = vec![(0, leader)];
    for (index, piece) in payload.chunks(slot).enumerate() {
        let packet = index as u32 + 1;
        let mut bytes = header(3, packet);
        bytes.extend(piece);
        all.push((packet, bytes));
    }
    let packet = all.len() as u32;
    let mut trailer = header(2, packet);
    trailer.extend([0, 0]);
    trailer.extend(kind.to_be_bytes());
    trailer.extend(height.to_be_bytes());
    if chunks.is_some() {
        trailer.extend(1_u32.to_be_bytes());
    }
    all.push((packet, trailer));
    all
}
