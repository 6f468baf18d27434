//! Projection through distorting lenses, both ways.
//!
//! The models are OpenCV's: Brown-Conrady in its rational form with eight coefficients, and Kannala-Brandt's fisheye
//! (Kannala and Brandt 2006, "A generic camera model and calibration method", equation 9 as OpenCV has it). Both are
//! polynomials that are only right where they were fitted: far from the axis they may fold back, so that two rays meet
//! one pixel. The folded part is refused in both directions; of a fisheye, which is one polynomial of the angle, so is all that
//! lies beyond.

use glam::{DMat2, DVec2, DVec3};

use crate::{Distortion, Intrinsics};

mod derivatives;

pub use derivatives::{INTRINSIC_PARAMETERS, Projection};

/// No ray can be found for a pixel.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("no ray of the lens model meets the pixel ({:.1}, {:.1}); its coefficients do not hold there", .0.x, .0.y)]
pub struct NoRay(pub DVec2);

/// Residual (in units of the focal length) at which an inversion has converged: some 1e-9 px.
const CONVERGED: f64 = 1e-12;
const ITERATIONS: usize = 64;

impl Intrinsics {
    /// The pixel position of a camera-space point, through the lens. `None` where the point lies behind the camera or
    /// where the lens model does not hold.
    #[must_use]
    pub fn project(&self, camera: DVec3) -> Option<DVec2> {
        let DVec2 { x, y } = self.distortion.distort(camera)?;
        Some(DVec2::new(self.fx * x + self.cx, self.fy * y + self.cy))
    }

    /// The direction (of length 1, in camera space) of the ray that meets `pixel`.
    ///
    /// # Errors
    /// If the lens model has no ray there.
    pub fn unproject(&self, pixel: DVec2) -> Result<DVec3, NoRay> {
        let point = DVec2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        self.distortion.undistort(point).ok_or(NoRay(pixel))
    }
}

impl Distortion {
    /// Where a camera-space point lies in the image plane at unit distance, after distortion.
    #[must_use]
    pub fn distort(&self, camera: DVec3) -> Option<DVec2> {
        match self {
            Self::None if camera.z > 0.0 => Some(camera.truncate() / camera.z),
            Self::BrownConrady(k) if camera.z > 0.0 => {
                let (point, jacobian) = brown_conrady(k, camera.truncate() / camera.z)?;
                (jacobian.determinant() > 0.0).then_some(point)
            }
            Self::KannalaBrandt(k) => {
                let radius = camera.truncate().length();
                if radius == 0.0 {
                    return (camera.z > 0.0).then_some(DVec2::ZERO);
                }
                let (distorted, _) = unfolded(k, radius.atan2(camera.z))?;
                Some(camera.truncate() * (distorted / radius))
            }
            Self::None | Self::BrownConrady(_) => None,
        }
    }

    /// The direction (of length 1) that [`Distortion::distort`] takes to `point`, by Newton's method; `None` where it
    /// does not converge.
    #[must_use]
    pub fn undistort(&self, point: DVec2) -> Option<DVec3> {
        if !point.is_finite() {
            return None;
        }
        match self {
            Self::None => Some(point.extend(1.0).normalize()),
            Self::BrownConrady(k) => invert_brown_conrady(k, point).map(|point| point.extend(1.0).normalize()),
            Self::KannalaBrandt(k) => {
                let radius = point.length();
                if radius == 0.0 {
                    return Some(DVec3::Z);
                }
                let (sine, cosine) = invert_kannala_brandt(k, radius)?.sin_cos();
                Some((point * (sine / radius)).extend(cosine))
            }
        }
    }
}

