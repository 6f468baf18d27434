//! The TOML files of caliscope and of pose2sim, which share a root: a table for each camera with `size`, `matrix`, `distortions`,
//! `rotation` and `translation` (world to camera, metres). caliscope's cameras are numbers in a table `cameras`, with the rotation
//! as a matrix; pose2sim's have names, with the rotation as a vector. The centre of the first pixel is (0, 0).

use std::{collections::BTreeSet, fmt::Write as _, path::Path};

use erfgs_base::{FileError, atomic};
use glam::{DMat3, DQuat, DVec3};
use toml::{Table, Value};

use super::{
    ExchangeError, Format, Lens, camera_yaml, coefficients, lens, losses, notes,
    unit::{self, Found, Unit},
    yaml::list,
    yaml::malformed,
};
use crate::{
    Intrinsics, Modality, Pose,
    camera::image_side,
    rig_file::{RigCamera, RigFile},
};

pub(super) fn write(rig: &RigFile, format: Format, out: &Path) -> Result<Vec<String>, ExchangeError> {
    let mut text = String::new();
    let mut lost = losses::common(rig, format);
    let numbers = numbers(rig);
    for (camera, number) in rig.cameras.iter().zip(&numbers) {
        let i = &camera.intrinsics;
        let (fisheye, coefficients) = match lens(i) {
            Lens::None => (false, vec![0.0; 5]),
            Lens::Brown(k) => (false, [k.clone(), vec![0.0; 5_usize.saturating_sub(k.len())]].concat()),
            Lens::Fisheye(k) => (true, k.to_vec()),
        };
        let _ = match format {
            Format::Caliscope => write!(text, "[cameras.{number}]\ncam_id = {number}\n"),
            _ => write!(text, "[{0}]\nname = {0}\n", quoted(&camera.name)),
        };
        let m = camera_yaml::matrix(i);
        let rows = |m: &[f64]| m.chunks(3).map(list).collect::<Vec<_>>().join(", ");
        let _ = write!(text, "size = [{}, {}]\nmatrix = [{}]\n", i.width, i.height, rows(&m));
        let _ = write!(text, "distortions = {}\nfisheye = {fisheye}\n", list(&coefficients));
        if let Some(pose) = camera.pose {
            let rotation = match format {
                Format::Caliscope => {
                    format!("[{}]", rows(&DMat3::from_quat(pose.rotation).transpose().to_cols_array()))
                }
                _ => list(&pose.rotation.to_scaled_axis().to_array()),
            };
            let _ = write!(text, "rotation = {rotation}\ntranslation = {}\n", list(&pose.translation.to_array()));
        }
        text.push('\n');
    }
    if format == Format::Pose2sim {
        text += "[metadata]\nadjusted = false\nerror = 0.0\n";
        // Anipose's files are made alike, in the unit of its board.
        text += if rig.metric { "unit = \"m\"\n" } else { "" };
    } else {
        let renamed =
            rig.cameras.iter().zip(&numbers).filter(|(camera, number)| camera.name != format!("cam_{number}"));
        lost.extend(renamed.map(|(camera, number)| format!("{}: caliscope calls it {number}", camera.name)));
    }
    let io = |source| ExchangeError::from(FileError::when("write", out)(source));
    atomic::write(out, text.as_bytes()).map_err(io)?;
    Ok(lost)
}

/// The numbers of cameras that are called `cam_0`, `cam_7`; in their order where one is not.
fn numbers(rig: &RigFile) -> Vec<u32> {
    let own: Option<Vec<u32>> =
        rig.cameras.iter().map(|camera| camera.name.strip_prefix("cam_")?.parse().ok()).collect();
    let own = own.filter(|own| own.iter().collect::<BTreeSet<_>>().len() == own.len());
    own.unwrap_or_else(|| (0..).take(rig.cameras.len()).collect())
}

/// A name as a key and as a string: names are those of files here, but for letters of any alphabet.
fn quoted(name: &str) -> String {
    Value::String(name.into()).to_string()
}

