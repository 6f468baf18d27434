//! Whether views of a board determine a focal length, and what is said where they do not.

use erfgs_base::random;
use erfgs_calibrate::board::{
    BoardDetections, BoardError, BoardOptions, BoardView, Corner, LensModel, Target, calibrate, single,
};
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DQuat, DVec2, DVec3};

fn board() -> Target {
    "chessboard:8x5:0.025".parse().unwrap()
}

fn camera() -> Intrinsics {
    Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 163.0, cy: 118.0, distortion: Distortion::None }
}

/// What the camera sees of boards at `places` (middle, turn about its axes in radians), off by 0.3 px.
fn seen(name: &str, places: &[(DVec3, DVec3)], seed: u64) -> BoardDetections {
    let view = |(number, (at, turn)): (usize, &(DVec3, DVec3))| {
        let rotation = DQuat::from_scaled_axis(*turn);
        let pose = Pose { rotation, translation: *at - rotation * DVec3::new(3.5, 2.0, 0.0) * 0.025 };
        let corner = |id: u32| {
            let key = random::key(seed, &[number as u64, u64::from(id)]);
            let noise = DVec2::new(random::normal(key), random::normal(random::extend(key, 1))) * 0.3;
            Corner { id, pixel: camera().project(pose.transform(board().point(id).unwrap())).unwrap() + noise }
        };
        let corners = (0..40).map(corner).collect();
        BoardView { instant: number.to_string(), time_s: None, file: "drawn".into(), frame: 0, corners }
    };
    let views = places.iter().enumerate().map(view).collect();
    BoardDetections {
        camera: name.into(),
        events: false,
        size: [320, 240],
        frames: places.len(),
        views,
        ..BoardDetections::default()
    }
}

/// A board that slides along its rows at one distance, and tilts by up to `tilt` radians about both axes.
fn slid(tilt: f64) -> Vec<(DVec3, DVec3)> {
    let place = |i: i32| {
        let turn = DVec3::new(f64::from(i % 3 - 1), f64::from(i % 5 - 2) / 2.0, 0.0) * tilt;
        (DVec3::new(0.01 * f64::from(i) - 0.1, 0.0, 0.4), turn)
    };
    (0..20).map(place).collect()
}

#[test]
fn a_board_that_never_tilts_gives_no_focal_length() {
    for model in [LensModel::Pinhole, LensModel::Brown5] {
        for (tilt, seed) in [(0.0, 0), (0.0, 1), (0.02, 2), (0.05, 3)] {
            let error = single(&seen("left", &slid(tilt), seed), &board(), model, false).unwrap_err();
            assert!(matches!(error, BoardError::NoFocal { .. }), "{model:?}, tilt {tilt}: {error}");
            let message = error.to_string();
            assert!(message.contains("camera left") && message.contains("tilted by 30 degrees"), "{message}");
        }
    }
    // What would fit best is nine times too long, and said with its standard deviation.
    let error = single(&seen("left", &slid(0.0), 0), &board(), LensModel::Pinhole, true).unwrap_err();
    let BoardError::NoFocal { found: Some([focal, sigma]), .. } = error else { panic!("{error}") };
    assert!(focal > 1500.0 && sigma > 200.0 && error.to_string().contains(&format!("({focal:.0} ± {sigma:.0} px)")));
    // No pose is built on it, either.
    let both = [seen("left", &slid(0.5), 5), seen("right", &slid(0.0), 6)];
    let error = calibrate(&both, &board(), &BoardOptions::default(), &|_, _, _| {}).unwrap_err();
    assert!(error.to_string().starts_with("camera right"), "{error}");
}

#[test]
fn a_board_that_tilts_gives_it_and_one_that_tilts_little_a_warning() {
    for (tilt, most_sigma, warned) in [(0.5, 2.0, false), (0.2, 6.0, true)] {
        let options = BoardOptions { model: LensModel::Pinhole, ..BoardOptions::default() };
        let (rig, _) = calibrate(&[seen("left", &slid(tilt), 7)], &board(), &options, &|_, _, _| {}).unwrap();
        let camera = &rig.cameras[0];
        let sigma = camera.sigma.as_ref().unwrap().intrinsics["fx"].unwrap();
        assert!((camera.intrinsics.fx - 300.0).abs() < 3.0 * sigma && sigma < most_sigma, "{:?}", camera.intrinsics);
        let warnings = camera.warnings.iter().filter(|warning| warning.contains("focal length is known only to 1."));
        assert_eq!(warnings.count(), usize::from(warned), "{:?}", camera.warnings);
    }
}

#[test]
fn frames_that_show_too_little_of_the_board_count_as_seen_and_what_was_looked_at_is_named() {
    let mut seen = seen("left", &slid(0.5)[..1], 5);
    (seen.frames, seen.source) = (120, "take/left.mp4".into());
    seen.views[0].corners.truncate(5);
    for known in [Default::default(), [("left".to_owned(), camera())].into()] {
        let options = BoardOptions { known, ..BoardOptions::default() };
        let message =
            calibrate(std::slice::from_ref(&seen), &board(), &options, &|_, _, _| {}).unwrap_err().to_string();
        assert!(
            message.contains("1 of 120 frames of take/left.mp4, in 0 of them with six corners or more"),
            "{message}"
        );
    }
}
