//! OpenCV's matrices, one file for each camera: `camera_matrix`, `distortion_coefficients`, and world-to-camera `R` and `T`. The
//! centre of the first pixel is (0, 0).

use std::path::{Path, PathBuf};

use erfgs_session::{Distortion, Intrinsics, Modality, Pose, atomic};
use glam::{DMat3, DVec3};

use super::{
    ConvertError, Format, Lens, common_losses, lens,
    yaml::{load, malformed, numbers},
};
use crate::rig_file::{RigCamera, RigFile};

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ConvertError> {
    for camera in &rig.cameras {
        let path = out.join(format!("{}.yaml", camera.name));
        let io = |source| ConvertError::Io { doing: "write", path: path.clone(), source };
        atomic::write(&path, file(camera).as_bytes()).map_err(io)?;
    }
    Ok(common_losses(rig, Format::OpenCv))
}

fn file(camera: &RigCamera) -> String {
    let i = &camera.intrinsics;
    let (model, coefficients) = match lens(i) {
        Lens::None => ("plumb_bob", vec![0.0; 5]),
        Lens::Brown(k) if k.len() <= 5 => ("plumb_bob", [k, vec![0.0]].concat()[..5].to_vec()),
        Lens::Brown(k) => ("rational_polynomial", k),
        Lens::Fisheye(k) => ("equidistant", k.to_vec()),
    };
    let matrix = |name: &str, rows: usize, columns: usize, data: &[f64]| {
        format!(
            "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {}\n",
            super::yaml::list(data)
        )
    };
    let mut text = format!(
        "%YAML:1.0\n---\ncamera_name: \"{}\"\nimage_width: {}\nimage_height: {}\ndistortion_model: {model}\n",
        camera.name.replace(['"', '\\', '\n'], "_"),
        i.width,
        i.height
    );
    text += &matrix("camera_matrix", 3, 3, &[i.fx, 0.0, i.cx - 0.5, 0.0, i.fy, i.cy - 0.5, 0.0, 0.0, 1.0]);
    text += &matrix("distortion_coefficients", 1, coefficients.len(), &coefficients);
    if let Some(pose) = camera.pose {
        let rotation = DMat3::from_quat(pose.rotation).transpose().to_cols_array();
        text += &matrix("R", 3, 3, &rotation);
        text += &matrix("T", 3, 1, &pose.translation.to_array());
    }
    text
}

pub(super) fn read(folder: &Path) -> Result<RigFile, ConvertError> {
    let io = |source| ConvertError::Io { doing: "read", path: folder.into(), source };
    let entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(io)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<_, _>>()
        .map_err(io)?;
    let mut files: Vec<PathBuf> =
        entries.into_iter().filter(|path| path.extension().is_some_and(|e| e == "yaml" || e == "yml")).collect();
    files.sort();
    if files.is_empty() {
        return Err(malformed(folder, "the folder holds neither a COLMAP model nor OpenCV's YAML files".into()));
    }
    let cameras = files.iter().map(|path| camera(path)).collect::<Result<_, _>>()?;
    Ok(RigFile::new("opencv", true, cameras))
}

fn camera(path: &Path) -> Result<RigCamera, ConvertError> {
    let document = load(path)?;
    let missing = |what: &str| malformed(path, format!("{what} is missing or is not what it should be"));
    let size =
        |name: &str| document[name].as_i64().and_then(|size| u32::try_from(size).ok()).ok_or_else(|| missing(name));
    let matrix =
        numbers(&document["camera_matrix"]).filter(|m| m.len() == 9).ok_or_else(|| missing("camera_matrix"))?;
    let k = numbers(&document["distortion_coefficients"]).unwrap_or_default();
    let distortion = match (document["distortion_model"].as_str(), k.as_slice()) {
        (Some("equidistant" | "fisheye"), &[k1, k2, k3, k4]) => Distortion::KannalaBrandt([k1, k2, k3, k4]),
        (_, k) if k.iter().all(|value| *value == 0.0) => Distortion::None,
        (_, k) if k.len() <= 8 => {
            let mut all = [0.0; 8];
            all[..k.len()].copy_from_slice(k);
            Distortion::BrownConrady(all)
        }
        _ => return Err(malformed(path, format!("{} distortion coefficients are not supported", k.len()))),
    };
    let intrinsics = Intrinsics {
        width: size("image_width")?,
        height: size("image_height")?,
        fx: matrix[0],
        fy: matrix[4],
        cx: matrix[2] + 0.5,
        cy: matrix[5] + 0.5,
        distortion,
    };
    let pose = match (numbers(&document["R"]), numbers(&document["T"])) {
        (Some(r), Some(t)) if r.len() == 9 && t.len() == 3 => {
            Some(Pose::from_matrix(DMat3::from_cols_slice(&r).transpose(), DVec3::from_slice(&t)))
        }
        _ => None,
    };
    let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(RigCamera::new(&name, Modality::Rgb, intrinsics, pose))
}
