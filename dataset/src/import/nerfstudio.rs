//! nerfstudio's `transforms.json`.
//!
//! The file is read by [`erfgs_scene::exchange::nerfstudio`]. `time` in [0, 1] (as in D-NeRF) is spread over the number of
//! distinct times at the frame rate. Frames of equal pose and intrinsics are frames of one camera, named by its folder of
//! images. Units are those of the file. Masks are not taken: they say what to ignore, not what moves.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use super::{
    ImportError, ImportOptions, Imported,
    common::{self, FileFrame, Frames, SourceView},
    stamps,
    write::{self, SourceRecording},
};
use crate::Split;
use erfgs_base::{names, order, progress::Progress};
use erfgs_scene::{
    Intrinsics, Pose,
    exchange::nerfstudio::{CameraKey, Transforms, camera_path, moving_frames},
};

const FPS: f64 = 30.0;

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
) -> Result<Imported, ImportError> {
    let fps = common::fps(options, FPS)?;
    let path = if source.is_file() { source.to_owned() } else { source.join("transforms.json") };
    if !path.is_file() {
        return Err(ImportError::Missing { path, remedy: "a nerfstudio folder holds transforms.json" });
    }
    let root = path.parent().unwrap_or(Path::new("."));
    let Transforms { frames, train, held_out, mut notes } = Transforms::read(&path)?;
    let split_given = train.is_some() && !held_out.is_empty();
    let mut shots = Vec::new();
    for frame in frames {
        let Some(image) = find_image(root, &frame.file) else {
            let what = "the image is missing".to_owned();
            return Err(ImportError::Camera { camera: frame.file, path, what });
        };
        let size = match frame.lens.size() {
            Some(size) => size,
            None => erfgs_scene::image::size(&image)
                .map_err(|source| ImportError::Image { camera: frame.file.clone(), source })?,
        };
        let wrong = |what| ImportError::Camera { camera: frame.file.clone(), path: path.clone(), what };
        let intrinsics = frame.lens.intrinsics(size).checked().map_err(|error| wrong(error.to_string()))?;
        let (pose, time) = (frame.pose, frame.time);
        let split = if held_out.contains(&frame.file) { Split::Test } else { Split::Train };
        shots.push(Shot { path: image, intrinsics, pose, time, split });
    }
    let is_timed = shots.iter().any(|shot| shot.time.is_some());
    let mut views = gather(shots, options, &path, fps, &mut notes)?;
    let mut rate = fps;
    if !is_timed {
        let description;
        (rate, description) = stamps::place(&mut views, options.fps, FPS)?;
        notes.extend(common::order_notes(views.iter().filter_map(SourceView::files), &description));
    }
    if !split_given {
        common::every_eighth(&mut views);
    }
    common::override_split(&mut views, options)?;
    let recording =
        SourceRecording { importer: "nerfstudio", source: root, views, any_size: true, fps: rate, points: None, notes };
    write::write(recording, options, out, progress)
}

/// The image of a frame; its extension may be missing, as in D-NeRF's files.
fn find_image(root: &Path, file: &str) -> Option<PathBuf> {
    let plain = root.join(file);
    let extended = ["png", "jpg", "jpeg"].map(|extension| root.join(format!("{file}.{extension}")));
    std::iter::once(plain).chain(extended).find(|path| path.is_file())
}

/// Frames of one camera in the order of the numbers in their names.
fn by_name(shots: Vec<Shot>, list: &Path) -> Result<Vec<Shot>, ImportError> {
    let root = list.parent().unwrap_or(Path::new(""));
    let name = |shot: &Shot| {
        shot.path.strip_prefix(root).unwrap_or(&shot.path).with_extension("").to_string_lossy().into_owned()
    };
    let names: Vec<String> = shots.iter().map(name).collect();
    let malformed = |what| ImportError::Malformed { path: list.to_owned(), what };
    let order = order::order(&names).map_err(|doubt| malformed(format!("{doubt}, or give all frames a `time`")))?;
    // Letters alone tell no order: the list must agree.
    let is_numbered =
        |name: &String| name.rsplit('/').next().is_some_and(|own| own.contains(|c: char| c.is_ascii_digit()));
    if !names.iter().all(is_numbered) && !order.is_sorted() {
        let what = format!(
            "the frames of {} have neither a `time` nor numbers, and are not in the order of the alphabet",
            names[0]
        );
        return Err(malformed(what + "; give all of them a `time`"));
    }
    let mut shots: Vec<Option<Shot>> = shots.into_iter().map(Some).collect();
    Ok(order.into_iter().filter_map(|at| shots[at].take()).collect())
}

