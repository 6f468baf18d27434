//! nerfstudio's `transforms.json`.
//!
//! Camera-to-world matrices with OpenGL axes (x right, y up, z backward); intrinsics for the whole file or for each
//! frame; `camera_model` PINHOLE, OPENCV or OPENCV_FISHEYE; principal points as COLMAP gives them, which is our
//! convention. `time` in [0, 1] (as in D-NeRF) is spread over the number of distinct times at the frame rate. Frames of
//! equal pose and intrinsics are frames of one camera, named by its folder of images. Units are those of the file.
//! Masks are not taken: they say what to ignore, not what moves.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use glam::{DMat3, DVec3};
use serde::Deserialize;

use super::{
    ImportError, ImportOptions,
    common::{self, FileFrame, Frames, SourceView},
    json::{self, Number},
    write::{self, SourceRecording},
};
use crate::{Dataset, Split};
use erfgs_base::progress::Progress;
use erfgs_scene::{Distortion, Intrinsics, Pose};

const FPS: f64 = 30.0;

/// The intrinsics of the file or of a frame; the frame's come first.
#[derive(Clone, Default, Deserialize)]
struct Lens {
    camera_model: Option<String>,
    camera_angle_x: Option<Number>,
    fl_x: Option<Number>,
    fl_y: Option<Number>,
    cx: Option<Number>,
    cy: Option<Number>,
    w: Option<Number>,
    h: Option<Number>,
    k1: Option<Number>,
    k2: Option<Number>,
    k3: Option<Number>,
    k4: Option<Number>,
    p1: Option<Number>,
    p2: Option<Number>,
}

#[derive(Deserialize)]
struct File {
    #[serde(flatten)]
    lens: Lens,
    frames: Vec<FrameEntry>,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
}

#[derive(Deserialize)]
struct FrameEntry {
    file_path: String,
    transform_matrix: Vec<Vec<Number>>,
    time: Option<Number>,
    #[serde(flatten)]
    lens: Lens,
}

/// A frame whose camera is known but not yet gathered with its like.
struct Shot {
    path: PathBuf,
    intrinsics: Intrinsics,
    pose: Pose,
    time: Option<f64>,
    split: Split,
}

