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
fn apart(folder: &Folder, told: &[CameraTime]) -> f64 {
    let [truth, off] = ["ds", "off"].map(|name| Dataset::load(&folder.path(name)).expect("a dataset"));
    let errors: Vec<f64> = truth
        .cameras(Split::Train)
        .zip(off.cameras(Split::Train))
        .map(|(truth, off)| {
            let found = told.iter().find(|of| of.camera == off.name).map_or(0.0, |of| of.late_ms);
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
    let told = RunFolder::open(folder.path("found")).expect("a run").read_info().expect("told").camera_times;
    let (before, after) = (apart(&folder, &[]), apart(&folder, &told));
    println!("{before} ms apart before, {after} after");
    assert_eq!(told.len(), 8);
    assert!(after < 0.4 * before, "{after} ms apart, {before} before");
}
