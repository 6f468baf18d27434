//! Cameras that do not run together: offsets and their deviations, against sequences of which they are known.

use std::collections::BTreeMap;

use erfgs_base::random;
use erfgs_calibrate::board::{
    BoardDetections, BoardError, BoardOptions, BoardView, Corner, LensModel, Target, calibrate,
};
use erfgs_scene::{Distortion, Intrinsics, Pose, rig_file::RigFile};
use glam::{DQuat, DVec2, DVec3};

const LENS: Intrinsics =
    Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 322.0, cy: 238.0, distortion: Distortion::None };
const NAMES: [&str; 3] = ["left", "middle", "right"];

fn board() -> Target {
    "chessboard:5x4:0.05".parse().unwrap()
}

fn place(camera: usize) -> Pose {
    let angle = [0.0_f64, 0.35, -0.4][camera];
    Pose::look_at(DVec3::new(angle.sin(), 0.1, -angle.cos()) * 1.2, DVec3::ZERO, DVec3::Y)
}

/// A sequence: how late each camera's frames are, how much each of them differs from that, and how often they come.
struct Sequence {
    seed: u64,
    late_s: [f64; 3],
    jitter_s: f64,
    period_s: f64,
    frames: u64,
}

impl Sequence {
    /// Where the board is: waved by a hand, differently in each sequence.
    fn waved(&self, t: f64) -> Pose {
        let wave = |of: u64, size: f64| -> f64 {
            let part = |k: u64| {
                let draw = |n, from, to| random::range(random::key(self.seed, &[of, k, n]), from, to);
                (draw(0, 0.6, 3.0) * t + draw(1, 0.0, 6.3)).sin() * size / 2.0
            };
            part(0) + part(1) + part(2)
        };
        let rotation = DQuat::from_scaled_axis(DVec3::new(wave(0, 0.5), wave(1, 0.5), wave(2, 0.4)));
        let at = DVec3::new(wave(3, 0.12), wave(4, 0.1), wave(5, 0.12));
        Pose { rotation, translation: at - rotation * DVec3::new(0.1, 0.075, 0.0) }
    }

    fn seen(&self) -> Vec<BoardDetections> {
        let of_camera = |camera: usize| {
            let view = |number: u64| {
                let drawn = |of: u64| random::key(self.seed, &[1000 + camera as u64, number, of]);
                let time_s = self.period_s * (number as f64 + 0.3 * random::uniform(drawn(0)));
                let true_s = time_s - self.late_s[camera] + self.jitter_s * random::normal(drawn(1));
                let pose = self.waved(true_s);
                let corner = |id: u32| {
                    let key = random::extend(drawn(2), u64::from(id));
                    let noise = DVec2::new(random::normal(key), random::normal(random::extend(key, 1))) * 0.2;
                    let point = place(camera).transform(pose.transform(board().point(id).unwrap()));
                    Corner { id, pixel: LENS.project(point).unwrap() + noise }
                };
                let corners = (0..20).map(corner).collect();
                let file = "drawn".into();
                BoardView { instant: number.to_string(), time_s: Some(time_s), file, frame: number, corners }
            };
            let (camera, views) = (NAMES[camera].into(), (0..self.frames).map(view).collect());
            BoardDetections {
                camera,
                size: [640, 480],
                frames: self.frames as usize,
                views,
                ..BoardDetections::default()
            }
        };
        (0..3).map(of_camera).collect()
    }
}

fn known() -> BTreeMap<String, Intrinsics> {
    NAMES.map(|name| (name.to_owned(), LENS)).into()
}

fn solve(sequence: &Sequence, options: &BoardOptions) -> Result<RigFile, BoardError> {
    calibrate(&sequence.seen(), &board(), options, &|_, _, _| {}).map(|(rig, _)| rig)
}

