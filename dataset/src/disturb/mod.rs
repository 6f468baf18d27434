//! Datasets that are wrong by a known amount: what calibration, clocks and sensors get wrong on a rig, put into a dataset
//! whose truth is known, so that it can be measured what each error costs.
//!
//! Only training cameras are touched: held-out ones stay the truth that a reconstruction is measured against. Each camera
//! draws its own errors from the seed, its name and the kind of error, so that a larger error of one kind is the same error
//! at a larger scale, whatever other cameras there are.

mod sensor;

use std::path::Path;

use erfgs_base::{
    progress::{Progress, in_parallel},
    random,
};
use erfgs_events::npz;
use glam::{DQuat, DVec3};
use serde::Serialize;

use crate::{Camera, Dataset, DatasetError, Split, VariantStep};

/// What is wrong, and by how much; nothing by default.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Disturbance {
    /// Event cameras' clocks are late by this much, all alike, seconds.
    pub event_clock_s: f64,
    /// Frames' times are off by a shift of each camera's own with this standard deviation, seconds.
    pub frame_clock_s: f64,
    /// Cameras stand elsewhere: standard deviation along each axis, metres.
    pub place_m: f64,
    /// Cameras look elsewhere: standard deviation about each axis, degrees.
    pub direction_deg: f64,
    /// Focal lengths are off by a factor of 1 and a normal number with this standard deviation.
    pub focal: f64,
    /// The contrast thresholds that are stated are this factor less one of the true ones, all alike.
    pub threshold: f64,
    /// What an ON event changes beside an OFF event is stated to be this factor less one of what it is: the one threshold is stated
    /// higher, the other lower, by the root of it.
    pub balance: f64,
    /// Events of noise, of either polarity, of each pixel in a second.
    pub noise_hz: f64,
    /// The share of the packets of events that are lost, 0 to 1. A packet holds [`Disturbance::PACKET`] events.
    pub lost: f64,
    /// The training cameras that are kept; all of them without it.
    pub cameras: Option<Vec<String>>,
    /// Seed of everything random.
    pub seed: u64,
}

impl Disturbance {
    /// Events of a packet.
    pub const PACKET: usize = 1024;

    fn check(&self, dataset: &Dataset) -> Result<(), DatasetError> {
        let within = |option, value: f64, limits: [f64; 2], allowed| {
            let ok = (limits[0]..=limits[1]).contains(&value);
            if ok { Ok(()) } else { Err(DatasetError::Disturbance { option, value: value.to_string(), allowed }) }
        };
        within("the lateness of event cameras, seconds,", self.event_clock_s, [-3600.0, 3600.0], "-3600 to 3600")?;
        within("the spread of frames' times, seconds,", self.frame_clock_s, [0.0, 3600.0], "0 to 3600")?;
        within("the spread of places, metres,", self.place_m, [0.0, 1e4], "0 to 10000")?;
        within("the spread of directions, degrees,", self.direction_deg, [0.0, 60.0], "0 to 60")?;
        within("the spread of focal lengths", self.focal, [0.0, 0.2], "0 to 0.2")?;
        within("the error of thresholds", self.threshold, [-0.95, 100.0], "-0.95 to 100")?;
        within("the error of the balance of thresholds", self.balance, [-0.95, 100.0], "-0.95 to 100")?;
        within("the rate of noise, hertz,", self.noise_hz, [0.0, 1e4], "0 to 10000")?;
        within("the share of lost packets", self.lost, [0.0, 1.0], "0 to 1")?;
        let training: Vec<&str> = dataset.cameras(Split::Train).map(|camera| camera.name.as_str()).collect();
        let unknown = self.cameras.iter().flatten().find(|name| !training.contains(&name.as_str()));
        let wrong = |value: &str| DatasetError::Disturbance {
            option: "the list of training cameras to keep",
            value: value.to_owned(),
            allowed: "names of training cameras of the dataset, at least one",
        };
        match (unknown, &self.cameras) {
            (Some(name), _) => Err(wrong(name)),
            (None, Some(names)) if names.is_empty() => Err(wrong("empty")),
            _ => Ok(()),
        }
    }

    fn keeps(&self, camera: &Camera) -> bool {
        let named = self.cameras.as_ref().is_none_or(|names| names.contains(&camera.name));
        camera.split == Split::Test || named
    }

    /// Whether points made before would know better than the cameras do.
    fn moves_frames(&self) -> bool {
        [self.place_m, self.direction_deg, self.focal].iter().any(|size| *size > 0.0) || self.cameras.is_some()
    }

    fn changes_events(&self) -> bool {
        self.event_clock_s != 0.0 || self.noise_hz > 0.0 || self.lost > 0.0
    }

    /// Normal numbers of a camera, for one kind of error.
    fn drawn(&self, camera: &str, kind: &str) -> impl Fn(u64) -> f64 {
        let key = random::key(self.seed, &[random::purpose(kind), random::purpose(camera)]);
        move |index| random::normal(random::extend(key, index))
    }

