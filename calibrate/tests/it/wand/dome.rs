//! A wand that somebody waves on the floor of the Panoptic Studio's dome, as its cameras and four event cameras see it.

use std::path::Path;

use erfgs_base::random;
use erfgs_calibrate::{
    geometry::{Similarity, angle, rigid},
    wand::{Sighting, Stick, WandCamera},
};
use erfgs_dataset::import::{ImportOptions, Layout, import};
use erfgs_scene::rig_file::RigFile;
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};
use glam::{DVec2, DVec3};

/// Standard deviations of a LED's place in frames and in events, pixels.
const SIGMA_PX: [f64; 2] = [0.2, 0.4];
/// Images and event windows per second.
const RATES: [f64; 2] = [30.0, 100.0];
/// What event cameras' stamps are late by, seconds; frames are of one clock.
pub const LATE_S: [f64; 4] = [0.0031, -0.0024, 0.0017, -0.0042];
/// Radius and height of who waves, metres.
const BODY_M: [f64; 2] = [0.2, 1.75];

/// A camera of the dome as it is.
#[derive(Clone, Debug)]
pub struct Eye {
    pub name: String,
    pub modality: Modality,
    pub intrinsics: Intrinsics,
    pub pose: Pose,
}

/// Where the Panoptic basketball scene lies among the shared recordings.
pub const PANOPTIC: &str = "data/panoptic_basketball";

/// The cameras of the Panoptic basketball scene, four of them as event cameras.
pub fn panoptic(source: &Path) -> Vec<Eye> {
    let folder = tempfile::tempdir().unwrap();
    let options = ImportOptions { frames: Some((40, 40)), ..ImportOptions::default() };
    let dataset = import(Layout::Panoptic, source, &options, &folder.path().join("ds"), &mut |_| {}).unwrap().dataset;
    let cameras = &dataset.manifest.cameras;
    let every = cameras.len() / 4;
    let eye = |(index, camera): (usize, &erfgs_dataset::Camera)| Eye {
        name: camera.name.clone(),
        modality: if index % every == every / 2 && index / every < 4 { Modality::Event } else { Modality::Rgb },
        intrinsics: camera.intrinsics,
        pose: camera.world_to_camera,
    };
    cameras.iter().enumerate().map(eye).collect()
}

/// `frames` frame cameras around the same floor, with `events` event cameras between them.
pub fn ring(frames: usize, events: usize) -> Vec<Eye> {
    let count = frames + events;
    let every = count / events;
    let eye = |index: usize| {
        let (turn, height) = (std::f64::consts::TAU * index as f64 / count as f64, 0.8 + 0.7 * (index % 3) as f64);
        let from = DVec3::new(2.6 * turn.cos(), -height, 2.6 * turn.sin());
        Eye {
            name: format!("cam{index:02}"),
            modality: if index % every == every / 2 { Modality::Event } else { Modality::Rgb },
            intrinsics: Intrinsics {
                width: 640,
                height: 360,
                fx: 465.0,
                fy: 464.0,
                cx: 317.0,
                cy: 186.0,
                distortion: Distortion::None,
            },
            pose: Pose::look_at(from, DVec3::new(0.0, -1.0, 0.0), DVec3::Y),
        }
    };
    (0..count).map(eye).collect()
}

/// Where who waves stands, and where the wand is and points, at a time in seconds: y points down, the floor is y = 0.
fn waved(t: f64, seed: u64) -> [DVec3; 3] {
    let phase = |index: u64| random::range(random::key(seed, &[1, index]), 0.0, std::f64::consts::TAU);
    let swing = |index: u64, rate: f64| (rate * t + phase(index)).sin();
    let body = DVec3::new(0.9 * swing(0, 0.23), 0.0, 0.9 * swing(1, 0.31));
    let heading = 0.6 * t + phase(2) + swing(3, 0.9);
    let middle = body + DVec3::new(0.6 * heading.cos(), -1.1 - 0.75 * swing(4, 1.3), 0.6 * heading.sin());
    let along = DVec3::new(swing(5, 0.9), swing(6, 1.4), swing(7, 0.7)) + 1e-3 * DVec3::Y;
    [body, middle, along.normalize()]
}

/// Whether a body (an upright cylinder) is between the eye and a point.
fn hidden(eye: DVec3, point: DVec3, body: DVec3) -> bool {
    let (from, way) = (DVec2::new(eye.x - body.x, eye.z - body.z), DVec2::new(point.x - eye.x, point.z - eye.z));
    let share = (-from.dot(way) / way.length_squared()).clamp(0.0, 1.0);
    let height = -(eye.y + (point.y - eye.y) * share);
    (from + way * share).length() < BODY_M[0] && height < BODY_M[1]
}

/// What the cameras see of a wand that is waved for so many seconds.
pub fn observe(eyes: &[Eye], stick: &Stick, seconds: f64, seed: u64) -> Vec<WandCamera> {
    let mut events = 0;
    let camera = |(index, eye): (usize, &Eye)| {
        let event = usize::from(eye.modality == Modality::Event);
        let late = if event == 1 {
            events += 1;
            LATE_S[(events - 1) % LATE_S.len()]
        } else {
            0.0
        };
        let sighting = |step: u64| {
            let t = (step as f64 + 0.3 * event as f64) / RATES[event];
            let [body, middle, along] = waved(t, seed);
            let offsets = stick.offsets_m();
            let leds = std::array::from_fn(|led| {
                let point = middle + along * offsets[led];
                let key = random::key(seed, &[2, index as u64, step, led as u64]);
                let noise = DVec2::new(random::normal(key), random::normal(random::extend(key, 1)));
                let seen = eye.intrinsics.project(eye.pose.transform(point))? + noise * SIGMA_PX[event];
                let size = DVec2::new(f64::from(eye.intrinsics.width), f64::from(eye.intrinsics.height));
                let inside = seen.cmpge(DVec2::ZERO).all() && seen.cmple(size).all();
                (inside && !hidden(eye.pose.centre(), point, body)).then_some(seen)
            });
            Sighting { t_ns: ((t + late) * 1e9).round() as i64, leds }
        };
        WandCamera {
            name: eye.name.clone(),
            modality: eye.modality,
            intrinsics: eye.intrinsics,
            sigma_px: Some(SIGMA_PX[event]),
            sightings: (0..(seconds * RATES[event]) as u64).map(sighting).collect(),
        }
    };
    eyes.iter().enumerate().map(camera).collect()
}

/// How far a rig's cameras are from where they are, after a rigid motion that its frame cameras alone choose: name, modality,
/// millimetres, degrees.
pub fn errors(found: &RigFile, eyes: &[Eye]) -> Vec<(String, Modality, f64, f64)> {
    let both: Vec<(&Eye, Pose)> = eyes.iter().filter_map(|eye| Some((eye, found.camera(&eye.name)?.pose?))).collect();
    let frames = both.iter().filter(|(eye, _)| eye.modality == Modality::Rgb);
    let pairs: Vec<_> = frames.map(|(eye, pose)| (pose.centre(), eye.pose.centre(), 1.0)).collect();
    let over = Similarity { scale: 1.0, pose: rigid(&pairs).unwrap_or(Pose::IDENTITY) };
    let error = |(eye, pose): &(&Eye, Pose)| {
        let pose = over.of_camera(pose);
        let turn = angle(pose.rotation, eye.pose.rotation);
        (eye.name.clone(), eye.modality, 1e3 * pose.centre().distance(eye.pose.centre()), turn.to_degrees())
    };
    both.iter().map(error).collect()
}
