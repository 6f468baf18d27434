//! Points through COLMAP: its features and its triangulation, our matching in between.
//!
//! 1. The frames are written, enlarged and grey, into a folder for each camera.
//! 2. COLMAP extracts SIFT features into a database, where the cameras are replaced by the known intrinsics.
//! 3. Each pair of cameras of an instant is matched along the known epipolar lines (`matching`), and the matches are
//!    written as if COLMAP had matched and verified them. Its own verification, which estimates the geometry, keeps a
//!    third of the pairs of a wide-baseline rig; this is where points are won.
//! 4. COLMAP triangulates the tracks with fixed poses; those of at least three views are kept.

use std::{
    collections::{BTreeMap, HashMap},
    fs,
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use erfgs_base::FileError;
use erfgs_dataset::DatasetError;
use erfgs_scene::{
    Intrinsics,
    colmap::{ColmapCamera, ColmapImage, Model},
};
use glam::DVec2;
use rayon::prelude::*;

use super::{
    CloudError, CloudOptions, CloudPoint, CloudStep, Counts, Progress,
    photo::{Photo, median_colour},
    rig::{Reach, Rig},
};
use erfgs_calibrate::colmap::{
    Colmap, Extraction, Triangulation,
    database::{Database, ImageRow, PairMatches},
    matching::{Features, Limits, Relative, match_pair},
};

/// Fewer features than this in all images together cannot make a useful cloud.
const FEWEST_FEATURES: usize = 100;

/// Where an image of the database was taken.
#[derive(Clone, Copy, Debug)]
struct Shot {
    instant: usize,
    /// Index among the instant's shots.
    position: usize,
    station: usize,
}

/// The points of all instants of `rig`, each with the instant it was seen at, unmerged.
pub fn points(
    rig: &Rig<'_>,
    photos: &[Vec<Photo>],
    options: &CloudOptions,
    reach: &Reach,
    work_dir: &Path,
    progress: Progress<'_>,
    counts: &mut Counts,
) -> Result<Vec<CloudPoint>, CloudError> {
    check(options)?;
    let colmap = Colmap::find(&options.colmap.program)?;
    counts.insert("colmap_version".into(), colmap.version().into());
    fs::create_dir_all(work_dir).map_err(FileError::when("make the work folder", work_dir))?;
    let work = tempfile::Builder::new().prefix("colmap-").tempdir_in(work_dir);
    let work = work.map_err(FileError::when("make a folder in", work_dir))?;
    let folder = work.path();

    let images = folder.join("images");
    let names = write_images(rig, photos, options.colmap.enlarge, &images, progress)?;
    let list = folder.join("images.txt");
    let mut sorted: Vec<String> = names.keys().cloned().collect();
    sorted.sort();
    fs::write(&list, sorted.join("\n") + "\n").map_err(FileError::when("write", &list))?;

    let path = folder.join("database.db");
    let threads = if options.threads == 0 { -1 } else { options.threads as i64 };
    let sizes = rig.stations.iter().map(|station| station.intrinsics().width.max(station.intrinsics().height));
    progress(CloudStep::Features, 0, sorted.len());
    let extraction = Extraction {
        database: path.clone(),
        images: images.clone(),
        list,
        names: sorted,
        camera_params: "1000,1000,500,500".into(),
        threads,
        max_image_size: sizes.max().unwrap_or(1) * options.colmap.enlarge,
        max_features: options.colmap.max_features,
        peak_threshold: options.colmap.peak_threshold,
        edge_threshold: options.colmap.edge_threshold,
    };
    colmap.extract(&extraction, &|done, total| progress(CloudStep::Features, done, total))?;

    let mut database = Database::open(&path)?;
    let rows = database.images()?;
    let shots = assign(&rows, &names)?;
    let enlarged: Vec<Intrinsics> =
        rig.stations.iter().map(|s| enlarge(s.intrinsics(), options.colmap.enlarge)).collect();
    set_cameras(&database, &rows, &shots, &enlarged)?;
    let features = read_features(&database, &rows, &shots, &enlarged)?;
    let feature_count: usize = features.iter().map(Features::count).sum();
    counts.insert("images".into(), rows.len().into());
    counts.insert("features".into(), feature_count.into());
    if feature_count < FEWEST_FEATURES {
        return Err(CloudError::TooFewFeatures { found: feature_count, images: rows.len() });
    }

    let pairs = match_all(rig, &rows, &shots, &features, &enlarged, options, reach, progress);
    counts.insert("matched_pairs".into(), pairs.len().into());
    counts.insert("matches".into(), pairs.iter().map(|pair| pair.matches.len()).sum::<usize>().into());
    database.write_matches(&pairs)?;
    drop((database, pairs, features));

    let (input, output) = (folder.join("input"), folder.join("output"));
    posed_model(rig, &rows, &shots, &enlarged).write_text(&input)?;
    fs::create_dir_all(&output).map_err(FileError::when("make the folder", &output))?;
    progress(CloudStep::Triangulation, 0, 1);
    colmap.triangulate(
        &Triangulation {
            database: path,
            images,
            input,
            output: output.clone(),
            threads,
            max_error_px: options.colmap.max_error_px,
            min_ray_angle_deg: options.colmap.min_ray_angle_deg,
        },
        &|_, _| {},
    )?;
    let model = Model::read(&output)?;
    progress(CloudStep::Triangulation, 1, 1);
    counts.insert("triangulated".into(), model.points.len().into());
    observed(rig, photos, &model, &names, options)
}

fn check(options: &CloudOptions) -> Result<(), CloudError> {
    let wrong = |option, why: String| Err(CloudError::Option { option, why });
    let colmap = &options.colmap;
    if !(1..=8).contains(&colmap.enlarge) {
        return wrong("enlarge", format!("images can be enlarged 1 to 8 times, not {}", colmap.enlarge));
    }
    let matching = &colmap.matching;
    if !(matching.band_px > 0.0 && matching.band_px.is_finite()) {
        return wrong("band_px", format!("{} is no positive width in pixels", matching.band_px));
    }
    if !(matching.ratio > 0.0 && matching.ratio <= 1.0) {
        return wrong("ratio", format!("{} is not in (0, 1]", matching.ratio));
    }
    if !(matching.max_ray_angle_deg > 0.0 && matching.max_ray_angle_deg <= 180.0) {
        return wrong("max_ray_angle_deg", format!("{} is not in (0, 180]", matching.max_ray_angle_deg));
    }
    Ok(())
}

fn enlarge(k: &Intrinsics, factor: u32) -> Intrinsics {
    k.resized(k.width * factor, k.height * factor)
}

/// Writes the images and returns where each was taken, by its name below the folder.
fn write_images(
    rig: &Rig<'_>,
    photos: &[Vec<Photo>],
    factor: u32,
    folder: &Path,
    progress: Progress<'_>,
) -> Result<HashMap<String, Shot>, CloudError> {
    let shots: Vec<(String, Shot)> = rig
        .instants
        .iter()
        .enumerate()
        .flat_map(|(instant, taken)| {
            taken.shots.iter().enumerate().map(move |(position, &(station, _))| {
                // Names of the dataset's cameras may hold anything; these cannot be misread.
                let name = format!("{station:05}/{instant:05}.png");
                (name, Shot { instant, position, station })
            })
        })
        .collect();
    let done = AtomicUsize::new(0);
    progress(CloudStep::Images, 0, shots.len());
    shots.par_iter().try_for_each(|(name, shot)| -> Result<(), CloudError> {
        let image = photos[shot.instant][shot.position].enlarged(factor);
        image
            .write_png(&folder.join(name))
            .map_err(|source| DatasetError::Image { camera: rig.stations[shot.station].camera.name.clone(), source })?;
        progress(CloudStep::Images, done.fetch_add(1, Ordering::Relaxed) + 1, shots.len());
        Ok(())
    })?;
    Ok(shots.into_iter().collect())
}

/// The shot of each row of the database.
fn assign(rows: &[ImageRow], names: &HashMap<String, Shot>) -> Result<Vec<Shot>, CloudError> {
    rows.iter()
        .map(|row| {
            let unknown = || CloudError::ModelMismatch { why: format!("it names an image '{}'", row.name) };
            names.get(&row.name).copied().ok_or_else(unknown)
        })
        .collect()
}

/// Replaces the database's cameras, of which each must belong to one station.
fn set_cameras(
    database: &Database,
    rows: &[ImageRow],
    shots: &[Shot],
    enlarged: &[Intrinsics],
) -> Result<(), CloudError> {
    let mut stations = BTreeMap::new();
    for (row, shot) in rows.iter().zip(shots) {
        if *stations.entry(row.camera).or_insert(shot.station) != shot.station {
            let why = format!("camera {} took the images of two folders", row.camera);
            return Err(CloudError::ModelMismatch { why });
        }
    }
    for (&camera, &station) in &stations {
        database.set_camera(camera, &ColmapCamera::from_intrinsics(&enlarged[station]), true)?;
    }
    Ok(())
}

fn read_features(
    database: &Database,
    rows: &[ImageRow],
    shots: &[Shot],
    enlarged: &[Intrinsics],
) -> Result<Vec<Features>, CloudError> {
    rows.iter()
        .zip(shots)
        .map(|(row, shot)| {
            let k = &enlarged[shot.station];
            let keypoints = database.keypoints(row.image)?;
            Ok(Features::new(k.width, k.height, keypoints.positions, keypoints.descriptors))
        })
        .collect()
}

/// Matches all pairs of images of the same instant; pairs without matches are left out.
#[expect(clippy::too_many_arguments, reason = "one call, from the function above that holds them all")]
fn match_all(
    rig: &Rig<'_>,
    rows: &[ImageRow],
    shots: &[Shot],
    features: &[Features],
    enlarged: &[Intrinsics],
    options: &CloudOptions,
    reach: &Reach,
    progress: Progress<'_>,
) -> Vec<PairMatches> {
    let matching = &options.colmap.matching;
    let limits = Limits {
        band_px: matching.band_px * f64::from(options.colmap.enlarge),
        ratio: matching.ratio,
        max_descriptor_angle: matching.max_descriptor_angle,
        max_ray_angle: matching.max_ray_angle_deg.to_radians(),
        depth_m: reach.depth_m,
    };
    // Rows are ordered by id, so that the first of a pair has the smaller one.
    let pairs: Vec<(usize, usize)> = (0..rows.len())
        .flat_map(|a| (a + 1..rows.len()).map(move |b| (a, b)))
        .filter(|&(a, b)| shots[a].instant == shots[b].instant && shots[a].station != shots[b].station)
        .collect();
    let done = AtomicUsize::new(0);
    pairs
        .par_iter()
        .map(|&(a, b)| {
            let camera = |index: usize| (&enlarged[shots[index].station], rig.stations[shots[index].station].pose());
            let relative = Relative::new(camera(a), camera(b));
            let matches = match_pair(&features[a], camera(a), &features[b], camera(b), &relative, &limits);
            progress(CloudStep::Matching, done.fetch_add(1, Ordering::Relaxed) + 1, pairs.len());
            PairMatches { images: [rows[a].image, rows[b].image], matches, relative }
        })
        .filter(|pair| !pair.matches.is_empty())
        .collect()
}

/// The model without points that triangulation starts from.
fn posed_model(rig: &Rig<'_>, rows: &[ImageRow], shots: &[Shot], enlarged: &[Intrinsics]) -> Model {
    let mut model = Model::default();
    for (row, shot) in rows.iter().zip(shots) {
        model.cameras.insert(row.camera, ColmapCamera::from_intrinsics(&enlarged[shot.station]));
        let pose = *rig.stations[shot.station].pose();
        let image = ColmapImage { pose, camera: row.camera, name: row.name.clone(), points: Vec::new() };
        model.images.insert(row.image, image);
    }
    model
}

/// The model's points with long enough tracks, with colour and error from the views that observe them.
fn observed(
    rig: &Rig<'_>,
    photos: &[Vec<Photo>],
    model: &Model,
    names: &HashMap<String, Shot>,
    options: &CloudOptions,
) -> Result<Vec<CloudPoint>, CloudError> {
    let mismatch = |why: String| CloudError::ModelMismatch { why };
    let scale = f64::from(options.colmap.enlarge);
    let mut points = Vec::new();
    for (id, point) in &model.points {
        if point.track.len() < options.colmap.min_track as usize || !point.position.is_finite() {
            continue;
        }
        let mut colours = Vec::with_capacity(point.track.len());
        let mut error = 0.0;
        let mut t_ns = i64::MAX;
        for observation in &point.track {
            let (image, keypoint) = model
                .images
                .get(&observation.image)
                .and_then(|image| Some((image, image.points.get(observation.point2d as usize)?)))
                .ok_or_else(|| mismatch(format!("point {id} refers to a keypoint that is not there")))?;
            let shot = names.get(&image.name).ok_or_else(|| mismatch(format!("it names an image '{}'", image.name)))?;
            let station = &rig.stations[shot.station];
            let pixel: DVec2 = keypoint.position / scale;
            colours.push(photos[shot.instant][shot.position].colour(pixel));
            let seen = station.intrinsics().project_pinhole(station.pose().transform(point.position));
            error += seen.distance(pixel);
            t_ns = t_ns.min(rig.instants[shot.instant].t_ns);
        }
        points.push(CloudPoint {
            position: point.position,
            colour: median_colour(&colours),
            track: point.track.len() as u32,
            reprojection_error_px: (error / point.track.len() as f64) as f32,
            t_ns,
            instants: 1,
            moving: false,
        });
    }
    Ok(points)
}

#[cfg(test)]
#[path = "pipeline_tests.rs"]
mod tests;