pub(super) fn read(path: &Path) -> Result<Found, ExchangeError> {
    let text = erfgs_base::text::read(path).map_err(FileError::when("read", path))?;
    let document: Table = text.parse().map_err(|error: toml::de::Error| malformed(path, error.message().into()))?;
    let numbered = document.get("cameras").and_then(Value::as_table);
    let mut rig = RigFile::new(if numbered.is_some() { "caliscope" } else { "pose2sim" }, true, Vec::new());
    let mut other = BTreeSet::new();
    for (key, value) in numbered.unwrap_or(&document) {
        let Some(table) = value.as_table().filter(|table| table.contains_key("matrix")) else {
            if key != "metadata" && !unit::is_key(key) {
                other.insert(key.clone());
            }
            continue;
        };
        let own = table.get("name").and_then(Value::as_str);
        let name = match own {
            Some(name) => name.to_owned(),
            None if numbered.is_some() => format!("cam_{key}"),
            None => key.clone(),
        };
        let camera = camera(&name, table).map_err(|what| ExchangeError::Camera {
            camera: name.clone(),
            path: path.into(),
            what,
        })?;
        rig.cameras.push(camera);
        let is_known = |key: &&String| KNOWN.contains(&key.as_str()) || coefficients::is_name(key) || unit::is_key(key);
        other.extend(table.keys().filter(|key| !is_known(key)).cloned());
    }
    if rig.cameras.is_empty() {
        return Err(malformed(path, "it has no camera with a matrix; is it of caliscope or pose2sim?".into()));
    }
    rig.warnings.extend(notes::unknown(&other));
    let unit = document_unit(&document).map_err(|what| malformed(path, what))?;
    Ok(Found { rig, unit, metres_by_format: numbered.is_some() })
}

/// The unit of lengths that a document says: it, its `metadata` or a camera. caliscope's board has a unit of its own.
fn document_unit(document: &Table) -> Result<Option<Unit>, String> {
    let tables = document.values().chain(document.values().filter_map(Value::as_table).flat_map(Table::values));
    let cameras = tables.filter_map(Value::as_table).filter(|table| table.contains_key("matrix"));
    let metadata = document.get("metadata").and_then(Value::as_table);
    let words = std::iter::once(document).chain(metadata).chain(cameras).flatten();
    unit::stated(words.filter(|(key, _)| unit::is_key(key)).map(|(_, word)| word.as_str()))
}

/// What is read of a camera, or says nothing of it.
const KNOWN: [&str; 15] = [
    "cam_id",
    "error",
    "exposure",
    "fisheye",
    "grid_count",
    "ignore",
    "matrix",
    "name",
    "port",
    "rotation",
    "rotation_count",
    "size",
    "translation",
    "verified_resolutions",
    "board_coverage",
];

fn camera(name: &str, table: &Table) -> Result<RigCamera, String> {
    let list =
        |key: &str| table.get(key).map(|value| numbers_of(value).ok_or_else(|| format!("its {key} are no numbers")));
    let needed = |key: &str, count: usize| match list(key) {
        Some(Ok(values)) if values.len() == count => Ok(values),
        Some(Err(error)) => Err(error),
        _ => Err(format!("its {key} is missing or has not {count} numbers")),
    };
    let size = needed("size", 2)?;
    let (width, height) = (image_side(size[0])?, image_side(size[1])?);
    let m = needed("matrix", 9)?;
    if [m[1], m[3], m[6], m[7], m[8]] != [0.0, 0.0, 0.0, 0.0, 1.0] {
        return Err("its matrix has a skew or another last row than 0, 0, 1; calibrate without skew".into());
    }
    let k = match coefficients::key(table.keys().map(String::as_str))? {
        Some(key) => list(key).transpose()?.unwrap_or_default(),
        None => Vec::new(),
    };
    let fisheye = table.get("fisheye").and_then(Value::as_bool) == Some(true);
    let distortion = if fisheye { coefficients::fisheye(&k)? } else { coefficients::standard(&k)? };
    let intrinsics = Intrinsics { width, height, fx: m[0], fy: m[4], cx: m[2] + 0.5, cy: m[5] + 0.5, distortion };
    let intrinsics = intrinsics.checked().map_err(|wrong| format!("its matrix: {wrong}"))?;
    let pose = match (list("rotation").transpose()?, list("translation").transpose()?) {
        (None, None) => None,
        (Some(r), Some(t)) if t.len() == 3 && r.len() == 9 => {
            Some(Pose::rigid(DMat3::from_cols_slice(&r).transpose(), DVec3::from_slice(&t))?)
        }
        (Some(r), Some(t)) if t.len() == 3 && r.len() == 3 => {
            let pose =
                Pose { rotation: DQuat::from_scaled_axis(DVec3::from_slice(&r)), translation: DVec3::from_slice(&t) };
            Some(pose.checked()?)
        }
        _ => {
            return Err(
                "its rotation and translation are no vectors of three (or a 3x3 matrix); give both, or neither".into(),
            );
        }
    };
    Ok(RigCamera::new(name, Modality::Rgb, intrinsics, pose))
}

/// The finite numbers of a list, or of a list of lists.
fn numbers_of(value: &Value) -> Option<Vec<f64>> {
    let mut numbers = Vec::new();
    for value in value.as_array()? {
        match value {
            Value::Array(_) => numbers.extend(numbers_of(value)?),
            Value::Integer(whole) => numbers.push(*whole as f64),
            Value::Float(number) if number.is_finite() => numbers.push(*number),
            _ => return None,
        }
    }
    Some(numbers)
}
