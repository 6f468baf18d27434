//! Frames of a recording, before and after they are decoded.

use bytes::Bytes;
use erfgs_scene::pixel::{FrameFormat, PixelFormat, with_huffman_tables};
use erfgs_session::clock::Exposure;

use super::Picture;

/// A frame with its time.
#[derive(Clone, Debug, PartialEq)]
pub struct TimedFrame {
    /// The number of the packet that it came in.
    pub sequence: u64,
    /// When it was exposed.
    pub exposure: Exposure,
    /// What it shows.
    pub picture: Picture,
    /// The picture as the camera sent it, where that was a JPEG image: a whole file, with its Huffman tables.
    pub jpeg: Option<Vec<u8>>,
}

/// A frame that waits until it is wanted.
pub(super) struct WaitingFrame {
    pub sequence: u64,
    pub exposure: Exposure,
    pub format: FrameFormat,
    /// Whether it is given 16 bits.
    pub deep: bool,
    pub payload: Bytes,
}

impl WaitingFrame {
    /// Decodes it; `None` if it is cut or damaged.
    pub fn decoded(self) -> Option<TimedFrame> {
        let Self { sequence, exposure, format, deep, payload } = self;
        let picture = Picture::decode(&format, deep, &payload).ok()?;
        let sent = format.pixels == PixelFormat::Mjpeg;
        let jpeg = sent.then(|| with_huffman_tables(&payload).into_owned());
        Some(TimedFrame { sequence, exposure, picture, jpeg })
    }
}
