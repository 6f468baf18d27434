//! A camera that is calibrated while the board is shown to it.

use erfgs_calibrate::board::{Corner, LensModel, Quick, Target};
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DQuat, DVec3};

const SIZE: [u32; 2] = [640, 480];

fn camera() -> Intrinsics {
    let mut k = [0.0; 8];
    k[0] = -0.1;
    let distortion = Distortion::BrownConrady(k);
    Intrinsics { width: SIZE[0], height: SIZE[1], fx: 600.0, fy: 600.0, cx: 322.0, cy: 238.0, distortion }
}

fn board() -> Target {
    "chessboard:9x6:0.025".parse().unwrap()
}

/// The board's corners with its middle at `at`, turned about the camera's axes by `turn` degrees.
fn view(at: DVec3, turn: [f64; 2]) -> Vec<Corner> {
    let rotation = DQuat::from_rotation_x(turn[0].to_radians()) * DQuat::from_rotation_y(turn[1].to_radians());
    let middle = DVec3::new(4.0, 2.5, 0.0) * 0.025;
    let pose = Pose { rotation, translation: at - rotation * middle };
    let see = |id| Some(Corner { id, pixel: camera().project(pose.transform(board().point(id)?))? });
    (0..54).filter_map(see).collect()
}

#[test]
fn a_board_that_is_held_still_is_one_view() {
    let mut quick = Quick::new("cam", false, SIZE, board(), LensModel::Brown5);
    for jitter in 0..20 {
        quick.see(view(DVec3::new(1e-4 * f64::from(jitter), 0.0, 0.6), [0.0, 10.0]));
    }
    quick.see(Vec::new());
    assert_eq!(quick.counts(), [21, 20, 1]);
    assert!(quick.last().is_empty() && quick.fit().is_none() && !quick.refit());
    assert_eq!(quick.coverage().iter().sum::<u32>(), 54);
    assert!(quick.advice().unwrap().contains("1 of 3"));
}

fn advice(quick: &Quick) -> String {
    quick.advice().unwrap_or_default()
}

#[test]
fn advice_names_what_is_missing_until_there_is_enough() {
    let mut quick = Quick::new("cam", false, SIZE, board(), LensModel::Brown5);
    for x in [-0.12, -0.06, 0.0] {
        for y in [-0.07, 0.0, 0.07] {
            quick.see(view(DVec3::new(x, y, 0.45), [3.0 * x, 2.0]));
            quick.refit();
        }
    }
    assert!(advice(&quick).contains("right of the image"), "{}", advice(&quick));
    for y in [-0.07, 0.0, 0.07] {
        quick.see(view(DVec3::new(0.12, y, 0.45), [0.0, 5.0]));
        quick.refit();
    }
    assert!(advice(&quick).contains("tilt"), "{}", advice(&quick));
    for turn in [
        [35.0, 0.0],
        [-35.0, 0.0],
        [0.0, 35.0],
        [0.0, -35.0],
        [25.0, 25.0],
        [-25.0, 25.0],
        [-30.0, -30.0],
        [30.0, -30.0],
    ] {
        quick.see(view(DVec3::new(0.0, 0.0, 0.35), turn));
        quick.see(view(DVec3::new(0.04, 0.02, 0.4), turn));
        quick.refit();
    }
    let fit = quick.fit().unwrap();
    assert!((fit.focal_px - 600.0).abs() < 1e-3 && fit.rms_px < 1e-6 && fit.tilt_deg > 30.0, "{fit:?}");
    assert_eq!(quick.advice(), None);
}

#[test]
fn any_number_of_frames_keeps_a_bounded_number_of_views() {
    let mut quick = Quick::new("cam", false, SIZE, board(), LensModel::Pinhole);
    for number in 0..400 {
        let (x, y) = (0.002 * f64::from(number % 100) - 0.1, 0.03 * f64::from(number / 100) - 0.05);
        quick.see(view(DVec3::new(x, y, 0.5 + 0.001 * f64::from(number)), [0.0, f64::from(number % 40)]));
    }
    assert!(quick.counts()[2] <= 60, "{:?}", quick.counts());
}
