//! The exact place of a corner where two edges cross.
//!
//! Around a corner, the brightness changes across the edges only, so that at each pixel the direction to the corner is at
//! right angles to the gradient or the gradient is nil (Förstner and Gülch 1987). The corner is where that holds best in the
//! least squares; repeated around the place found last.

use glam::{DMat2, DVec2};

use super::detect::Grey;

const ITERATIONS: usize = 40;

/// The corner near `start` (pixels, centres at half-integers), from a window of `2 radius + 1` pixels. `None` where there is no
/// corner within half a window.
pub(super) fn refine(image: &Grey, start: DVec2, radius: i32) -> Option<DVec2> {
    let mut at = start;
    let sigma2 = f64::from(radius * radius);
    for _ in 0..ITERATIONS {
        let mut matrix = DMat2::ZERO;
        let mut right = DVec2::ZERO;
        for y in -radius..=radius {
            for x in -radius..=radius {
                let offset = DVec2::new(f64::from(x), f64::from(y));
                let place = at + offset;
                let slope = DVec2::new(
                    image.sample(place + DVec2::X)? - image.sample(place - DVec2::X)?,
                    image.sample(place + DVec2::Y)? - image.sample(place - DVec2::Y)?,
                );
                let weight = (-(offset.x * offset.x) / sigma2).exp() * (-(offset.y * offset.y) / sigma2).exp();
                let outer = DMat2::from_cols(slope * slope.x, slope * slope.y) * weight;
                matrix += outer;
                right += outer * offset;
            }
        }
        // Both edges must be there: the smaller eigenvalue of the sum is that of the fainter one.
        let (trace, determinant) = (matrix.x_axis.x + matrix.y_axis.y, matrix.determinant());
        if determinant <= 1e-4 * trace * trace {
            return None;
        }
        let step = matrix.inverse() * right;
        at += step;
        if (at - start).length() > f64::from(radius) {
            return None;
        }
        if step.length() < 1e-4 {
            break;
        }
    }
    Some(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A corner of a slanted chessboard at `corner`, through a lens that spreads a point over two pixels.
    fn picture(corner: DVec2) -> Grey {
        let (a, b) = (DVec2::from_angle(0.2), DVec2::from_angle(1.5));
        let mut pixels = Vec::new();
        for y in 0..40 {
            for x in 0..40 {
                let mut bright = 0;
                for sub in 0..256 {
                    let place = DVec2::new(
                        f64::from(x) - 0.5 + (f64::from(sub % 16) + 0.5) / 8.0,
                        f64::from(y) - 0.5 + (f64::from(sub / 16) + 0.5) / 8.0,
                    );
                    bright += i32::from((a.perp_dot(place - corner) > 0.0) == (b.perp_dot(place - corner) > 0.0));
                }
                pixels.push((30 + bright * 200 / 256) as u8);
            }
        }
        Grey { width: 40, height: 40, pixels }
    }

    #[test]
    fn a_corner_is_found_to_a_twentieth_of_a_pixel() {
        for corner in [DVec2::new(20.0, 20.0), DVec2::new(19.3, 20.8), DVec2::new(20.47, 19.61)] {
            let found = refine(&picture(corner), DVec2::new(21.0, 19.0), 5).unwrap();
            assert!((found - corner).length() < 0.05, "{found} {corner}");
        }
    }

    #[test]
    fn flat_places_and_edges_are_no_corners() {
        let flat = Grey { width: 40, height: 40, pixels: vec![90; 1600] };
        assert_eq!(refine(&flat, DVec2::splat(20.0), 5), None);
        let edge = (0..1600).map(|i| if i % 40 < 20 { 20 } else { 220 }).collect();
        assert_eq!(refine(&Grey { width: 40, height: 40, pixels: edge }, DVec2::splat(20.0), 5), None);
        assert_eq!(refine(&flat, DVec2::splat(1.0), 5), None, "too near to the border");
    }
}
