use std::collections::BTreeMap;

use erfgs_dataset::{Dataset, Split};
use erfgs_scene::{ImageRgb8, PointCloud};
use erfgs_stage::{FilmOptions, RigOptions, StageOptions, film};

use crate::command_line::Folder;

/// Gains of the training cameras; in the mean they are 1.
const GAINS: [[f32; 3]; 6] = [
    [0.80, 1.00, 1.20],
    [1.20, 1.00, 0.80],
    [0.90, 0.85, 0.95],
    [1.10, 1.15, 1.05],
    [0.85, 1.10, 1.00],
    [1.15, 0.90, 1.00],
];

/// Six cameras that do not agree on colours and a held-out one that sees them as they are, before the true surfaces.
fn film_with_gains(folder: &Folder) {
    let options = FilmOptions {
        stage: StageOptions { samples_per_axis: 1, ..StageOptions::default() },
        rig: RigOptions { width: 80, height: 60, rgb: 6, event: 0, test: 1, ..RigOptions::default() },
        duration_ns: 100_000_000,
        exposure_ns: 0,
        rgb_fps: 30.0,
        test_fps: 30.0,
        truth_points: 3000,
        ..FilmOptions::default()
    };
    film(&folder.path("ds"), &options, &|_| {}).expect("a film");
    let mut dataset = Dataset::load(&folder.path("ds")).expect("a dataset");
    let training = dataset.manifest.cameras.iter().filter(|camera| camera.split == Split::Train);
    for (camera, gain) in training.zip(GAINS) {
        for frame in &camera.frames {
            let image = dataset.read_image(camera, frame).expect("a frame");
            let shown = |(at, &value): (usize, &u8)| (f32::from(value) * gain[at % 3]).round().min(255.0) as u8;
            let data = image.data.iter().enumerate().map(shown).collect();
            let image = ImageRgb8 { data, ..image };
            image.write_png(&dataset.path(&frame.file).expect("a path")).expect("written");
        }
    }
    let cloud = PointCloud::read(&folder.path("ds").join("truth_points.ply")).expect("points");
    dataset.set_points(&cloud, "truth", BTreeMap::new()).expect("points");
    dataset.hash_files().expect("hashes");
    dataset.save().expect("saved");
}

#[test]
fn cameras_that_do_not_agree_on_colours_are_told_apart() {
    let folder = Folder::new();
    film_with_gains(&folder);
    let train = "train ds --method 4dgs --iterations 500+0 --set dynamic.coarse_without_moving=false";
    let matched = folder.figures(&format!("{train} --out matched"));
    let plain = folder.figures(&format!("{train} --set camera_colour.enabled=false --out plain"));
    let psnr = |figures: &serde_json::Value| figures["psnr"].as_f64().expect("a PSNR");
    assert!(psnr(&matched) > psnr(&plain) + 0.3, "{} against {} dB", psnr(&matched), psnr(&plain));

    let run = erfgs_run::RunFolder::open(folder.path("matched")).expect("a run").read_info().expect("told");
    assert_eq!(run.camera_colours.len(), GAINS.len());
    let grey = |colour: &erfgs_run::CameraColour| -> [f32; 3] {
        std::array::from_fn(|c| 0.5 * colour.gain[c] + colour.offset[c])
    };
    for (colour, gain) in run.camera_colours.iter().zip(GAINS) {
        for (found, gain) in grey(colour).into_iter().zip(gain) {
            assert!((found - 0.5 * gain).abs() < 0.03, "{colour:?} against {gain}");
        }
    }
    assert!(folder.succeed("report matched plain --out report.html").contains("report.html"));
    let page = std::fs::read_to_string(folder.path("report.html")).expect("a page");
    assert!(page.contains("Colours of the cameras") && page.contains("rgb05"));
}
