//! LLFF's `poses_bounds.npy`: for each camera in order a 3x5 matrix (camera-to-world rotation with the columns down, right, back;
//! the centre; height, width, focal length), and bounds of the depth.

use std::path::Path;

use crate::Distortion;
use erfgs_base::{atomic, npy};
use glam::DMat3;

use super::{ConvertError, Format, common_losses, pose};
use crate::rig_file::RigFile;

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ConvertError> {
    let mut lost = common_losses(rig, Format::Llff);
    let poses = rig.cameras.iter().map(|camera| pose(camera, Format::Llff)).collect::<Result<Vec<_>, _>>()?;
    // Where the scene is nobody knows here: between a twentieth and twice the rig's extent.
    let extent = poses.iter().map(|pose| (pose.centre() - poses[0].centre()).length()).fold(0.0, f64::max).max(1.0);
    let mut values = Vec::with_capacity(17 * poses.len());
    for (camera, pose) in rig.cameras.iter().zip(&poses) {
        let i = &camera.intrinsics;
        let r = DMat3::from_quat(pose.rotation.conjugate());
        let (centre, size) = (pose.centre(), [f64::from(i.height), f64::from(i.width), 0.5 * (i.fx + i.fy)]);
        for row in 0..3 {
            values.extend([r.y_axis[row], r.x_axis[row], -r.z_axis[row], centre[row], size[row]]);
        }
        values.extend([0.05 * extent, 2.0 * extent]);
        let off = (i.cx - 0.5 * f64::from(i.width)).abs().max((i.cy - 0.5 * f64::from(i.height)).abs());
        if off > 0.01 || (i.fx - i.fy).abs() > 0.01 {
            lost.push(format!(
                "{}: one focal length and a centred principal point are all that LLFF holds",
                camera.name
            ));
        }
        if i.distortion != Distortion::None {
            lost.push(format!("{}: LLFF holds no distortion; undistort the images first", camera.name));
        }
    }
    lost.push("the bounds of the depth are guessed from the rig's extent".into());
    let io = |source| ConvertError::Io { doing: "write", path: out.into(), source };
    atomic::write(out, &npy::encode(&[poses.len(), 17], values.into_iter())).map_err(io)?;
    Ok(lost)
}