/// What the offsets and centres of a rig are off by, in stated deviations; and the largest error of an offset, seconds.
fn errors(rig: &RigFile, sequence: &Sequence) -> (Vec<f64>, f64) {
    let (mut ratios, mut most_s) = (Vec::new(), 0.0_f64);
    for camera in 1..3 {
        let found = &rig.cameras[camera];
        let sigma = found.sigma.as_ref().unwrap();
        // What to add to its times to get the first camera's.
        let truth = sequence.late_s[0] - sequence.late_s[camera];
        let off = found.time_offset_s - truth;
        most_s = most_s.max(off.abs());
        ratios.push(off / sigma.time_offset_s.unwrap());
        let there = place(0).inverse().then(&place(camera)).centre();
        let apart = found.pose.unwrap().centre() - there;
        ratios.extend((0..3).map(|axis| apart[axis] / sigma.centre_m[axis].unwrap()));
    }
    (ratios, most_s)
}

#[test]
fn offsets_are_found_and_deviations_cover_what_they_are_off_by() {
    let options =
        BoardOptions { model: LensModel::Pinhole, known: known(), time_offsets: true, ..BoardOptions::default() };
    for (what, jitter_s, period_s, most_ms, limit) in [
        ("30 a second", 0.0, 0.033, 2.0, 1.5),
        ("6 a second", 0.0, 0.167, 8.0, 1.5),
        ("6 a second, each frame off by 20 ms", 0.02, 0.167, 25.0, 1.5),
    ] {
        let (mut all, mut most_s) = (Vec::new(), 0.0_f64);
        for seed in 0..8 {
            let draw = |of: u64| random::range(random::key(seed, &[90, of]), -0.11, 0.11);
            let frames = if period_s < 0.1 { 90 } else { 45 };
            let sequence = Sequence { seed, late_s: [draw(0), draw(1), draw(2)], jitter_s, period_s, frames };
            let rig = solve(&sequence, &options).unwrap();
            let (ratios, off_s) = errors(&rig, &sequence);
            println!("  {seed}: {ratios:.1?}, {:.2} ms", 1e3 * off_s);
            all.extend(ratios);
            most_s = most_s.max(off_s);
        }
        let rms = (all.iter().map(|ratio| ratio * ratio).sum::<f64>() / all.len() as f64).sqrt();
        let within = all.iter().filter(|ratio| ratio.abs() < 2.0).count() as f64 / all.len() as f64;
        println!(
            "{what}: {rms:.2} deviations (rms), {:.0} % within two, {:.2} ms at most",
            100.0 * within,
            1e3 * most_s
        );
        assert!(1e3 * most_s < most_ms && rms < limit && within > 0.8, "{what}: {most_s} {rms} {within}");
    }
}

#[test]
fn offsets_are_tried_by_themselves_where_residuals_grow_with_speed() {
    let sequence = Sequence { seed: 3, late_s: [0.0, 0.105, -0.033], jitter_s: 0.0, period_s: 0.1, frames: 60 };
    for options in [
        BoardOptions { model: LensModel::Pinhole, known: known(), ..BoardOptions::default() },
        BoardOptions { model: LensModel::Pinhole, ..BoardOptions::default() },
    ] {
        let rig = solve(&sequence, &options).unwrap();
        println!("{:#?}", rig.warnings);
        assert!(rig.warnings.iter().any(|warning| warning.contains("do not run together")), "{:?}", rig.warnings);
        let (ratios, off_s) = errors(&rig, &sequence);
        assert!(off_s < 4e-3 && ratios.iter().all(|ratio| ratio.abs() < 4.0), "{off_s} {ratios:?}");
    }
    // Without times nobody can estimate them, and that is what is said.
    let mut untimed = sequence.seen();
    untimed.iter_mut().flat_map(|seen| &mut seen.views).for_each(|view| view.time_s = None);
    let options = BoardOptions { model: LensModel::Pinhole, ..BoardOptions::default() };
    let error = calibrate(&untimed, &board(), &options, &|_, _, _| {}).unwrap_err().to_string();
    println!("{error}");
    assert!(error.contains("timestamps.csv") && error.contains("Tried"), "{error}");
}
