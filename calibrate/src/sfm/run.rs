//! One run of COLMAP: images enlarged, features, matches, verification, mapper, the largest model.

use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
    time::Instant,
};

use erfgs_base::{FileError, random};
use erfgs_scene::{
    Intrinsics, Pose,
    colmap::{CameraModel, ColmapCamera, Model},
    image::Resample,
};
use rayon::prelude::*;

use super::{CameraView, Progress, Setting, SfmError, SfmStep};
use crate::colmap::{
    Colmap, Extraction, Mapping, RunError, Verification,
    brute::Descriptors,
    database::{Database, ImageRow, Keypoints},
};

/// COLMAP's limits on the angle between descriptors, radians.
const MAX_DESCRIPTOR_ANGLE: f64 = 0.7;
/// SIFT's limit of features per image.
const MAX_FEATURES: u32 = 16384;
/// An unknown focal length starts at so many times the longer side; COLMAP's own guess.
const GUESSED_FOCAL: f64 = 1.2;

/// A camera of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    /// Its intrinsics, for the view's own pixels.
    pub intrinsics: Intrinsics,
    /// World to camera; the unit of length is the model's.
    pub pose: Pose,
    /// How many points it sees.
    pub points: usize,
}

/// What a run came to.
#[derive(Clone, Debug)]
pub(super) struct Run {
    /// Its setting's name.
    pub name: String,
    /// The cameras of the largest model, by view; empty where there is none.
    pub cameras: Vec<Option<Placed>>,
    /// The views of the other models, the largest first.
    pub others: Vec<Vec<usize>>,
    /// Number of points of the largest model.
    pub points: usize,
    /// Their mean reprojection error, pixels of the views.
    pub error_px: f64,
    /// Depths at which they are seen: the 2nd and 98th percentile.
    pub depths: [f64; 2],
    /// The features of each view, in its own pixels.
    pub features: Vec<Keypoints>,
    /// Wall time.
    pub seconds: f64,
}

/// Extracts the features of all views, in their own pixels, into `folder`.
pub(super) struct Prepared {
    database: Database,
    rows: Vec<ImageRow>,
    /// The view of each row.
    views: Vec<usize>,
    /// In the pixels of the enlarged images, by view.
    raw: Vec<Keypoints>,
}

pub(super) fn thread_count(threads: usize) -> i64 {
    if threads == 0 { -1 } else { threads as i64 }
}

/// Runs COLMAP with a setting, in an empty `folder`.
pub(super) fn run(
    views: &[CameraView],
    setting: &Setting,
    colmap: &Colmap,
    threads: usize,
    folder: &Path,
    progress: Progress<'_>,
) -> Result<Run, SfmError> {
    let since = Instant::now();
    let mut prepared = extract(views, setting, colmap, threads, folder, progress)?;
    let sizes: Vec<[u32; 2]> = views.iter().map(|view| enlarged_size(view, setting.enlarge)).collect();
    for (row, &view) in prepared.rows.iter().zip(&prepared.views) {
        let (camera, trusted) = colmap_camera(&views[view], sizes[view]);
        prepared.database.set_camera(row.camera, &camera, trusted)?;
    }
    let pairs = match_all(&prepared, setting, progress);
    prepared.database.write_unverified(&pairs)?;
    let path = folder.join("database.db");
    let seed = setting.seed;
    let threads = thread_count(threads);
    progress(SfmStep::Verifying, 0, 1);
    colmap.verify(&Verification { database: path.clone(), threads, seed }, &|_, _| {})?;
    progress(SfmStep::Verifying, 1, 1);
    let output = folder.join("models");
    fs::create_dir_all(&output).map_err(FileError::when("make the folder", &output))?;
    let refine_intrinsics = views.iter().any(|view| view.intrinsics.is_none());
    let mapping = Mapping {
        database: path,
        images: folder.join("images"),
        output: output.clone(),
        threads,
        seed,
        refine_intrinsics,
    };
    // The mapper fails where it finds no model, which is an answer.
    progress(SfmStep::Mapping, 0, views.len());
    let mapped = colmap.map(&mapping, &|done, _| progress(SfmStep::Mapping, done.min(views.len()), views.len()));
    if let Err(error @ RunError::Hung { .. }) = mapped {
        return Err(error.into());
    }
    let models = read_models(&output)?;
    if let (Err(error), true) = (mapped, models.is_empty()) {
        tracing::debug!("{}: {error}", setting.name());
    }
    progress(SfmStep::Mapping, views.len(), views.len());
    let mut run = read(views, &prepared, &models, setting);
    run.seconds = since.elapsed().as_secs_f64();
    Ok(run)
}

