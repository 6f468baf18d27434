//! nerfstudio's `transforms.json`, for rigs and for datasets alike.
//!
//! Camera-to-world matrices with OpenGL axes (x right, y up, z backward); intrinsics for the whole file or for each frame,
//! of which the frame's come first (a value in two forms, as a focal length in pixels or by an angle, is one); principal points as COLMAP gives them, which is our convention. Units and world are
//! those of the file: `applied_transform` and `applied_scale` tell what was done to another world, and are not undone.

mod cameras;
mod keys;
mod lens;
mod write;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use erfgs_base::names;
use glam::{DMat3, DVec3};

pub use cameras::{CameraKey, camera_path, moving_frames};
pub use lens::Lens;
pub(super) use write::write;
pub use write::{Shot, write_shots};

use self::keys::{File, FrameKeys};
use super::{
    ExchangeError,
    json::{self, Number},
    notes,
};
use crate::{
    Intrinsics, Modality, Pose,
    rig_file::{RigCamera, RigFile},
};

/// What a `transforms.json` says.
#[derive(Clone, Debug)]
pub struct Transforms {
    /// At least one image with its camera.
    pub frames: Vec<Frame>,
    /// The frames to train with, by `file_path`, where the file says.
    pub train: Option<Vec<String>>,
    /// The frames to test and to validate with.
    pub held_out: BTreeSet<String>,
    /// What the file says beyond that, a sentence for each.
    pub notes: Vec<String>,
}

/// One image and its camera.
#[derive(Clone, Debug)]
pub struct Frame {
    /// `file_path`: the image, relative to the file's folder; its extension may be missing.
    pub file: String,
    /// World-to-camera pose.
    pub pose: Pose,
    /// Sensor and lens.
    pub lens: Lens,
    /// When the image was taken, in units of the file (D-NeRF's are from 0 to 1); finite.
    pub time: Option<f64>,
}

impl Transforms {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is malformed or names no frames; if a frame's camera model is not known or holds a lens that
    /// ours cannot, or one of its numbers makes no sense. The message names the frame.
    pub fn read(path: &Path) -> Result<Self, ExchangeError> {
        let file: File = json::read(path)?;
        if file.frames.is_empty() {
            return Err(ExchangeError::Malformed { path: path.into(), what: "it names no frames".into() });
        }
        let mut other: BTreeSet<String> = file.other.into_keys().collect();
        let mut frames = Vec::with_capacity(file.frames.len());
        for keys in file.frames {
            let wrong = |what| ExchangeError::Camera { camera: keys.file_path.clone(), path: path.into(), what };
            let lens = keys.lens.over(&file.lens).and_then(|keys| Lens::new(&keys)).map_err(wrong)?;
            let pose = pose(&keys.transform_matrix).map_err(wrong)?;
            let time = keys.time.map(|Number(time)| time);
            if time.is_some_and(|time| !time.is_finite()) {
                return Err(wrong("the time is not a number".into()));
            }
            let FrameKeys { file_path: file, other: own, .. } = keys;
            other.extend(own.into_keys());
            frames.push(Frame { file, pose, lens, time });
        }
        let held_out = file.test_filenames.into_iter().chain(file.val_filenames).flatten().collect();
        Ok(Self { frames, train: file.train_filenames, held_out, notes: left_out(other) })
    }
}

fn pose(rows: &[Vec<Number>]) -> Result<Pose, String> {
    let row = |at: usize| match rows.get(at).map(Vec::as_slice) {
        Some(&[a, b, c, d]) => Ok([a.0, b.0, c.0, d.0]),
        _ => Err("transform_matrix has not four columns and three or four rows".to_owned()),
    };
    let [x, y, z] = [row(0)?, row(1)?, row(2)?];
    if rows.len() > 3 && (row(3)? != [0.0, 0.0, 0.0, 1.0] || rows.len() > 4) {
        return Err("the last row of transform_matrix is not 0, 0, 0, 1; a rigid pose is needed".to_owned());
    }
    let column = |at: usize| DVec3::new(x[at], y[at], z[at]);
    // OpenGL's y points up and its z backward.
    let rotation = DMat3::from_cols(column(0), -column(1), -column(2)).transpose();
    Pose::rigid(rotation, -(rotation * column(3)))
}

