//! Sensor and lens of a frame of `transforms.json`.

use erfgs_base::plausible::{Implausible, Quantity, SIDE, focal};
use glam::{DMat3, DVec3};

use super::keys::LensKeys;
use crate::{Distortion, Intrinsics, camera::image_side, exchange::json::Number};

/// Sensor and lens of a frame. The file need not say how large images are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    size: Option<[u32; 2]>,
    /// Across and down.
    focal: [Focal; 2],
    /// Pixels; the middle of the image where absent.
    centre: [Option<f64>; 2],
    distortion: Distortion,
}

/// What a file tells the focal length by.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Focal {
    Pixels(f64),
    /// Half the field of view, the tangent.
    Angle(f64),
    /// As across: pixels are square.
    Square,
}

impl Focal {
    fn new(pixels: Option<Number>, angle: Option<Number>) -> Result<Option<Self>, String> {
        match (pixels, angle) {
            (Some(Number(pixels)), _) => Ok(Some(Self::Pixels(pixels))),
            (None, Some(Number(angle))) if (1e-6..std::f64::consts::PI - 1e-6).contains(&angle) => {
                Ok(Some(Self::Angle((0.5 * angle).tan())))
            }
            (None, Some(Number(angle))) => Err(format!("the field of view {angle} is no angle from 0 to pi")),
            (None, None) => Ok(None),
        }
    }
}

impl Lens {
    /// The lens that keys tell of.
    pub(super) fn new(keys: &LensKeys) -> Result<Self, String> {
        let size = match (keys.w, keys.h) {
            (Some(Number(w)), Some(Number(h))) => Some([image_side(w)?, image_side(h)?]),
            (None, None) => None,
            _ => return Err("there is one of w and h; give both, or neither".to_owned()),
        };
        let Some(across) = Focal::new(keys.fl_x, keys.camera_angle_x)? else {
            return Err("there is neither fl_x nor camera_angle_x; add the focal length in pixels".to_owned());
        };
        let down = Focal::new(keys.fl_y, keys.camera_angle_y)?;
        let centre = [keys.cx, keys.cy].map(|centre| centre.map(|Number(centre)| centre));
        let plain = Self { size, focal: [across, down.unwrap_or(Focal::Square)], centre, distortion: Distortion::None };
        let checked = |lens: &Self| match size {
            Some(size) => lens.intrinsics(size).checked(),
            None => of_any_size(lens.intrinsics([1, 1])),
        };
        let intrinsics = checked(&plain)?;
        // How far from the axis images reach, as the tangent of the angle.
        let reach = match (size, across) {
            (Some(_), _) => {
                let far = |centre: f64, side: u32, focal: f64| centre.max(f64::from(side) - centre) / focal;
                far(intrinsics.cx, intrinsics.width, intrinsics.fx).hypot(far(
                    intrinsics.cy,
                    intrinsics.height,
                    intrinsics.fy,
                ))
            }
            (None, Focal::Angle(tangent)) => 1.25 * tangent,
            (None, _) => 1.0,
        };
        let lens = Self { distortion: distortion(keys, reach)?, ..plain };
        checked(&lens)?;
        Ok(lens)
    }

    /// Width and height of images, where the file says.
    #[must_use]
    pub fn size(&self) -> Option<[u32; 2]> {
        self.size
    }

    /// The intrinsics for images of `width` x `height` pixels, which is [`Lens::size`] unless the file does not say.
    #[must_use]
    pub fn intrinsics(&self, [width, height]: [u32; 2]) -> Intrinsics {
        let [w, h] = [width, height].map(f64::from);
        let focal = |focal: Focal, side: f64, across: f64| match focal {
            Focal::Pixels(pixels) => pixels,
            Focal::Angle(tangent) => 0.5 * side / tangent,
            Focal::Square => across,
        };
        let fx = focal(self.focal[0], w, 0.0);
        let fy = focal(self.focal[1], h, fx);
        let [cx, cy] = self.centre;
        let (cx, cy) = (cx.unwrap_or(0.5 * w), cy.unwrap_or(0.5 * h));
        Intrinsics { width, height, fx, fy, cx, cy, distortion: self.distortion }
    }
}

