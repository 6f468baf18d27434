//! Converted rigs, read by the programs whose formats they are: where they see points of the world.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use erfgs_scene::{Distortion, Intrinsics, Modality, Pose};
use erfgs_scene::{
    exchange::{Format, write},
    rig_file::{RigCamera, RigFile},
};
use glam::{DVec2, DVec3};

fn rig() -> RigFile {
    let lenses = [
        Distortion::None,
        Distortion::BrownConrady([-0.21, 0.06, 1e-3, -2e-3, 0.0, 0.0, 0.0, 0.0]),
        Distortion::BrownConrady([-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.02, -0.01, 0.003]),
        Distortion::KannalaBrandt([0.05, -0.01, 1e-3, 2e-4]),
    ];
    let cameras = lenses.into_iter().enumerate().map(|(index, distortion)| {
        let intrinsics =
            Intrinsics { width: 640, height: 480, fx: 500.25, fy: 501.5, cx: 318.75, cy: 244.125, distortion };
        let eye = DVec3::new(index as f64 - 1.5, 0.3, -2.0);
        RigCamera::new(&format!("c{index}"), Modality::Rgb, intrinsics, Some(Pose::look_at(eye, DVec3::ZERO, DVec3::Y)))
    });
    RigFile::new("wand", true, cameras.collect())
}

const POINTS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [-0.4, 0.3, 0.5], [0.1, 0.4, -0.3]];

/// Where the other program sees the points: for each camera in order, for each point.
fn others(script: &str, path: &Path) -> Vec<Vec<[f64; 2]>> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python =
        std::env::var_os("ERFGS_ORACLES").map_or_else(|| here.join("../target/oracles/bin/python"), PathBuf::from);
    let output = Command::new(&python)
        .arg(here.join("tests/it/exchange").join(script))
        .arg(path)
        .arg(serde_json::to_string(&POINTS).unwrap())
        .output()
        .unwrap_or_else(|error| panic!("{}: {error}; run scripts/setup.sh --oracles", python.display()));
    assert!(output.status.success(), "{script} failed:\n{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// `shift` is where the other program puts the centre of the first pixel, less our half.
fn compare(theirs: &[Vec<[f64; 2]>], shift: f64) {
    for (camera, seen) in rig().cameras.iter().zip(theirs) {
        for (point, theirs) in POINTS.iter().zip(seen) {
            let ours = camera.intrinsics.project(camera.pose.unwrap().transform(DVec3::from_array(*point))).unwrap();
            let off = (ours + shift - DVec2::from_array(*theirs)).length();
            assert!(off < 1e-6, "{}: {ours} against {theirs:?}", camera.name);
        }
    }
    assert_eq!(theirs.len(), 4);
}

#[test]
fn colmap_sees_what_we_see() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("model");
    write(&rig(), Format::Colmap, &out).unwrap();
    compare(&others("colmap.py", &out), 0.0);
}

#[test]
fn opencv_sees_what_we_see_half_a_pixel_to_the_left_and_up() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("opencv");
    write(&rig(), Format::OpenCv, &out).unwrap();
    compare(&others("opencv.py", &out), -0.5);
}
