//! nerfstudio's `transforms.json`: camera-to-world matrices of cameras that look along -z with y up. Principal points are as
//! COLMAP's, which is our convention.

use std::path::Path;

use crate::{Distortion, Intrinsics, Modality, Pose};
use erfgs_base::atomic;
use glam::{DMat3, DVec3};
use serde_json::{Value, json};

use super::{ConvertError, Format, Lens, common_losses, lens, pose};
use crate::rig_file::{RigCamera, RigFile};

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ConvertError> {
    let frames = rig.cameras.iter().map(frame).collect::<Result<Vec<Value>, _>>()?;
    let io = |source| ConvertError::Io { doing: "write", path: out.into(), source };
    let text = serde_json::to_vec_pretty(&json!({ "frames": frames })).map_err(|error| io(error.into()))?;
    atomic::write(out, &text).map_err(io)?;
    Ok(common_losses(rig, Format::Nerfstudio))
}

fn frame(camera: &RigCamera) -> Result<Value, ConvertError> {
    let i = &camera.intrinsics;
    let to_world = pose(camera, Format::Nerfstudio)?.inverse();
    let r = DMat3::from_quat(to_world.rotation) * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let t = to_world.translation;
    let row = |at: usize| [r.row(at).x, r.row(at).y, r.row(at).z, t[at]];
    let mut frame = json!({
        "file_path": format!("images/{}.png", camera.name),
        "w": i.width, "h": i.height, "fl_x": i.fx, "fl_y": i.fy, "cx": i.cx, "cy": i.cy,
        "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
    });
    let (model, names, values) = match lens(i) {
        Lens::None => ("OPENCV", ["k1", "k2", "p1", "p2"], vec![0.0; 4]),
        Lens::Brown(k) if k.len() == 4 => ("OPENCV", ["k1", "k2", "p1", "p2"], k),
        Lens::Brown(_) => {
            let (format, what, remedy) = (Format::Nerfstudio, "its polynomial goes beyond k2", "fisheye");
            return Err(ConvertError::Lens { camera: camera.name.clone(), format, what, remedy });
        }
        Lens::Fisheye(k) => ("OPENCV_FISHEYE", ["k1", "k2", "k3", "k4"], k.to_vec()),
    };
    frame["camera_model"] = model.into();
    for (name, value) in names.into_iter().zip(values) {
        frame[name] = value.into();
    }
    Ok(frame)
}

pub(super) fn read(path: &Path) -> Result<RigFile, ConvertError> {
    let io = |source| ConvertError::Io { doing: "read", path: path.into(), source };
    let malformed = |what: String| ConvertError::Malformed { path: path.into(), what };
    let text = std::fs::read_to_string(path).map_err(io)?;
    let file: Value = serde_json::from_str(&text).map_err(|error| malformed(error.to_string()))?;
    let frames = file["frames"].as_array().ok_or_else(|| malformed("it has no list of frames".into()))?;
    let cameras = frames.iter().enumerate().map(|(number, frame)| {
        camera(frame, &file)
            .ok_or_else(|| malformed(format!("frame {number}: intrinsics or pose are missing or not finite")))
    });
    let mut rig = RigFile::new("nerfstudio", false, cameras.collect::<Result<_, _>>()?);
    rig.warnings.push("a transforms.json does not say whether its unit is the metre".into());
    Ok(rig)
}

/// A frame; what it does not have is the file's.
fn camera(frame: &Value, file: &Value) -> Option<RigCamera> {
    let value = |name: &str| if frame[name].is_null() { &file[name] } else { &frame[name] };
    let number = |name: &str| value(name).as_f64().filter(|value| value.is_finite());
    let size = |name: &str| number(name).filter(|size| (1.0..65_536.0).contains(size)).map(|size| size as u32);
    let k: Vec<f64> = ["k1", "k2", "p1", "p2", "k3", "k4"].iter().map(|name| number(name).unwrap_or(0.0)).collect();
    let distortion = match value("camera_model").as_str() {
        Some("OPENCV_FISHEYE") => Distortion::KannalaBrandt([k[0], k[1], k[4], k[5]]),
        _ if k[..4].iter().all(|value| *value == 0.0) => Distortion::None,
        _ => Distortion::BrownConrady([k[0], k[1], k[2], k[3], 0.0, 0.0, 0.0, 0.0]),
    };
    let fx = number("fl_x")?;
    let (width, height) = (size("w")?, size("h")?);
    let intrinsics = Intrinsics {
        width,
        height,
        fx,
        fy: number("fl_y").unwrap_or(fx),
        cx: number("cx").unwrap_or(0.5 * f64::from(width)),
        cy: number("cy").unwrap_or(0.5 * f64::from(height)),
        distortion,
    };
    let rows = frame["transform_matrix"].as_array()?;
    let cell = |row: usize, column: usize| rows.get(row)?.get(column)?.as_f64().filter(|value| value.is_finite());
    let column = |at: usize| Some(DVec3::new(cell(0, at)?, cell(1, at)?, cell(2, at)?));
    let to_world = DMat3::from_cols(column(0)?, -column(1)?, -column(2)?);
    let pose = Pose::from_matrix(to_world, column(3)?).inverse();
    let name = Path::new(frame["file_path"].as_str()?).file_stem()?.to_string_lossy().into_owned();
    Some(RigCamera::new(&name, Modality::Rgb, intrinsics, Some(pose)))
}