fn moving_note(frames: usize) -> String {
    format!(
        "{frames} frames have a pose and a time of their own, as those of a camera that moves. The cameras of a dataset stand still: each of \
         these frames becomes a camera. No view is seen twice then, so moving points, bodies and masks of motion are not found, and a \
         training learns what moves as a deformation field"
    )
}

/// Frames of equal pose and intrinsics made into views with times.
fn gather(
    shots: Vec<Shot>,
    options: &ImportOptions,
    path: &Path,
    fps: f64,
    notes: &mut Vec<String>,
) -> Result<Vec<SourceView>, ImportError> {
    let timed = shots.iter().filter(|shot| shot.time.is_some()).count();
    if timed != 0 && timed != shots.len() {
        let what = format!("{timed} of {} frames have a `time`; give all of them one, or none", shots.len());
        return Err(ImportError::Malformed { path: path.to_owned(), what });
    }
    let mut order = Vec::new();
    let mut cameras: BTreeMap<CameraKey, Vec<Shot>> = BTreeMap::new();
    for shot in shots {
        let key = CameraKey::new(&shot.intrinsics, &shot.pose);
        if !cameras.contains_key(&key) {
            order.push(key.clone());
        }
        cameras.entry(key).or_default().push(shot);
    }
    let each: Vec<Vec<Option<f64>>> =
        cameras.values().map(|shots| shots.iter().map(|shot| shot.time).collect()).collect();
    notes.extend(moving_frames(each.iter().map(Vec::as_slice)).map(moving_note));
    // Distinct times in order; without times, frames follow each other by their names: a list may have any order.
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

    let (mut views, mut sources): (Vec<SourceView>, Vec<(String, usize)>) = (Vec::new(), Vec::new());
    for (number, key) in order.iter().enumerate() {
        let mut shots = cameras.remove(key).unwrap_or_default();
        if timed == 0 && shots.len() > 1 {
            shots = by_name(shots, path)?;
        }
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
        let Some(shot) = shots.first() else { continue };
        let own = camera_path(&shot.path, shots.len());
        let name = names::file_name(&own.file_name().unwrap_or_default().to_string_lossy());
        if frames.is_empty() {
            notes.push(format!("{name}: left out, it has no frame among those asked for"));
            continue;
        }
        sources.push((own.to_string_lossy().into_owned(), number));
        let split = if shots.iter().any(|shot| shot.split == Split::Test) { Split::Test } else { Split::Train };
        views.push(SourceView {
            name,
            split,
            intrinsics: shot.intrinsics,
            pose: shot.pose,
            frames: Frames::Files(frames),
        });
    }
    name_apart(&mut views, &sources);
    Ok(views)
}

/// Calls cameras by what tells the paths of their images apart where the last parts of these do not; `sources` has the path and the
/// number of each.
fn name_apart(views: &mut [SourceView], sources: &[(String, usize)]) {
    let distinct: BTreeSet<&str> = views.iter().map(|view| view.name.as_str()).collect();
    if distinct.len() == views.len() {
        return;
    }
    let paths: Vec<&str> = sources.iter().map(|(path, _)| path.as_str()).collect();
    let mut taken = BTreeSet::new();
    for ((view, name), (_, number)) in views.iter_mut().zip(names::apart(&paths)).zip(sources) {
        let name = names::file_name(&name);
        view.name = if taken.insert(name.clone()) { name } else { format!("{name}_{number:03}") };
    }
}
