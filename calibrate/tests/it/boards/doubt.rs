//! Rigs that would look right and are wrong, and what is left out.

use std::collections::BTreeSet;

use erfgs_base::random;
use erfgs_calibrate::board::{
    BoardDetections, BoardError, BoardOptions, BoardView, Corner, LensModel, Target, calibrate,
};
use erfgs_scene::{Distortion, Intrinsics, Pose, rig_file::RigFile};
use glam::{DQuat, DVec2, DVec3};

fn board() -> Target {
    "chessboard:8x5:0.03".parse().unwrap()
}

fn lens() -> Intrinsics {
    Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 322.0, cy: 238.0, distortion: Distortion::None }
}

/// World-to-camera pose of a camera on an arc around the board.
fn place(angle: f64) -> Pose {
    Pose::look_at(DVec3::new(angle.sin(), 0.1, -angle.cos()) * 1.2, DVec3::ZERO, DVec3::Y)
}

/// Where the board is at a time, seconds: it is waved, and tilts all the time. `film` is another recording.
fn waved(t: f64, film: f64) -> Pose {
    let phase = |speed: f64, from: f64| (speed * t + from * (1.0 + film)).sin();
    let turn = DVec3::new(0.5 * phase(1.3, 0.4), 0.6 * phase(1.7, 2.0), 0.5 * phase(0.9, 1.1));
    let rotation = DQuat::from_scaled_axis(turn);
    let at = DVec3::new(0.12 * phase(1.9, 0.1), 0.1 * phase(2.3, 1.5), 0.15 * phase(1.1, 0.7));
    Pose { rotation, translation: at - rotation * DVec3::new(0.105, 0.06, 0.0) }
}

/// What a camera at `angle` sees, ten times a second, `late` seconds after it says so; corners are off by 0.2 px.
fn seen(name: &str, angle: f64, late: f64, film: f64) -> BoardDetections {
    let view = |number: u32| {
        let time = 0.1 * f64::from(number);
        let board_at = waved(time + late, film);
        let corner = |id: u32| {
            let key = random::key(random::purpose(name), &[u64::from(number), u64::from(id)]);
            let noise = DVec2::new(random::normal(key), random::normal(random::extend(key, 1))) * 0.2;
            let point = place(angle).transform(board_at.transform(board().point(id).unwrap()));
            Corner { id, pixel: lens().project(point).unwrap() + noise }
        };
        let corners = (0..40).map(corner).collect();
        BoardView { instant: number.to_string(), time_s: Some(time), file: "drawn".into(), frame: 0, corners }
    };
    BoardDetections {
        camera: name.into(),
        size: [640, 480],
        frames: 40,
        views: (0..40).map(view).collect(),
        ..BoardDetections::default()
    }
}

fn without_times(mut seen: Vec<BoardDetections>) -> Vec<BoardDetections> {
    seen.iter_mut().flat_map(|seen| &mut seen.views).for_each(|view| view.time_s = None);
    seen
}

fn options() -> BoardOptions {
    BoardOptions { model: LensModel::Pinhole, ..BoardOptions::default() }
}

fn solve(seen: &[BoardDetections], options: &BoardOptions) -> Result<RigFile, BoardError> {
    calibrate(seen, &board(), options, &|_, _, _| {}).map(|(rig, _)| rig)
}

/// How far a camera is from where it stands, seen from the first one; and three of its deviations, metres.
fn off(rig: &RigFile, index: usize, angles: [f64; 2]) -> (f64, f64) {
    let truth = place(angles[0]).inverse().then(&place(angles[1]));
    let camera = &rig.cameras[index];
    let sigma = camera.sigma.as_ref().unwrap().centre_m.iter().flatten().map(|s| s * s).sum::<f64>().sqrt();
    (camera.pose.unwrap().centre().distance(truth.centre()), 3.0 * sigma)
}

#[test]
fn a_sound_rig_is_within_its_deviations_and_nothing_is_said_first() {
    let seen = [seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)];
    let rig = solve(&seen, &options()).unwrap();
    let (off, limit) = off(&rig, 1, [0.0, 0.5]);
    assert!(rig.warnings.is_empty() && off < limit && off < 2e-3, "{off} {limit} {:?}", rig.warnings);
}

