//! eWand's recording of four cameras.

use std::path::Path;

use erfgs_calibrate::{
    geometry::triangulate,
    wand::{WandCamera, WandOptions, calibrate, read_points},
};
use erfgs_recordings::shared;
use erfgs_scene::Pose;
use erfgs_scene::rig_file::RigFile;
use glam::{DMat3, DVec3};

use crate::halves::{differences, in_deviations};

const RECORDING: &str = "data/ewand_wand_4cam_points";

fn options() -> WandOptions {
    WandOptions::new("0.13+0.26".parse().unwrap())
}

fn measure(rig: &RigFile, name: &str) -> f64 {
    rig.quality.as_ref().unwrap().measures[name]
}

#[test]
fn a_recorded_rig_measures_wands_that_took_no_part() {
    let Some(folder) = shared(RECORDING) else { return };
    let cameras = read_points(&folder).unwrap();
    let (rig, evidence) = calibrate(&cameras, &options()).unwrap();
    for gap in ["first_gap", "second_gap", "whole_wand"] {
        let [mean, rms, count] =
            ["mean_mm", "rms_mm", "count"].map(|what| measure(&rig, &format!("held_out_{gap}_{what}")));
        assert!(mean.abs() < 0.25 && rms < 0.7 && count > 100.0, "{gap}: {mean} mm on average, rms {rms} mm, {count}");
    }
    let quality = rig.quality.as_ref().unwrap();
    assert!(quality.rms_px < 0.5, "{} px", quality.rms_px);
    // The stamps of the first camera are some 8 ms from those of the other three, which agree.
    for camera in &rig.cameras[1..] {
        assert!((6.5e-3..9e-3).contains(&camera.time_offset_s), "{}: {}", camera.name, camera.time_offset_s);
    }
    let outliers: usize = rig.cameras.iter().map(|camera| camera.outliers).sum();
    assert_eq!(evidence.residuals.iter().filter(|residual| !residual.used).count(), outliers);
    assert!(evidence.passes.len() > 4 && evidence.tables.len() == 2);
}

#[test]
fn the_focal_lengths_that_came_with_a_recording_measure_worse() {
    let Some(folder) = shared(RECORDING) else { return };
    let cameras = read_points(&folder).unwrap();
    let (refined, _) = calibrate(&cameras, &options()).unwrap();
    let (kept, _) = calibrate(&cameras, &WandOptions { fix_focal: true, ..options() }).unwrap();
    assert!(kept.quality.as_ref().unwrap().rms_px > 1.5 * refined.quality.as_ref().unwrap().rms_px);
    let (of_kept, of_refined) =
        (measure(&kept, "held_out_whole_wand_rms_mm"), measure(&refined, "held_out_whole_wand_rms_mm"));
    assert!(of_kept > 1.5 * of_refined, "{of_kept} mm, {of_refined} mm");
    // All four are of one make: refined, their focal lengths agree better than those that came with them.
    let spread = |rig: &RigFile| {
        let focal = || rig.cameras.iter().map(|camera| camera.intrinsics.fx);
        focal().fold(0.0, f64::max) - focal().fold(f64::INFINITY, f64::min)
    };
    assert!(spread(&refined) < 0.5 * spread(&kept), "{} {}", spread(&refined), spread(&kept));
    // The poses that came with it, made by eWand's own program.
    let (mean, rms) = lengths_of_reference(&folder, &cameras);
    eprintln!(
        "whole wand, 390 mm: reference poses {mean:+.2} mm on average, rms {rms:.2} mm; reference intrinsics rms \
         {of_kept:.2} mm; refined rms {of_refined:.2} mm"
    );
    assert!(rms > of_refined, "{rms} mm");
}

/// Mean and root mean square error of the wand's length, millimetres, with the poses in the YAML files.
fn lengths_of_reference(folder: &Path, cameras: &[WandCamera]) -> (f64, f64) {
    let pose = |camera: &WandCamera| {
        let text = std::fs::read_to_string(folder.join(format!("{}.yaml", camera.name))).unwrap();
        let block = &text[text.find("extrinsics:").unwrap()..];
        let data = &block[block.find("data: [").unwrap() + 7..];
        let numbers = data[..data.find(']').unwrap()].split(',').map(|n| n.trim().parse::<f64>().unwrap());
        let m: Vec<f64> = numbers.collect();
        let rotation = DMat3::from_cols_array(&[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]]);
        Pose::from_matrix(rotation, DVec3::new(m[3], m[7], m[11]) * 1e-3)
    };
    let poses: Vec<Pose> = cameras.iter().map(pose).collect();
    let mut errors: Vec<f64> = Vec::new();
    for sighting in &cameras[0].sightings {
        let locate = |led: usize| {
            let views = cameras.iter().zip(&poses).filter_map(|(camera, pose)| {
                let same = camera.sightings.iter().find(|s| s.t_ns == sighting.t_ns)?;
                Some((&camera.intrinsics, pose, same.leds[led]?, 0.3))
            });
            let views: Vec<_> = views.collect();
            let (point, _) = triangulate(&views)?;
            let near = |(lens, pose, pixel, _): &(&erfgs_scene::Intrinsics, &Pose, glam::DVec2, f64)| {
                lens.project(pose.transform(point)).is_some_and(|seen| (seen - *pixel).length() < 8.0)
            };
            (views.len() >= 3 && views.iter().all(near)).then_some(point)
        };
        if let (Some(from), Some(to)) = (locate(0), locate(2)) {
            errors.push(1e3 * ((to - from).length() - 0.39));
        }
    }
    let mean = |of: &dyn Fn(f64) -> f64| errors.iter().map(|e| of(*e)).sum::<f64>() / errors.len() as f64;
    eprintln!("{} wands", errors.len());
    (mean(&|e| e), mean(&|e| e * e).sqrt())
}

#[test]
fn parts_of_a_recording_agree_within_their_deviations() {
    let Some(folder) = shared(RECORDING) else { return };
    let cameras = read_points(&folder).unwrap();
    let mut times: Vec<i64> = cameras.iter().flat_map(|camera| &camera.sightings).map(|s| s.t_ns).collect();
    times.sort_unstable();
    times.dedup();
    let of = |wanted: &dyn Fn(usize) -> bool| {
        let part = |camera: &WandCamera| {
            let sightings = camera.sightings.iter().filter(|s| wanted(times.partition_point(|t| *t < s.t_ns)));
            WandCamera { sightings: sightings.copied().collect(), ..camera.clone() }
        };
        let part: Vec<WandCamera> = cameras.iter().map(part).collect();
        calibrate(&part, &options()).unwrap().0
    };
    let mut squares = 0.0;
    // Every other instant (too far apart for a LED's speed, so that there are no time offsets), every other of 16, 8 and 4
    // stretches, the first half and the second.
    let parts = [times.len(), 16, 8, 4, 2];
    for stretches in parts {
        let [one, other] = [0, 1].map(|odd| of(&|number| number * stretches / times.len() % 2 == odd));
        let [rms, _] = in_deviations(&format!("every other of {stretches}"), &differences(&one, &other));
        assert!(rms < 2.0, "{stretches}: {rms}");
        squares += rms * rms / parts.len() as f64;
    }
    // Deviations that take each LED's error for its own are too small by a factor of three.
    assert!(squares.sqrt() < 1.4, "{}", squares.sqrt());
}
