//! A frame as an array: as many channels as its camera has.

use erfgs_scene::pixel::{FrameFormat, PixelError};

/// The pixels of a frame, row by row: grey, or red, green and blue, encoded for display (sRGB).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples of a pixel: 1 or 3.
    pub channels: usize,
    /// `height * width * channels` samples.
    pub samples: Samples,
}

/// Samples of 8 or 16 bits, all of which count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Samples {
    /// 0 to 255.
    Bits8(Vec<u8>),
    /// 0 to 65535.
    Bits16(Vec<u16>),
}

impl Picture {
    /// Decodes a frame.
    pub(super) fn decode(format: &FrameFormat, deep: bool, payload: &[u8]) -> Result<Self, PixelError> {
        let channels = if format.pixels.is_grey() { 1 } else { 3 };
        Ok(if deep {
            let image = format.deep_picture(payload)?;
            let samples = Samples::Bits16(every(image.data, channels));
            Self { width: image.width, height: image.height, channels, samples }
        } else {
            let image = format.picture(payload)?;
            let samples = Samples::Bits8(every(image.data, channels));
            Self { width: image.width, height: image.height, channels, samples }
        })
    }
}

/// Of pixels of three equal samples one each, if there is to be one.
fn every<T: Copy>(samples: Vec<T>, channels: usize) -> Vec<T> {
    if channels == 3 { samples } else { samples.into_iter().step_by(3).collect() }
}