/// The distorted point of an undistorted one, and the derivative of the one with respect to the other. `None` where the
/// denominator vanishes.
fn brown_conrady(&[k1, k2, p1, p2, k3, k4, k5, k6]: &[f64; 8], DVec2 { x, y }: DVec2) -> Option<(DVec2, DMat2)> {
    let r2 = x * x + y * y;
    let polynomial = |a: f64, b: f64, c: f64| (1.0 + r2 * (a + r2 * (b + r2 * c)), a + r2 * (2.0 * b + r2 * 3.0 * c));
    let ((above, d_above), (below, d_below)) = (polynomial(k1, k2, k3), polynomial(k4, k5, k6));
    let radial = above / below;
    if !(below > 0.0 && radial > 0.0) {
        return None;
    }
    // The derivative of the radial factor with respect to r squared.
    let d_radial = (d_above - radial * d_below) / below;
    let point = DVec2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let mixed = 2.0 * x * y * d_radial + 2.0 * p1 * x + 2.0 * p2 * y;
    let jacobian = DMat2::from_cols(
        DVec2::new(radial + 2.0 * x * x * d_radial + 2.0 * p1 * y + 6.0 * p2 * x, mixed),
        DVec2::new(mixed, radial + 2.0 * y * y * d_radial + 6.0 * p1 * y + 2.0 * p2 * x),
    );
    (point.is_finite() && jacobian.is_finite()).then_some((point, jacobian))
}

fn invert_brown_conrady(k: &[f64; 8], target: DVec2) -> Option<DVec2> {
    // A point where the model holds (the axis always is one), from which every step stays on the same side of a fold.
    let usable = |at: DVec2| brown_conrady(k, at).filter(|(_, jacobian)| jacobian.determinant() > 0.0);
    let (mut at, (mut point, mut jacobian)) = match usable(target) {
        Some(value) => (target, value),
        None => (DVec2::ZERO, usable(DVec2::ZERO)?),
    };
    for _ in 0..ITERATIONS {
        let residual = target - point;
        if residual.length() <= CONVERGED * (1.0 + target.length()) {
            return Some(at);
        }
        let step = jacobian.inverse() * residual;
        let better = (0..40).find_map(|halvings| {
            let next = at + step * 0.5_f64.powi(halvings);
            let value = usable(next)?;
            ((target - value.0).length() < residual.length()).then_some((next, value))
        });
        (at, (point, jacobian)) = better?;
    }
    None
}

/// The distorted angle of an angle from the axis, and its derivative.
fn kannala_brandt(&[k1, k2, k3, k4]: &[f64; 4], angle: f64) -> (f64, f64) {
    let a2 = angle * angle;
    let distorted = angle * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))));
    let slope = 1.0 + a2 * (3.0 * k1 + a2 * (5.0 * k2 + a2 * (7.0 * k3 + a2 * 9.0 * k4)));
    (distorted, slope)
}

/// As [`kannala_brandt`], up to the first fold: beyond it the polynomial may grow again, but no lens does that.
fn unfolded(k: &[f64; 4], angle: f64) -> Option<(f64, f64)> {
    let (distorted, slope) = kannala_brandt(k, angle);
    (distorted.is_finite() && grows(k, angle)).then_some((distorted, slope))
}

/// Whether the distorted angle grows all the way from the axis to `angle`.
///
/// Its slope is a polynomial of degree 4 in the square of the angle, which lies between the least and the greatest of its
/// Bernstein coefficients over the interval; where these do not decide, the halves do.
fn grows(&[k1, k2, k3, k4]: &[f64; 4], angle: f64) -> bool {
    /// Halvings after which what is still not decided is a fold.
    const DEPTH: u32 = 40;
    fn positive(b: [f64; 5], depth: u32) -> bool {
        if !(b[0] > 0.0 && b[4] > 0.0) || depth == DEPTH {
            return false;
        }
        if b.iter().all(|value| *value > 0.0) {
            return true;
        }
        // De Casteljau: the means of neighbours, row below row; the halves' coefficients are at the ends of the rows.
        let (mut row, mut first, mut last) = (b, b, b);
        for level in 1..5 {
            for i in 0..5 - level {
                row[i] = 0.5 * (row[i] + row[i + 1]);
            }
            first[level] = row[0];
            last[4 - level] = row[4 - level];
        }
        positive(first, depth + 1) && positive(last, depth + 1)
    }
    let x = angle * angle;
    let [a, b, c, d] = [3.0 * k1 * x, 5.0 * k2 * x * x, 7.0 * k3 * x.powi(3), 9.0 * k4 * x.powi(4)];
    let bernstein =
        [1.0, 1.0 + a / 4.0, 1.0 + a / 2.0 + b / 6.0, 1.0 + 0.75 * a + b / 2.0 + c / 4.0, 1.0 + a + b + c + d];
    positive(bernstein, 0)
}