/// A lens whose file does not say how large images are, if there can be images that it fits. Who knows their size checks again.
fn of_any_size(lens: Intrinsics) -> Result<Intrinsics, Implausible> {
    let any = Quantity { most: focal(SIDE.most).most, ..focal(SIDE.least) };
    any.check_all([lens.fx, lens.fy])?;
    let largest = Intrinsics { width: SIDE.most as u32, fx: SIDE.most, fy: SIDE.most, ..lens };
    Intrinsics { distortion: Distortion::None, ..largest }.checked().map(|_| lens)
}

/// nerfstudio tells apart perspective models by name alone: all share one polynomial of up to four radial coefficients and two
/// tangential ones, of which ours has no fourth: a rational polynomial takes its place. FULL_OPENCV is COLMAP's, OpenCV's rational model.
fn distortion(keys: &LensKeys, reach: f64) -> Result<Distortion, String> {
    let LensKeys { k1, k2, k3, k4, k5, k6, p1, p2, .. } = keys;
    let k = [k1, k2, p1, p2, k3, k4, k5, k6].map(|value| value.map_or(0.0, |Number(value)| value));
    let [k1, k2, p1, p2, k3, k4, k5, k6] = k;
    if !k.iter().all(|value| value.is_finite()) {
        return Err("a distortion coefficient is not finite".to_owned());
    }
    let fisheye = keys.is_fisheye == Some(true);
    let model = keys.model();
    match model {
        "OPENCV_FISHEYE" if [p1, p2, k5, k6] == [0.0; 4] => Ok(Distortion::KannalaBrandt([k1, k2, k3, k4])),
        "OPENCV_FISHEYE" => {
            Err("p1, p2, k5 or k6 with the model OPENCV_FISHEYE cannot be held; calibrate with k1 to k4 alone"
                .to_owned())
        }
        other if fisheye => Err(format!("is_fisheye contradicts the camera model {other}; correct one of them")),
        "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" if [k5, k6] != [0.0; 2] => {
            Err(format!("a k5 or k6 with the model {model} cannot be held; calibrate without"))
        }
        // nerfstudio's k4 is the fourth radial term, OpenCV's the first of a denominator.
        "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" if k4 != 0.0 => {
            let [n1, n2, n3, d1, d2, d3] = rational([k1, k2, k3, k4], reach).ok_or_else(|| {
                format!("k1 to k4 with the model {model} bend images more than our lenses can; calibrate without k4")
            })?;
            Ok(Distortion::BrownConrady([n1, n2, p1, p2, n3, d1, d2, d3]))
        }
        "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" | "FULL_OPENCV" if k == [0.0; 8] => {
            Ok(Distortion::None)
        }
        "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" | "FULL_OPENCV" => {
            Ok(Distortion::BrownConrady(k))
        }
        other => Err(format!(
            "the camera model {} is not supported; PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV and \
             OPENCV_FISHEYE are: undistort the images to one of them",
            other.escape_debug()
        )),
    }
}

/// The polynomial 1 + a1 s + a2 s² + a3 s³ + a4 s⁴ as (1 + n1 s + n2 s² + n3 s³) / (1 + d1 s + d2 s² + d3 s³): Padé's
/// approximation, which agrees with it to the sixth power. `None` where images that reach as far as `reach` would differ by more
/// than a ten-thousandth of the focal length, a twentieth of a pixel or so.
fn rational([a1, a2, a3, a4]: [f64; 4], reach: f64) -> Option<[f64; 6]> {
    const DIFFERS: f64 = 1e-4;
    let matrix = DMat3::from_cols(DVec3::new(a3, a4, 0.0), DVec3::new(a2, a3, a4), DVec3::new(a1, a2, a3));
    let d = matrix.inverse() * DVec3::new(-a4, 0.0, 0.0);
    let n = [a1 + d.x, a2 + a1 * d.x + d.y, a3 + a2 * d.x + a1 * d.y + d.z];
    // A distorted image reaches as far as an undistorted one that is larger or smaller.
    for step in 1..=400 {
        let r = 0.01 * f64::from(step) * reach;
        let s = r * r;
        let wanted = 1.0 + s * (a1 + s * (a2 + s * (a3 + s * a4)));
        let under = 1.0 + s * (d.x + s * (d.y + s * d.z));
        let found = (1.0 + s * (n[0] + s * (n[1] + s * n[2]))) / under;
        // NaN is not near, either.
        let near = (r * (wanted - found)).abs() < DIFFERS && under > 0.0;
        if !near {
            return None;
        }
        if r * wanted > reach {
            break;
        }
    }
    Some([n[0], n[1], n[2], d.x, d.y, d.z])
}
