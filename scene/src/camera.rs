//! Camera models.

use erfgs_base::plausible::{Implausible, Lens, SIDE, check_lens};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// How a lens bends rays away from the pinhole model. Coefficients as in OpenCV.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distortion {
    /// An ideal pinhole.
    #[default]
    None,
    /// Brown-Conrady: k1, k2, p1, p2, k3, k4, k5, k6 (zero where the model has fewer).
    BrownConrady([f64; 8]),
    /// Kannala-Brandt fisheye: k1, k2, k3, k4.
    KannalaBrandt([f64; 4]),
}

impl Distortion {
    /// The coefficients, each with the power of the distance from the axis that it is multiplied by.
    fn terms(&self) -> Vec<(f64, i32)> {
        match self {
            Self::None => Vec::new(),
            Self::BrownConrady(k) => k.iter().copied().zip([2, 4, 2, 2, 6, 2, 4, 6]).collect(),
            Self::KannalaBrandt(k) => k.iter().copied().zip([2, 4, 6, 8]).collect(),
        }
    }
}

/// Intrinsics of one camera. Focal lengths and principal point in pixels; pixel centres at half-integers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels from the left edge of the image.
    pub cx: f64,
    /// Principal point y, pixels from the top edge of the image.
    pub cy: f64,
    /// Lens distortion.
    #[serde(default)]
    pub distortion: Distortion,
}

/// The pixels along a side of an image, of a number in a file: a whole one from 1 to 65535.
///
/// # Errors
/// What is wrong with it.
pub fn image_side(pixels: f64) -> Result<u32, Implausible> {
    let whole = if pixels.fract() == 0.0 { pixels } else { f64::NAN };
    SIDE.check(whole).map_err(|error| Implausible { value: pixels, ..error }).map(|pixels| pixels as u32)
}

impl Intrinsics {
    /// These intrinsics, which a file gave, if they can be those of a camera.
    ///
    /// # Errors
    /// Which number cannot, and what can ([`erfgs_base::plausible::check_lens`]).
    pub fn checked(self) -> Result<Self, Implausible> {
        check_lens(&Lens {
            size: [self.width, self.height],
            focal: [self.fx, self.fy],
            centre: [self.cx, self.cy],
            distortion: &self.distortion.terms(),
        })?;
        Ok(self)
    }

    /// The pixel position of a camera-space point under the pinhole part of the model (no distortion).
    #[must_use]
    pub fn project_pinhole(&self, camera: DVec3) -> DVec2 {
        DVec2::new(self.fx * camera.x / camera.z + self.cx, self.fy * camera.y / camera.z + self.cy)
    }

    /// The camera-space point at depth `z` (metres) seen at `pixel`, under the pinhole part of the model.
    #[must_use]
    pub fn unproject_pinhole(&self, pixel: DVec2, z: f64) -> DVec3 {
        DVec3::new((pixel.x - self.cx) / self.fx * z, (pixel.y - self.cy) / self.fy * z, z)
    }

    /// The same camera for images resized to `width` x `height` pixels.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (sx, sy) = (f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        Self { width, height, fx: self.fx * sx, fy: self.fy * sy, cx: self.cx * sx, cy: self.cy * sy, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resizing_keeps_what_a_pixel_sees() {
        let full = Intrinsics {
            width: 640,
            height: 360,
            fx: 465.7,
            fy: 464.4,
            cx: 318.3,
            cy: 186.8,
            distortion: Distortion::None,
        };
        let half = full.resized(320, 180);
        let point = DVec3::new(0.3, -0.2, 2.0);
        assert!((half.project_pinhole(point) * 2.0 - full.project_pinhole(point)).length() < 1e-12);
    }

    #[test]
    fn what_no_camera_has_is_refused() {
        let distortion = Distortion::BrownConrady([0.1; 8]);
        let good = Intrinsics { width: 640, height: 480, fx: 500.0, fy: 501.0, cx: 320.0, cy: 240.0, distortion };
        assert_eq!(good.checked(), Ok(good));
        let mut coefficients = [0.1; 8];
        coefficients[7] = f64::INFINITY;
        for bad in [
            Intrinsics { width: 0, ..good },
            Intrinsics { height: 65_536, ..good },
            Intrinsics { fx: -500.0, ..good },
            Intrinsics { fy: f64::NAN, ..good },
            Intrinsics { fx: f64::INFINITY, ..good },
            Intrinsics { cx: f64::NAN, ..good },
            Intrinsics { distortion: Distortion::BrownConrady(coefficients), ..good },
        ] {
            assert!(bad.checked().is_err(), "{bad:?}");
        }
        assert_eq!(image_side(640.0), Ok(640));
        for bad in [0.0, -1.0, 0.5, 640.5, 1e30, f64::NAN, f64::INFINITY] {
            assert!(image_side(bad).is_err(), "{bad}");
        }
    }
}

/// What a viewpoint recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Modality {
    /// Frames alone.
    Rgb,
    /// Events alone.
    Event,
    /// Frames and events through one lens.
    Both,
}

impl Modality {
    /// Whether the viewpoint has frames.
    #[must_use]
    pub fn has_frames(self) -> bool {
        self != Self::Event
    }

    /// Whether the viewpoint has events.
    #[must_use]
    pub fn has_events(self) -> bool {
        self != Self::Rgb
    }
}
