//! Frames as cameras send them to RGB: YUYV, UYVY, NV12, grey and Bayer of 8, 10 and 12 bits, RGB, BGR, Motion JPEG.
//!
//! What a sensor gives in grey and Bayer formats may be light or codes, and may have a black level and need a white
//! balance: [`RawLook`] says so, and a recording carries it in the settings of the stream.

mod demosaic;
#[cfg(feature = "images")]
mod developed;
mod format;
#[cfg(feature = "images")]
mod jpeg;
#[cfg(feature = "images")]
mod picture;
mod raw;
mod samples;
#[cfg(feature = "images")]
mod yuv;

use erfgs_base::plausible;

pub use demosaic::demosaic;
pub use format::{BayerOrder, PixelFormat, Samples};
#[cfg(feature = "images")]
pub use jpeg::with_huffman_tables;
#[cfg(feature = "images")]
pub use picture::{LightRgb, decode};
pub use raw::{RawLook, Response};
#[cfg(feature = "images")]
pub use yuv::rgb as yuv_to_rgb;

/// Why a frame cannot be shown.
#[derive(Debug, thiserror::Error)]
#[cfg_attr(not(feature = "images"), non_exhaustive)]
pub enum PixelError {
    /// Columns or rows are zero, too many, or no multiple of what shares bytes or colour.
    #[error("a frame of {width} x {height} pixels cannot be {encoding}: {needs}")]
    Size {
        /// How the frame is said to be encoded.
        encoding: PixelFormat,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Which sizes can be.
        needs: &'static str,
    },
    /// The frame is cut, or of another size than the stream says.
    #[error(
        "a frame of {width} x {height} pixels in {encoding} has {expected} bytes, this one {found}: it is cut, or damaged"
    )]
    Length {
        /// How the frame is said to be encoded.
        encoding: PixelFormat,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes that it should have.
        expected: usize,
        /// Bytes that it has.
        found: usize,
    },
    /// The JPEG image has too few bytes for the size that it says.
    #[error("a Motion JPEG frame of {width} x {height} pixels cannot have only {found} bytes: it is cut, or damaged")]
    Short {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes that it has.
        found: usize,
    },
    /// The JPEG image is damaged.
    #[cfg(feature = "images")]
    #[error("a Motion JPEG frame cannot be decoded: {0}")]
    Jpeg(#[from] image::ImageError),
}

/// Bytes of a frame; `None` for Motion JPEG, whose frames have no fixed size.
#[must_use]
pub fn frame_bytes(encoding: PixelFormat, width: u32, height: u32) -> Option<usize> {
    let rows = height as usize;
    match encoding {
        PixelFormat::Nv12 => Some(width as usize * rows + width as usize * rows / 2),
        _ => Some(row_bytes(encoding, width)? * rows),
    }
}

/// Bytes of a row, of one plane where there are several (NV12: both have the same).
#[must_use]
pub fn row_bytes(encoding: PixelFormat, width: u32) -> Option<usize> {
    let width = width as usize;
    match encoding {
        PixelFormat::Yuyv | PixelFormat::Uyvy => Some(2 * width),
        PixelFormat::Nv12 => Some(width),
        PixelFormat::Rgb8 | PixelFormat::Bgr8 => Some(3 * width),
        _ => encoding.samples().map(|samples| samples.bytes(width)),
    }
}

/// Looks whether frames of an encoding can have a size.
///
/// # Errors
/// If not, saying which sizes can be.
pub fn check_size(encoding: PixelFormat, width: u32, height: u32) -> Result<(), PixelError> {
    let even = width.is_multiple_of(2);
    let needs = match encoding {
        _ if plausible::check_size([width, height]).is_err() => {
            "it has 1 to 65535 columns and rows, and no more than 500 million pixels"
        }
        PixelFormat::Yuyv | PixelFormat::Uyvy if !even => {
            "two columns share their colour, so that there are pairs of them"
        }
        PixelFormat::Nv12 if !even || !height.is_multiple_of(2) => {
            "two columns and two rows share their colour, so that there are pairs of both"
        }
        PixelFormat::Bayer(..) if width < 2 || height < 2 => {
            "colours repeat every two columns and rows, so that it has both"
        }
        _ => match encoding.samples() {
            Some(samples) if !samples.fits(width) => match samples {
                Samples::Packed10 | Samples::Lsb10 => {
                    "four columns are packed together, so that their number is a multiple of 4"
                }
                _ => "two columns are packed together, so that their number is even",
            },
            _ => return Ok(()),
        },
    };
    Err(PixelError::Size { encoding, width, height, needs })
}

/// Whether frames have more than 8 bits a colour.
#[must_use]
pub fn is_deep(encoding: PixelFormat) -> bool {
    encoding.samples().is_some_and(|samples| samples.bits() > 8)
}

/// The frames of one stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameFormat {
    /// How their pixels lie in memory.
    pub pixels: PixelFormat,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// What raw values mean.
    pub look: RawLook,
}
