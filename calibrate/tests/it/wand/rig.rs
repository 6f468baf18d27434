//! Simulated rigs, and how far a calibration is from the truth.

use erfgs_base::random;
use erfgs_calibrate::{
    geometry,
    wand::{Sighting, Stick, WandCamera, WandOptions},
};
use erfgs_scene::rig_file::RigFile;
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};
use glam::{DVec2, DVec3};

/// The wand of all simulations.
pub fn stick() -> Stick {
    Stick::new([0.13, 0.26]).unwrap()
}

/// Options without time offsets: simulated placements are independent of each other.
pub fn options() -> WandOptions {
    WandOptions { time_offsets: false, ..WandOptions::new(stick()) }
}

/// A camera as it is.
#[derive(Clone)]
pub struct Station {
    pub modality: Modality,
    pub intrinsics: Intrinsics,
    pub pose: Pose,
    pub sigma_px: f64,
}

pub fn lens(distortion: Distortion) -> Intrinsics {
    Intrinsics { width: 1280, height: 720, fx: 900.0, fy: 903.0, cx: 644.0, cy: 357.0, distortion }
}

/// A camera at `eye` that looks at `target`.
pub fn station(modality: Modality, eye: DVec3, target: DVec3) -> Station {
    let sigma_px = if modality == Modality::Event { 0.4 } else { 0.2 };
    let distortion = Distortion::BrownConrady([-0.1, 0.05, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]);
    Station { modality, intrinsics: lens(distortion), pose: Pose::look_at(eye, target, DVec3::Y), sigma_px }
}

/// `count` cameras on an arc of `degrees` to either side, 3 m from the origin.
pub fn arc(count: usize, degrees: f64, is_event: impl Fn(usize) -> bool) -> Vec<Station> {
    (0..count)
        .map(|i| {
            let angle = degrees.to_radians() * (2.0 * i as f64 / (count - 1) as f64 - 1.0);
            let eye = DVec3::new(3.0 * angle.sin(), -0.4 + 0.3 * (i % 3) as f64, -3.0 * angle.cos());
            station(if is_event(i) { Modality::Event } else { Modality::Rgb }, eye, DVec3::ZERO)
        })
        .collect()
}

/// The rig of the accuracy study: 8 RGB and 6 event cameras on an arc of 69 degrees to either side.
pub fn mixed() -> Vec<Station> {
    arc(14, 69.0, |i| i % 2 == 1 && i < 13)
}

pub fn vector(seed: u64, words: &[u64], scale: f64) -> DVec3 {
    let key = random::key(seed, words);
    let part = |axis| scale * random::normal(random::extend(key, axis));
    DVec3::new(part(0), part(1), part(2))
}

/// Middles and directions of wands at random, in a box of 2.4 m by 1.6 m by 2.4 m in the middle of the rig.
pub fn wands(count: usize, seed: u64) -> Vec<(DVec3, DVec3)> {
    let half = DVec3::new(1.2, 0.8, 1.2);
    let uniform = |i, axis| random::range(random::key(seed, &[1, i, axis]), -1.0, 1.0);
    let middle = |i| DVec3::new(uniform(i, 0), uniform(i, 1), uniform(i, 2)) * half;
    (0..count as u64).map(|i| (middle(i), vector(seed, &[2, i], 1.0).normalize())).collect()
}

