//! OpenCV's matrices, one file for each camera: `camera_matrix`, `distortion_coefficients`, and world-to-camera `R` and `T`. The
//! centre of the first pixel is (0, 0).

use std::path::{Path, PathBuf};

use crate::{Modality, Pose};
use erfgs_base::{FileError, atomic, order::natural};
use glam::{DMat3, DVec3};
use yaml_rust2::Yaml;

use super::{
    ExchangeError, Format,
    camera_yaml::{self, model, quoted},
    files, losses, ros,
    unit::Found,
    yaml::{self, list, load, malformed, numbers},
};
use crate::rig_file::{RigCamera, RigFile};

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ExchangeError> {
    for (camera, path) in rig.cameras.iter().zip(files(rig, out)) {
        let io = |source| ExchangeError::from(FileError::when("write", &path)(source));
        atomic::write(&path, file(camera, rig.metric).as_bytes()).map_err(io)?;
    }
    Ok(losses::common(rig, Format::OpenCv))
}

fn file(camera: &RigCamera, metric: bool) -> String {
    let i = &camera.intrinsics;
    let (model, coefficients) = model(i);
    let matrix = |name: &str, rows: usize, columns: usize, data: &[f64]| {
        format!("{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {}\n", list(data))
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
        // OpenCV's programs know none; boards are in millimetres as often as not.
        text += if metric { "unit: m\n" } else { "" };
    }
    text
}

pub(super) fn read(folder: &Path) -> Result<Found, ExchangeError> {
    let io = |source| ExchangeError::from(FileError::when("read", folder)(source));
    let entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(io)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<_, _>>()
        .map_err(io)?;
    let mut files: Vec<PathBuf> =
        entries.into_iter().filter(|path| path.extension().is_some_and(|e| e == "yaml" || e == "yml")).collect();
    files.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
    if files.is_empty() {
        return Err(malformed(
            folder,
            "the folder holds neither a COLMAP model nor YAML files of OpenCV or ROS".into(),
        ));
    }
    let mut rig = RigFile::new("opencv", true, Vec::new());
    let mut units = Vec::new();
    for (number, path) in files.iter().enumerate() {
        let one = read_file(path)?;
        if number == 0 {
            rig.method = one.rig.method;
        }
        if one.rig.cameras.iter().any(|camera| camera.pose.is_some()) {
            units.push((one.unit, path));
        }
        rig.cameras.extend(one.rig.cameras);
        rig.warnings.extend(one.rig.warnings);
    }
    if let Some(((_, first), (_, path))) = units.iter().zip(units.iter().skip(1)).find(|(a, b)| a.0 != b.0) {
        let what = format!("its unit of length is not that of {}, where one of them may not say it", first.display());
        return Err(malformed(path, what + "; give both the same (unit: mm)"));
    }
    Ok(Found { unit: units.first().and_then(|(unit, _)| *unit), ..Found::new(rig) })
}

/// Reads the file of one camera, OpenCV's or ROS's. Its name is the file's: what files call their cameras need not differ.
pub(super) fn read_file(path: &Path) -> Result<Found, ExchangeError> {
    let document = load(path)?;
    let wrong = |what| malformed(path, what);
    let intrinsics = camera_yaml::intrinsics(&document).map_err(wrong)?;
    let pose = pose(&document).map_err(wrong)?;
    let unit = yaml::unit(&document).map_err(wrong)?;
    let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let method = if document[ros::OWN_KEY].is_badvalue() { "opencv" } else { "ros" };
    let notes = camera_yaml::left_out(&document, &intrinsics, &name);
    let mut rig = RigFile::new(method, true, vec![RigCamera::new(&name, Modality::Rgb, intrinsics, pose)]);
    rig.warnings.extend(notes.into_iter().map(|note| format!("{name}: {note}")));
    Ok(Found { unit, ..Found::new(rig) })
}

/// World to camera, where the document says.
fn pose(document: &Yaml) -> Result<Option<Pose>, String> {
    let (r, t) = (&document["R"], &document["T"]);
    if r.is_badvalue() && t.is_badvalue() {
        return Ok(None);
    }
    match (numbers(r), numbers(t)) {
        (Some(r), Some(t)) if r.len() == 9 && t.len() == 3 => {
            Pose::rigid(DMat3::from_cols_slice(&r).transpose(), DVec3::from_slice(&t)).map(Some)
        }
        _ => Err("its R and T are no 3x3 matrix with a vector of three; give both, or neither".into()),
    }
}

/// Whether a document describes one camera in this way.
pub(super) fn is_camera(document: &Yaml) -> bool {
    !document["camera_matrix"].is_badvalue()
}
