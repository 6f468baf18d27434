//! Kalibr's camchain: cameras in a row, each with its pose relative to the one before (`T_cn_cnm1`). The centre of the first
//! pixel is (0, 0).

use std::{collections::BTreeSet, fmt::Write as _, path::Path};

use crate::{Distortion, Intrinsics, Modality, Pose, camera::image_side};
use erfgs_base::{
    FileError, atomic,
    names::{self, FileNames},
};
use glam::{DMat3, DVec3};
use yaml_rust2::Yaml;

use super::{
    ExchangeError, Format, Lens, coefficients, lens, losses, notes, pose,
    unit::{self, Found},
    yaml::{self, list, load, malformed, numbers},
};
use crate::rig_file::{RigCamera, RigFile};

pub(super) fn write(rig: &RigFile, out: &Path) -> Result<Vec<String>, ExchangeError> {
    let mut text = String::new();
    let mut before: Option<Pose> = None;
    let mut topics = FileNames::default();
    let topics: Vec<String> = rig.cameras.iter().map(|camera| topics.give(&topic(&camera.name))).collect();
    for (index, camera) in rig.cameras.iter().enumerate() {
        let i = &camera.intrinsics;
        let (model, coefficients) = match lens(i) {
            Lens::None => ("radtan", vec![0.0; 4]),
            Lens::Brown(k) if k.len() == 4 => ("radtan", k),
            Lens::Brown(_) => {
                let (format, what, remedy) = (Format::Kalibr, "its polynomial goes beyond k2", "k1k2p1p2");
                return Err(ExchangeError::Lens { camera: camera.name.clone(), format, what, remedy });
            }
            Lens::Fisheye(k) => ("equidistant", k.to_vec()),
        };
        let pose = pose(camera, Format::Kalibr)?;
        let _ = write!(
            text,
            "cam{index}:\n  camera_model: pinhole\n  distortion_coeffs: {}\n  distortion_model: {model}\n  intrinsics: {}\n  \
             resolution: [{}, {}]\n  rostopic: /{}/image_raw\n",
            list(&coefficients),
            list(&[i.fx, i.fy, i.cx - 0.5, i.cy - 0.5]),
            i.width,
            i.height,
            topics[index],
        );
        if let Some(before) = before {
            let rotation = DMat3::from_quat(pose.rotation * before.rotation.conjugate());
            let translation = pose.translation - rotation * before.translation;
            text.push_str("  T_cn_cnm1:\n");
            for row in 0..3 {
                let r = rotation.row(row);
                let _ = writeln!(text, "  - {}", list(&[r.x, r.y, r.z, translation[row]]));
            }
            text.push_str("  - [0.0, 0.0, 0.0, 1.0]\n");
        }
        before = Some(pose);
    }
    let io = |source| ExchangeError::from(FileError::when("write", out)(source));
    atomic::write(out, text.as_bytes()).map_err(io)?;
    let mut lost = losses::common(rig, Format::Kalibr);
    for (camera, topic) in rig.cameras.iter().zip(&topics).filter(|(camera, topic)| **topic != camera.name) {
        lost.push(format!("{}: it is called {topic} in its topic", camera.name.escape_debug()));
    }
    if rig.cameras.first().and_then(|camera| camera.pose).is_some_and(|pose| pose != Pose::IDENTITY) {
        lost.push("a camchain's world is its first camera: poses are relative to it".into());
    }
    Ok(lost)
}

/// A camera's name in a ROS topic.
fn topic(name: &str) -> String {
    name.replace(|c: char| !c.is_ascii_alphanumeric(), "_")
}

pub(super) fn read(path: &Path) -> Result<Found, ExchangeError> {
    let document = load(path)?;
    let mut cameras: Vec<RigCamera> = Vec::new();
    loop {
        let entry = &document[format!("cam{}", cameras.len()).as_str()];
        if entry.is_badvalue() {
            break;
        }
        let before = cameras.last().and_then(|camera| camera.pose);
        cameras.push(camera(entry, cameras.len(), before).map_err(|what| malformed(path, what))?);
    }
    if cameras.is_empty() {
        return Err(malformed(path, "it has no camera cam0; is it a camchain?".into()));
    }
    name_apart(&document, &mut cameras);
    let entries: BTreeSet<String> = (0..cameras.len()).map(|index| format!("cam{index}")).collect();
    let mut other: BTreeSet<String> =
        yaml::keys(&document).filter(|key| !entries.contains(*key)).map(str::to_owned).collect();
    let is_camera = |key: &&String| key.strip_prefix("cam").is_some_and(|number| number.parse::<u32>().is_ok());
    if let Some(camera) = other.iter().find(is_camera) {
        return Err(malformed(path, format!("{camera} follows a gap: number the cameras from cam0 on")));
    }
    for name in &entries {
        other.extend(yaml::keys(&document[name.as_str()]).filter(|key| !KNOWN.contains(key)).map(str::to_owned));
    }
    let unit = yaml::unit(&document).map_err(|what| malformed(path, what))?;
    other.retain(|key| !unit::is_key(key));
    let mut rig = RigFile::new("kalibr", true, cameras);
    rig.warnings.extend(notes::unknown(&other));
    Ok(Found { rig, unit, metres_by_format: true })
}

