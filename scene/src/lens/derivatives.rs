//! Projection with its derivatives by the point and by the intrinsics, for solvers.

use glam::{DVec2, DVec3};

use super::{brown_conrady, unfolded};
use crate::{Distortion, Intrinsics};

/// Number of intrinsic parameters that a derivative is given for: fx, fy, cx, cy, then eight coefficients in the order
/// of [`Distortion::BrownConrady`] (four and zeros for [`Distortion::KannalaBrandt`]).
pub const INTRINSIC_PARAMETERS: usize = 12;

/// The pixel of a camera-space point, and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Position, pixels.
    pub pixel: DVec2,
    /// Derivative of the pixel (x, y) by the point, pixels per metre.
    pub by_point: [DVec3; 2],
    /// Derivative of the pixel (x, y) by the intrinsics.
    pub by_intrinsics: [[f64; INTRINSIC_PARAMETERS]; 2],
}

/// The image-plane point of a camera-space point before focal length and principal point.
struct Bent {
    point: DVec2,
    by_point: [DVec3; 2],
    by_coefficients: [[f64; 8]; 2],
}

impl Intrinsics {
    /// [`Intrinsics::project`] with derivatives; `None` where that gives none.
    #[must_use]
    pub fn project_with_derivatives(&self, camera: DVec3) -> Option<Projection> {
        let bent = self.distortion.distort_with_derivatives(camera)?;
        let mut by_intrinsics = [[0.0; INTRINSIC_PARAMETERS]; 2];
        for (axis, focal) in [self.fx, self.fy].into_iter().enumerate() {
            by_intrinsics[axis][axis] = bent.point[axis];
            by_intrinsics[axis][2 + axis] = 1.0;
            for (to, from) in by_intrinsics[axis][4..].iter_mut().zip(bent.by_coefficients[axis]) {
                *to = focal * from;
            }
        }
        Some(Projection {
            pixel: DVec2::new(self.fx * bent.point.x + self.cx, self.fy * bent.point.y + self.cy),
            by_point: [bent.by_point[0] * self.fx, bent.by_point[1] * self.fy],
            by_intrinsics,
        })
    }
}

impl Distortion {
    fn distort_with_derivatives(&self, camera: DVec3) -> Option<Bent> {
        match self {
            Self::None => {
                let (point, by_point) = pinhole(camera)?;
                Some(Bent { point, by_point, by_coefficients: [[0.0; 8]; 2] })
            }
            Self::BrownConrady(k) => {
                let (point, by_camera) = pinhole(camera)?;
                let (bent, slope) = brown_conrady(k, point).filter(|(_, slope)| slope.determinant() > 0.0)?;
                let by_point = [0, 1].map(|axis| {
                    let row = slope.row(axis);
                    by_camera[0] * row.x + by_camera[1] * row.y
                });
                Some(Bent { point: bent, by_point, by_coefficients: by_brown_conrady(k, point) })
            }
            Self::KannalaBrandt(k) => by_kannala_brandt(k, camera),
        }
    }
}

fn pinhole(camera: DVec3) -> Option<(DVec2, [DVec3; 2])> {
    if camera.z <= 0.0 || !camera.is_finite() {
        return None;
    }
    let (point, near) = (camera.truncate() / camera.z, 1.0 / camera.z);
    Some((point, [DVec3::new(near, 0.0, -point.x * near), DVec3::new(0.0, near, -point.y * near)]))
}

fn by_brown_conrady(&[k1, k2, _, _, k3, k4, k5, k6]: &[f64; 8], DVec2 { x, y }: DVec2) -> [[f64; 8]; 2] {
    let r2 = x * x + y * y;
    let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
    let (up, down) = (r2 / below, -above / below * r2 / below);
    let row = |a: f64, [p1, p2]: [f64; 2]| {
        [a * up, a * up * r2, p1, p2, a * up * r2 * r2, a * down, a * down * r2, a * down * r2 * r2]
    };
    [row(x, [2.0 * x * y, r2 + 2.0 * x * x]), row(y, [r2 + 2.0 * y * y, 2.0 * x * y])]
}

