//! Whether standard deviations cover what they claim to.

use erfgs_base::random;
use erfgs_calibrate::{
    board::{BoardDetections, BoardOptions, BoardView, Corner, LensModel, Target, calibrate, look, single},
    bundle::Loss,
};
use erfgs_scene::{Distortion, Intrinsics, Pose, rig_file::RigFile};
use glam::{DQuat, DVec2, DVec3};

use super::chessboards::{folder, target};
use crate::halves::{differences, in_deviations};

const LENS: Intrinsics =
    Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 322.0, cy: 238.0, distortion: Distortion::None };

/// Twenty views of a board that is bent by up to 2 mm, another way in each view: an error that all corners of a view share.
fn bent(seed: u64) -> (BoardDetections, Target) {
    let board: Target = "chessboard:8x5:0.03".parse().unwrap();
    let view = |number: u64| {
        let draw = |of: u64, from, to| random::range(random::key(seed, &[number, of]), from, to);
        let rotation = DQuat::from_scaled_axis(DVec3::new(draw(0, -0.7, 0.7), draw(1, -0.7, 0.7), draw(2, -0.5, 0.5)));
        let at = DVec3::new(draw(3, -0.15, 0.15), draw(4, -0.1, 0.1), draw(5, 0.4, 0.8));
        let pose = Pose { rotation, translation: at - rotation * DVec3::new(0.105, 0.06, 0.0) };
        let bend = draw(6, -0.002, 0.002);
        let corner = |id: u32| {
            let mut point = board.point(id).unwrap();
            point.z = bend * ((point.x - 0.105) / 0.105).powi(2);
            let key = random::key(seed, &[number, 100 + u64::from(id)]);
            let noise = DVec2::new(random::normal(key), random::normal(random::extend(key, 1))) * 0.1;
            Corner { id, pixel: LENS.project(pose.transform(point)).unwrap() + noise }
        };
        let corners = (0..40).map(corner).collect();
        BoardView { instant: number.to_string(), time_s: None, file: "drawn".into(), frame: 0, corners }
    };
    let views = (0..20).map(view).collect();
    (BoardDetections { camera: "a".into(), size: [640, 480], frames: 20, views, ..BoardDetections::default() }, board)
}

#[test]
fn what_all_corners_of_a_view_share_is_in_the_deviations() {
    let (mut squares, mut promised, mut count, mut within) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..12 {
        let (seen, board) = bent(seed);
        let found = single(&seen, &board, LensModel::Pinhole, false).unwrap();
        let i = found.bundle.cameras[0].intrinsics;
        let each_its_own = found.bundle.uncertainty(Loss::Squared).unwrap();
        let off = [i.fx - LENS.fx, i.fy - LENS.fy, i.cx - LENS.cx, i.cy - LENS.cy];
        for ((off, sigma), own) in
            off.iter().zip(&found.uncertainty.cameras[0].sigma).zip(&each_its_own.cameras[0].sigma)
        {
            squares += (off / sigma).powi(2);
            promised += (off / own).powi(2);
            within += f64::from(u8::from(off.abs() < 2.0 * sigma));
            count += 1.0;
        }
    }
    let (rms, before) = (f64::sqrt(squares / count), f64::sqrt(promised / count));
    println!(
        "errors are {rms:.2} deviations (rms), {before:.2} of those that take each corner for itself; {:.0} % within two",
        100.0 * within / count
    );
    assert!(rms < 1.3 && within / count > 0.85, "{rms} {}", within / count);
    assert!(before > 1.7, "the case shows nothing: {before}");
}

#[test]
fn halves_of_a_recording_agree_within_their_deviations() {
    let seen = look(&folder(), &target(), None, &|_, _| {}).unwrap();
    let options = BoardOptions { model: LensModel::Brown4, ..BoardOptions::default() };
    let half = |odd: usize| -> RigFile {
        let part = |seen: &BoardDetections| BoardDetections {
            views: seen.views.iter().enumerate().filter(|(n, _)| n % 2 == odd).map(|(_, view)| view.clone()).collect(),
            ..seen.clone()
        };
        let seen: Vec<BoardDetections> = seen.iter().map(part).collect();
        calibrate(&seen, &target(), &options, &|_, _, _| {}).unwrap().0
    };
    let differences = differences(&half(0), &half(1));
    let within = differences.iter().filter(|(_, off, sigma)| off.abs() < 2.0 * sigma).count();
    assert!(10 * within >= 8 * differences.len(), "{within} of {}", differences.len());
    let [rms, most] = in_deviations("odd and even pictures", &differences);
    assert!(rms < 1.0 && most < 2.5, "{rms} {most}");
}
