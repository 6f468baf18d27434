//! The wand in one view: its place follows from the gaps alone.
//!
//! The middle LED divides the stick in a known ratio, which gives the distances along the three rays up to one factor, and
//! the wand's length gives the factor. The tilt towards the camera is known badly (some degrees), and the distance with it;
//! for starting values that is enough, and no other camera is needed.

use erfgs_scene::Intrinsics;
use glam::{DVec2, DVec3};
use nalgebra::{Matrix3, SVD};

use super::Stick;

/// Farther than this from the line of the outer two, in pixels of the focal length, the middle LED is something else.
const BENT_PX: f64 = 4.0;
/// A wand whose ends differ more in distance is so near that labels in the wrong order are likelier.
const STEEP: f64 = 2.0;

/// The wand in one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lone {
    /// Rays through the LEDs in camera space, length 1.
    pub rays: [DVec3; 3],
    /// Where the LEDs are in camera space, metres.
    pub points: [DVec3; 3],
    /// How much this view's distances count against others': 1 at 1 m seen broadside, less farther away or tilted.
    pub weight: f64,
}

impl Lone {
    /// The wand from three pixels, in the order of the gaps; `None` where they are no wand.
    pub fn new(stick: &Stick, intrinsics: &Intrinsics, pixels: [DVec2; 3]) -> Option<Self> {
        let mut rays = [DVec3::ZERO; 3];
        for (ray, pixel) in rays.iter_mut().zip(pixels) {
            *ray = intrinsics.unproject(pixel).ok()?;
        }
        let normal = rays[0].cross(rays[2]);
        let bent = rays[1].dot(normal.normalize_or_zero()).abs() * intrinsics.fx;
        if bent > BENT_PX || normal.length() * intrinsics.fx < BENT_PX {
            return None;
        }
        let ranges = ranges(stick, &rays)?;
        let points: [DVec3; 3] = std::array::from_fn(|i| rays[i] * ranges[i]);
        let along = (points[2] - points[0]).normalize();
        let broadside = along.cross(rays[1]).length();
        Some(Self { rays, points, weight: (broadside * broadside / ranges[1]).powi(2) })
    }

    /// Whether it is so far from the camera, for its length, as wands are.
    pub fn is_likely(&self) -> bool {
        self.steepness() <= STEEP.ln()
    }

    /// The logarithm of how much farther one end is than the other.
    fn steepness(&self) -> f64 {
        (self.points[2].length() / self.points[0].length()).ln().abs()
    }
}

/// The distances of the LEDs along their rays, metres.
fn ranges(stick: &Stick, rays: &[DVec3; 3]) -> Option<[f64; 3]> {
    let share = stick.share();
    let columns = [rays[0] * (1.0 - share), -rays[1], rays[2] * share];
    let matrix = Matrix3::from_fn(|row, column| columns[column][row]);
    let svd = SVD::new(matrix, false, true);
    let least = svd.singular_values.imin();
    let row = svd.v_t?;
    let mut ranges: [f64; 3] = std::array::from_fn(|i| row[(least, i)]);
    if ranges[1] < 0.0 {
        ranges = ranges.map(|range| -range);
    }
    let scale = stick.length_m() / (rays[2] * ranges[2] - rays[0] * ranges[0]).length();
    let ranges = ranges.map(|range| range * scale);
    ranges.iter().all(|range| *range > 1e-3 && range.is_finite()).then_some(ranges)
}

/// Puts three LEDs into the order of the gaps where the order given cannot be: the middle one first, by its place on the
/// line, then the ends, by which is nearer to the middle one. Equal gaps say nothing about the ends.
pub(super) fn label(stick: &Stick, intrinsics: &Intrinsics, pixels: [DVec2; 3]) -> [DVec2; 3] {
    let [a, b, c] = pixels;
    let between = |middle: DVec2, from: DVec2, to: DVec2| (middle - from).dot(to - middle) > 0.0;
    let ordered = if between(b, a, c) {
        [a, b, c]
    } else if between(a, b, c) {
        [b, a, c]
    } else {
        [a, c, b]
    };
    let reversed = [ordered[2], ordered[1], ordered[0]];
    let steepness = |pixels| Lone::new(stick, intrinsics, pixels).map_or(f64::INFINITY, |lone| lone.steepness());
    let (straight, other) = (steepness(ordered), steepness(reversed));
    if straight > STEEP.ln() && other < 0.7 * straight {
        reversed
    } else if straight.is_finite() {
        ordered
    } else {
        // One of them is no LED of the wand; which one is for the adjustment to find out.
        pixels
    }
}

#[cfg(test)]
mod tests {
    use erfgs_scene::Distortion;

    use super::*;

    fn camera(distortion: Distortion) -> Intrinsics {
        Intrinsics { width: 1280, height: 720, fx: 900.0, fy: 905.0, cx: 640.0, cy: 355.0, distortion }
    }

    fn seen(camera: &Intrinsics, middle: DVec3, direction: DVec3) -> ([DVec3; 3], [DVec2; 3]) {
        let stick = Stick::new([0.13, 0.26]).unwrap();
        let points = stick.offsets_m().map(|offset| middle + direction.normalize() * offset);
        (points, points.map(|point| camera.project(point).unwrap()))
    }

    #[test]
    fn one_view_tells_where_the_wand_is() {
        let stick = Stick::new([0.13, 0.26]).unwrap();
        let lenses = [
            Distortion::None,
            Distortion::BrownConrady([-0.2, 0.05, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]),
            Distortion::KannalaBrandt([0.02, 0.0, 0.0, 0.0]),
        ];
        for lens in lenses {
            let camera = camera(lens);
            let (points, pixels) = seen(&camera, DVec3::new(0.3, -0.4, 2.5), DVec3::new(1.0, 0.3, -0.8));
            let lone = Lone::new(&stick, &camera, pixels).unwrap();
            for (found, known) in lone.points.iter().zip(points) {
                assert!((*found - known).length() < 1e-6, "{lens:?} {found} {known}");
            }
        }
        // Beside a fisheye camera, and behind it.
        let camera = camera(Distortion::KannalaBrandt([0.0; 4]));
        let (points, pixels) = seen(&camera, DVec3::new(-1.5, 0.2, -0.1), DVec3::new(0.2, 1.0, 0.5));
        let lone = Lone::new(&stick, &camera, pixels).unwrap();
        assert!((lone.points[0] - points[0]).length() < 1e-6);
    }

    #[test]
    fn wrong_orders_are_put_right() {
        let (stick, camera) = (Stick::new([0.13, 0.26]).unwrap(), camera(Distortion::None));
        for tilt in [-0.9, -0.3, 0.0, 0.4, 0.9] {
            let (_, [a, b, c]) = seen(&camera, DVec3::new(0.1, 0.1, 1.5), DVec3::new(0.5, 1.0, tilt));
            for given in [[a, b, c], [c, b, a], [b, a, c], [a, c, b], [b, c, a], [c, a, b]] {
                assert_eq!(label(&stick, &camera, given), [a, b, c], "{tilt}");
            }
        }
    }

    #[test]
    fn three_lights_that_are_no_wand_are_none() {
        let (stick, camera) = (Stick::new([0.13, 0.26]).unwrap(), camera(Distortion::None));
        let bent = [DVec2::new(100.0, 100.0), DVec2::new(200.0, 120.0), DVec2::new(400.0, 100.0)];
        assert_eq!(Lone::new(&stick, &camera, bent), None);
        assert_eq!(Lone::new(&stick, &camera, [DVec2::new(300.0, 200.0); 3]), None);
    }
}
