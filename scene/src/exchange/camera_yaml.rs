//! One camera's YAML file as OpenCV's programs and ROS's `camera_info` have it: `image_width`, `image_height`, `camera_matrix`,
//! `distortion_model`, `distortion_coefficients`. The centre of the first pixel is (0, 0) there, and is shifted.

use std::path::Path;

use crate::{Distortion, Intrinsics, camera::image_side};
use yaml_rust2::Yaml;

use super::{
    ExchangeError, Lens, coefficients, lens, notes, unit,
    yaml::{self, load, malformed, numbers},
};

/// Reads the intrinsics of a file.
///
/// # Errors
/// If it cannot be read, or something in it is missing or not supported.
pub fn read_intrinsics(path: &Path) -> Result<Intrinsics, ExchangeError> {
    intrinsics(&load(path)?).map_err(|what| malformed(path, what))
}

/// The intrinsics of a document.
pub(super) fn intrinsics(document: &Yaml) -> Result<Intrinsics, String> {
    let side = |key: &str| {
        let size = document[key].as_i64().ok_or_else(|| format!("it has no '{key}' that is a number of pixels"))?;
        image_side(size as f64).map_err(|wrong| format!("its '{key}' is no number of pixels: {wrong}"))
    };
    let (width, height) = (side("image_width")?, side("image_height")?);
    let matrix = numbers(&document["camera_matrix"]).filter(|matrix| matrix.len() == 9);
    let m = matrix.ok_or("it has no 'camera_matrix' with the nine numbers of a 3x3 matrix")?;
    if [m[1], m[3], m[6], m[7], m[8]] != [0.0, 0.0, 0.0, 0.0, 1.0] {
        return Err("its camera_matrix has a skew or another last row than 0, 0, 1; calibrate without skew".into());
    }
    let distortion = distortion(document)?;
    Intrinsics { width, height, fx: m[0], fy: m[4], cx: m[2] + 0.5, cy: m[5] + 0.5, distortion }
        .checked()
        .map_err(|wrong| format!("its camera_matrix: {wrong}"))
}

fn distortion(document: &Yaml) -> Result<Distortion, String> {
    let key = coefficients::key(yaml::keys(document))?;
    let k = match key.map(|key| (key, &document[key])) {
        None | Some((_, Yaml::BadValue | Yaml::Null)) => Vec::new(),
        Some((key, value)) => numbers(value).ok_or_else(|| format!("its {key} are not all numbers"))?,
    };
    let model = model_of(document)?;
    let lens = match model {
        "equidistant" | "fisheye" => coefficients::fisheye(&k),
        "plumb_bob" | "rational_polynomial" | "" => coefficients::standard(&k),
        _ => Err("plumb_bob, rational_polynomial and equidistant are".into()),
    };
    let model: String = model.escape_debug().take(40).collect();
    lens.map_err(|what| format!("distortion model '{model}' with {} coefficients is not supported: {what}", k.len()))
}

/// The lens model: as it is named, or as OpenCV's calibration programs say whether it is the fisheye.
fn model_of(document: &Yaml) -> Result<&str, String> {
    let named = match &document["distortion_model"] {
        Yaml::BadValue | Yaml::Null => None,
        value => Some(
            value
                .as_str()
                .ok_or("its distortion_model is no name; plumb_bob, rational_polynomial and equidistant are")?,
        ),
    };
    // Whatever else such a key is called, a lens of the other kind would be taken.
    let mut fisheye = None;
    for key in yaml::keys(document).filter(|key| key.to_lowercase().contains("fisheye")) {
        let is_one = match &document[key] {
            Yaml::Integer(1) | Yaml::Boolean(true) => true,
            Yaml::Integer(0) | Yaml::Boolean(false) => false,
            _ => {
                return Err(format!(
                    "its {} is neither 0 nor 1; name the model by distortion_model",
                    key.escape_debug()
                ));
            }
        };
        if fisheye.is_some_and(|before| before != is_one) {
            return Err(
                "its keys contradict each other on whether the lens is a fisheye; name the model by distortion_model"
                    .into(),
            );
        }
        fisheye = Some(is_one);
    }
    match (named, fisheye) {
        (Some("equidistant" | "fisheye"), Some(false)) | (Some("plumb_bob" | "rational_polynomial"), Some(true)) => {
            Err("its distortion_model and its key of the fisheye contradict each other; remove the one that is wrong"
                .into())
        }
        (Some(model), _) => Ok(model),
        (None, Some(true)) => Ok("fisheye"),
        (None, _) => Ok("plumb_bob"),
    }
}

