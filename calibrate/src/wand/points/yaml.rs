//! Intrinsics from OpenCV's YAML, as eWand and ROS write them.

use std::path::Path;

use erfgs_session::{Distortion, Intrinsics};

use super::{WandError, malformed, read_text};

/// Reads `image_width`, `image_height`, `camera_matrix`, `distortion_model` and `distortion_coefficients`.
pub fn read(path: &Path) -> Result<Intrinsics, WandError> {
    let text = read_text(path)?;
    let error = |what: String| malformed(path, None, what);
    let scalar = |key: &str| {
        let value = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'));
        value.map(str::trim).ok_or_else(|| error(format!("it has no '{key}'")))
    };
    let pixels = |key: &str| {
        let value = scalar(key)?;
        value.parse::<u32>().map_err(|_| error(format!("{key}: '{value}' is no number of pixels")))
    };
    let (width, height) = (pixels("image_width")?, pixels("image_height")?);
    let matrix = data(&text, "camera_matrix").map_err(error)?;
    let &[fx, _, cx, _, fy, cy, ..] = matrix.as_slice() else {
        return Err(error("camera_matrix has not the nine numbers of a 3x3 matrix".into()));
    };
    let k = data(&text, "distortion_coefficients").map_err(error)?;
    let distortion = match scalar("distortion_model").unwrap_or("plumb_bob").trim_matches('"') {
        "plumb_bob" | "rational_polynomial" if k.len() <= 8 => {
            let mut all = [0.0; 8];
            all[..k.len()].copy_from_slice(&k);
            Distortion::BrownConrady(all)
        }
        "equidistant" | "fisheye" if k.len() == 4 => Distortion::KannalaBrandt([k[0], k[1], k[2], k[3]]),
        model => {
            let what = format!("distortion model '{model}' with {} coefficients is not supported", k.len());
            return Err(error(format!("{what}; plumb_bob, rational_polynomial and equidistant are")));
        }
    };
    let intrinsics = Intrinsics { width, height, fx, fy, cx: cx + 0.5, cy: cy + 0.5, distortion };
    if width == 0 || height == 0 || !(fx > 0.0 && fy > 0.0) {
        return Err(error("a focal length or a side of the image is not positive".into()));
    }
    Ok(intrinsics)
}

/// The numbers of the matrix `key`: what stands in brackets after its `data:`.
fn data(text: &str, key: &str) -> Result<Vec<f64>, String> {
    let missing = || format!("it has no matrix '{key}' with 'data: [...]'");
    let start = text.find(&format!("{key}:")).ok_or_else(missing)?;
    let block = &text[start..];
    let data = &block[block.find("data:").ok_or_else(missing)?..];
    let open = data.find('[').ok_or_else(missing)?;
    let close = data.find(']').filter(|close| *close > open).ok_or_else(missing)?;
    let numbers = data[open + 1..close].split(',').map(str::trim).filter(|number| !number.is_empty());
    numbers
        .map(|number| number.parse::<f64>().ok().filter(|value| value.is_finite()))
        .map(|value| value.ok_or_else(|| format!("{key}: its data are not all numbers")))
        .collect()
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
        let found = read(&path).unwrap();
        assert_eq!((found.fx, found.cx, found.fy, found.cy), (1255.5, 653.0, 1253.5, 507.0));
        assert_eq!(found.distortion, Distortion::BrownConrady([-0.2, 0.24, -2e-4, 1e-3, -0.2, 0.0, 0.0, 0.0]));
    }

    #[test]
    fn what_is_missing_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.yaml");
        for (from, to, said) in [
            ("image_width", "w", "no 'image_width'"),
            ("plumb_bob", "sphere", "'sphere' with 5"),
            ("-0.2,", "x,", "not all numbers"),
            ("1255.5", "-3", "not positive"),
        ] {
            std::fs::write(&path, TEXT.replace(from, to)).unwrap();
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains(said) && message.contains("a.yaml"), "{message}");
        }
    }
}