fn by_kannala_brandt(k: &[f64; 4], camera: DVec3) -> Option<Bent> {
    let flat = camera.truncate();
    let (radius, squared) = (flat.length(), camera.length_squared());
    // So near to the axis that the direction from it has no digits left: the lens is a pinhole there.
    if radius <= 1e-12 * squared.sqrt() {
        let (point, by_point) = pinhole(camera)?;
        return Some(Bent { point, by_point, by_coefficients: [[0.0; 8]; 2] });
    }
    let angle = radius.atan2(camera.z);
    let (distorted, slope) = unfolded(k, angle)?;
    let out = flat / radius;
    let by_angle = DVec3::new(camera.z * out.x, camera.z * out.y, -radius) / squared;
    let stretch = distorted / radius;
    let turn = [
        DVec3::new(out.y * out.y, -out.x * out.y, 0.0) * stretch,
        DVec3::new(-out.x * out.y, out.x * out.x, 0.0) * stretch,
    ];
    let mut by_coefficients = [[0.0; 8]; 2];
    for axis in 0..2 {
        let mut power = angle;
        for coefficient in &mut by_coefficients[axis][..4] {
            power *= angle * angle;
            *coefficient = out[axis] * power;
        }
    }
    Some(Bent {
        point: out * distorted,
        by_point: [by_angle * (slope * out.x) + turn[0], by_angle * (slope * out.y) + turn[1]],
        by_coefficients,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn intrinsics(values: [f64; 12], kind: u8) -> Intrinsics {
        let [fx, fy, cx, cy, k @ ..] = values;
        let distortion = match kind {
            0 => Distortion::None,
            1 => Distortion::BrownConrady(k),
            _ => Distortion::KannalaBrandt([k[0], k[1], k[2], k[3]]),
        };
        Intrinsics { width: 640, height: 480, fx, fy, cx, cy, distortion }
    }

    proptest! {
        #[test]
        fn derivatives_are_the_limits_of_differences(
            k in prop::array::uniform8(-1.0..1.0_f64),
            point in prop::array::uniform3(-1.0..1.0_f64),
            kind in 0..3_u8,
        ) {
            let scale = [0.15, 0.05, 0.01, 0.01, 0.02, 0.05, 0.02, 0.01];
            let mut values = [500.0, 480.0, 318.0, 244.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            for (i, value) in values[4..].iter_mut().enumerate() {
                *value = k[i] * scale[i];
            }
            // A fisheye sees beside and behind itself, too.
            let depth = if kind == 2 { 0.3 * point[2] } else { 1.5 + 0.5 * point[2] };
            let point = DVec3::new(point[0], point[1], depth);
            prop_assume!(point.truncate().length() > 0.05);
            let camera = intrinsics(values, kind);
            // Where a random lens folds there is nothing to compare, nor near there: farther out is to the side, and behind
            // the camera backwards. A fold may end before.
            for farther in [DVec3::ZERO, point.truncate().extend(0.0) * 0.1, DVec3::NEG_Z * 0.05] {
                prop_assume!(camera.project(point + farther).is_some());
            }
            let at = camera.project_with_derivatives(point).unwrap();
            prop_assert!((at.pixel - camera.project(point).unwrap()).length() < 1e-9);
            for axis in 0..3 {
                let mut step = DVec3::ZERO;
                step[axis] = 1e-6;
                let slope = (camera.project(point + step).unwrap() - camera.project(point - step).unwrap()) / 2e-6;
                for row in 0..2 {
                    prop_assert!((slope[row] - at.by_point[row][axis]).abs() < 1e-4 * (1.0 + slope[row].abs()));
                }
            }
            let parameters = [4, 12, 8][usize::from(kind)];
            for i in 0..parameters {
                let moved = |by: f64| {
                    let mut values = values;
                    values[i] += by;
                    intrinsics(values, kind).project(point).unwrap()
                };
                let slope = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                for row in 0..2 {
                    let analytic = at.by_intrinsics[row][i];
                    prop_assert!((slope[row] - analytic).abs() < 1e-4 * (1.0 + slope[row].abs()), "{i} {row}");
                }
            }
        }
    }

    #[test]
    fn a_fisheye_on_its_axis_is_a_pinhole() {
        let camera = intrinsics([500.0, 480.0, 318.0, 244.5, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2);
        let at = camera.project_with_derivatives(DVec3::new(0.0, 0.0, 2.0)).unwrap();
        assert_eq!(at.pixel, DVec2::new(318.0, 244.5));
        assert_eq!(at.by_point, [DVec3::new(250.0, 0.0, 0.0), DVec3::new(0.0, 240.0, 0.0)]);
        assert_eq!(camera.project_with_derivatives(DVec3::new(0.0, 0.0, -2.0)), None);
    }
}
