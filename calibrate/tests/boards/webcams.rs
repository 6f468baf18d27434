use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_calibrate::board::{BoardOptions, calibrate, look};
use erfgs_session::{Distortion, Intrinsics, Pose};
use glam::{DMat3, DVec3};

/// The folder of real recordings, where there is one.
fn shared() -> PathBuf {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    std::env::var_os("ERFGS_SHARED").map_or_else(beside, PathBuf::from)
}

/// The reference: intrinsics (OpenCV's pixel convention) and world-to-camera poses.
fn reference(file: &Path) -> BTreeMap<String, (Intrinsics, Pose)> {
    let table: toml::Table = std::fs::read_to_string(file).unwrap().parse().unwrap();
    let numbers = |value: &toml::Value| -> Vec<f64> { value.clone().try_into().unwrap() };
    let rows = |value: &toml::Value| -> Vec<f64> { value.as_array().unwrap().iter().flat_map(numbers).collect() };
    let camera = |(id, camera): (&String, &toml::Value)| {
        let (m, d) = (rows(&camera["matrix"]), numbers(&camera["distortions"]));
        let intrinsics = Intrinsics {
            width: 1280,
            height: 720,
            fx: m[0],
            fy: m[4],
            cx: m[2] + 0.5,
            cy: m[5] + 0.5,
            distortion: Distortion::BrownConrady([d[0], d[1], d[2], d[3], d[4], 0.0, 0.0, 0.0]),
        };
        let rotation = DMat3::from_cols_slice(&rows(&camera["rotation"])).transpose();
        let pose = Pose::from_matrix(rotation, DVec3::from_slice(&numbers(&camera["translation"])));
        (format!("cam_{id}"), (intrinsics, pose))
    };
    table["cameras"].as_table().unwrap().iter().map(camera).collect()
}

#[test]
fn four_free_running_webcams_and_a_waved_board() {
    let source = shared().join("data/caliscope_sessions/post_optimization");
    if !source.exists() {
        eprintln!("{} is not there: nothing checked", source.display());
        return;
    }
    let target = "charuco:4x5:0.054:0.0405:DICT_4X4_1000:inverted".parse().unwrap();
    let seen = look(&source.join("calibration/extrinsic"), &target, &|_, _| {}).unwrap();
    let reference = reference(&source.join("camera_array.toml"));
    let known = reference.iter().map(|(name, (intrinsics, _))| (name.clone(), *intrinsics)).collect();
    let options = BoardOptions { known, ..BoardOptions::default() };
    for (what, time_offsets, untimed) in
        [("plain", false, true), ("to one time", false, false), ("offsets", true, false)]
    {
        let mut seen = seen.clone();
        if untimed {
            seen.iter_mut().flat_map(|seen| &mut seen.views).for_each(|view| view.time_s = None);
        }
        let (rig, _) =
            calibrate(&seen, &target, &BoardOptions { time_offsets, ..options.clone() }, &|_, _, _| {}).unwrap();
        println!("{what}: {:?}", rig.quality.as_ref().unwrap().rms_px);
        let world = reference["cam_0"].1;
        for camera in &rig.cameras {
            let (_, pose) = reference[&camera.name];
            // Both with the first camera as the world.
            let centre = world.transform(pose.centre());
            let rotation = pose.rotation * world.rotation.conjugate();
            let found = camera.pose.unwrap();
            let off = (found.centre() - centre).length() * 1e3;
            let turned = found.rotation.angle_between(rotation).to_degrees();
            let sigma = camera.sigma.as_ref().unwrap();
            println!(
                "  {}: {off:.2} mm of {:.0}, {turned:.3} deg, rms {:.3} px, {} corners, {} left out, offset {:.1} ms, sigma {:?} {:?}",
                camera.name,
                centre.length() * 1e3,
                camera.rms_px.unwrap(),
                camera.observations,
                camera.outliers,
                camera.time_offset_s * 1e3,
                sigma.centre_m,
                sigma.rotation_deg
            );
        }
    }
}
