use std::{
    path::{Path, PathBuf},
    process::Command,
};

use erfgs_calibrate::board::{BoardOptions, LensModel, Target, calibrate, look, single};
use erfgs_recordings::python;
use erfgs_scene::{Distortion, Intrinsics};
use glam::DVec3;
use serde_json::Value;

/// OpenCV's pictures of a chessboard, and the board.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/chessboards")
}

pub fn target() -> Target {
    "chessboard:9x6:0.025".parse().unwrap()
}

/// What OpenCV makes of the same pictures.
fn opencv(folder: &Path) -> Value {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let output = Command::new(python())
        .arg(here.join("tests/it/boards/opencv.py"))
        .arg(folder)
        .args(["9", "6", "0.025"])
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
    let reference = opencv(&folder);
    for seen in &seen {
        let reference = &reference[&seen.camera];
        let alone = single(seen, &target(), LensModel::Brown5, false).unwrap();
        let (rms, _) = alone.bundle.rms_px(None);
        let opencv_rms = reference["rms"].as_f64().unwrap();
        println!("{}: {} views, rms {rms:.4} px; OpenCV {opencv_rms:.4}", seen.camera, seen.views.len());
        assert_eq!((seen.frames, reference["views"].as_array().unwrap().len()), (13, 13));
        assert_eq!(seen.views.len(), 13);
        assert!(rms <= opencv_rms + 0.01, "{rms} against {opencv_rms}");
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
fn views_that_never_tilt_and_too_few_views_are_refused() {
    let folder = folder();
    let mut seen = look(&folder, &target(), None, &|_, _| {}).unwrap().remove(0);
    seen.views.truncate(2);
    let message = single(&seen, &target(), LensModel::Brown5, false).unwrap_err().to_string();
    assert!(message.contains("camera left") && message.contains("2 of 13"), "{message}");
    let message = look(&folder.join("none"), &target(), None, &|_, _| {}).unwrap_err().to_string();
    assert!(message.contains("none"), "{message}");
}
