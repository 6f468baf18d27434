//! Rigid world-to-camera transforms.

use erfgs_base::plausible::{Implausible, POSITION, QUATERNION};
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A rigid transform that takes world points (metres) to camera points: `x_camera = R x_world + t`.
///
/// In files it is written as `{"rotation_wxyz": [w, x, y, z], "translation_m": [x, y, z]}`, COLMAP's parametrisation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "PoseFile", into = "PoseFile")]
pub struct Pose {
    /// Unit quaternion of the world-to-camera rotation.
    pub rotation: DQuat,
    /// World-to-camera translation, metres.
    pub translation: DVec3,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
struct PoseFile {
    rotation_wxyz: [f64; 4],
    translation_m: [f64; 3],
}

impl From<PoseFile> for Pose {
    fn from(file: PoseFile) -> Self {
        let [w, x, y, z] = file.rotation_wxyz;
        Self { rotation: DQuat::from_xyzw(x, y, z, w), translation: file.translation_m.into() }
    }
}

impl From<Pose> for PoseFile {
    fn from(pose: Pose) -> Self {
        let q = pose.rotation;
        Self { rotation_wxyz: [q.w, q.x, q.y, q.z], translation_m: pose.translation.to_array() }
    }
}

impl Pose {
    /// The transform that leaves points where they are.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// From a rotation matrix and a translation; the matrix is projected onto the nearest rotation by normalisation.
    #[must_use]
    pub fn from_matrix(rotation: DMat3, translation: DVec3) -> Self {
        Self { rotation: DQuat::from_mat3(&rotation).normalize(), translation }
    }

    /// As [`Pose::from_matrix`], of numbers in a file: the matrix must be a rotation to within the rounding of text.
    ///
    /// # Errors
    /// What is wrong: it deviates from a rotation by more than 0.001, mirrors, or a number is not plausible.
    pub fn rigid(rotation: DMat3, translation: DVec3) -> Result<Self, String> {
        if !rotation.is_finite() {
            return Err("the pose holds a number that is not finite; calibrate the recording again".to_owned());
        }
        POSITION.check_all(translation.to_array())?;
        let deviation = rotation.transpose() * rotation - DMat3::IDENTITY;
        let largest = deviation.to_cols_array().iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        if largest > 1e-3 || rotation.determinant() < 0.0 {
            let determinant = rotation.determinant();
            return Err(format!(
                "the pose is no rotation (it deviates by {largest:.3}, its determinant is {determinant:.3}); calibrate again"
            ));
        }
        Ok(Self::from_matrix(rotation, translation))
    }

    /// This pose, which a file gave, if a camera can stand there.
    ///
    /// # Errors
    /// Which number cannot be: the length of the quaternion, or a coordinate.
    pub fn checked(self) -> Result<Self, Implausible> {
        QUATERNION.check(self.rotation.length())?;
        POSITION.check_all(self.translation.to_array())?;
        Ok(self)
    }

    /// The camera that stands at `eye` and looks at `target`; `down` is the world direction that points down the image.
    #[must_use]
    pub fn look_at(eye: DVec3, target: DVec3, down: DVec3) -> Self {
        let forward = (target - eye).normalize();
        let right = down.cross(forward).normalize();
        let image_down = forward.cross(right);
        let rotation = DMat3::from_cols(right, image_down, forward).transpose();
        Self::from_matrix(rotation, -(rotation * eye))
    }

    /// A world point in camera coordinates, metres.
    #[must_use]
    pub fn transform(&self, world: DVec3) -> DVec3 {
        self.rotation * world + self.translation
    }

    /// This transform, and after it `second`.
    #[must_use]
    pub fn then(&self, second: &Self) -> Self {
        Self {
            rotation: (second.rotation * self.rotation).normalize(),
            translation: second.rotation * self.translation + second.translation,
        }
    }

    /// The camera-to-world transform.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// The camera centre in world coordinates, metres.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        self.inverse().translation
    }

    /// The transform as a 4x4 matrix.
    #[must_use]
    pub fn matrix(&self) -> DMat4 {
        DMat4::from_rotation_translation(self.rotation, self.translation)
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_puts_the_target_on_the_optical_axis() {
        let pose = Pose::look_at(DVec3::new(1.0, -2.0, 3.0), DVec3::new(0.5, 0.0, 0.0), DVec3::Y);
        let seen = pose.transform(DVec3::new(0.5, 0.0, 0.0));
        assert!(seen.x.abs() < 1e-12 && seen.y.abs() < 1e-12 && seen.z > 0.0, "{seen}");
        assert!(pose.transform(DVec3::new(0.5, 1.0, 0.0)).y > seen.y, "down in the world is down in the image");
        assert!((pose.centre() - DVec3::new(1.0, -2.0, 3.0)).length() < 1e-12);
    }

    #[test]
    fn reflections_shears_and_nan_are_no_rotations() {
        let ok = DMat3::from_rotation_y(0.3);
        assert!(Pose::rigid(ok, DVec3::ONE).is_ok());
        assert!(Pose::rigid(-ok, DVec3::ONE).unwrap_err().contains("determinant"));
        assert!(Pose::rigid(ok * 1.01, DVec3::ONE).is_err());
        for wrong in [f64::NAN, f64::INFINITY, 9e18] {
            assert!(Pose::rigid(ok, DVec3::new(0.0, wrong, 0.0)).unwrap_err().contains("plausible"), "{wrong}");
        }
    }
}