/// What is read of a document, or known to say the same again.
const KNOWN: [&str; 9] = [
    "camera_matrix",
    "camera_name",
    "distortion_model",
    "image_height",
    "image_width",
    "projection_matrix",
    "R",
    "rectification_matrix",
    "T",
];

/// What a document says beyond the intrinsics and pose of the camera `name`, a sentence for each.
pub(super) fn left_out(document: &Yaml, intrinsics: &Intrinsics, name: &str) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(own) = document["camera_name"].as_str().filter(|own| *own != quoted(name)) {
        let own: String = own.escape_debug().take(40).collect();
        notes.push(format!("the name {own} within the file is not kept"));
    }
    let [fx, _, cx, _, fy, cy, ..] = matrix(intrinsics);
    for (key, usual) in [
        ("rectification_matrix", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0][..]),
        ("projection_matrix", &[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    ] {
        let value = &document[key];
        let same =
            |found: &[f64]| found.len() == usual.len() && found.iter().zip(usual).all(|(a, b)| (a - b).abs() < 1e-9);
        if !value.is_badvalue() && !numbers(value).is_some_and(|found| same(&found)) {
            notes.push(format!("its {key} is that of rectified images and is not kept"));
        }
    }
    let is_known = |key: &&str| {
        KNOWN.contains(key) || key.to_lowercase().contains("fisheye") || coefficients::is_name(key) || unit::is_key(key)
    };
    let keys = yaml::keys(document).filter(|key| !is_known(key)).map(str::to_owned).collect();
    notes.extend(notes::unknown(&keys));
    notes
}

/// The name of the lens model and its coefficients.
pub(super) fn model(intrinsics: &Intrinsics) -> (&'static str, Vec<f64>) {
    match lens(intrinsics) {
        Lens::None => ("plumb_bob", vec![0.0; 5]),
        Lens::Brown(k) if k.len() <= 5 => ("plumb_bob", [k, vec![0.0]].concat()[..5].to_vec()),
        Lens::Brown(k) => ("rational_polynomial", k),
        Lens::Fisheye(k) => ("equidistant", k.to_vec()),
    }
}

/// The camera matrix, row by row.
pub(super) fn matrix(i: &Intrinsics) -> [f64; 9] {
    [i.fx, 0.0, i.cx - 0.5, 0.0, i.fy, i.cy - 0.5, 0.0, 0.0, 1.0]
}

/// A camera's name within double quotes.
pub(super) fn quoted(name: &str) -> String {
    name.replace(['"', '\\', '\n'], "_")
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "%YAML:1.0\nimage_width: 1280\nimage_height: 1024\ncamera_matrix: !!opencv-matrix\n  rows: 3\n  \
                        cols: 3\n  dt: d\n  data: [1255.5, 0, 652.5,\n    0, 1253.5, 506.5, 0, 0, 1]\ndistortion_model: \
                        plumb_bob\ndistortion_coefficients: !!opencv-matrix\n  rows: 1\n  cols: 5\n  data: [-0.2, 0.24, \
                        -2e-4, 1e-3, -0.2]\n";

    #[test]
    fn intrinsics_are_read_and_shifted_by_half_a_pixel() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.yaml");
        std::fs::write(&path, TEXT).unwrap();
        let found = read_intrinsics(&path).unwrap();
        assert_eq!((found.fx, found.cx, found.fy, found.cy), (1255.5, 653.0, 1253.5, 507.0));
        assert_eq!(found.distortion, Distortion::BrownConrady([-0.2, 0.24, -2e-4, 1e-3, -0.2, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn what_is_missing_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.yaml");
        for (from, to, expected) in [
            ("image_width", "w", "no 'image_width'"),
            ("1280", "-3", "number of pixels"),
            ("camera_matrix", "m", "no 'camera_matrix'"),
            ("plumb_bob", "sphere", "'sphere' with 5"),
            ("[-0.2,", "[x,", "not all numbers"),
            ("1255.5", "-3", "focal length is -3"),
        ] {
            std::fs::write(&path, TEXT.replace(from, to)).unwrap();
            let message = read_intrinsics(&path).unwrap_err().to_string();
            assert!(message.contains(expected) && message.contains("a.yaml"), "{message}");
        }
    }
}
