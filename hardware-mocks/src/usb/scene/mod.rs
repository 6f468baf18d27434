//! What the sensors see.
//!
//! An event sensor asks its [`EventScene`] for the changes of light as time goes on; a frame camera asks its
//! [`FrameScene`] for a picture of each exposure. Scenes live in true time (the front end's); a sensor stamps what it
//! sees with its own clock, which may be wrong.

mod pattern;
mod recorded;
mod take;

pub use pattern::{Pattern, PatternFrames};
pub use recorded::{RecordedWords, RecordingError};
pub use take::{TakeEvents, TakeFrames};

use std::sync::Arc;

use erfgs_events::CdEvent;

use super::clock::TimeBase;

/// Changes of light in front of an event sensor.
pub trait EventScene: Send {
    /// The sensor starts to look, at the true time `now_ns`, when its counter says `clock.ticks_us(now_ns)`.
    fn begin(&mut self, clock: &TimeBase, now_ns: i64);

    /// Appends the events since the last call (or since [`EventScene::begin`]) up to and including `now_ns`, stamped with
    /// the sensor's clock, in order of time.
    fn until(&mut self, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>);
}

/// A picture, 8-bit RGB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Three bytes a pixel, row by row.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// The luma of every pixel (BT.601, full range).
    #[must_use]
    pub fn luma(&self) -> Vec<u8> {
        self.rgb.as_chunks::<3>().0.iter().map(|&pixel| luma(pixel)).collect()
    }
}

/// Luma of BT.601, full range.
#[must_use]
pub fn luma([r, g, b]: [u8; 3]) -> u8 {
    ((u32::from(r) * 77 + u32::from(g) * 150 + u32::from(b) * 29 + 128) >> 8) as u8
}

/// Light in front of a frame camera.
pub trait FrameScene: Send {
    /// The picture of frame `number`, exposed over `exposure_ns` of true time, `width` by `height` pixels. A picture with
    /// the same key is the same picture, so that a camera may keep what it has encoded.
    fn frame(&mut self, number: u64, exposure_ns: [i64; 2], width: u32, height: u32) -> (u64, Arc<Picture>);

    /// The pictures that are known ahead, so that a camera can encode them before it is plugged in.
    fn known(&mut self, _width: u32, _height: u32) -> Vec<(u64, Arc<Picture>)> {
        Vec::new()
    }
}
