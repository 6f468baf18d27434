//! Twin of `raster/project.wgsl`.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::raster::{RenderOptions, View};

/// A Gaussian as it appears in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Mean, pixels.
    pub mean: DVec2,
    /// Inverse covariance a, b, c: [a b; b c], per square pixel.
    pub conic: [f64; 3],
    /// Opacity, 0 to 1.
    pub opacity: f64,
    /// r, g, b.
    pub colour: DVec3,
    /// Depth along the optical axis, metres.
    pub depth: f64,
    /// Three standard deviations along the longest axis, pixels.
    pub radius: f64,
}

/// Projects one Gaussian (`core`: a row of 12, `sh`: a row of coefficients); `None` where it is culled.
///
/// EWA splatting (Zwicker et al. 2001) as in 3D Gaussian splatting (Kerbl et al. 2023): the covariance is `J W S W^T J^T`
/// plus the low pass, with the slopes x/z and y/z in the Jacobian `J` bounded to 15 % of the image beyond each
/// border.
#[must_use]
pub fn project(core: &[f64], sh: &[f64], view: &View, options: &RenderOptions) -> Option<Splat> {
    project_from(core, sh, view, &pose(view), options)
}

/// Where a view says that its camera is: rotation and translation from the world to the camera.
#[must_use]
pub fn pose(view: &View) -> (DMat3, DVec3) {
    let rotation = DMat3::from_cols_array(&std::array::from_fn(|i| f64::from(view.rotation[i / 3][i % 3]))).transpose();
    (rotation, DVec3::from(view.translation.map(f64::from)))
}

/// The same from a pose of its own, to the precision that differences need.
#[must_use]
pub fn project_from(
    core: &[f64],
    sh: &[f64],
    view: &View,
    &(world_to_camera, translation): &(DMat3, DVec3),
    options: &RenderOptions,
) -> Option<Splat> {
    let mean = DVec3::from_slice(&core[0..3]);
    let camera = world_to_camera * mean + translation;
    let scale = DVec3::from_slice(&core[3..6]).min(DVec3::splat(20.0)).exp();
    let raw = DQuat::from_xyzw(core[7], core[8], core[9], core[6]);
    let opacity = 1.0 / (1.0 + (-core[10]).exp());
    if raw.length_squared() < 1e-12 {
        return None;
    }
    let axes = world_to_camera * DMat3::from_quat(raw.normalize()) * DMat3::from_diagonal(scale);
    let axes = axes.transpose();
    let reach = f64::from(options.near_sigmas) * axes.z_axis.length();
    let in_front = camera.z > f64::from(options.near) && camera.z > reach;
    if !in_front {
        return None;
    }
    let (fx, fy) = (f64::from(view.fx), f64::from(view.fy));
    let (cx, cy) = (f64::from(view.cx), f64::from(view.cy));
    let (width, height) = (f64::from(view.width), f64::from(view.height));
    let x = (camera.x / camera.z).clamp((-0.15 * width - cx) / fx, (1.15 * width - cx) / fx);
    let y = (camera.y / camera.z).clamp((-0.15 * height - cy) / fy, (1.15 * height - cy) / fy);
    let row_x = fx / camera.z * DVec3::new(1.0, 0.0, -x);
    let row_y = fy / camera.z * DVec3::new(0.0, 1.0, -y);
    let (root_x, root_y) = (axes * row_x, axes * row_y);
    let low_pass = f64::from(options.low_pass);
    let (xx, xy, yy) = (root_x.length_squared() + low_pass, root_x.dot(root_y), root_y.length_squared() + low_pass);
    let determinant = root_x.cross(root_y).length_squared() + low_pass * (xx + yy) - low_pass * low_pass;
    let centre = -(world_to_camera.transpose() * translation);
    let splat = Splat {
        mean: DVec2::new(fx * camera.x / camera.z + cx, fy * camera.y / camera.z + cy),
        conic: [yy / determinant, -xy / determinant, xx / determinant],
        opacity,
        colour: colour(sh, options.sh_degree, (mean - centre).normalize()).max(DVec3::ZERO),
        depth: camera.z,
        radius: 3.0 * (0.5 * (xx + yy) + (0.25 * (xx - yy).powi(2) + xy * xy).sqrt()).sqrt(),
    };
    let finite = splat.mean.is_finite() && splat.colour.is_finite() && splat.conic.iter().all(|x| x.is_finite());
    (finite && opacity >= 1.0 / 255.0).then_some(splat)
}

/// `0.5 + sum of coefficients times harmonics`, with the signs of the 3DGS code; not clamped.
#[must_use]
pub fn colour(sh: &[f64], degree: u32, direction: DVec3) -> DVec3 {
    let count = ((degree + 1) * (degree + 1)) as usize;
    harmonics(direction)
        .iter()
        .zip(sh.chunks_exact(3))
        .take(count)
        .fold(DVec3::splat(0.5), |sum, (value, coefficient)| sum + *value * DVec3::from_slice(coefficient))
}

/// Real spherical harmonics up to degree 3, from their closed forms.
fn harmonics(d: DVec3) -> [f64; 16] {
    use std::f64::consts::PI;
    let DVec3 { x, y, z } = d;
    let root = |numerator: f64, denominator: f64| (numerator / (denominator * PI)).sqrt();
    [
        root(1.0, 4.0),
        -root(3.0, 4.0) * y,
        root(3.0, 4.0) * z,
        -root(3.0, 4.0) * x,
        root(15.0, 4.0) * x * y,
        -root(15.0, 4.0) * y * z,
        root(5.0, 16.0) * (3.0 * z * z - 1.0),
        -root(15.0, 4.0) * x * z,
        root(15.0, 16.0) * (x * x - y * y),
        -root(35.0, 32.0) * y * (3.0 * x * x - y * y),
        root(105.0, 4.0) * x * y * z,
        -root(21.0, 32.0) * y * (5.0 * z * z - 1.0),
        root(7.0, 16.0) * z * (5.0 * z * z - 3.0),
        -root(21.0, 32.0) * x * (5.0 * z * z - 1.0),
        root(105.0, 16.0) * z * (x * x - y * y),
        -root(35.0, 32.0) * x * (x * x - 3.0 * y * y),
    ]
}
