//! What can be free in a camera, and how a step changes it.

use erfgs_scene::{Distortion, Intrinsics, Pose, lens::INTRINSIC_PARAMETERS};
use glam::{DQuat, DVec3};

use super::{BundleCamera, Placement};

/// A parameter of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Parameter {
    /// Both focal lengths at once, their ratio kept; counted in pixels of fx.
    Focal,
    /// Focal length along x, pixels.
    Fx,
    /// Focal length along y, pixels.
    Fy,
    /// Principal point x, pixels.
    Cx,
    /// Principal point y, pixels.
    Cy,
    /// A coefficient of the lens, by its index in [`Distortion`].
    Coefficient(u8),
    /// A turn about an axis of the camera (0, 1, 2), radians.
    Rotation(u8),
    /// A shift along an axis of the camera (0, 1, 2), metres.
    Translation(u8),
    /// Time offset, seconds.
    TimeOffset,
}

/// All columns that a camera can have: intrinsics, then rotation, translation, time offset.
pub(super) const COLUMNS: usize = INTRINSIC_PARAMETERS + 7;
/// How many parameters of a camera there are: each column's, and the focal length that both directions share.
pub(super) const PARAMETERS: usize = COLUMNS + 1;

/// Focal lengths, principal point and the coefficients of `distortion` (`coefficients` of them) as free parameters.
#[must_use]
pub fn free_lens(coefficients: usize) -> Vec<Parameter> {
    let lens = [Parameter::Fx, Parameter::Fy, Parameter::Cx, Parameter::Cy].into_iter();
    lens.chain((0..coefficients).map(|index| Parameter::Coefficient(index as u8))).collect()
}

impl Parameter {
    /// The six of a pose.
    pub const POSE: [Self; 6] = [
        Self::Rotation(0),
        Self::Rotation(1),
        Self::Rotation(2),
        Self::Translation(0),
        Self::Translation(1),
        Self::Translation(2),
    ];

    /// The derivative by this parameter, from those by all columns.
    pub(super) fn derivative(self, columns: &[f64; COLUMNS], intrinsics: &Intrinsics) -> f64 {
        let at = |index: u8| columns.get(usize::from(index)).copied().unwrap_or(0.0);
        match self {
            Self::Focal => columns[0] + columns[1] * intrinsics.fy / intrinsics.fx,
            Self::Fx => columns[0],
            Self::Fy => columns[1],
            Self::Cx => columns[2],
            Self::Cy => columns[3],
            Self::Coefficient(index) => at(4 + index),
            Self::Rotation(axis) => at(INTRINSIC_PARAMETERS as u8 + axis),
            Self::Translation(axis) => at(INTRINSIC_PARAMETERS as u8 + 3 + axis),
            Self::TimeOffset => columns[COLUMNS - 1],
        }
    }

    /// The value in a camera; 0 for poses, which have no coordinates of their own.
    #[must_use]
    pub fn value(self, camera: &BundleCamera) -> f64 {
        match self {
            Self::Focal | Self::Fx => camera.intrinsics.fx,
            Self::Fy => camera.intrinsics.fy,
            Self::Cx => camera.intrinsics.cx,
            Self::Cy => camera.intrinsics.cy,
            Self::Coefficient(index) => coefficient(&camera.intrinsics.distortion, index).unwrap_or(0.0),
            Self::Rotation(_) | Self::Translation(_) => 0.0,
            Self::TimeOffset => camera.time_offset_s,
        }
    }

    /// `fx`, `k3`, `turn about x`, as messages and reports call it.
    #[must_use]
    pub fn name(self, camera: &BundleCamera) -> String {
        match self {
            Self::Focal => "focal length".into(),
            Self::Fx => "fx".into(),
            Self::Fy => "fy".into(),
            Self::Cx => "cx".into(),
            Self::Cy => "cy".into(),
            Self::Coefficient(index) => match camera.intrinsics.distortion {
                Distortion::BrownConrady(_) => {
                    ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"].get(usize::from(index)).map_or("k?", |n| n).into()
                }
                _ => format!("k{}", index + 1),
            },
            Self::Rotation(_) | Self::Translation(_) => self.of_pose().unwrap_or_default(),
            Self::TimeOffset => "time offset".into(),
        }
    }

