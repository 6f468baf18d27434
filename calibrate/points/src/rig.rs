//! The training cameras and the instants that the cloud is made from.

use std::collections::HashSet;

use erfgs_dataset::{Camera, Dataset, Frame, Split};
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::{CloudError, FrameChoice, photo::Photo};
use erfgs_calibrate::statistics::median;

/// Frames count as simultaneous when their labels differ by at most this.
const SIMULTANEOUS_NS: i64 = 2_000_000;
/// Fewer views cannot tell a right point from a wrong one.
const FEWEST_VIEWS: usize = 3;

/// A training camera that was checked: finite pose, sensible pinhole intrinsics.
#[derive(Clone, Debug)]
pub struct Station<'a> {
    /// Its entry in the manifest.
    pub camera: &'a Camera,
    /// Where it stands, metres.
    pub centre: DVec3,
}

impl Station<'_> {
    /// Intrinsics of the dataset's images.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.camera.intrinsics
    }

    /// World to camera.
    pub fn pose(&self) -> &Pose {
        &self.camera.world_to_camera
    }

    /// The viewing direction in the world.
    pub fn forward(&self) -> DVec3 {
        self.pose().rotation.conjugate() * DVec3::Z
    }

    /// Where a world point is seen, and at which depth (metres); none behind the camera or outside the image.
    pub fn see(&self, point: DVec3) -> Option<(DVec2, f64)> {
        let seen = self.pose().transform(point);
        if seen.z <= 1e-9 {
            return None;
        }
        let k = self.intrinsics();
        let pixel = k.project_pinhole(seen);
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < f64::from(k.width) && pixel.y < f64::from(k.height);
        inside.then_some((pixel, seen.z))
    }
}

/// A time, and the frames that the stations took then.
#[derive(Clone, Debug)]
pub struct Instant<'a> {
    /// When it was, nanoseconds on the session clock: the earliest label of frames of one pulse, the median label of others.
    pub t_ns: i64,
    /// Index of the station, and its frame; ordered by station.
    pub shots: Vec<(usize, &'a Frame)>,
}

/// The training cameras with frames, and the instants chosen.
#[derive(Clone, Debug)]
pub struct Rig<'a> {
    /// What the cameras and frames belong to.
    pub dataset: &'a Dataset,
    /// The training cameras that have frames.
    pub stations: Vec<Station<'a>>,
    /// The instants, ordered by time.
    pub instants: Vec<Instant<'a>>,
}

impl<'a> Rig<'a> {
    /// Checks the training cameras of `dataset` that have frames, and picks instants.
    pub fn new(dataset: &'a Dataset, frames: &FrameChoice) -> Result<Self, CloudError> {
        let cameras: Vec<_> = dataset
            .cameras(Split::Train)
            .filter(|camera| camera.modality.has_frames() && !camera.frames.is_empty())
            .collect();
        if cameras.len() < FEWEST_VIEWS {
            return Err(CloudError::TooFewCameras { found: cameras.len() });
        }
        let stations = cameras.into_iter().map(station).collect::<Result<Vec<_>, _>>()?;
        check_baseline(&stations)?;
        let instants = choose(all_instants(&stations), frames)?;
        Ok(Self { dataset, stations, instants })
    }

    /// Reads the images of an instant, in the order of its shots.
    pub fn photos(&self, instant: usize) -> Result<Vec<Photo>, CloudError> {
        let shots = &self.instants[instant].shots;
        shots.par_iter().map(|&(station, frame)| self.photo(station, frame)).collect()
    }

    /// Reads an image.
    pub fn photo(&self, station: usize, frame: &Frame) -> Result<Photo, CloudError> {
        let image = self.dataset.read_image(self.stations[station].camera, frame)?;
        Ok(Photo::new(image))
    }
}

/// Checks a camera: a finite pose, an undistorted image with pixels.
pub fn station(camera: &Camera) -> Result<Station<'_>, CloudError> {
    let wrong = |why: &str| CloudError::DegenerateCamera { camera: camera.name.clone(), why: why.into() };
    let pose = &camera.world_to_camera;
    if !pose.is_finite() {
        return Err(wrong("its pose holds a number that is not finite"));
    }
    if (pose.rotation.length() - 1.0).abs() > 1e-6 {
        return Err(wrong("its rotation is not a unit quaternion"));
    }
    let k = &camera.intrinsics;
    if ![k.fx, k.fy, k.cx, k.cy].iter().all(|number| number.is_finite()) || k.fx <= 0.0 || k.fy <= 0.0 {
        return Err(wrong("its focal length is not a positive number, or its principal point is not finite"));
    }
    if k.width == 0 || k.height == 0 {
        return Err(wrong("its images have no pixels"));
    }
    if k.distortion != Distortion::None {
        return Err(wrong("its images are distorted, and the initial cloud needs undistorted ones"));
    }
    Ok(Station { camera, centre: pose.centre() })
}

