//! PanopticSports as Dynamic 3D Gaussians packages it.
//!
//! ```text
//! train_meta.json, test_meta.json   w, h; k[t][i] (3x3), w2c[t][i] (4x4), fn[t][i], cam_id[t][i]
//! ims/<camera>/<frame>.jpg          undistorted frames; `fn` names them
//! seg/<camera>/<frame>.png          1 = people and ball, training cameras only
//! ```
//! Units are metres, y points down. Principal points are used as they are: against static points they fit the
//! convention of half-integer pixel centres. The masks become masks of moving pixels, which is what people and ball are
//! in these recordings; a person who stands still is included.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use glam::{DMat3, DVec3};
use serde::Deserialize;

use super::{
    ImportError, ImportOptions, Imported,
    common::{self, FileFrame, Frames, SourceView},
    write::{self, SourceRecording},
};
use crate::Split;
use erfgs_base::progress::Progress;
use erfgs_scene::{
    Distortion, Intrinsics, Pose,
    exchange::json::{self, Number},
};

/// The rate of the Panoptic Studio's HD cameras as packaged.
const FPS: f64 = 30.0;

#[derive(Deserialize)]
struct Meta {
    w: u32,
    h: u32,
    k: Vec<Vec<[[Number; 3]; 3]>>,
    w2c: Vec<Vec<[[Number; 4]; 4]>>,
    #[serde(rename = "fn")]
    files: Vec<Vec<String>>,
    cam_id: Vec<Vec<u64>>,
}

/// One camera while its rows are gathered.
struct Track {
    split: Split,
    k: [[Number; 3]; 3],
    w2c: [[Number; 4]; 4],
    size: [u32; 2],
    meta: PathBuf,
    /// Files relative to `ims`, by frame number.
    frames: BTreeMap<u64, PathBuf>,
}

/// Imports the recording in `source` into a new dataset in the folder `out`. The test cameras are those of
/// `test_meta.json`; cameras are called `cam00`, `cam01` and so on by their numbers.
///
/// # Errors
/// If the source is incomplete or malformed, or the dataset cannot be written.
pub fn import(
    source: &Path,
    options: &ImportOptions,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Imported, ImportError> {
    let fps = common::fps(options, FPS)?;
    let range = common::checked_range(options)?;
    let mut tracks = BTreeMap::new();
    for (file, split) in [("train_meta.json", Split::Train), ("test_meta.json", Split::Test)] {
        let path = source.join(file);
        if !path.is_file() {
            let remedy = "a PanopticSports folder holds train_meta.json, test_meta.json and ims/";
            return Err(ImportError::Missing { path, remedy });
        }
        gather(&path, split, range, &mut tracks)?;
    }
    let numbers: BTreeSet<u64> = tracks.values().flat_map(|track| track.frames.keys().copied()).collect();
    let first = numbers.first().copied().unwrap_or(0);
    let mut views = Vec::new();
    for (id, track) in &tracks {
        if let Some(number) = numbers.iter().find(|number| !track.frames.contains_key(number)) {
            let what = format!("frame {number} is missing, which other cameras have");
            return Err(ImportError::Camera { camera: camera_name(*id), path: track.meta.clone(), what });
        }
        views.push(view(source, *id, track, first, fps)?);
    }
    common::override_split(&mut views, options)?;
    let recording =
        SourceRecording { importer: "panoptic", source, views, any_size: false, fps, points: None, notes: Vec::new() };
    write::write(recording, options, out, progress)
}

fn camera_name(id: u64) -> String {
    format!("cam{id:02}")
}

/// Adds the cameras of one metadata file with the frames that lie in `range`.
fn gather(
    path: &Path,
    split: Split,
    range: Option<(u64, u64)>,
    tracks: &mut BTreeMap<u64, Track>,
) -> Result<(), ImportError> {
    let meta: Meta = json::read(path)?;
    let malformed = |what| Err(ImportError::Malformed { path: path.to_owned(), what });
    let rows = [meta.k.len(), meta.w2c.len(), meta.files.len(), meta.cam_id.len()];
    if rows.iter().any(|&count| count != rows[0]) {
        return malformed(format!("k, w2c, fn and cam_id have {rows:?} frames; they must have equally many"));
    }
    let mut known = None::<(u64, u64)>;
    let mut used = 0;
    let mut last: BTreeMap<u64, u64> = BTreeMap::new();
    for (row, (((k, w2c), files), ids)) in meta.k.iter().zip(&meta.w2c).zip(&meta.files).zip(&meta.cam_id).enumerate() {
        let counts = [k.len(), w2c.len(), files.len(), ids.len()];
        if counts.iter().any(|&count| count != counts[0]) {
            return malformed(format!("k, w2c, fn and cam_id have {counts:?} cameras in frame {row}"));
        }
        for (((k, w2c), file), &id) in k.iter().zip(w2c).zip(files).zip(ids) {
            let file = PathBuf::from(file);
            let Some(number) = common::number(&common::stem(&file)) else {
                return malformed(format!("the file name {} holds no frame number", file.display()));
            };
            if let Some(before) = last.insert(id, number).filter(|before| number < *before) {
                return malformed(format!(
                    "row {row} names frame {number} of camera {id} behind frame {before}; rows are in the order of time, so that the \
                     numbers at the ends of the names must ascend"
                ));
            }
            known = Some(known.map_or((number, number), |(low, high)| (low.min(number), high.max(number))));
            if range.is_some_and(|(first, last)| !(first..=last).contains(&number)) {
                continue;
            }
            used += 1;
            let meta_path = path.to_owned();
            let track = tracks.entry(id).or_insert_with(|| Track {
                split,
                k: *k,
                w2c: *w2c,
                size: [meta.w, meta.h],
                meta: meta_path,
                frames: BTreeMap::new(),
            });
            let wrong = |what| Err(ImportError::Camera { camera: camera_name(id), path: path.to_owned(), what });
            if track.split != split {
                return wrong("the camera is named for training and for testing".to_owned());
            }
            if !same(k.as_flattened(), track.k.as_flattened()) || !same(w2c.as_flattened(), track.w2c.as_flattened()) {
                return wrong(format!(
                    "the camera moves or zooms in frame {number}; only static cameras can be imported"
                ));
            }
            if track.frames.insert(number, file).is_some() {
                return wrong(format!("frame {number} comes twice"));
            }
        }
    }
    match (known, range) {
        (Some((low, high)), Some((first, last))) if used == 0 || first < low || last > high => {
            Err(ImportError::Malformed {
                path: path.to_owned(),
                what: format!("the frames {first}..{last} were asked for, but there are {low}..{high}"),
            })
        }
        (None, _) => malformed("it names no frames".to_owned()),
        _ => Ok(()),
    }
}

/// Whether two matrices are the same up to rounding; NaN in the same place counts as the same and is found later.
fn same(a: &[Number], b: &[Number]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a.0 - b.0).abs() <= 1e-6 * (1.0 + a.0.abs()) || (a.0.is_nan() && b.0.is_nan()))
}