/// Calls cameras by what tells their topics apart where the first parts of these do not.
fn name_apart(document: &Yaml, cameras: &mut [RigCamera]) {
    let distinct: BTreeSet<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
    if distinct.len() == cameras.len() {
        return;
    }
    let topics: Vec<String> = (0..cameras.len()).map(|at| format!("cam{at}")).collect();
    let topics: Option<Vec<&str>> = topics.iter().map(|key| document[key.as_str()]["rostopic"].as_str()).collect();
    let Some(topics) = topics else { return };
    for (camera, name) in cameras.iter_mut().zip(names::apart(&topics)) {
        camera.name = name;
    }
}

/// What is read of a camera, or says nothing of it.
const KNOWN: [&str; 8] = [
    "T_cn_cnm1",
    "cam_overlaps",
    "camera_model",
    "distortion_coeffs",
    "distortion_model",
    "intrinsics",
    "resolution",
    "rostopic",
];

fn camera(entry: &Yaml, index: usize, before: Option<Pose>) -> Result<RigCamera, String> {
    let wrong = |what: &str| format!("cam{index}: {what}");
    let list = |name: &str, count: usize| {
        numbers(&entry[name])
            .filter(|values| values.len() == count)
            .ok_or_else(|| wrong(&format!("{name} is no list of {count} numbers")))
    };
    match entry["camera_model"].as_str() {
        Some("pinhole") => {}
        other => {
            let other = other.unwrap_or("that is absent").escape_debug();
            return Err(wrong(&format!(
                "the camera model {other} is not supported; calibrate with pinhole, and radtan or equidistant for the lens"
            )));
        }
    }
    let i = list("intrinsics", 4)?;
    let size = list("resolution", 2)?;
    let side = |value: f64| image_side(value).map_err(|what| wrong(&format!("resolution: {what}")));
    let (width, height) = (side(size[0])?, side(size[1])?);
    let distortion = match entry["distortion_model"].as_str() {
        Some("none") | None => {
            let k = numbers(&entry["distortion_coeffs"]).unwrap_or_default();
            if k.iter().any(|value| *value != 0.0) {
                return Err(wrong(
                    "it has distortion_coeffs but no distortion_model; name the model, radtan or equidistant",
                ));
            }
            Distortion::None
        }
        // Both have four; zeros behind them say nothing.
        Some(model @ ("radtan" | "equidistant")) => {
            let k = numbers(&entry["distortion_coeffs"]).filter(|k| k.len() >= 4);
            let k = k.ok_or_else(|| wrong("distortion_coeffs is no list of 4 numbers"))?;
            if k[4..].iter().any(|value| *value != 0.0) {
                let count = k.len();
                return Err(wrong(&format!("{model} has 4 distortion_coeffs, and there are {count}; calibrate again")));
            }
            let lens = if model == "radtan" { coefficients::standard(&k) } else { coefficients::fisheye(&k) };
            lens.map_err(|what| wrong(&what))?
        }
        Some(other) => {
            return Err(wrong(&format!(
                "the distortion model {} is not supported; radtan and equidistant are",
                other.escape_debug()
            )));
        }
    };
    let intrinsics = Intrinsics { width, height, fx: i[0], fy: i[1], cx: i[2] + 0.5, cy: i[3] + 0.5, distortion };
    let intrinsics = intrinsics.checked().map_err(|what| wrong(&what.to_string()))?;
    let pose = match before {
        None => Pose::IDENTITY,
        Some(before) => {
            let rows = entry["T_cn_cnm1"].as_vec().ok_or_else(|| wrong("T_cn_cnm1 is missing"))?;
            let rows: Option<Vec<Vec<f64>>> = rows.iter().map(numbers).collect();
            let rows = rows.filter(|rows| rows.len() == 4 && rows.iter().all(|row| row.len() == 4));
            let m = rows.ok_or_else(|| wrong("T_cn_cnm1 is no 4x4 matrix"))?;
            let row = |at: usize| DVec3::new(m[at][0], m[at][1], m[at][2]);
            let rotation = DMat3::from_cols(row(0), row(1), row(2)).transpose();
            let relative = Pose::rigid(rotation, DVec3::new(m[0][3], m[1][3], m[2][3]));
            let pose = before.then(&relative.map_err(|what| wrong(&format!("T_cn_cnm1: {what}")))?);
            pose.checked().map_err(|what| wrong(&format!("T_cn_cnm1 after those before: {what}")))?
        }
    };
    let topic = entry["rostopic"].as_str().and_then(|topic| topic.trim_matches('/').split('/').next());
    let name = topic.filter(|name| !name.is_empty()).map_or_else(|| format!("cam{index}"), String::from);
    Ok(RigCamera::new(&name, Modality::Rgb, intrinsics, Some(pose)))
}
