//! What a camera saw of the wand.

use erfgs_scene::{Intrinsics, Modality};
use glam::DVec2;

/// A camera and all that it saw of the wand.
#[derive(Clone, Debug, PartialEq)]
pub struct WandCamera {
    /// Name, as in the recording.
    pub name: String,
    /// What it records.
    pub modality: Modality,
    /// Lens and sensor, as known beforehand.
    pub intrinsics: Intrinsics,
    /// Standard deviation of a LED's position in either direction, pixels; estimated from the residuals where it is not
    /// known.
    pub sigma_px: Option<f64>,
    /// What it saw, in any order.
    pub sightings: Vec<Sighting>,
}

/// The wand in one image, or in the events around one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// When, on the camera's clock, nanoseconds.
    pub t_ns: i64,
    /// The LEDs in the order of the wand's gaps, pixels (centres at half-integers); `None` where one was not seen.
    pub leds: [Option<DVec2>; 3],
}