fn enlarged_size(view: &CameraView, by: f64) -> [u32; 2] {
    [view.image.width, view.image.height].map(|side| ((f64::from(side) * by).round() as u32).max(1))
}

/// Writes the enlarged images and extracts their features.
pub(super) fn extract(
    views: &[CameraView],
    setting: &Setting,
    colmap: &Colmap,
    threads: usize,
    folder: &Path,
    progress: Progress<'_>,
) -> Result<Prepared, SfmError> {
    let images = folder.join("images");
    // COLMAP numbers images by their names, and its choices depend on the numbers.
    let order = match setting.seed {
        0 => (0..views.len()).collect(),
        seed => random::permutation(random::key(u64::from(seed), &[random::purpose("order of views")]), views.len()),
    };
    let mut place = vec![0; views.len()];
    for (position, &view) in order.iter().enumerate() {
        place[view] = position;
    }
    let names: Vec<String> = place.iter().map(|place| format!("{place:05}/view.png")).collect();
    let done = AtomicUsize::new(0);
    progress(SfmStep::Images, 0, views.len());
    views.par_iter().zip(&names).try_for_each(|(view, name)| -> Result<(), SfmError> {
        let [width, height] = enlarged_size(view, setting.enlarge);
        let image = |source| SfmError::Image { camera: view.name.clone(), source };
        view.image.resized(width, height, Resample::Lanczos).write_png(&images.join(name)).map_err(image)?;
        progress(SfmStep::Images, done.fetch_add(1, Ordering::Relaxed) + 1, views.len());
        Ok(())
    })?;
    let mut sorted = names.clone();
    sorted.sort();
    let list = folder.join("images.txt");
    fs::write(&list, sorted.join("\n") + "\n").map_err(FileError::when("write", &list))?;
    let database = folder.join("database.db");
    let largest = views.iter().flat_map(|view| enlarged_size(view, setting.enlarge)).max().unwrap_or(1);
    let job = Extraction {
        database: database.clone(),
        images,
        list,
        names: sorted,
        camera_params: "1000,1000,500,500".into(),
        threads: thread_count(threads),
        max_image_size: largest,
        max_features: MAX_FEATURES,
        peak_threshold: setting.peak_threshold,
        edge_threshold: setting.edge_threshold,
    };
    colmap.extract(&job, &|done, total| progress(SfmStep::Features, done, total))?;
    let database = Database::open(&database)?;
    let rows = database.images()?;
    let of_rows: Vec<usize> =
        rows.iter().map(|row| names.iter().position(|name| *name == row.name).unwrap_or(usize::MAX)).collect();
    let mut raw = vec![Keypoints::default(); views.len()];
    let (rows, of_rows): (Vec<_>, Vec<_>) =
        rows.into_iter().zip(of_rows).filter(|(_, view)| *view < views.len()).unzip();
    for (row, &view) in rows.iter().zip(&of_rows) {
        raw[view] = database.keypoints(row.image)?;
    }
    Ok(Prepared { database, rows, views: of_rows, raw })
}

impl Prepared {
    /// The features in the views' own pixels.
    pub fn features(&self, views: &[CameraView], enlarge: f64) -> Vec<Keypoints> {
        let of = |(view, raw): (&CameraView, &Keypoints)| {
            let [width, height] = enlarged_size(view, enlarge);
            let (x, y) =
                (f64::from(view.image.width) / f64::from(width), f64::from(view.image.height) / f64::from(height));
            Keypoints {
                positions: raw.positions.iter().map(|p| glam::DVec2::new(p.x * x, p.y * y)).collect(),
                scales: raw.scales.iter().map(|scale| scale * (x * y).sqrt()).collect(),
                descriptors: raw.descriptors.clone(),
            }
        };
        views.iter().zip(&self.raw).map(of).collect()
    }
}

