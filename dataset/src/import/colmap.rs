//! A COLMAP model and folders of images.
//!
//! ```text
//! sparse/0/ (or sparse/, colmap/sparse/0/, .)   cameras, images, points3D as .bin or .txt
//! images/<camera>/<frame>.png                   one folder for each camera, or
//! images/<camera>.png                           one image for each camera
//! ```
//! The model needs one registered image for each camera; with several, their poses must agree, for cameras stand still.
//! All images in a camera's folder are imported, whether registered or not. COLMAP's scale is arbitrary: units are
//! metres only if the model was made from metric poses.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    ImportError, ImportOptions, Imported,
    common::{self, FileFrame, Frames, SourceView},
    stamps,
    write::{self, SourceRecording},
};
use crate::Split;
use erfgs_base::{names, plausible::POINT, progress::Progress};
use erfgs_scene::{
    colmap::{ColmapImage, Model, Point3d},
    image::is_picture,
    ply::PointCloud,
};

const FPS: f64 = 30.0;

/// Imports the recording in `source` into a new dataset in the folder `out`. Every eighth camera is for testing unless
/// the option names others.
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
    let candidates = ["sparse/0", "sparse", "colmap/sparse/0", "."].map(|folder| source.join(folder));
    let has_model = |folder: &&PathBuf| ["cameras.bin", "cameras.txt"].iter().any(|name| folder.join(name).is_file());
    let Some(folder) = candidates.iter().find(has_model) else {
        let remedy = "the folder must hold a COLMAP model in sparse/0 (cameras, images, points3D as .bin or .txt)";
        return Err(ImportError::Missing { path: source.join("sparse/0/cameras.bin"), remedy });
    };
    let model = Model::read(folder)?;
    let images = source.join("images");
    if !images.is_dir() {
        return Err(ImportError::Missing { path: images, remedy: "the images of the model lie in it" });
    }

    // A name with a folder belongs to the camera of that folder, one without is a camera of its own.
    let mut cameras: BTreeMap<String, Vec<&ColmapImage>> = BTreeMap::new();
    for image in model.images.values() {
        let path = Path::new(&image.name);
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let name = folder.map_or_else(|| common::stem(path), |folder| folder.to_string_lossy().into_owned());
        cameras.entry(name).or_default().push(image);
    }
    let mut views = Vec::new();
    let mut counts: Option<(String, usize)> = None;
    for (name, shots) in cameras {
        let view = view(&name, &shots, &model, folder, &images, options, fps)?;
        let Frames::Files(files) = &view.frames else { continue };
        let (first, count) = counts.get_or_insert_with(|| (name.clone(), files.len()));
        if *count != files.len() {
            let what = format!("the camera has {} images, but camera {first} has {count}", files.len());
            return Err(ImportError::Camera { camera: name.clone(), path: images.join(&name), what });
        }
        if views.iter().any(|other: &SourceView| other.name == view.name) {
            let what = format!("two cameras would be called {}; rename a folder", view.name);
            return Err(ImportError::Camera { camera: name.clone(), path: images.join(&name), what });
        }
        views.push(view);
    }
    common::every_eighth(&mut views);
    common::override_split(&mut views, options)?;
    let mut notes = left_out(&model, &images, &views)?;
    let (fps, description) = stamps::place(&mut views, options.fps, FPS)?;
    notes.extend(common::order_notes(views.iter().filter_map(SourceView::files), &description));
    let recording =
        SourceRecording { importer: "colmap", source, views, any_size: false, fps, points: points(&model), notes };
    write::write(recording, options, out, progress)
}

/// The points of the model. It does not tell when they were seen.
fn points(model: &Model) -> Option<(PointCloud, &'static str)> {
    let known: Vec<&Point3d> = model.points.values().filter(|point| fits(point)).collect();
    (!known.is_empty()).then(|| {
        let positions = known.iter().map(|point| point.position.as_vec3().to_array()).collect();
        (PointCloud { positions, colours: known.iter().map(|point| point.colour).collect() }, "colmap")
    })
}

fn fits(point: &Point3d) -> bool {
    POINT.check_all(point.position.to_array()).is_ok()
}

/// What of the model and of the folder of images is not in the dataset.
fn left_out(model: &Model, images: &Path, views: &[SourceView]) -> Result<Vec<String>, ImportError> {
    let mut notes = Vec::new();
    let held_out = views.iter().filter(|view| view.split == Split::Test).count();
    let lost = model.points.values().filter(|point| !fits(point)).count();
    if model.points.len() > lost && held_out > 0 {
        notes.push(format!(
            "points taken from the model: {}. The {held_out} held-out cameras may have contributed to them (erfgs dataset points \
             makes points without these cameras)",
            model.points.len() - lost
        ));
    }
    if lost > 0 {
        notes.push(format!("points of the model left out: {lost}, which are implausibly far away"));
    }
    for (name, path) in common::entries(images)? {
        let own = if path.is_dir() { name.clone() } else { common::stem(&path) };
        let known = views.iter().any(|view| view.name == names::file_name(&own));
        let has_images = if path.is_dir() { !common::images(&path)?.is_empty() } else { is_picture(&name) };
        if has_images && !known {
            notes.push(format!("{name}: left out, the model has no image of it"));
        }
    }
    Ok(notes)
}

fn view(
    name: &str,
    shots: &[&ColmapImage],
    model: &Model,
    folder: &Path,
    images: &Path,
    options: &ImportOptions,
    fps: f64,
) -> Result<SourceView, ImportError> {
    let wrong = |what| ImportError::Camera { camera: name.to_owned(), path: folder.to_owned(), what };
    let Some(first) = shots.first() else { return Err(wrong("it has no image".to_owned())) };
    for other in shots {
        let turned = first.pose.rotation.dot(other.pose.rotation).abs().min(1.0).acos() * 2.0;
        let moved = first.pose.centre().distance(other.pose.centre());
        if other.camera != first.camera || turned > 1e-3 || moved > 1e-3 * (1.0 + first.pose.centre().length()) {
            let what = format!(
                "{} and {} are of one folder, but differ in camera or pose ({:.3} degrees, {moved:.4} units); \
                 only static cameras can be imported, with one folder for each",
                first.name,
                other.name,
                turned.to_degrees()
            );
            return Err(wrong(what));
        }
    }
    let Some(camera) = model.cameras.get(&first.camera) else { return Err(wrong("its camera is missing".to_owned())) };
    let intrinsics = camera.intrinsics().map_err(|error| wrong(error.to_string()))?;
    let pose = first.pose.checked().map_err(|error| wrong(error.to_string()))?;
    let single = images.join(&first.name);
    let own = images.join(name);
    let files = match (single.is_file(), own.is_dir()) {
        (_, true) => common::frames(&own)?,
        (true, false) => vec![single],
        (false, false) => {
            let what = "the image is missing; put the images where the model was made from".to_owned();
            return Err(ImportError::Camera { camera: name.to_owned(), path: single, what });
        }
    };
    let files =
        if files.len() > 1 || options.frames.is_some() { common::in_range(files, options, &own)? } else { files };
    let frame = |(index, image)| FileFrame { image, mask: None, t_ns: common::frame_time(index as u64, fps) };
    let frames = Frames::Files(files.into_iter().enumerate().map(frame).collect());
    Ok(SourceView { name: names::file_name(name), split: Split::Train, intrinsics, pose, frames })
}