/// Keys whose meaning is known and has no place here.
const KNOWN: [(&str, &str); 5] = [
    ("mask_path", "masks (mask_path) are not taken: they say what to ignore, not what moves"),
    ("depth_file_path", "depth images (depth_file_path) are not taken"),
    ("ply_file_path", "the point cloud (ply_file_path) is not taken"),
    ("applied_transform", "applied_transform is not undone: the world is the file's"),
    ("applied_scale", "applied_scale is not undone: the unit is the file's"),
];

fn left_out(mut keys: BTreeSet<String>) -> Vec<String> {
    let known = KNOWN.iter().filter(|(key, _)| keys.remove(*key)).map(|(_, sentence)| (*sentence).to_owned());
    let mut notes: Vec<String> = known.collect();
    notes.extend(notes::unknown(&keys));
    notes
}

/// The file as a rig: frames of one pose and lens are of one camera, named by the folder of its images, or by its only image.
pub(super) fn read(path: &Path) -> Result<RigFile, ExchangeError> {
    let file = Transforms::read(path)?;
    let mut order: BTreeMap<CameraKey, usize> = BTreeMap::new();
    let mut groups: Vec<(Intrinsics, Vec<&Frame>)> = Vec::new();
    for frame in &file.frames {
        let wrong =
            |what: &str| ExchangeError::Camera { camera: frame.file.clone(), path: path.into(), what: what.into() };
        let size = frame.lens.size().ok_or_else(|| wrong("there are no w and h; add the size of the images"))?;
        Path::new(&frame.file).file_stem().ok_or_else(|| wrong("file_path names no file"))?;
        let intrinsics = frame.lens.intrinsics(size);
        let at = *order.entry(CameraKey::new(&intrinsics, &frame.pose)).or_insert(groups.len());
        if at == groups.len() {
            groups.push((intrinsics, Vec::new()));
        }
        groups[at].1.push(frame);
    }
    let names = camera_names(&groups);
    let cameras = names.into_iter().zip(&groups);
    let cameras = cameras
        .map(|(name, (intrinsics, frames))| RigCamera::new(&name, Modality::Rgb, *intrinsics, Some(frames[0].pose)));
    let mut rig = RigFile::new("nerfstudio", false, cameras.collect());
    rig.warnings.push("a transforms.json does not say whether its unit is the metre".into());
    rig.warnings.extend(file.notes);
    if file.frames.iter().any(|frame| frame.time.is_some()) {
        rig.warnings.push("the times of frames are not kept: a rig stands still".into());
    }
    let times: Vec<Vec<Option<f64>>> =
        groups.iter().map(|(_, frames)| frames.iter().map(|frame| frame.time).collect()).collect();
    if let Some(moving) = moving_frames(times.iter().map(Vec::as_slice)) {
        rig.warnings.push(format!(
            "{moving} frames have a pose and a time of their own, as those of a camera that moves: each becomes a camera of the rig, as if \
             it had been there all the time"
        ));
    }
    if file.train.is_some() || !file.held_out.is_empty() {
        rig.warnings.push("which frames are to train and to test with is not kept".into());
    }
    Ok(rig)
}

/// Names by the last part of a camera's path, by more of it where that is alike, and by a number where all of it is.
fn camera_names(groups: &[(Intrinsics, Vec<&Frame>)]) -> Vec<String> {
    let path = |frames: &[&Frame]| camera_path(Path::new(&frames[0].file), frames.len());
    let paths: Vec<PathBuf> = groups.iter().map(|(_, frames)| path(frames)).collect();
    let last = |path: &PathBuf| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut names: Vec<String> = paths.iter().map(last).collect();
    let are_alike = |names: &[String]| names.iter().collect::<BTreeSet<_>>().len() < names.len();
    if are_alike(&names) {
        let paths: Vec<String> = paths.iter().map(|path| path.to_string_lossy().into_owned()).collect();
        names = names::apart(&paths.iter().map(String::as_str).collect::<Vec<_>>());
    }
    if are_alike(&names) {
        names.iter_mut().enumerate().for_each(|(number, name)| *name = format!("{name}_{number:03}"));
    }
    names
}

#[cfg(test)]
mod tests;
