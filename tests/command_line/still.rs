use std::fs;

use erfgs_base::random;
use erfgs_dataset::Split;
use erfgs_scene::ImageRgb8;
use erfgs_stage::{FilmOptions, RigOptions, StageOptions, film};
use serde_json::Value;

use crate::command_line::Folder;

/// Levels by which the frames of the empty room are noisy, either way.
const NOISE: f64 = 4.0;

/// The room without what moves in it, seen by four noisy cameras, two event cameras with noise of their own, and a held-out camera.
fn empty_room(folder: &Folder) {
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, empty: true, ..StageOptions::default() },
        rig: RigOptions { width: 48, height: 36, rgb: 4, event: 2, test: 1, ..RigOptions::default() },
        duration_ns: 300_000_000,
        rgb_fps: 20.0,
        test_fps: 20.0,
        truth_points: 0,
        ..FilmOptions::default()
    };
    let mut dataset = film(&folder.path("ds"), &options, &|_| {}).expect("a film").dataset;
    for (camera, of) in dataset.cameras(Split::Train).enumerate() {
        for (frame, file) in of.frames.iter().enumerate() {
            let image = dataset.read_image(of, file).expect("a frame");
            let noisy = |(at, &value): (usize, &u8)| {
                let key = random::key(1, &[camera as u64, frame as u64, at as u64]);
                (f64::from(value) + random::range(key, -NOISE, NOISE)).round().clamp(0.0, 255.0) as u8
            };
            let data = image.data.iter().enumerate().map(noisy).collect();
            let image = ImageRgb8 { data, ..image };
            image.write_png(&dataset.path(&file.file).expect("a path")).expect("written");
        }
    }
    dataset.hash_files().expect("hashes");
    dataset.save().expect("saved");
    folder.succeed("dataset points ds --method random --random-points 400");
}

fn motion(folder: &Folder, run: &str) -> String {
    let config = fs::read_to_string(folder.path(run).join("config.toml")).expect("a configuration");
    let line = config.lines().find(|line| line.starts_with("motion = ")).expect("a motion model");
    line.trim_start_matches("motion = ").trim_matches('"').to_owned()
}

#[test]
fn a_scene_in_which_nothing_moves_is_trained_as_one() {
    let folder = Folder::new();
    empty_room(&folder);
    folder.succeed("train ds --iterations 40+40 --out run");
    assert_eq!(motion(&folder, "run"), "still");
    let info: Value =
        serde_json::from_slice(&fs::read(folder.path("run").join("run.json")).expect("told")).expect("JSON");
    let left_out: Vec<&str> =
        info["left_out"].as_array().expect("a list").iter().filter_map(|left| left["what"].as_str()).collect();
    for what in ["motion", "the event loss and event-guided densification"] {
        assert!(left_out.contains(&what), "{left_out:?}");
    }
    let curve = fs::read_to_string(folder.path("run").join("curve.csv")).expect("a curve");
    let column =
        curve.lines().next().expect("names").split(',').position(|name| name == "loss_event").expect("a column");
    assert!(curve.lines().skip(1).all(|line| line.split(',').nth(column) == Some("")), "{curve}");

    // What was saved goes on, is measured, and can be shown.
    folder.succeed("train ds --iterations 40+80 --resume --change --out run");
    let figures = folder.figures("eval run");
    assert_eq!(figures["iterations"].as_u64(), Some(120), "{figures}");
    assert!(figures["psnr"].as_f64() > Some(10.0), "{figures}");
    folder.succeed("export run --to e4d --out still.e4d");

    // It may be told otherwise.
    folder.succeed("train ds --iterations 1+1 --motion hexplane --out field");
    assert_eq!(motion(&folder, "field"), "hexplane");
}

#[test]
fn where_something_moves_no_points_of_it_are_needed_to_see_that() {
    let folder = Folder::with_stage("ds");
    folder.succeed("dataset points ds --method random --random-points 200 --moving 0");
    folder.succeed("train ds --iterations 1+1 --out run");
    assert_eq!(motion(&folder, "run"), "hexplane");
    folder.succeed("train ds --iterations 1+1 --motion still --out told");
    assert_eq!(motion(&folder, "told"), "still");
}
