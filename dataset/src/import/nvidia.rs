//! Nvidia dynamic scenes (Yoon et al. 2020) in their multi-view packaging.
//!
//! ```text
//! poses_bounds.npy                LLFF poses; row i is camera i, further rows repeat the cameras in turn
//! mv_images/00000/cam01.jpg ...   one folder for each time, one image for each camera
//! mv_masks/00000/cam01.png ...    moving pixels (white), where given
//! ```
//! The files may lie in `source` or in `source/dense`. The packaging does not name its frame rate; 15 a second is
//! assumed unless the option says otherwise. The papers disagree on test views; here `cam04` and `cam09` are held out
//! unless the option names others, which leaves neighbours on both sides of each.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use super::{
    ImportError, ImportOptions, Imported,
    common::{self, FileFrame, Frames, SourceView, poses_bounds},
    stamps,
    write::{self, SourceRecording},
};
use crate::Split;
use erfgs_base::{names, progress::Progress};
use erfgs_scene::{Pose, exchange::llff::BOUNDS_LEFT_OUT};

const FPS: f64 = 15.0;
const TEST: [u64; 2] = [4, 9];

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
    let dense = source.join("dense");
    let root = if dense.join("mv_images").is_dir() { dense } else { source.to_owned() };
    let folder = root.join("mv_images");
    if !folder.is_dir() {
        let remedy = "a folder of this layout holds mv_images/00000/cam01.jpg and so on";
        return Err(ImportError::Missing { path: folder, remedy });
    }
    let poses = root.join("poses_bounds.npy");
    let rows = poses_bounds(&poses)?;
    let times: Vec<PathBuf> = common::entries(&folder)?.into_values().filter(|path| path.is_dir()).collect();
    let times = common::in_range(common::in_order(times, &folder)?, options, &folder)?;
    let images: Vec<Vec<PathBuf>> = times.iter().map(|time| common::images(time)).collect::<Result<_, _>>()?;
    let names: Vec<String> =
        images.iter().flatten().map(|path| common::stem(path)).collect::<BTreeSet<_>>().into_iter().collect();
    if names.is_empty() || rows.len() < names.len() || rows.len() % names.len() != 0 {
        let what =
            format!("it holds {} poses, but there are {} cameras ({})", rows.len(), names.len(), names.join(", "));
        return Err(ImportError::Malformed { path: poses, what });
    }
    common::check_rows(names.iter().map(String::as_str), &poses)?;
    let mut views = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let wrong = |path: &Path, what: &str| ImportError::Camera {
            camera: name.clone(),
            path: path.to_owned(),
            what: what.to_owned(),
        };
        let (intrinsics, pose) = rows[index].clone().map_err(|what| wrong(&poses, &what))?;
        for repeated in rows.iter().skip(index).step_by(names.len()) {
            if !repeated.as_ref().is_ok_and(|(_, other)| same(&pose, other)) {
                return Err(wrong(&poses, "the rows of the camera differ; only static cameras can be imported"));
            }
        }
        let mut frames = Vec::new();
        for (index, (time, images)) in times.iter().zip(&images).enumerate() {
            let Some(image) = images.iter().find(|image| common::stem(image) == *name) else {
                return Err(wrong(time, "the camera's image is missing here"));
            };
            let mask = time.file_name().map(|time| root.join("mv_masks").join(time).join(format!("{name}.png")));
            let mask = mask.filter(|path| path.is_file());
            frames.push(FileFrame { image: image.clone(), mask, t_ns: common::frame_time(index as u64, fps) });
        }
        let test = common::number(name).is_some_and(|number| TEST.contains(&number));
        let split = if test { Split::Test } else { Split::Train };
        views.push(SourceView { name: names::file_name(name), split, intrinsics, pose, frames: Frames::Files(frames) });
    }
    common::override_split(&mut views, options)?;
    let of = |path: &PathBuf| FileFrame { image: path.clone(), mask: None, t_ns: 0 };
    let folders: Vec<FileFrame> = times.iter().map(of).collect();
    let (fps, description) = stamps::place(&mut views, options.fps, FPS)?;
    let mut notes = common::order_notes(std::iter::once(("mv_images", &folders[..])), &description);
    notes.push(BOUNDS_LEFT_OUT.to_owned());
    let recording = SourceRecording { importer: "nvidia", source, views, any_size: true, fps, points: None, notes };
    write::write(recording, options, out, progress)
}

/// Whether two poses are the same up to what a reconstruction writes for one camera.
fn same(a: &Pose, b: &Pose) -> bool {
    a.rotation.dot(b.rotation).abs() > 1.0 - 1e-6
        && a.translation.distance(b.translation) <= 1e-3 * a.translation.length()
}
