//! Standard 3DGS point clouds: what other viewers and tools read.

use std::path::Path;

use erfgs_scene::ply::{GaussianCloud, GaussianCloudError};

use crate::gaussians::{CORE, Gaussians, sh_stride};

/// Writes Gaussians, in one step.
///
/// # Errors
/// [`GaussianCloudError::Write`], [`GaussianCloudError::Length`], [`GaussianCloudError::ShDegree`].
pub fn write_ply(path: &Path, gaussians: &Gaussians) -> Result<(), GaussianCloudError> {
    GaussianCloud::from(gaussians).write(path)
}

impl From<&Gaussians> for GaussianCloud {
    /// The same values without what pads the rows. The file does not say which Gaussians move.
    fn from(gaussians: &Gaussians) -> Self {
        let mut cloud = Self { sh_degree: gaussians.sh_degree, ..Self::default() };
        for row in gaussians.core.as_chunks::<CORE>().0 {
            let &[x, y, z, a, b, c, qw, qx, qy, qz, opacity, _] = row;
            cloud.positions.push([x, y, z]);
            cloud.log_scales.push([a, b, c]);
            cloud.rotations.push([qw, qx, qy, qz]);
            cloud.opacity_logits.push(opacity);
        }
        let used = cloud.sh_stride();
        for row in gaussians.sh.chunks(sh_stride(gaussians.sh_degree)) {
            cloud.sh.extend(row.iter().take(used));
        }
        cloud
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussians of distinct values.
    fn gaussians(sh_degree: u32, count: usize) -> Gaussians {
        let values = |count: usize| (0..count).map(|i| i as f32).collect();
        let (core, sh) = (values(count * CORE), values(count * sh_stride(sh_degree)));
        Gaussians { sh_degree, dynamic: 1, core, sh, ..Gaussians::default() }
    }

    #[test]
    fn rows_are_written_without_their_padding() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        write_ply(&path, &gaussians(0, 2)).unwrap();
        let cloud = GaussianCloud::read(&path).unwrap();
        assert_eq!(cloud.positions, [[0.0, 1.0, 2.0], [12.0, 13.0, 14.0]]);
        assert_eq!(cloud.log_scales, [[3.0, 4.0, 5.0], [15.0, 16.0, 17.0]]);
        assert_eq!(cloud.rotations, [[6.0, 7.0, 8.0, 9.0], [18.0, 19.0, 20.0, 21.0]]);
        assert_eq!(cloud.opacity_logits, [10.0, 22.0]);
        assert_eq!(cloud.sh, [0.0, 1.0, 2.0, 4.0, 5.0, 6.0]);
        for degree in 0..=3 {
            let cloud = GaussianCloud::from(&gaussians(degree, 3));
            assert_eq!((cloud.len(), cloud.sh.len()), (3, 9 * (degree as usize + 1).pow(2)), "degree {degree}");
        }
    }

    #[test]
    fn rows_that_do_not_fit_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        let wrong = Gaussians { sh_degree: 1, ..gaussians(0, 2) };
        let error = write_ply(&path, &wrong).unwrap_err();
        assert!(matches!(error, GaussianCloudError::Length { count: 2, expected: 24, found: 8, .. }), "{error}");
        let error = write_ply(&path, &Gaussians { sh_degree: 4, ..wrong }).unwrap_err();
        assert!(matches!(error, GaussianCloudError::ShDegree(4)), "{error}");
    }
}