    fn apply(&self, camera: &mut Camera) {
        let name = camera.name.clone();
        let three = |kind| {
            let normal = self.drawn(&name, kind);
            DVec3::new(normal(0), normal(1), normal(2))
        };
        // What is not wrong stays as it is, to the last digit.
        if self.place_m > 0.0 || self.direction_deg > 0.0 {
            let pose = &mut camera.world_to_camera;
            let centre = pose.centre() + self.place_m * three("disturbed place");
            let turn = self.direction_deg.to_radians() * three("disturbed direction");
            pose.rotation = (DQuat::from_scaled_axis(turn) * pose.rotation).normalize();
            pose.translation = -(pose.rotation * centre);
            camera.pose_sigma = camera.pose_sigma.map(|sigma| sigma.with(self.place_m, self.direction_deg));
        }
        let focal = 1.0 + self.focal * self.drawn(&name, "disturbed focal length")(0);
        camera.intrinsics.fx *= focal;
        camera.intrinsics.fy *= focal;
        camera.clock_sigma_s = camera.clock_sigma_s.map(|sigma| sigma.hypot(self.frame_clock_s));
        let late = (1e9 * self.frame_clock_s * self.drawn(&name, "disturbed clock")(0)).round() as i64;
        for frame in &mut camera.frames {
            frame.t_ns += late;
            frame.exposure_ns = frame.exposure_ns.map(|t| t + late);
        }
        if let Some(events) = &mut camera.events {
            let more = (1.0 + self.balance).sqrt();
            events.threshold_on *= (1.0 + self.threshold) * more;
            events.threshold_off *= (1.0 + self.threshold) / more;
            events.covers_ns = events.covers_ns.map(|t| t + 1000 * self.event_clock_us());
        }
    }

    fn event_clock_us(&self) -> i64 {
        (1e6 * self.event_clock_s).round() as i64
    }
}

/// Makes a dataset that is wrong as `disturbance` says, in the new folder `out`; the step is recorded in
/// [`crate::Manifest::variant`] as `disturb`. The initial points are left out where they were made by cameras that have
/// moved since.
///
/// # Errors
/// If the disturbance is out of range, a file cannot be read or written, or `out` is not empty.
pub fn disturb(
    dataset: &Dataset,
    disturbance: &Disturbance,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Dataset, DatasetError> {
    disturbance.check(dataset)?;
    let folder = DatasetError::new_folder(out)?;
    let mut new = Dataset::new(folder.path(), dataset.manifest.clone());
    new.manifest.cameras.retain(|camera| disturbance.keeps(camera));
    for camera in new.manifest.cameras.iter_mut().filter(|camera| camera.split == Split::Train) {
        disturbance.apply(camera);
    }
    if disturbance.moves_frames() {
        new.manifest.points = None;
    }
    // Paths of bodies follow from frames, events, clocks and poses alike.
    new.manifest.bodies = None;
    // Frames that were shifted over an end of the recording take it with them.
    let times = new.manifest.cameras.iter().flat_map(|camera| camera.frames.iter().map(|frame| frame.t_ns));
    let [first, last] = new.manifest.span_ns;
    new.manifest.span_ns = times.fold([first, last], |[first, last], t| [first.min(t), last.max(t)]);

    let files: Vec<_> = new.files().into_iter().collect();
    let of_events: Vec<Option<&Camera>> = files
        .iter()
        .map(|file| {
            let holds = |camera: &&Camera| camera.events.as_ref().is_some_and(|events| events.file == *file);
            dataset.cameras(Split::Train).find(holds)
        })
        .collect();
    let tasks: Vec<_> = files.iter().zip(of_events).collect();
    let work = |(file, camera): &(&std::path::PathBuf, Option<&Camera>), tick: &dyn Fn()| {
        let to = folder.path().join(file);
        let count = match camera {
            Some(camera) if disturbance.changes_events() => Some(sensor::write(dataset, camera, disturbance, &to)?),
            _ => dataset.copy_file(file, &to).map(|()| None)?,
        };
        tick();
        Ok::<_, DatasetError>(count)
    };
    let counts = in_parallel(None, &tasks, ("files", tasks.len() as u64), work, progress)?;
    for (file, count) in files.iter().zip(counts) {
        let mut events = new.manifest.cameras.iter_mut().filter_map(|camera| camera.events.as_mut());
        if let (Some(count), Some(events)) = (count, events.find(|events| events.file == *file)) {
            events.count = count;
        }
    }
    let parameters = serde_json::to_value(disturbance).ok().and_then(|value| value.as_object().cloned());
    let parameters = parameters.into_iter().flatten().collect();
    new.manifest.variant.push(VariantStep { step: "disturb".to_owned(), parameters });
    new.complete(folder, out)
}

#[cfg(test)]
mod tests;