fn colmap_camera(view: &CameraView, [width, height]: [u32; 2]) -> (ColmapCamera, bool) {
    match &view.intrinsics {
        Some(k) => (ColmapCamera::from_intrinsics(&k.resized(width, height)), true),
        None => {
            let [w, h] = [width, height].map(f64::from);
            let parameters = vec![GUESSED_FOCAL * w.max(h), 0.5 * w, 0.5 * h];
            let (width, height) = (u64::from(width), u64::from(height));
            (ColmapCamera { model: CameraModel::SimplePinhole, width, height, parameters }, false)
        }
    }
}

type Pairs = Vec<([u32; 2], Vec<[u32; 2]>)>;

fn match_all(prepared: &Prepared, setting: &Setting, progress: Progress<'_>) -> Pairs {
    let descriptors: Vec<Descriptors> =
        prepared.views.iter().map(|&view| Descriptors::new(&prepared.raw[view].descriptors)).collect();
    let count = descriptors.len();
    let pairs: Vec<(usize, usize)> = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect();
    let rows = &prepared.rows;
    let done = AtomicUsize::new(0);
    pairs
        .par_iter()
        .map(|&(a, b)| {
            let matches = descriptors[a].matches(&descriptors[b], setting.ratio, MAX_DESCRIPTOR_ANGLE);
            progress(SfmStep::Matching, done.fetch_add(1, Ordering::Relaxed) + 1, pairs.len());
            ([rows[a].image, rows[b].image], matches)
        })
        .collect()
}

fn read_models(output: &Path) -> Result<Vec<Model>, SfmError> {
    let mut models = Vec::new();
    for entry in fs::read_dir(output).map_err(FileError::when("list the folder", output))? {
        let path = entry.map_err(FileError::when("list the folder", output))?.path();
        if path.is_dir() {
            models.push(Model::read(&path)?);
        }
    }
    models.sort_by_key(|model| std::cmp::Reverse((model.images.len(), model.points.len())));
    Ok(models)
}

fn read(views: &[CameraView], prepared: &Prepared, models: &[Model], setting: &Setting) -> Run {
    let features = prepared.features(views, setting.enlarge);
    let mut run = Run {
        name: setting.name(),
        cameras: vec![None; views.len()],
        others: Vec::new(),
        points: 0,
        error_px: 0.0,
        depths: [0.0; 2],
        features,
        seconds: 0.0,
    };
    let view_of = |image: u32| {
        prepared.rows.iter().zip(&prepared.views).find(|(row, _)| row.image == image).map(|(_, view)| *view)
    };
    for model in models.iter().skip(1) {
        run.others.push(model.images.keys().filter_map(|&image| view_of(image)).collect());
    }
    let Some(model) = models.first() else { return run };
    for (&id, image) in &model.images {
        let (Some(view), Some(camera)) = (view_of(id), model.cameras.get(&image.camera)) else { continue };
        let intrinsics = match camera.intrinsics() {
            Ok(intrinsics) => intrinsics,
            Err(error) => {
                tracing::warn!("{}: {} is not placed: {error}", run.name, views[view].name);
                continue;
            }
        };
        let own = &views[view].image;
        let points = image.points.iter().filter(|point| point.point3d.is_some()).count();
        run.cameras[view] =
            Some(Placed { intrinsics: intrinsics.resized(own.width, own.height), pose: image.pose, points });
    }
    run.points = model.points.len();
    run.error_px = model.points.values().map(|point| point.error).sum::<f64>()
        / model.points.len().max(1) as f64
        / setting.enlarge;
    let seen = model.points.values().flat_map(|point| {
        point.track.iter().filter_map(|o| Some(model.images.get(&o.image)?.pose.transform(point.position).z))
    });
    let mut depths: Vec<f64> = seen.filter(|depth| *depth > 0.0).collect();
    depths.sort_by(f64::total_cmp);
    if !depths.is_empty() {
        let at = |share: f64| depths[((depths.len() - 1) as f64 * share) as usize];
        run.depths = [at(0.02), at(0.98)];
    }
    run
}