fn view(source: &Path, id: u64, track: &Track, first: u64, fps: f64) -> Result<SourceView, ImportError> {
    let name = camera_name(id);
    let wrong = |what| ImportError::Camera { camera: name.clone(), path: track.meta.clone(), what };
    let k = track.k.map(|row| row.map(|value| value.0));
    let [[fx, skew, cx], [below, fy, cy], last] = k;
    if [skew, below, last[0], last[1], last[2]] != [0.0, 0.0, 0.0, 0.0, 1.0] {
        return Err(wrong(format!("k = {k:?} is no pinhole without skew")));
    }
    let w2c = track.w2c.map(|row| row.map(|value| value.0));
    let [[a, b, c, x], [d, e, f, y], [g, h, i, z], bottom] = w2c;
    if bottom != [0.0, 0.0, 0.0, 1.0] {
        return Err(wrong(format!("the last row of w2c is {bottom:?} instead of 0, 0, 0, 1")));
    }
    let rotation = DMat3::from_cols_array_2d(&[[a, d, g], [b, e, h], [c, f, i]]);
    let pose = Pose::rigid(rotation, DVec3::new(x, y, z)).map_err(wrong)?;
    let [width, height] = track.size;
    let intrinsics = Intrinsics { width, height, fx, fy, cx, cy, distortion: Distortion::None };
    let intrinsics = intrinsics.checked().map_err(|error| wrong(error.to_string()))?;

    let masks = source.join("seg").join(id.to_string()).is_dir();
    let mut frames = Vec::new();
    for (&number, file) in &track.frames {
        let image = source.join("ims").join(file);
        let mask = masks.then(|| source.join("seg").join(file).with_extension("png"));
        if let Some(path) = std::iter::once(&image).chain(&mask).find(|path| !path.is_file()) {
            let what = format!("frame {number} is missing{}", present(path));
            return Err(ImportError::Camera { camera: name, path: path.clone(), what });
        }
        frames.push(FileFrame { image, mask, t_ns: common::frame_time(number - first, fps) });
    }
    Ok(SourceView { name, split: track.split, intrinsics, pose, frames: Frames::Files(frames) })
}

/// A hint at the frames that lie beside a missing one.
fn present(missing: &Path) -> String {
    let beside = missing.parent().and_then(|folder| common::images(folder).ok()).unwrap_or_default();
    let mut numbers = beside.iter().filter_map(|path| common::number(&common::stem(path)));
    match (numbers.next(), beside.len()) {
        (Some(first), _) => {
            let last = numbers.next_back().unwrap_or(first);
            format!("; its folder holds frames from {first} to {last}: import those with --frames {first}..{last}")
        }
        (None, _) => "; its folder holds no frames".to_owned(),
    }
}