/// Refuses cameras that all stand at one place.
fn check_baseline(stations: &[Station<'_>]) -> Result<(), CloudError> {
    let first = stations[0].centre;
    let spread_m = stations.iter().map(|station| station.centre.distance(first)).fold(0.0, f64::max);
    let size = stations.iter().map(|station| station.centre.length()).fold(0.0, f64::max);
    if spread_m <= 1e-9 * size.max(1e-3) {
        return Err(CloudError::NoBaseline { cameras: stations.len(), spread_m });
    }
    Ok(())
}

/// All times at which enough stations have a frame. Where cameras run freely, so that no two thirds of them ever have one at the same time,
/// the frames that are nearest to one another in time count as simultaneous: what stands still is the same in them, and what moves is
/// where it is to half an interval.
pub fn all_instants<'a>(stations: &[Station<'a>]) -> Vec<Instant<'a>> {
    let together = simultaneous(stations);
    let most = together.iter().map(|instant| instant.shots.len()).max().unwrap_or(0);
    if 3 * most >= 2 * stations.len() { together } else { nearest(stations) }
}

/// For each frame of the station that has the most, the frames of others that were taken less than half an interval from it.
fn nearest<'a>(stations: &[Station<'a>]) -> Vec<Instant<'a>> {
    let Some(lead) = stations.iter().rev().max_by_key(|station| station.camera.frames.len()) else { return Vec::new() };
    let times: Vec<i64> = lead.camera.frames.iter().map(|frame| frame.t_ns).collect();
    let steps = times.windows(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64);
    let half = median(steps).map_or(SIMULTANEOUS_NS.unsigned_abs(), |step| (0.5 * step) as u64);
    let at = |t_ns: i64| {
        let away = |frame: &&Frame| frame.t_ns.abs_diff(t_ns);
        let shot = |(index, station): (usize, &Station<'a>)| {
            // Frames are ordered by time: the last before it, or the first that is not.
            let frames = &station.camera.frames;
            let next = frames.partition_point(|frame| frame.t_ns < t_ns);
            let frame = frames[next.saturating_sub(1)..].iter().take(2).min_by_key(away)?;
            (away(&frame) <= half).then_some((index, frame))
        };
        let shots: Vec<(usize, &Frame)> = stations.iter().enumerate().filter_map(shot).collect();
        let mut labels: Vec<i64> = shots.iter().map(|(_, frame)| frame.t_ns).collect();
        labels.sort_unstable();
        (shots.len() >= FEWEST_VIEWS).then(|| Instant { t_ns: labels[labels.len() / 2], shots })
    };
    times.into_iter().filter_map(at).collect()
}

/// All times at which enough stations have a frame with the same label, or nearly so.
fn simultaneous<'a>(stations: &[Station<'a>]) -> Vec<Instant<'a>> {
    let mut all: Vec<(i64, usize, &Frame)> = stations
        .iter()
        .enumerate()
        .flat_map(|(index, station)| station.camera.frames.iter().map(move |frame| (frame.t_ns, index, frame)))
        .collect();
    all.sort_by_key(|&(t_ns, station, _)| (t_ns, station));
    let mut found: Vec<Instant<'_>> = Vec::new();
    let mut present = HashSet::new();
    for (t_ns, station, frame) in all {
        match found.last_mut() {
            Some(last) if t_ns.saturating_sub(last.t_ns) <= SIMULTANEOUS_NS && present.insert(station) => {
                last.shots.push((station, frame));
            }
            _ => {
                present = HashSet::from([station]);
                found.push(Instant { t_ns, shots: vec![(station, frame)] });
            }
        }
    }
    found.retain(|instant| instant.shots.len() >= FEWEST_VIEWS);
    for instant in &mut found {
        instant.shots.sort_by_key(|&(station, _)| station);
    }
    found
}

