//! OpenCV's matrices, one file for each camera: `camera_matrix`, `distortion_coefficients`, and world-to-camera `R` and `T`. The
//! centre of the first pixel is (0, 0).

use std::path::{Path, PathBuf};

use crate::{Modality, Pose};
use erfgs_base::atomic;
use glam::{DMat3, DVec3};
use yaml_rust2::Yaml;

use super::{
    ConvertError, Format,
    camera_yaml::{self, model, quoted},
    common_losses, ros,
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
    let (model, coefficients) = model(i);
    let matrix = |name: &str, rows: usize, columns: usize, data: &[f64]| {
        format!(
            "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {}\n",
            super::yaml::list(data)
        )
    };
    let mut text = format!(
        "%YAML:1.0\n---\ncamera_name: \"{}\"\nimage_width: {}\nimage_height: {}\ndistortion_model: {model}\n",
        quoted(&camera.name),
        i.width,
        i.height
    );
    text += &matrix("camera_matrix", 3, 3, &camera_yaml::matrix(i));
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
        return Err(malformed(
            folder,
            "the folder holds neither a COLMAP model nor YAML files of OpenCV or ROS".into(),
        ));
    }
    let mut rigs = files.iter().map(|path| read_file(path)).collect::<Result<Vec<RigFile>, _>>()?;
    let cameras: Vec<RigCamera> = rigs.iter_mut().flat_map(|rig| rig.cameras.drain(..)).collect();
    let method = rigs.first().map_or("opencv", |rig| rig.method.as_str());
    Ok(RigFile::new(method, true, cameras))
}

/// Reads the file of one camera, OpenCV's or ROS's. Its name is the file's: what files call their cameras need not differ.
pub(super) fn read_file(path: &Path) -> Result<RigFile, ConvertError> {
    let document = load(path)?;
    let intrinsics = camera_yaml::intrinsics(&document).map_err(|what| malformed(path, what))?;
    let pose = match (numbers(&document["R"]), numbers(&document["T"])) {
        (Some(r), Some(t)) if r.len() == 9 && t.len() == 3 => {
            Some(Pose::from_matrix(DMat3::from_cols_slice(&r).transpose(), DVec3::from_slice(&t)))
        }
        _ => None,
    };
    let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let method = if document[ros::OWN_KEY].is_badvalue() { "opencv" } else { "ros" };
    Ok(RigFile::new(method, true, vec![RigCamera::new(&name, Modality::Rgb, intrinsics, pose)]))
}

/// Whether a document describes one camera in this way.
pub(super) fn is_camera(document: &Yaml) -> bool {
    !document["camera_matrix"].is_badvalue()
}