#[test]
fn recordings_that_do_not_belong_together_are_no_rig() {
    for seen in [
        vec![seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.0, 3.0)],
        without_times(vec![seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.0, 3.0)]),
    ] {
        let error = solve(&seen, &options()).unwrap_err();
        assert!(matches!(error, BoardError::Contradiction { .. }), "{error}");
        let message = error.to_string();
        assert!(message.contains("right") && message.contains("belong together"), "{message}");
        // What was tried is named; of two cameras none can be left out.
        assert!(message.contains("Tried: ") && message.contains("--keep-intrinsics does not help"), "{message}");
        assert!(!message.contains("--without"), "{message}");
    }
}

#[test]
fn instants_that_tie_no_cameras_contradict_nothing_and_are_named_if_there_are_none_such() {
    let (mut seen, other) =
        (vec![seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)], seen("right", 0.5, 0.0, 3.0));
    // For a while somebody held another board before the one camera.
    let wrong = 8..14;
    seen[1].views[wrong.clone()].clone_from_slice(&other.views[wrong.clone()]);
    let before = solve(&seen, &options()).map_or_else(|error| vec![error.to_string()], |rig| rig.warnings);
    assert!(before.iter().any(|doubt| doubt.contains("right")), "{before:?}");
    let untied = BoardOptions { untied: wrong.map(|instant| instant.to_string()).collect(), ..options() };
    let rig = solve(&seen, &untied).unwrap();
    let (off, limit) = off(&rig, 1, [0.0, 0.5]);
    assert!(rig.warnings.is_empty() && off < limit && off < 4e-3, "{off} {limit} {:?}", rig.warnings);
    let unknown = BoardOptions { untied: ["floor".into()].into(), ..options() };
    let error = solve(&seen, &unknown).unwrap_err().to_string();
    assert!(error.contains("floor") && error.contains("--untie") && error.contains("0, 1"), "{error}");
}

#[test]
fn of_three_cameras_of_which_one_was_moved_the_refusal_says_that_without_it_there_is_a_rig() {
    let mut seen = vec![seen("left", 0.0, 0.0, 0.0), seen("middle", 0.3, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)];
    let elsewhere = self::seen("right", 0.75, 0.0, 0.0);
    seen[2].views[20..].clone_from_slice(&elsewhere.views[20..]);
    let error = solve(&seen, &options()).unwrap_err().to_string();
    println!("{error}");
    assert!(error.contains("--without right gives a rig") && !error.contains("--without left gives"), "{error}");
}

#[test]
fn cameras_that_do_not_run_together_are_found_out_and_their_offsets_estimated() {
    let seen = vec![seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.06, 0.0)];
    let rig = solve(&seen, &options()).unwrap();
    assert!(rig.warnings.iter().any(|warning| warning.contains("do not run together")), "{:?}", rig.warnings);
    let (off, _) = off(&rig, 1, [0.0, 0.5]);
    assert!((rig.cameras[1].time_offset_s.abs() - 0.06).abs() < 0.005, "{}", rig.cameras[1].time_offset_s);
    assert!(off < 0.01, "{off}");
    // Without times nobody can estimate them, and the result is refused, or doubted before anything else is said.
    match solve(&without_times(seen), &options()) {
        Err(error) => assert!(error.to_string().contains("timestamps.csv"), "{error}"),
        Ok(rig) => assert!(rig.warnings[0].contains("right") || rig.warnings[0].contains("left"), "{:?}", rig.warnings),
    }
}

#[test]
fn lenses_that_are_given_must_be_of_these_cameras() {
    let seen = [seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)];
    let known = |name: &str, lens: Intrinsics| BoardOptions { known: [(name.into(), lens)].into(), ..options() };
    let error = solve(&seen, &known("other", lens())).unwrap_err().to_string();
    assert!(error.contains("other") && error.contains("left, right"), "{error}");
    let error =
        solve(&seen, &known("left", Intrinsics { width: 1280, height: 960, ..lens() })).unwrap_err().to_string();
    assert!(error.contains("camera left") && error.contains("1280x960") && error.contains("640x480"), "{error}");
    // Of the right size, but of another zoom.
    let zoomed = Intrinsics { fx: 750.0, fy: 750.0, ..lens() };
    let message = match solve(&seen, &known("left", zoomed)) {
        Err(error) => error.to_string(),
        Ok(rig) => rig.warnings[0].clone(),
    };
    assert!(message.contains("given intrinsics of left") && message.contains("zoom"), "{message}");
}