/// Imports the recording in `source` (a folder, or the `transforms.json` itself) into a new dataset in the folder
/// `out`. Test cameras are those with frames in `test_filenames` or `val_filenames`, else every eighth camera.
///
/// # Errors
/// If the source is incomplete or malformed, or the dataset cannot be written.
pub fn import(
    source: &Path,
    options: &ImportOptions,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Dataset, ImportError> {
    let fps = common::fps(options, FPS)?;
    let path = if source.is_file() { source.to_owned() } else { source.join("transforms.json") };
    if !path.is_file() {
        return Err(ImportError::Missing { path, remedy: "a nerfstudio folder holds transforms.json" });
    }
    let root = path.parent().unwrap_or(Path::new("."));
    let file: File = json::read(&path)?;
    let held: BTreeSet<&String> = file.test_filenames.iter().chain(&file.val_filenames).flatten().collect();
    let split_given = file.train_filenames.is_some() && !held.is_empty();
    let mut shots = Vec::new();
    for entry in &file.frames {
        let wrong = |what| ImportError::Camera { camera: entry.file_path.clone(), path: path.clone(), what };
        let image = find_image(root, &entry.file_path).ok_or_else(|| wrong("the image is missing".to_owned()))?;
        let broken = |source| ImportError::Image { camera: entry.file_path.clone(), source };
        let size = match entry.lens.size().or_else(|| file.lens.size()) {
            Some(size) => size,
            None => erfgs_scene::image::size(&image).map_err(broken)?,
        };
        let intrinsics = entry.lens.over(&file.lens).intrinsics(size).map_err(wrong)?;
        let pose = pose(&entry.transform_matrix).map_err(wrong)?;
        let time = entry.time.map(|time| time.0);
        if time.is_some_and(|time| !time.is_finite()) {
            return Err(wrong("the time is not a number".to_owned()));
        }
        let split = if held.contains(&entry.file_path) { Split::Test } else { Split::Train };
        shots.push(Shot { path: image, intrinsics, pose, time, split });
    }
    if shots.is_empty() {
        return Err(ImportError::Malformed { path, what: "it names no frames".to_owned() });
    }
    let mut views = gather(shots, options, &path, fps)?;
    if !split_given {
        common::every_eighth(&mut views);
    }
    common::override_split(&mut views, options)?;
    let recording = SourceRecording { importer: "nerfstudio", source: root, views, any_size: true, fps };
    write::write(recording, options, out, progress)
}

/// The image of a frame; its extension may be missing, as in D-NeRF's files.
fn find_image(root: &Path, file: &str) -> Option<PathBuf> {
    let plain = root.join(file);
    let extended = ["png", "jpg", "jpeg"].map(|extension| root.join(format!("{file}.{extension}")));
    std::iter::once(plain).chain(extended).find(|path| path.is_file())
}

fn pose(rows: &[Vec<Number>]) -> Result<Pose, String> {
    let row = |at: usize| match rows.get(at).map(Vec::as_slice) {
        Some(&[a, b, c, d]) => Ok([a.0, b.0, c.0, d.0]),
        _ => Err("transform_matrix has not four columns and at least three rows".to_owned()),
    };
    let [x, y, z] = [row(0)?, row(1)?, row(2)?];
    let column = |at: usize| DVec3::new(x[at], y[at], z[at]);
    // OpenGL's y points up and its z backward.
    let rotation = DMat3::from_cols(column(0), -column(1), -column(2)).transpose();
    common::rigid(rotation, -(rotation * column(3)))
}

impl Lens {
    fn size(&self) -> Option<[u32; 2]> {
        let whole = |length: Number| (1.0..=65_535.0).contains(&length.0).then_some(length.0 as u32);
        Some([self.w.and_then(whole)?, self.h.and_then(whole)?])
    }

    /// These values, and those of `file` where they are absent.
    fn over(&self, file: &Self) -> Self {
        let Self { camera_model, camera_angle_x, fl_x, fl_y, cx, cy, w, h, k1, k2, k3, k4, p1, p2 } = self.clone();
        Self {
            camera_model: camera_model.or_else(|| file.camera_model.clone()),
            camera_angle_x: camera_angle_x.or(file.camera_angle_x),
            fl_x: fl_x.or(file.fl_x),
            fl_y: fl_y.or(file.fl_y),
            cx: cx.or(file.cx),
            cy: cy.or(file.cy),
            w: w.or(file.w),
            h: h.or(file.h),
            k1: k1.or(file.k1),
            k2: k2.or(file.k2),
            k3: k3.or(file.k3),
            k4: k4.or(file.k4),
            p1: p1.or(file.p1),
            p2: p2.or(file.p2),
        }
    }

    fn intrinsics(&self, [width, height]: [u32; 2]) -> Result<Intrinsics, String> {
        let from_angle = |angle: Number| 0.5 * f64::from(width) / (0.5 * angle.0).tan();
        let Some(fx) = self.fl_x.map(|f| f.0).or(self.camera_angle_x.map(from_angle)) else {
            return Err("there is neither fl_x nor camera_angle_x; add the focal length in pixels".to_owned());
        };
        let fy = self.fl_y.map_or(fx, |f| f.0);
        if !(fx > 0.0 && fy > 0.0 && fx.is_finite() && fy.is_finite()) {
            return Err(format!("the focal lengths {fx} and {fy} are not positive"));
        }
        let [cx, cy] = [(self.cx, width), (self.cy, height)].map(|(c, size)| c.map_or(f64::from(size) / 2.0, |c| c.0));
        let [k1, k2, k3, k4, p1, p2] =
            [self.k1, self.k2, self.k3, self.k4, self.p1, self.p2].map(|value| value.map_or(0.0, |value| value.0));
        if ![cx, cy, k1, k2, k3, k4, p1, p2].iter().all(|value| value.is_finite()) {
            return Err("the principal point or a distortion coefficient is not finite".to_owned());
        }
        let distortion = match self.camera_model.as_deref() {
            _ if [k1, k2, k3, k4, p1, p2] == [0.0; 6] && self.camera_model.as_deref() != Some("OPENCV_FISHEYE") => {
                Distortion::None
            }
            // nerfstudio's k4 is the fourth radial term, OpenCV's the first of a denominator.
            None | Some("PINHOLE" | "OPENCV" | "SIMPLE_PINHOLE") if k4 == 0.0 => {
                Distortion::BrownConrady([k1, k2, p1, p2, k3, 0.0, 0.0, 0.0])
            }
            Some("OPENCV_FISHEYE") => Distortion::KannalaBrandt([k1, k2, k3, k4]),
            Some("OPENCV") | None => {
                return Err("a k4 with the model OPENCV cannot be imported; calibrate without".to_owned());
            }
            Some(other) => {
                return Err(format!(
                    "the camera model {other} cannot be imported; PINHOLE, OPENCV, OPENCV_FISHEYE can"
                ));
            }
        };
        Ok(Intrinsics { width, height, fx, fy, cx, cy, distortion })
    }
}

/// Frames of equal pose and intrinsics made into views with times.
fn gather(shots: Vec<Shot>, options: &ImportOptions, path: &Path, fps: f64) -> Result<Vec<SourceView>, ImportError> {
    let bits = |shot: &Shot| {
        let (i, p) = (shot.intrinsics, shot.pose);
        let numbers = [i.fx, i.fy, i.cx, i.cy].into_iter().chain(p.rotation.to_array()).chain(p.translation.to_array());
        let lens = match i.distortion {
            Distortion::None => Vec::new(),
            Distortion::BrownConrady(k) => k.to_vec(),
            Distortion::KannalaBrandt(k) => k.to_vec(),
        };
        numbers.chain(lens).map(f64::to_bits).collect::<Vec<_>>()
    };
    let timed = shots.iter().filter(|shot| shot.time.is_some()).count();
    if timed != 0 && timed != shots.len() {
        let what = format!("{timed} of {} frames have a `time`; give all of them one, or none", shots.len());
        return Err(ImportError::Malformed { path: path.to_owned(), what });
    }
    let mut order = Vec::new();
    let mut cameras: BTreeMap<Vec<u64>, Vec<Shot>> = BTreeMap::new();
    for shot in shots {
        let key = bits(&shot);
        if !cameras.contains_key(&key) {
            order.push(key.clone());
        }
        cameras.entry(key).or_default().push(shot);
    }
    // Distinct times in order; without times, frames follow each other as in the file.
    let mut times: Vec<f64> = cameras.values().flatten().filter_map(|shot| shot.time).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let longest = cameras.values().map(Vec::len).max().unwrap_or(0);
    let instants: Vec<u64> = (0..if timed == 0 { longest } else { times.len() } as u64).collect();
    let chosen = common::in_range(instants.clone(), options, path)?;
    let (first, last) = (chosen.first().copied().unwrap_or(0), chosen.last().copied().unwrap_or(0));
    let (start, length) = match (times.first(), times.last()) {
        (Some(start), Some(end)) => (*start, end - start),
        _ => (0.0, 0.0),
    };
    // Times are kept as they are given: they need not be evenly spaced.
    let seconds = |time: f64| if length > 0.0 { (time - start) / length * (times.len() - 1) as f64 / fps } else { 0.0 };

    let mut views: Vec<SourceView> = Vec::new();
    for (number, key) in order.iter().enumerate() {
        let mut shots = cameras.remove(key).unwrap_or_default();
        shots.sort_by(|a, b| a.time.unwrap_or(0.0).total_cmp(&b.time.unwrap_or(0.0)));
        let mut frames = Vec::new();
        for (index, shot) in shots.iter().enumerate() {
            let instant = match shot.time {
                Some(time) => times.partition_point(|&other| other < time) as u64,
                None => index as u64,
            };
            if instants.is_empty() || !(first..=last).contains(&instant) {
                continue;
            }
            let zero = times.get(first as usize).map_or(0.0, |&time| seconds(time));
            let t_ns = match shot.time {
                Some(time) => ((seconds(time) - zero) * 1e9).round() as i64,
                None => common::frame_time(instant - first, fps),
            };
            frames.push(FileFrame { image: shot.path.clone(), mask: None, t_ns });
        }
        let Some(shot) = shots.first().filter(|_| !frames.is_empty()) else { continue };
        let folder = shot.path.parent().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
        let own = if shots.len() > 1 { folder.unwrap_or_default() } else { common::stem(&shot.path) };
        let name = common::folder_name(&own);
        let taken = views.iter().any(|view| view.name == name);
        let name = if taken { format!("{name}_{number:03}") } else { name };
        let split = if shots.iter().any(|shot| shot.split == Split::Test) { Split::Test } else { Split::Train };
        views.push(SourceView {
            name,
            split,
            intrinsics: shot.intrinsics,
            pose: shot.pose,
            frames: Frames::Files(frames),
        });
    }
    Ok(views)
}
