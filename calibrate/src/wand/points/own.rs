//! erfgs's own layout: `wand.json` names the cameras, and a CSV file for each holds what it saw. Pixel centres lie at
//! half-integers.

use std::path::Path;

use erfgs_scene::{Intrinsics, Modality};
use serde::{Deserialize, Serialize};

use super::{super::WandCamera, WandError, csv, malformed, read_text};

const FORMAT: &str = "erfgs-wand-points";
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u32,
    cameras: Vec<CameraEntry>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    name: String,
    modality: Modality,
    intrinsics: Intrinsics,
    #[serde(default)]
    sigma_px: Option<f64>,
    /// CSV file, from the folder of the JSON file.
    points: String,
}

/// Reads a `wand.json` and the files that it names.
pub fn read(path: &Path) -> Result<Vec<WandCamera>, WandError> {
    let file: File =
        serde_json::from_str(&read_text(path)?).map_err(|error| malformed(path, None, error.to_string()))?;
    if file.format != FORMAT || file.version != VERSION {
        let what = format!("it is '{}' version {}, not '{FORMAT}' version {VERSION}", file.format, file.version);
        return Err(malformed(path, None, what));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    file.cameras
        .into_iter()
        .map(|camera| {
            let CameraEntry { name, modality, intrinsics, sigma_px, points } = camera;
            if sigma_px.is_some_and(|sigma| !(sigma > 0.0 && sigma.is_finite())) {
                return Err(malformed(path, None, format!("camera {name}: sigma_px is not positive")));
            }
            if !(intrinsics.fx > 0.0 && intrinsics.fy > 0.0) {
                return Err(malformed(path, None, format!("camera {name}: a focal length is not positive")));
            }
            let sightings = csv::read(&folder.join(points), ',', false, 0.0)?;
            Ok(WandCamera { name, modality, intrinsics, sigma_px, sightings })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;

    #[test]
    fn points_are_read_as_they_are_and_mistakes_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let json = r#"{"format": "erfgs-wand-points", "version": 1, "cameras": [{"name": "left", "modality": "event",
            "intrinsics": {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240},
            "sigma_px": 0.4, "points": "left.csv"}]}"#;
        let path = folder.path().join("wand.json");
        std::fs::write(&path, json).unwrap();
        let points = folder.path().join("left.csv");
        std::fs::write(&points, "t_ns,x1,y1,x2,y2,x3,y3\n7,1.5,2,,,-1,-1\n").unwrap();
        let cameras = super::super::read_points(folder.path()).unwrap();
        assert_eq!((cameras[0].modality, cameras[0].sigma_px), (Modality::Event, Some(0.4)));
        assert_eq!(cameras[0].sightings[0].leds, [Some(DVec2::new(1.5, 2.0)), None, Some(DVec2::NEG_ONE)]);
        std::fs::write(&points, "7,1.5,2,,,-1,x\n").unwrap();
        let message = super::super::read_points(&path).unwrap_err().to_string();
        assert!(message.ends_with("left.csv, line 1: 'x' is no pixel coordinate"), "{message}");
        std::fs::write(&path, json.replace("0.4", "-1")).unwrap();
        assert!(super::super::read_points(&path).unwrap_err().to_string().contains("camera left"));
        std::fs::remove_file(&path).unwrap();
        assert!(matches!(super::super::read_points(folder.path()), Err(WandError::NoPoints { .. })));
    }
}
