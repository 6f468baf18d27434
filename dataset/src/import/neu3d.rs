//! Neural 3D Video (Neu3D, DyNeRF).
//!
//! ```text
//! poses_bounds.npy                       one row for each camera, in the order of their names
//! cam00.mp4, cam01.mp4, ...              numbers may have gaps, where cameras were taken out
//! cam00/*.png or cam00/images/*.png      instead of a video: frames in the order of their numbers
//! ```
//! `cam00`, the centre camera, is held out. Each camera has its own row of intrinsics. Images may be smaller than the
//! poses say (4DGS reduces them to 1352 x 1014); the intrinsics follow.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    ImportError, ImportOptions, Imported,
    common::{self, FileFrame, Frames, SourceView, poses_bounds},
    write::{self, SourceRecording},
};
use crate::Split;
use erfgs_base::progress::Progress;
use erfgs_scene::exchange::llff::BOUNDS_LEFT_OUT;

/// The rate of the published recordings.
const FPS: f64 = 30.0;

/// Imports the recording in `source` into a new dataset in the folder `out`.
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
    let poses = source.join("poses_bounds.npy");
    let rows = poses_bounds(&poses)?;
    let cameras = cameras(source)?;
    if rows.len() != cameras.len() {
        let names: Vec<&str> = cameras.keys().map(String::as_str).collect();
        let what = format!(
            "it holds {} poses, but there are {} cameras ({}); each row belongs to one camera, in order of the names",
            rows.len(),
            cameras.len(),
            names.join(", ")
        );
        return Err(ImportError::Malformed { path: poses, what });
    }
    let mut views = Vec::new();
    let mut expected = None;
    for ((name, path), row) in cameras.into_iter().zip(rows) {
        let (intrinsics, pose) =
            row.map_err(|what| ImportError::Camera { camera: name.clone(), path: poses.clone(), what })?;
        let frames = if path.is_dir() {
            let all = common::images(&path)?;
            let first = expected.get_or_insert_with(|| (name.clone(), all.len()));
            if first.1 != all.len() {
                let what = format!("the folder holds {} images, but that of camera {} {}", all.len(), first.0, first.1);
                return Err(ImportError::Camera { camera: name, path, what });
            }
            let frames = common::in_range(all, options, &path)?.into_iter().enumerate();
            let time = |index: usize| common::frame_time(index as u64, fps);
            Frames::Files(frames.map(|(i, image)| FileFrame { image, mask: None, t_ns: time(i) }).collect())
        } else {
            let (first, last) = range.map_or((0, None), |(first, last)| (first, Some(last)));
            Frames::Video { path, first, last, fps }
        };
        let split = if common::number(&name) == Some(0) { Split::Test } else { Split::Train };
        views.push(SourceView { name, split, intrinsics, pose, frames });
    }
    common::override_split(&mut views, options)?;
    let recording = SourceRecording {
        importer: "neu3d",
        source,
        views,
        any_size: true,
        fps,
        points: None,
        notes: vec![BOUNDS_LEFT_OUT.to_owned()],
    };
    write::write(recording, options, out, progress)
}

/// The cameras by name: folders of images, or else videos.
fn cameras(source: &Path) -> Result<BTreeMap<String, PathBuf>, ImportError> {
    let mut cameras = BTreeMap::new();
    let (mut folders, mut videos) = (Vec::new(), Vec::new());
    for (name, path) in common::entries(source)? {
        let stem = common::stem(&path);
        let is_camera = |name: &str| {
            name.strip_prefix("cam")
                .is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit()))
        };
        if path.is_dir() && is_camera(&name) {
            let inner = path.join("images");
            let folder = if inner.is_dir() { inner } else { path };
            if !common::images(&folder)?.is_empty() {
                folders.push((name, folder));
            }
        } else if is_camera(&stem) && path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mp4")) {
            videos.push((stem, path));
        }
    }
    // A folder holds what was decoded from the video of the same name before.
    cameras.extend(videos);
    cameras.extend(folders);
    if cameras.is_empty() {
        let remedy = "a Neu3D folder holds cam00.mp4, cam01.mp4, ... or folders of images of these names";
        return Err(ImportError::Missing { path: source.join("cam00.mp4"), remedy });
    }
    Ok(cameras)
}
