//! Clocks: cameras that run free, and stamps that are late.

use erfgs_calibrate::wand::{Sighting, WandOptions, calibrate};
use glam::DVec3;

use crate::wand::rig;

/// A wand that somebody waves: where it is and where it points at a time in seconds.
fn waved(t: f64) -> (DVec3, DVec3) {
    let middle = DVec3::new(0.9 * (1.3 * t).sin(), 0.6 * (1.7 * t + 1.0).sin(), 0.9 * (1.1 * t + 2.0).sin());
    let along = DVec3::new((0.9 * t).sin(), (1.4 * t + 0.5).cos(), (0.7 * t).cos());
    (middle, along.normalize())
}

#[test]
fn late_stamps_of_free_running_cameras_are_found() {
    let stations = rig::arc(4, 60.0, |i| i == 3);
    // Start and period in ms, and how much later a camera's stamps are than the instants they stand for.
    let clocks = [(0.0, 10.0, 0.0), (3.0, 10.0, 0.004), (1.0, 8.0, -0.0025), (0.0, 2.5, 0.001)];
    let mut cameras = rig::observe(&stations, &[], 6, |_, _| true);
    for (index, (camera, (start, period, late_s))) in cameras.iter_mut().zip(clocks).enumerate() {
        let count = (20_000.0 / period) as usize;
        let times: Vec<f64> = (0..count).map(|i| 1e-3 * (start + period * i as f64)).collect();
        let wands: Vec<_> = times.iter().map(|t| waved(*t)).collect();
        let seen = rig::observe(&stations[index..=index], &wands, 60 + index as u64, |_, _| true).remove(0);
        camera.sightings = seen
            .sightings
            .iter()
            .map(|s| {
                let t = times[(s.t_ns / 10_000_000_000) as usize] + late_s;
                Sighting { t_ns: (t * 1e9).round() as i64, leds: s.leds }
            })
            .collect();
    }
    let options = WandOptions { most: 400, ..WandOptions::new(rig::stick()) };
    let (found, _) = calibrate(&cameras, &options).unwrap();
    for (camera, (_, _, late_s)) in found.cameras.iter().zip(clocks) {
        assert!((camera.time_offset_s + late_s).abs() < 5e-5, "{}: {}", camera.name, camera.time_offset_s);
    }
    let sigma = found.cameras[1].sigma.as_ref().unwrap().time_offset_s.unwrap();
    assert!((1e-7..3e-5).contains(&sigma), "{sigma}");
    let errors = rig::centre_errors(&found, &stations, false);
    assert!(errors.iter().all(|error| *error < 1.5e-3), "{errors:?}");
    // Without it the same recording does not fit, and says so.
    let (blind, _) = calibrate(&cameras, &WandOptions { time_offsets: false, ..options }).unwrap();
    let rms = |rig: &erfgs_scene::rig_file::RigFile| rig.quality.as_ref().unwrap().rms_px;
    assert!(rms(&blind) > 2.0 * rms(&found), "{} px, {} px", rms(&blind), rms(&found));
    assert!(blind.cameras.iter().any(|camera| !camera.warnings.is_empty()));
}
