//! Lenses: what is believed depends on the size of the picture.

use super::{CALIBRATE, Implausible, Quantity, SIDE, check_size};

/// The numbers of a lens, in pixels where they have a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens<'a> {
    /// Width and height of the picture.
    pub size: [u32; 2],
    /// Focal lengths across and down.
    pub focal: [f64; 2],
    /// The principal point.
    pub centre: [f64; 2],
    /// Coefficients of distortion, each with the power of the distance from the axis that it is multiplied by; the distance is that of
    /// the image plane at unit distance, or an angle.
    pub distortion: &'a [(f64, i32)],
}

/// A lens sees less than 179 degrees as a pinhole does, or is a fisheye whose circle is far smaller than the picture.
const SHORTEST: f64 = 0.01;
/// A picture of 1000 pixels behind a focal length of a hundred million is less than 3 seconds of arc wide.
const LONGEST: f64 = 1e5;

/// Focal lengths for a picture whose longest side has so many pixels.
#[must_use]
pub fn focal(longest_side: f64) -> Quantity {
    let remedy = "a focal length is in pixels: calibrate or import it again";
    Quantity::new("the focal length", "px", SHORTEST * longest_side, LONGEST * longest_side, remedy)
}

/// Checks a lens.
///
/// # Errors
/// [`Implausible`]: the size, a focal length, the principal point or a coefficient of distortion.
pub fn check_lens(lens: &Lens<'_>) -> Result<(), Implausible> {
    check_size(lens.size)?;
    let sides = lens.size.map(f64::from);
    focal(sides[0].max(sides[1])).check_all(lens.focal)?;
    let axes = || sides.into_iter().zip(lens.focal).zip(lens.centre);
    for ((side, focal), centre) in axes() {
        principal_point(side, focal).check(centre)?;
    }
    let reach = axes().map(|((side, focal), centre)| centre.abs().max((side - centre).abs()) / focal);
    let reach = reach.fold(0.0, f64::hypot);
    lens.distortion.iter().try_for_each(|&(value, power)| distortion(reach, power).check(value).map(drop))
}

/// A picture may be a part of a larger one, at its edge, and the axis of a long lens may lie outside of both.
fn principal_point(side: f64, focal: f64) -> Quantity {
    let outside = SIDE.most + focal;
    Quantity::new("the principal point", "px", -outside, side + outside, CALIBRATE)
}

/// A coefficient may be as large as this, or bend rays at the corner of the picture by as much: those of long lenses are large, since no ray
/// is far from their axis.
const STRONGEST: f64 = 1e4;

/// A coefficient of distortion, by how far the picture reaches from the axis.
fn distortion(reach: f64, power: i32) -> Quantity {
    let most = STRONGEST.max(STRONGEST / reach.powi(power));
    Quantity::new("a distortion coefficient", "", -most, most, CALIBRATE)
}
