//! The wand's LEDs in recordings: blinking ones in events, bright ones in frames.
//!
//! In events each LED blinks at a frequency of its own, or all at one. A pixel whose rises come at such a period is lit by a
//! LED (`blink.rs`); neighbouring ones are one light, whose place is the mean of its events, moved to the middle of the
//! window. In frames a light is a bright spot (`bright.rs`). Which three lights are the wand is decided by frequency, or by
//! the line and the gaps (`choose.rs`).

mod blink;
mod bright;
mod choose;
mod spot;
#[cfg(test)]
mod tests;

use glam::DVec2;

pub use blink::{BlinkDetector, BlinkOptions};
pub use bright::{BrightOptions, bright_lights};
pub use choose::choose;

/// A light in an image, or in the events of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Its place, pixels (centres at half-integers).
    pub pixel: DVec2,
    /// How strong it is: its number of events, or the brightness above the background summed over its pixels.
    pub weight: f64,
}

/// The lights of one instant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lights {
    /// When, on the stream's clock: microseconds for events, as the detector was told them.
    pub t: i64,
    /// The lights of each frequency, the strongest first; one list where lights are not told apart.
    pub by_frequency: Vec<Vec<Light>>,
}
