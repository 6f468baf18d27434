use std::{
    path::{Path, PathBuf},
    process::Command,
};

use erfgs_base::random;
use erfgs_calibrate::board::{BoardOptions, LensModel, Target, calibrate, detect, look, single};
use erfgs_recordings::python;
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DVec2, DVec3};
use serde_json::Value;

use super::scene::{Rays, Sheet, errors, photograph};

/// OpenCV's pictures of a chessboard, and the board.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/chessboards")
}

pub fn target() -> Target {
    "chessboard:9x6:0.025".parse().unwrap()
}

/// What OpenCV makes of the same pictures; with `more`, the corners that its sector-based detector finds.
fn opencv(folder: &Path, more: &[&str]) -> Value {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(python())
        .arg(here.join("tests/it/boards/opencv.py"))
        .arg(folder)
        .args(["9", "6", "0.025"])
        .args(more)
        .output()
        .unwrap();
    assert!(output.status.success(), "OpenCV failed:\n{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// fx, fy, cx, cy, k1, k2, p1, p2, k3 in OpenCV's convention.
fn parameters(i: &Intrinsics) -> [f64; 9] {
    let Distortion::BrownConrady([k1, k2, p1, p2, k3, ..]) = i.distortion else { panic!("{:?}", i.distortion) };
    [i.fx, i.fy, i.cx - 0.5, i.cy - 0.5, k1, k2, p1, p2, k3]
}

#[test]
fn stereo_pairs_give_what_opencv_gives() {
    let folder = folder();
    let seen = look(&folder, &target(), None, &|_, _| {}).unwrap();
    let reference = opencv(&folder, &[]);
    for seen in &seen {
        let reference = &reference[&seen.camera];
        let alone = single(seen, &target(), LensModel::Brown5, false).unwrap();
        let (rms, _) = alone.bundle.rms_px(None);
        let (opencv_rms, sectors) = (reference["rms"].as_f64().unwrap(), reference["sectors_rms"].as_f64().unwrap());
        println!(
            "{}: {} views, rms {rms:.4} px; OpenCV {opencv_rms:.4}, by sectors {sectors:.4}",
            seen.camera,
            seen.views.len()
        );
        assert_eq!((seen.frames, reference["views"].as_array().unwrap().len()), (13, 13));
        assert_eq!(seen.views.len(), 13);
        assert!(rms < 0.9 * opencv_rms && rms < 0.9 * sectors, "{rms} against {opencv_rms} and {sectors}");
        let sigma = &alone.uncertainty.cameras[0].sigma;
        for (index, ours) in parameters(&alone.bundle.cameras[0].intrinsics).into_iter().enumerate() {
            let theirs = reference["parameters"][index].as_f64().unwrap();
            let deviation = reference["deviations"][index].as_f64().unwrap();
            println!("  {ours:.5} ± {:.5}   {theirs:.5} ± {deviation:.5}", sigma[index]);
            assert!(
                (ours - theirs).abs() < 2.0 * deviation,
                "parameter {index}: {ours} against {theirs} ± {deviation}"
            );
        }
    }
    let (rig, _) = calibrate(&seen, &target(), &BoardOptions::default(), &|_, _, _| {}).unwrap();
    let (pose, sigma) = (rig.cameras[1].pose.unwrap(), rig.cameras[1].sigma.as_ref().unwrap());
    let vector = |name: &str| DVec3::from_array(serde_json::from_value(reference["stereo"][name].clone()).unwrap());
    let baseline = vector("translation").length();
    let spread = sigma.centre_m.iter().flatten().map(|s| s * s).sum::<f64>().sqrt();
    println!(
        "baseline {} ± {spread}, OpenCV's {baseline}; rms {}",
        pose.translation.length(),
        rig.quality.unwrap().rms_px
    );
    assert!((pose.translation.length() - baseline).abs() < 2.0 * spread);
    let turned = pose.rotation.angle_between(glam::DQuat::from_scaled_axis(vector("rotation")));
    let spread = sigma.rotation_deg.iter().flatten().map(|s| s * s).sum::<f64>().sqrt();
    assert!(turned.to_degrees() < 2.0 * spread, "{} deg against {spread}", turned.to_degrees());
}

#[test]
fn corners_are_as_exact_as_those_of_the_detector_by_sectors() {
    let lens = super::aprilgrids::camera();
    let (sheet, rays) = (Sheet::of(&target(), 0.025), Rays::<5>::of(&lens));
    let folder = tempfile::tempdir().unwrap();
    let (mut squares, mut theirs, mut corners) = (0.0, 0.0, 0);
    let poses: Vec<Pose> = (0..6)
        .map(|view| {
            let draw = |of, from, to| random::range(random::key(12, &[view, of]), from, to);
            let place = DVec3::new(draw(0, -0.05, 0.05), draw(1, -0.05, 0.05), draw(2, 0.35, 0.8));
            sheet.pose(place, DVec3::new(draw(3, -0.6, 0.6), draw(4, -0.6, 0.6), draw(5, -0.4, 0.4)))
        })
        .collect();
    let pictures: Vec<_> = poses
        .iter()
        .enumerate()
        .map(|(view, pose)| {
            let blur = [0.6, 0.8, 1.2][view % 3];
            let picture = photograph(&rays.light(&sheet, pose, blur), [640, 480], 6.0, view as u64);
            picture.write_png(&folder.path().join(format!("{view}.png"))).unwrap();
            picture
        })
        .collect();
    let answer = opencv(folder.path(), &["sectors"]);
    for ((picture, pose), answer) in pictures.iter().zip(&poses).zip(answer.as_array().unwrap()) {
        let Ok(found) = serde_json::from_value::<Vec<[f64; 2]>>(answer.clone()) else { continue };
        let ours = detect(picture, &target());
        assert_eq!(ours.len(), 54);
        squares += errors(&ours, &target(), &lens, pose).iter().map(|error| error * error).sum::<f64>();
        for id in 0..54 {
            let truth = lens.project(pose.transform(target().point(id).unwrap())).unwrap();
            let nearest = found.iter().map(|at| (DVec2::from_array(*at) + 0.5).distance(truth));
            theirs += nearest.fold(f64::INFINITY, f64::min).powi(2);
        }
        corners += 54;
    }
    let (ours, theirs) = ((squares / f64::from(corners)).sqrt(), (theirs / f64::from(corners)).sqrt());
    println!("{corners} corners: {ours:.4} px; OpenCV by sectors {theirs:.4} px");
    assert!(corners >= 4 * 54 && ours <= theirs && ours < 0.06, "{corners} {ours} {theirs}");
}

#[test]
fn charuco_boards_as_opencv_drew_them_before_are_read() {
    for (legacy, begins_black) in [(":legacy", false), ("", true)] {
        let target: Target = format!("charuco:5x6:0.03:0.0225:DICT_4X4_50{legacy}").parse().unwrap();
        let sheet = Sheet::of(&target, 0.00375);
        assert_eq!(sheet.colour(DVec2::splat(0.001)), Some(begins_black));
        let picture = sheet.picture(8);
        let corners = detect(&picture, &target);
        assert_eq!(corners.len(), 20, "{target}");
        for corner in &corners {
            assert!(corner.pixel.distance(sheet.in_picture(corner.id, 8)) < 0.5, "{target}: {corner:?}");
        }
        // Of an odd number of rows there is one way only.
        let odd: Target = format!("charuco:5x7:0.03:0.0225:DICT_4X4_50{legacy}").parse().unwrap();
        assert_eq!(Sheet::of(&odd, 0.00375).colour(DVec2::splat(0.001)), Some(true));
    }
}

#[test]
fn views_that_never_tilt_and_too_few_views_are_refused() {
    let folder = folder();
    let mut seen = look(&folder, &target(), None, &|_, _| {}).unwrap().remove(0);
    seen.views.truncate(2);
    let message = single(&seen, &target(), LensModel::Brown5, false).unwrap_err().to_string();
    assert!(message.contains("camera left") && message.contains("2 of 13"), "{message}");
    let message = look(&folder.join("none"), &target(), None, &|_, _| {}).unwrap_err().to_string();
    assert!(message.contains("none"), "{message}");
}
