//! Pictures as a camera sends them. Every frame tells its number and when it was exposed, so that a receiver can check
//! both: an MJPEG frame in a comment, others in the luma of their first pixels.

use std::{collections::BTreeMap, sync::Arc};

use erfgs_scene::image::jpeg;
use serde::{Deserialize, Serialize};

use crate::usb::scene::{Picture, luma};

/// The formats of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// A JPEG image for each frame.
    Mjpeg,
    /// Packed 4:2:2.
    Yuyv,
    /// A plane of luma, then a plane of both chromas at half resolution.
    Nv12,
    /// Luma alone.
    Grey,
}

impl Format {
    pub(super) fn bits_per_pixel(self) -> u8 {
        match self {
            Self::Yuyv => 16,
            Self::Nv12 => 12,
            Self::Mjpeg | Self::Grey => 8,
        }
    }

    /// The most bytes of a frame.
    pub(super) fn largest_frame(self, width: u32, height: u32) -> u32 {
        match self {
            Self::Mjpeg => width * height * 2,
            _ => width * height / 8 * u32::from(self.bits_per_pixel()),
        }
    }
}

/// What a frame tells of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameTruth {
    /// Its number since streaming began.
    pub number: u64,
    /// Start and end of its exposure, true time, nanoseconds.
    pub exposure_ns: [i64; 2],
}

impl FrameTruth {
    /// Bytes of the luma that carry it, in formats other than MJPEG.
    pub const PIXELS: usize = 24;

    pub(crate) fn bytes(self) -> [u8; Self::PIXELS] {
        let mut bytes = [0; Self::PIXELS];
        bytes[..8].copy_from_slice(&self.number.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.exposure_ns[0].to_le_bytes());
        bytes[16..].copy_from_slice(&self.exposure_ns[1].to_le_bytes());
        bytes
    }

    /// Reads it back from a frame's bytes; `None` if they are not those of an emulated camera.
    #[must_use]
    pub fn of(format: Format, frame: &[u8]) -> Option<Self> {
        if format == Format::Mjpeg {
            let text = frame.strip_prefix(&[0xff, 0xd8, 0xff, 0xfe])?;
            let length = usize::from(u16::from_be_bytes(*text.first_chunk()?));
            let text = str::from_utf8(text.get(2..length)?).ok()?;
            let mut fields = text.strip_prefix("erfgs frame ")?.split(' ');
            let number = fields.next()?.parse().ok()?;
            let exposure_ns = [fields.next()?.parse().ok()?, fields.next()?.parse().ok()?];
            return Some(Self { number, exposure_ns });
        }
        let step = if format == Format::Yuyv { 2 } else { 1 };
        let bytes: Vec<u8> = frame.iter().copied().step_by(step).take(Self::PIXELS).collect();
        let part = |at: usize| bytes.get(at..at + 8).and_then(|part| part.first_chunk::<8>().copied());
        Some(Self {
            number: u64::from_le_bytes(part(0)?),
            exposure_ns: [i64::from_le_bytes(part(8)?), i64::from_le_bytes(part(16)?)],
        })
    }
}

/// Encodes frames, and keeps what a scene shows again and again.
#[derive(Debug, Default)]
pub(super) struct Encoder {
    kept: BTreeMap<(u64, Format, u32, u32), Arc<Vec<u8>>>,
}

/// How many encoded pictures are kept.
const KEPT: usize = 64;

impl Encoder {
    /// Encodes a picture ahead.
    pub(super) fn prepare(&mut self, format: Format, key: u64, picture: &Picture) {
        self.kept.insert((key, format, picture.width, picture.height), Arc::new(encode(format, picture)));
    }

    pub(super) fn encode(&mut self, format: Format, key: u64, picture: &Picture, truth: FrameTruth) -> Vec<u8> {
        if self.kept.len() > KEPT {
            self.kept.clear();
        }
        let body = self
            .kept
            .entry((key, format, picture.width, picture.height))
            .or_insert_with(|| Arc::new(encode(format, picture)));
        if format == Format::Mjpeg {
            // A comment right after the start of the image.
            let [start, end] = truth.exposure_ns;
            let text = format!("erfgs frame {} {start} {end}", truth.number);
            let length = ((text.len() + 2) as u16).to_be_bytes();
            let rest = body.get(2..).unwrap_or_default();
            return [&[0xff, 0xd8, 0xff, 0xfe][..], &length, text.as_bytes(), rest].concat();
        }
        let mut frame = body.to_vec();
        let step = if format == Format::Yuyv { 2 } else { 1 };
        for (pixel, byte) in frame.iter_mut().step_by(step).zip(truth.bytes()) {
            *pixel = byte;
        }
        frame
    }
}

fn encode(format: Format, picture: &Picture) -> Vec<u8> {
    let pixels = picture.rgb.as_chunks::<3>().0;
    match format {
        // A picture of the wrong size leaves a frame that does not decode.
        Format::Mjpeg => jpeg(&picture.rgb, picture.width, picture.height, 85).unwrap_or_default(),
        Format::Grey => picture.luma(),
        Format::Yuyv => pixels
            .chunks(2)
            .flat_map(|pair| {
                let [u, v] = chroma(pair);
                [luma(pair[0]), u, luma(pair[pair.len() - 1]), v]
            })
            .collect(),
        Format::Nv12 => {
            let width = picture.width as usize;
            let mut bytes = picture.luma();
            for row in pixels.chunks(width.max(1)).step_by(2) {
                bytes.extend(row.chunks(2).flat_map(chroma));
            }
            bytes
        }
    }
}

/// The mean chroma of some pixels (BT.601, full range).
fn chroma(pixels: &[[u8; 3]]) -> [u8; 2] {
    let mean =
        |channel: usize| pixels.iter().map(|pixel| i32::from(pixel[channel])).sum::<i32>() / pixels.len().max(1) as i32;
    let (r, g, b) = (mean(0), mean(1), mean(2));
    let u = (-43 * r - 85 * g + 128 * b + 32_768) >> 8;
    let v = (128 * r - 107 * g - 21 * b + 32_768) >> 8;
    [u.clamp(0, 255) as u8, v.clamp(0, 255) as u8]
}