/// The matrix of what is free is empty.
#[test]
fn one_camera_whose_lens_is_known_is_told_how_well_it_fits() {
    let options = BoardOptions { known: [("left".into(), lens())].into(), ..options() };
    let rig = solve(&[seen("left", 0.0, 0.0, 0.0)], &options).unwrap();
    let camera = &rig.cameras[0];
    assert!((0.2..0.35).contains(&camera.rms_px.unwrap()) && camera.pose.is_none(), "{camera:?}");
    assert_eq!((camera.intrinsics, rig.cameras.len()), (lens(), 1));
    // And two of which nothing is free but a pose, or nothing at all is asked.
    let seen = [seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)];
    let both = BoardOptions { known: [("left".into(), lens()), ("right".into(), lens())].into(), ..options };
    assert!(solve(&seen, &both).unwrap().cameras[1].pose.is_some());
    let alone = BoardOptions { intrinsics_only: true, ..both };
    assert!(solve(&seen, &alone).unwrap().cameras.iter().all(|camera| camera.pose.is_none()));
}

#[test]
fn a_camera_that_sees_nothing_is_left_out_with_a_note_and_others_by_name() {
    let mut seen = vec![seen("left", 0.0, 0.0, 0.0), seen("middle", 0.3, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)];
    let without = BoardOptions { without: BTreeSet::from(["middle".into()]), ..options() };
    let names = |rig: &RigFile| rig.cameras.iter().map(|camera| camera.name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&solve(&seen, &without).unwrap()), ["left", "right"]);
    let nobody = BoardOptions { without: BTreeSet::from(["centre".into()]), ..options() };
    assert!(solve(&seen, &nobody).unwrap_err().to_string().contains("left, middle, right"));
    seen[1].views.truncate(1);
    let rig = solve(&seen, &options()).unwrap();
    assert_eq!(names(&rig), ["left", "right"]);
    assert!(rig.warnings[0].starts_with("left out: camera middle"), "{:?}", rig.warnings);
    // Of two, nothing is left.
    seen.remove(0);
    assert!(matches!(solve(&seen, &options()), Err(BoardError::TooFewViews { .. })));
}

#[test]
fn a_camera_that_shares_no_board_keeps_its_lens_without_a_pose() {
    let mut seen = vec![seen("left", 0.0, 0.0, 0.0), seen("middle", 0.3, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)];
    seen[0].views.iter_mut().for_each(|view| view.instant = format!("other {}", view.instant));
    let rig = solve(&seen, &options()).unwrap();
    let poses: Vec<(&str, bool)> = rig.cameras.iter().map(|c| (c.name.as_str(), c.pose.is_some())).collect();
    assert_eq!(poses, [("middle", true), ("right", true), ("left", false)]);
    assert!(rig.warnings[0].contains("no pose: left") && (rig.cameras[2].intrinsics.fx - 600.0).abs() < 5.0);
    // Of two, both lenses come with the error.
    seen.truncate(2);
    let Err(BoardError::Apart { alone, .. }) = solve(&seen, &options()) else { panic!("tied") };
    assert!(alone.0.cameras.len() == 2 && (alone.0.cameras[0].intrinsics.fx - 600.0).abs() < 5.0);
    assert!(!alone.1.residuals.is_empty());
}

#[test]
fn the_world_can_be_a_board() {
    let seen = [seen("left", 0.0, 0.0, 0.0), seen("right", 0.5, 0.0, 0.0)];
    let rig = solve(&seen, &BoardOptions { origin: Some("7".into()), ..options() }).unwrap();
    // x along its rows, z out of the sheet, towards the cameras.
    let board_at = waved(0.7, 0.0);
    let axes = Pose { rotation: DQuat::from_rotation_x(std::f64::consts::PI), ..Pose::IDENTITY }.then(&board_at);
    for (camera, angle) in rig.cameras.iter().zip([0.0, 0.5]) {
        let truth = axes.then(&place(angle));
        assert!(camera.pose.unwrap().centre().distance(truth.centre()) < 0.01, "{}", camera.name);
        assert!(camera.pose.unwrap().centre().z > 0.5);
    }
    let error = solve(&seen, &BoardOptions { origin: Some("floor".into()), ..options() }).unwrap_err().to_string();
    assert!(error.contains("floor") && error.contains("0, 1"), "{error}");
}
