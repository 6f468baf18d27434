use erfgs_dataset::{Dataset, Split};
use erfgs_run::{CameraTime, RunFolder};
use erfgs_stage::{FilmOptions, RigOptions, StageOptions, film};

use crate::command_line::Folder;

/// What moves in the room, from eight cameras whose frames say that they were taken up to twelve milliseconds from when they were, and
/// from two that are held out.
fn film_at_other_times(folder: &Folder) {
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 96, height: 72, rgb: 8, event: 0, test: 2, ..RigOptions::default() },
        duration_ns: 400_000_000,
        exposure_ns: 0,
        rgb_fps: 20.0,
        test_fps: 20.0,
        truth_points: 4000,
        ..FilmOptions::default()
    };
    film(&folder.path("ds"), &options, &|_| {}).expect("a film");
    folder.succeed("dataset points ds --method random --random-points 3000");
    folder.succeed("dataset disturb ds --frame-clock-us 12000 --out off");
}

/// How far the times of cameras are from the truth, milliseconds, beside each other: root mean square from their mean.
fn apart(folder: &Folder, times: &[CameraTime]) -> f64 {
    let [truth, off] = ["ds", "off"].map(|name| Dataset::load(&folder.path(name)).expect("a dataset"));
    let errors: Vec<f64> = truth
        .cameras(Split::Train)
        .zip(off.cameras(Split::Train))
        .map(|(truth, off)| {
            let found = times.iter().find(|of| of.camera == off.name).map_or(0.0, |of| of.late_ms);
            1e-6 * (off.frames[0].t_ns - truth.frames[0].t_ns) as f64 + found
        })
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let square = errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / errors.len() as f64;
    square.sqrt()
}

#[test]
fn cameras_that_look_at_other_times_are_found() {
    let folder = Folder::new();
    film_at_other_times(&folder);
    folder.succeed(
        "train off --method 4dgs --iterations 100+500 --no-evaluation --set camera_colour.enabled=false \
         --set camera_pose.enabled=false --set camera_time.rate=[0.04,0.002] --out found",
    );
    let times = RunFolder::open(folder.path("found")).expect("a run").read_info().expect("told").camera_times;
    let (before, after) = (apart(&folder, &[]), apart(&folder, &times));
    println!("{before} ms apart before, {after} after");
    assert_eq!(times.len(), 8);
    assert!(after < 0.4 * before, "{after} ms apart, {before} before");
}

#[test]
fn event_cameras_that_answer_late_are_found() {
    let folder = Folder::new();
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 96, height: 72, rgb: 4, event: 2, test: 1, ..RigOptions::default() },
        duration_ns: 300_000_000,
        exposure_ns: 0,
        rgb_fps: 40.0,
        test_fps: 20.0,
        truth_points: 4000,
        ..FilmOptions::default()
    };
    film(&folder.path("ds"), &options, &|_| {}).expect("a film");
    folder.succeed("dataset points ds --method random --random-points 3000");
    folder.succeed("dataset disturb ds --event-clock-us 6000 --out late");
    let found = |dataset: &str| -> Vec<f64> {
        folder.succeed(&format!(
            "train {dataset} --iterations 100+500 --no-evaluation --set camera_time.events=true \
             --set camera_time.rate=[0.08,0.004] --out {dataset}-run"
        ));
        let run = RunFolder::open(folder.path(&format!("{dataset}-run"))).expect("a run");
        let times = run.read_info().expect("what was learned").camera_times;
        // Four frame cameras are too few for theirs.
        assert!(times.iter().all(|time| time.camera.starts_with("event")), "{times:?}");
        times.iter().map(|time| time.late_ms).collect()
    };
    let (right, late) = (found("ds"), found("late"));
    println!("{right:?} ms of clocks that are right, {late:?} of clocks that are 6 ms late");
    assert_eq!((right.len(), late.len()), (2, 2));
    for (right, late) in right.iter().zip(&late) {
        // Counts of whole thresholds lag behind the light, with clocks that are right, too.
        assert!(right.abs() < 3.0 && (late - right + 6.0).abs() < 2.0);
    }
}