/// What the cameras see of the wands, each 10 s after the last, where `sees(camera, wand)`.
pub fn observe(
    stations: &[Station],
    wands: &[(DVec3, DVec3)],
    seed: u64,
    sees: impl Fn(usize, usize) -> bool,
) -> Vec<WandCamera> {
    let camera = |(index, station): (usize, &Station)| {
        let sightings =
            wands.iter().enumerate().filter(|(wand, _)| sees(index, *wand)).map(|(wand, &(middle, along))| {
                let mut leds = stick().offsets_m().map(|offset| {
                    let seen = station.intrinsics.project(station.pose.transform(middle + along * offset))?;
                    let inside = seen.cmpge(DVec2::ZERO).all()
                        && seen.x <= f64::from(station.intrinsics.width)
                        && seen.y <= f64::from(station.intrinsics.height);
                    inside.then_some(seen)
                });
                for (led, pixel) in leds.iter_mut().enumerate() {
                    if let Some(pixel) = pixel {
                        *pixel +=
                            vector(seed, &[3, index as u64, wand as u64, led as u64], station.sigma_px).truncate();
                    }
                }
                Sighting { t_ns: wand as i64 * 10_000_000_000, leds }
            });
        WandCamera {
            name: format!("{}{index}", if station.modality == Modality::Event { "event" } else { "rgb" }),
            modality: station.modality,
            intrinsics: station.intrinsics,
            sigma_px: Some(station.sigma_px),
            sightings: sightings.collect(),
        }
    };
    stations.iter().enumerate().map(camera).collect()
}

/// Makes the focal lengths wrong by about `share`.
pub fn spoil_focal(cameras: &mut [WandCamera], share: f64, seed: u64) {
    for (index, camera) in cameras.iter_mut().enumerate() {
        let factor = 1.0 + share * random::normal(random::key(seed, &[4, index as u64]));
        camera.intrinsics.fx *= factor;
        camera.intrinsics.fy *= factor;
    }
}

/// Centres as they are in the space of the first camera.
pub fn true_centres(stations: &[Station]) -> Vec<DVec3> {
    stations.iter().map(|station| stations[0].pose.transform(station.pose.centre())).collect()
}

/// How far the centres are from the truth after the best alignment with or without a change of scale, metres.
pub fn centre_errors(rig: &RigFile, stations: &[Station], scaled: bool) -> Vec<f64> {
    let centres = rig.cameras.iter().map(|camera| camera.pose.unwrap().centre());
    let pairs: Vec<_> = centres.zip(stations).map(|(found, station)| (found, station.pose.centre(), 1.0)).collect();
    let motion = if scaled {
        geometry::similarity(&pairs)
    } else {
        geometry::rigid(&pairs).map(|pose| geometry::Similarity { scale: 1.0, pose })
    };
    match motion {
        Some(motion) => pairs.iter().map(|(found, known, _)| (motion.transform(*found) - *known).length()).collect(),
        // Two cameras, or all on one line: compared in the space of the first.
        None => {
            pairs.iter().zip(true_centres(stations)).map(|((found, _, _), known)| (*found - known).length()).collect()
        }
    }
}

/// Greatest angle between the turns from one camera to the next and the true ones, degrees.
pub fn rotation_error_deg(rig: &RigFile, stations: &[Station]) -> f64 {
    let first = rig.cameras[0].pose.unwrap().rotation;
    let errors = rig.cameras.iter().zip(stations).map(|(camera, station)| {
        let found = camera.pose.unwrap().rotation * first.conjugate();
        let known = station.pose.rotation * stations[0].pose.rotation.conjugate();
        (found * known.conjugate()).to_scaled_axis().length().to_degrees()
    });
    errors.fold(0.0, f64::max)
}

/// Error over predicted standard deviation, squared: of each camera's centre coordinates (all but the first camera's), and
/// of each focal length.
pub fn normalised_squares(rig: &RigFile, stations: &[Station]) -> (Vec<f64>, Vec<f64>) {
    let (mut centres, mut focals) = (Vec::new(), Vec::new());
    for (index, (camera, known)) in rig.cameras.iter().zip(true_centres(stations)).enumerate() {
        let sigma = camera.sigma.as_ref().unwrap();
        let error = camera.pose.unwrap().centre() - known;
        if index > 0 {
            centres.extend((0..3).map(|axis| (error[axis] / sigma.centre_m[axis].unwrap()).powi(2)));
        }
        if let Some(Some(sigma)) = sigma.intrinsics.get("fx") {
            focals.push(((camera.intrinsics.fx - stations[index].intrinsics.fx) / sigma).powi(2));
        }
    }
    (centres, focals)
}
