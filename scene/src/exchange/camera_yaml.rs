//! One camera's YAML file as OpenCV's programs and ROS's `camera_info` have it: `image_width`, `image_height`, `camera_matrix`,
//! `distortion_model`, `distortion_coefficients`. The centre of the first pixel is (0, 0) there, and is shifted.

use std::path::Path;

use crate::{Distortion, Intrinsics};
use yaml_rust2::Yaml;

use super::{
    ConvertError, Lens, lens,
    yaml::{load, malformed, numbers},
};

/// Reads the intrinsics of a file.
///
/// # Errors
/// If it cannot be read, or something in it is missing or not supported.
pub fn read_intrinsics(path: &Path) -> Result<Intrinsics, ConvertError> {
    intrinsics(&load(path)?).map_err(|what| malformed(path, what))
}

/// The intrinsics of a document.
pub(super) fn intrinsics(document: &Yaml) -> Result<Intrinsics, String> {
    let side = |key: &str| {
        let value = &document[key];
        let size = value.as_i64().and_then(|size| u32::try_from(size).ok()).filter(|size| *size > 0);
        size.ok_or_else(|| format!("it has no '{key}' that is a number of pixels"))
    };
    let (width, height) = (side("image_width")?, side("image_height")?);
    let matrix = numbers(&document["camera_matrix"]).filter(|matrix| matrix.len() == 9);
    let matrix = matrix.ok_or("it has no 'camera_matrix' with the nine numbers of a 3x3 matrix")?;
    let (fx, fy) = (matrix[0], matrix[4]);
    if !(fx > 0.0 && fy > 0.0) {
        return Err("a focal length in its camera_matrix is not positive".into());
    }
    let coefficients = &document["distortion_coefficients"];
    let k = match coefficients {
        Yaml::BadValue | Yaml::Null => Vec::new(),
        value => numbers(value).ok_or("its distortion_coefficients are not all numbers")?,
    };
    let distortion = match (document["distortion_model"].as_str().unwrap_or("plumb_bob"), k.as_slice()) {
        ("equidistant" | "fisheye", &[k1, k2, k3, k4]) => Distortion::KannalaBrandt([k1, k2, k3, k4]),
        ("plumb_bob" | "rational_polynomial" | "", k) if k.iter().all(|value| *value == 0.0) => Distortion::None,
        ("plumb_bob" | "rational_polynomial" | "", k) if k.len() <= 8 => {
            let mut all = [0.0; 8];
            all[..k.len()].copy_from_slice(k);
            Distortion::BrownConrady(all)
        }
        (model, k) => {
            return Err(format!(
                "distortion model '{model}' with {} coefficients is not supported; plumb_bob, rational_polynomial and \
                 equidistant are",
                k.len()
            ));
        }
    };
    Ok(Intrinsics { width, height, fx, fy, cx: matrix[2] + 0.5, cy: matrix[5] + 0.5, distortion })
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
        for (from, to, said) in [
            ("image_width", "w", "no 'image_width'"),
            ("1280", "-3", "number of pixels"),
            ("camera_matrix", "m", "no 'camera_matrix'"),
            ("plumb_bob", "sphere", "'sphere' with 5"),
            ("[-0.2,", "[x,", "not all numbers"),
            ("1255.5", "-3", "not positive"),
        ] {
            std::fs::write(&path, TEXT.replace(from, to)).unwrap();
            let message = read_intrinsics(&path).unwrap_err().to_string();
            assert!(message.contains(said) && message.contains("a.yaml"), "{message}");
        }
    }
}
