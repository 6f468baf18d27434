use std::collections::BTreeMap;

use erfgs_dataset::{Dataset, Split};
use erfgs_scene::PointCloud;
use erfgs_stage::{FilmOptions, RigOptions, StageOptions, film};

use crate::command_line::Folder;

/// The empty room from eight cameras that stand up to a centimetre beside where they are said to, and from two that are held out.
fn film_beside(folder: &Folder) {
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, empty: true, ..StageOptions::default() },
        rig: RigOptions { width: 96, height: 72, rgb: 8, event: 0, test: 2, ..RigOptions::default() },
        duration_ns: 50_000_000,
        exposure_ns: 0,
        rgb_fps: 10.0,
        test_fps: 10.0,
        truth_points: 4000,
        ..FilmOptions::default()
    };
    film(&folder.path("ds"), &options, &|_| {}).expect("a film");
    folder.succeed("dataset disturb ds --pose-mm 8 --pose-degrees 0.4 --out off");
    let cloud = PointCloud::read(&folder.path("ds").join("truth_points.ply")).expect("points");
    for name in ["ds", "off"] {
        let mut dataset = Dataset::load(&folder.path(name)).expect("a dataset");
        dataset.set_points(&cloud, "truth", BTreeMap::new()).expect("points");
        dataset.hash_files().expect("hashes");
        dataset.save().expect("saved");
    }
}

/// How far directions of cameras are from the truth, degrees, beside each other: root mean square over all pairs.
fn apart(folder: &Folder, moved: &[erfgs_run::CameraPose]) -> f64 {
    let [truth, off] = ["ds", "off"].map(|name| Dataset::load(&folder.path(name)).expect("a dataset"));
    let errors: Vec<glam::DQuat> = truth
        .cameras(Split::Train)
        .zip(off.cameras(Split::Train))
        .map(|(truth, off)| {
            let found_pose = moved.iter().find(|of| of.camera == off.name);
            let turn = found_pose.map_or([0.0; 3], |of| of.turn_degrees.map(f64::to_radians));
            let found = glam::DQuat::from_scaled_axis(turn.into()) * off.world_to_camera.rotation;
            truth.world_to_camera.rotation.inverse() * found
        })
        .collect();
    let pairs = errors.iter().enumerate().flat_map(|(at, a)| errors[..at].iter().map(|b| a.angle_between(*b)));
    let squares: Vec<f64> = pairs.map(|angle| angle.to_degrees().powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn cameras_that_stand_elsewhere_are_found() {
    let folder = Folder::new();
    film_beside(&folder);
    let train =
        "train off --method 4dgs --iterations 450+0 --set camera_colour.enabled=false --set camera_pose.enabled";
    let plain = folder.figures(&format!("{train}=false --out plain"));
    let found = folder.figures(&format!("{train}=true --out found"));
    let psnr = |figures: &serde_json::Value| figures["psnr"].as_f64().expect("a PSNR");
    let camera_poses = |name: &str| {
        erfgs_run::RunFolder::open(folder.path(name)).expect("a run").read_info().expect("told").camera_poses
    };
    let (before, after) = (apart(&folder, &camera_poses("plain")), apart(&folder, &camera_poses("found")));
    assert!(camera_poses("plain").is_empty() && camera_poses("found").len() == 8);
    assert!(after < 0.7 * before, "{after} degrees apart, {before} before");
    assert!(psnr(&found) > psnr(&plain) + 0.5, "{} against {} dB", psnr(&found), psnr(&plain));
    // When the run is looked at again, cameras are where they were found.
    let seen = |run: &str| folder.figures(&format!("eval {run}"))["train_psnr"].as_f64().expect("a PSNR");
    assert!(seen("found") > seen("plain") + 0.5, "{} against {} dB", seen("found"), seen("plain"));
}
