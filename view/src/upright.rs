//! Gaussians at an instant in the axes that other programs draw in: x right, y up, z backward. Those of cameras here are x right, y down,
//! z forward, so that all is turned half around x, the harmonics too.

use erfgs_scene::ply::GaussianCloud;
use erfgs_splat::gaussians::sigmoid;

/// What is fainter is not written.
const LEAST_OPACITY: f32 = 1.0 / 255.0;

/// Of each degree, the signs of the harmonics that are turned half around x.
pub const HARMONICS: [&[f32]; 4] =
    [&[1.0], &[-1.0, -1.0, 1.0], &[-1.0, 1.0, 1.0, -1.0, 1.0], &[-1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0]];

/// Of a cloud nothing can be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("at this instant no Gaussian can be seen; take another with --at")]
pub struct NothingSeen;

/// A file of those that can be seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The file.
    pub bytes: Vec<u8>,
    /// Gaussians of the file.
    pub gaussians: usize,
}

/// Those Gaussians of a cloud that can be seen.
pub fn seen(cloud: &GaussianCloud) -> Result<Vec<usize>, NothingSeen> {
    let seen: Vec<usize> = (0..cloud.len()).filter(|&index| opacity(cloud, index) >= LEAST_OPACITY).collect();
    if seen.is_empty() { Err(NothingSeen) } else { Ok(seen) }
}

/// From 0 to 1.
pub fn opacity(cloud: &GaussianCloud, index: usize) -> f32 {
    sigmoid(cloud.opacity_logits[index])
}

/// A place, turned half around x.
pub fn place([x, y, z]: [f32; 3]) -> [f32; 3] {
    [x, -y, -z]
}

/// A rotation (w, x, y, z, of any length), followed by half a turn around x: x, y, z, w of length 1.
pub fn rotation(wxyz: [f32; 4]) -> [f32; 4] {
    let length = wxyz.iter().map(|part| part * part).sum::<f32>().sqrt();
    // A quaternion of nothing turns nothing.
    let [w, x, y, z] = if length > 0.0 { wxyz.map(|part| part / length) } else { [1.0, 0.0, 0.0, 0.0] };
    [w, -z, y, -x]
}

#[cfg(test)]
pub mod tests {
    /// The functions of the extension's appendix, but for their factors, which turning does not change.
    pub fn harmonics([x, y, z]: [f32; 3]) -> [f32; 16] {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        [
            1.0,
            y,
            z,
            x,
            x * y,
            y * z,
            2.0 * zz - xx - yy,
            x * z,
            xx - yy,
            y * (3.0 * xx - yy),
            x * y * z,
            y * (4.0 * zz - xx - yy),
            z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            x * (4.0 * zz - xx - yy),
            z * (xx - yy),
            x * (xx - 3.0 * yy),
        ]
    }
}