fn choose<'a>(all: Vec<Instant<'a>>, frames: &FrameChoice) -> Result<Vec<Instant<'a>>, CloudError> {
    if all.is_empty() {
        return Err(CloudError::NoCommonInstant { tolerance_ns: SIMULTANEOUS_NS });
    }
    let chosen: Vec<usize> = match frames {
        FrameChoice::Spread(0) => {
            return Err(CloudError::Option { option: "frames", why: "at least one frame is needed".into() });
        }
        FrameChoice::Spread(count) => spread(all.len(), *count),
        FrameChoice::Named(names) => {
            let mut chosen = Vec::new();
            for name in names {
                let has = |instant: &Instant<'_>| {
                    instant
                        .shots
                        .iter()
                        .any(|(_, frame)| frame.file.file_stem().is_some_and(|stem| stem == name.as_str()))
                };
                chosen.push(all.iter().position(has).ok_or_else(|| CloudError::UnknownFrame { name: name.clone() })?);
            }
            chosen
        }
    };
    let chosen: HashSet<usize> = chosen.into_iter().collect();
    let picked: Vec<_> =
        all.into_iter().enumerate().filter(|(index, _)| chosen.contains(index)).map(|(_, instant)| instant).collect();
    if picked.is_empty() {
        return Err(CloudError::Option { option: "frames", why: "no frame is named".into() });
    }
    Ok(picked)
}

/// `count` of `all` indices, spread evenly with both ends; the middle one if it is one.
pub fn spread(all: usize, count: usize) -> Vec<usize> {
    match count {
        0 => Vec::new(),
        1 => vec![all / 2],
        _ if count >= all => (0..all).collect(),
        _ => (0..count).map(|index| (index * (all - 1) + (count - 1) / 2) / (count - 1)).collect(),
    }
}

/// How far from the cameras the scene lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach {
    /// `[nearest, farthest]` depth of a point, metres.
    pub depth_m: [f64; 2],
    /// Depth that the cameras look at, metres.
    pub focus_m: f64,
}

/// Depths from the options, or from the box that the scene lies in, or from how the cameras stand.
///
/// Cameras around a scene look at its middle: the point nearest to all optical axes, at a distance of r. What they see
/// lies between them and a little behind the opposite cameras: 0.1 r to 2.5 r. Cameras that stand side by side may see
/// much further; their range ends at 20 r.
pub fn reach(
    stations: &[Station<'_>],
    depth_m: Option<[f64; 2]>,
    bounds: Option<[DVec3; 2]>,
) -> Result<Reach, CloudError> {
    let (focus_m, surrounded) = focus(stations);
    let depth_m = match (depth_m, bounds) {
        (Some(given), _) => given,
        (None, Some(corners)) => depths_of_box(stations, corners, focus_m),
        (None, None) => [0.1 * focus_m, if surrounded { 2.5 } else { 20.0 } * focus_m],
    };
    if !(depth_m[0] > 0.0 && depth_m[1] > depth_m[0] && depth_m[1].is_finite()) {
        let why = format!("{depth_m:?} m is no range of positive depths");
        return Err(CloudError::Option { option: "depth_m", why });
    }
    Ok(Reach { depth_m, focus_m: focus_m.clamp(depth_m[0], depth_m[1]) })
}

/// Distance at which the cameras look at the same point, and whether they stand around it.
fn focus(stations: &[Station<'_>]) -> (f64, bool) {
    let spread = stations.iter().map(|s| s.centre.distance(stations[0].centre)).fold(0.0, f64::max);
    let axes: Vec<DVec3> = stations.iter().map(Station::forward).collect();
    let widest = axes.iter().flat_map(|a| axes.iter().map(move |b| a.dot(*b))).fold(1.0, f64::min);
    // The point nearest to all axes: sum (I - d d') x = sum (I - d d') c.
    let mut normal = DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for (station, d) in stations.iter().zip(&axes) {
        let across = DMat3::IDENTITY - DMat3::from_cols(*d * d.x, *d * d.y, *d * d.z);
        normal += across;
        right += across * station.centre;
    }
    let fallback = 5.0 * spread;
    let conditioned = normal.determinant().abs() > 1e-4 * (stations.len() as f64).powi(3);
    if !conditioned {
        return (fallback, false);
    }
    let target = normal.inverse() * right;
    match median(stations.iter().map(|station| station.pose().transform(target).z)) {
        Some(depth) if depth.is_finite() && depth > 0.05 * spread => (depth, widest < 0.0),
        _ => (fallback, false),
    }
}

/// The depths at which a box is seen.
fn depths_of_box(stations: &[Station<'_>], corners: [DVec3; 2], focus_m: f64) -> [f64; 2] {
    let depths = stations.iter().flat_map(|station| {
        (0..8).map(move |corner: usize| {
            let pick = |axis: usize| corners[(corner >> axis) & 1][axis];
            station.pose().transform(DVec3::new(pick(0), pick(1), pick(2))).z
        })
    });
    let (low, high) = depths.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), z| (a.min(z), b.max(z)));
    [low.max(0.05 * focus_m), high]
}

#[cfg(test)]
#[path = "rig_tests.rs"]
mod tests;