    /// The same of a turn or a shift, which are called alike whatever it is that has a pose.
    pub(super) fn of_pose(self) -> Option<String> {
        const AXES: [&str; 3] = ["x", "y", "z"];
        let axis = |index: u8| AXES.get(usize::from(index)).copied().unwrap_or("?");
        match self {
            Self::Rotation(index) => Some(format!("turn about {}", axis(index))),
            Self::Translation(index) => Some(format!("shift along {}", axis(index))),
            _ => None,
        }
    }
}

fn coefficient(distortion: &Distortion, index: u8) -> Option<f64> {
    match distortion {
        Distortion::None => None,
        Distortion::BrownConrady(k) => k.get(usize::from(index)).copied(),
        Distortion::KannalaBrandt(k) => k.get(usize::from(index)).copied(),
    }
}

/// A pose moved by a turn (a vector, radians) and a shift in the space that it leads to.
fn moved(pose: &Pose, rotation: DVec3, translation: DVec3) -> Pose {
    pose.then(&Pose { rotation: DQuat::from_scaled_axis(rotation), translation })
}

impl BundleCamera {
    /// The camera after a step in its free parameters.
    pub(super) fn moved(&self, step: &[f64]) -> Self {
        let mut camera = self.clone();
        let (mut rotation, mut translation) = (DVec3::ZERO, DVec3::ZERO);
        let i = &mut camera.intrinsics;
        for (parameter, by) in self.free.iter().zip(step) {
            match *parameter {
                Parameter::Focal => {
                    i.fy *= 1.0 + by / i.fx;
                    i.fx += by;
                }
                Parameter::Fx => i.fx += by,
                Parameter::Fy => i.fy += by,
                Parameter::Cx => i.cx += by,
                Parameter::Cy => i.cy += by,
                Parameter::Coefficient(index) => {
                    let coefficients: &mut [f64] = match &mut i.distortion {
                        Distortion::None => &mut [],
                        Distortion::BrownConrady(k) => k,
                        Distortion::KannalaBrandt(k) => k,
                    };
                    if let Some(value) = coefficients.get_mut(usize::from(index)) {
                        *value += by;
                    }
                }
                Parameter::Rotation(axis) => rotation[usize::from(axis)] += by,
                Parameter::Translation(axis) => translation[usize::from(axis)] += by,
                Parameter::TimeOffset => camera.time_offset_s += by,
            }
        }
        if rotation != DVec3::ZERO || translation != DVec3::ZERO {
            camera.pose = moved(&self.pose, rotation, translation);
        }
        camera
    }
}

impl Placement {
    /// The placement after a step in its parameters.
    pub(super) fn moved(&self, step: &[f64]) -> Self {
        let three = |from: usize| DVec3::from_slice(&step[from..]);
        match self {
            Self::Board(pose) => Self::Board(moved(pose, three(0), three(3))),
            Self::Wand { middle, direction } => {
                let (a, b) = direction.any_orthonormal_pair();
                let direction = (*direction + a * step[3] + b * step[4]).normalize();
                Self::Wand { middle: *middle + three(0), direction }
            }
            Self::Point(point) => Self::Point(*point + three(0)),
            Self::Fixed => Self::Fixed,
        }
    }

    /// The derivative of a feature's world position by the placement's parameters: one vector for each.
    pub(super) fn derivatives(&self, on_target: DVec3) -> [DVec3; 6] {
        let mut by = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO];
        match self {
            Self::Board(pose) => {
                let world = pose.transform(on_target);
                by[3..].copy_from_slice(&[DVec3::X, DVec3::Y, DVec3::Z]);
                for (by, axis) in by.iter_mut().zip(DVec3::AXES) {
                    *by = axis.cross(world);
                }
            }
            Self::Wand { direction, .. } => {
                let (a, b) = direction.any_orthonormal_pair();
                by[3] = a * on_target.x;
                by[4] = b * on_target.x;
            }
            Self::Point(_) => {}
            Self::Fixed => by = [DVec3::ZERO; 6],
        }
        by
    }
}