fn invert_kannala_brandt(k: &[f64; 4], target: f64) -> Option<f64> {
    let (mut angle, (mut distorted, mut slope)) = (0.0, kannala_brandt(k, 0.0));
    for _ in 0..ITERATIONS {
        let residual = target - distorted;
        if residual.abs() <= CONVERGED * (1.0 + target) {
            return Some(angle);
        }
        let better = (0..40).find_map(|halvings| {
            let next = angle + residual / slope * 0.5_f64.powi(halvings);
            let value = (0.0..=std::f64::consts::PI).contains(&next).then(|| unfolded(k, next)).flatten()?;
            ((target - value.0).abs() < residual.abs()).then_some((next, value))
        });
        (angle, (distorted, slope)) = better?;
    }
    None
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn camera(distortion: Distortion) -> Intrinsics {
        Intrinsics { width: 640, height: 480, fx: 500.0, fy: 480.0, cx: 318.0, cy: 244.5, distortion }
    }

    #[test]
    fn brown_conrady_agrees_with_arithmetic_by_hand() {
        // x = 0.5, y = -0.25: r^2 = 0.3125, radial factor 1 + 0.1 * 0.3125 = 1.03125.
        let lens = Distortion::BrownConrady([0.1, 0.0, 0.01, -0.02, 0.0, 0.0, 0.0, 0.0]);
        let point = lens.distort(DVec3::new(1.0, -0.5, 2.0)).unwrap();
        assert!((point - DVec2::new(0.496_875, -0.248_437_5)).length() < 1e-15, "{point}");
        // (1 + 0.2 * 0.3125) / (1 + 0.4 * 0.3125) = 1.0625 / 1.125
        let lens = Distortion::BrownConrady([0.2, 0.0, 0.0, 0.0, 0.0, 0.4, 0.0, 0.0]);
        let point = lens.distort(DVec3::new(0.5, -0.25, 1.0)).unwrap();
        assert!((point - DVec2::new(0.5, -0.25) * (1.0625 / 1.125)).length() < 1e-15, "{point}");
    }

    #[test]
    fn kannala_brandt_is_proportional_to_the_angle_even_beside_the_camera() {
        let lens = Distortion::KannalaBrandt([0.0; 4]);
        let point = lens.distort(DVec3::new(0.0, 5.0, 0.0)).unwrap();
        assert!((point - DVec2::new(0.0, std::f64::consts::FRAC_PI_2)).length() < 1e-15, "{point}");
        let lens = Distortion::KannalaBrandt([0.1, 0.0, 0.0, 0.0]);
        let angle = std::f64::consts::FRAC_PI_4;
        let point = lens.distort(DVec3::new(-3.0, 0.0, 3.0)).unwrap();
        assert!((point.x + angle * (1.0 + 0.1 * angle * angle)).abs() < 1e-15, "{point}");
        assert_eq!(lens.undistort(DVec2::ZERO), Some(DVec3::Z));
    }

    #[test]
    fn what_lies_behind_or_beyond_the_fold_is_refused() {
        let brown = Distortion::BrownConrady([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        for lens in [Distortion::None, brown] {
            assert_eq!(camera(lens).project(DVec3::new(0.1, 0.1, -1.0)), None);
            assert_eq!(camera(lens).project(DVec3::new(0.1, 0.1, 0.0)), None);
        }
        // r (1 - 0.3 r^2) grows up to r = 1.054, where it is 0.703.
        assert!(brown.distort(DVec3::new(1.05, 0.0, 1.0)).is_some());
        assert_eq!(brown.distort(DVec3::new(1.06, 0.0, 1.0)), None);
        assert!(brown.undistort(DVec2::new(0.0, 0.70)).is_some());
        let error = camera(brown).unproject(DVec2::new(318.0 + 500.0 * 0.71, 244.5)).unwrap_err();
        assert!(error.to_string().contains("(673.0, 244.5)"), "{error}");
        let fisheye = Distortion::KannalaBrandt([-0.1, 0.0, 0.0, 0.0]);
        assert_eq!(fisheye.distort(DVec3::new(1.0, 0.0, -0.4)), None);
        assert_eq!(fisheye.undistort(DVec2::new(1.3, 0.0)), None);
        assert_eq!(brown.undistort(DVec2::new(f64::NAN, 0.0)), None);
    }

    #[test]
    fn a_fisheye_that_folds_twice_ends_at_the_first_fold() {
        // The slope 1 + 3 k1 x + 5 k2 x^2 of x, the angle squared, is (1 - x)(1 - x / 2): it falls below nothing between 1 and 2.
        let fisheye = Distortion::KannalaBrandt([-0.5, 0.1, 0.0, 0.0]);
        let at = |angle: f64| fisheye.distort(DVec3::new(angle.sin(), 0.0, angle.cos()));
        assert!(at(0.99).is_some());
        for angle in [1.01, 1.2, 1.40, 1.43, 1.6, 2.5] {
            assert_eq!(at(angle), None, "{angle}");
        }
        // Where it grows again it takes rays to pixels that the first part has, and to pixels that no ray has.
        let (far, _) = kannala_brandt(&[-0.5, 0.1, 0.0, 0.0], 2.5);
        assert!(far > at(0.99).unwrap().x && fisheye.undistort(DVec2::new(far, 0.0)).is_none());
        let ray = fisheye.undistort(DVec2::new(0.55, 0.0)).unwrap();
        assert!(ray.x.atan2(ray.z) < 1.0, "{ray}");
        // 1 - 2 x + x^2 just touches nothing: a little less and there are two folds, a little more and there is none.
        let behind = DVec3::new(1.0, 0.0, -0.5);
        assert_eq!(Distortion::KannalaBrandt([-0.667, 0.2, 0.0, 0.0]).distort(behind), None);
        assert!(Distortion::KannalaBrandt([-0.666, 0.2, 0.0, 0.0]).distort(behind).is_some());
    }

    proptest! {
        #[test]
        fn no_fisheye_has_a_fold_before_a_ray_that_it_projects(
            k in prop::array::uniform4(-1.0..1.0_f64),
            angle in 0.01..3.1_f64,
        ) {
            let lens = Distortion::KannalaBrandt(k);
            let least = (0..=1000).map(|i| kannala_brandt(&k, angle * f64::from(i) / 1000.0).1).fold(f64::INFINITY, f64::min);
            prop_assume!(least.abs() > 1e-3);
            let seen = lens.distort(DVec3::new(angle.sin(), 0.0, angle.cos()));
            prop_assert_eq!(seen.is_some(), least > 0.0);
        }

        #[test]
        fn pixels_come_back_through_moderate_lenses(
            k in prop::array::uniform8(-1.0..1.0_f64),
            x in 0.0..640.0_f64,
            y in 0.0..480.0_f64,
            fisheye in any::<bool>(),
        ) {
            let scale = [0.15, 0.05, 0.01, 0.01, 0.02, 0.05, 0.02, 0.01];
            let c: [f64; 8] = std::array::from_fn(|i| k[i] * scale[i]);
            let lens =
                if fisheye { Distortion::KannalaBrandt([c[0], c[1], c[2], c[3]]) } else { Distortion::BrownConrady(c) };
            let (camera, pixel) = (camera(lens), DVec2::new(x, y));
            let ray = camera.unproject(pixel).unwrap();
            prop_assert!((ray.length() - 1.0).abs() < 1e-12);
            prop_assert!((camera.project(ray * 7.0).unwrap() - pixel).length() < 1e-8);
        }

        #[test]
        fn inverting_any_lens_gives_a_ray_that_meets_the_pixel_or_none(
            k in prop::array::uniform8(-3.0..3.0_f64),
            x in -2.0..2.0_f64,
            y in -2.0..2.0_f64,
            fisheye in any::<bool>(),
        ) {
            let lens =
                if fisheye { Distortion::KannalaBrandt([k[0], k[1], k[2], k[3]]) } else { Distortion::BrownConrady(k) };
            if let Some(ray) = lens.undistort(DVec2::new(x, y)) {
                prop_assert!((lens.distort(ray).unwrap() - DVec2::new(x, y)).length() < 1e-9);
            }
        }
    }
}
