//! A run whose dataset is gone: drawn, exported and shown from its folder alone.

use std::{
    fs,
    path::{Path, PathBuf},
};

use erfgs_dataset::Dataset;
use erfgs_run::RunFolder;
use erfgs_splat::{
    gpu::{AdapterChoice, Gpu},
    raster::View,
    trained::TrainedScene,
};
use erfgs_train::{
    checkpoint::Checkpoint,
    scene::Scene,
    trainer::{TrainOptions, Trainer},
};

use super::{Folder, bodies::give_bodies, page::film_small, view::Served};

/// A run by each model of motion, one of them with cameras that were found to stand elsewhere.
const RUNS: [(&str, &str); 4] = [
    ("bodies", "--motion bodies --set bodies.trial=0"),
    (
        "free",
        "--motion free-time --set free_time.knots=2 --set camera_pose.enabled=true --set camera_pose.fewest=3 --set camera_pose.from=0",
    ),
    ("field", "--motion hexplane"),
    ("still", "--motion still"),
];

fn train(folder: &Folder) {
    film_small(folder);
    give_bodies(&folder.path("ds"));
    for (run, how) in RUNS {
        folder.succeed(&format!("train ds --out {run} {how} --iterations 8+12 --no-evaluation -q"));
    }
}

/// A run's trainer, which needs its dataset.
fn trainer<'a>(gpu: &'a Gpu, run: &RunFolder, dataset: &Path) -> Trainer<'a> {
    let checkpoint = Checkpoint::load(&run.checkpoint_file()).expect("a checkpoint");
    let dataset = Dataset::load(dataset).expect("a dataset");
    let scene = Scene::load(dataset, &checkpoint.config, false).expect("a scene");
    Trainer::resume(gpu, scene, checkpoint, &TrainOptions::default()).expect("a trainer")
}

#[test]
fn a_run_is_drawn_from_its_folder_as_its_trainer_draws_it() {
    let folder = Folder::new();
    train(&folder);
    let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
    for (run, _) in RUNS {
        let run = RunFolder::open(folder.path(run)).expect("a run");
        let mut trainer = trainer(&gpu, &run, &folder.path("ds"));
        let moved = trainer.camera_poses().iter().any(|camera| camera.moved_px > 0.0);
        assert_eq!(moved, run.name() == "free", "{}", run.name());
        let mut scene = TrainedScene::open(&gpu, run.root()).expect("a scene");
        assert_eq!(scene.learned(), &trainer.reconstruction().expect("what it learned"), "{}", run.name());
        let cameras: Vec<View> = trainer.scene.views.iter().map(|own| own.view).collect();
        // One that is none of the recording, and larger.
        let [width, height] = [2 * cameras[0].width, 2 * cameras[0].height];
        let [fx, fy, cx, cy] = [cameras[0].fx, cameras[0].fy, cameras[0].cx, cameras[0].cy].map(|of| 2.0 * of);
        let larger = View { width, height, fx, fy, cx, cy, ..cameras[1] };
        for view in cameras.iter().chain([&larger]) {
            for t01 in [0.0, 0.37, 1.0] {
                let [drawn, expected] =
                    [scene.render(view, t01).expect("drawn"), trainer.render(view, t01).expect("drawn")];
                assert!(expected.transmittance.iter().any(|&light| light < 0.9), "something is seen");
                assert_eq!(drawn, expected, "{} at {t01}", run.name());
            }
        }
        let expected = trainer.model.drawn.gaussians_at(&gpu, 0.6).expect("Gaussians");
        assert_eq!(scene.gaussians_at(0.6).expect("Gaussians"), expected);
    }
}

/// The files below a folder, in the order of their names.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
    entries.sort();
    let of = |path: &PathBuf| match path.is_dir() {
        true => files(path),
        false => vec![(path.file_name().expect("a name").display().to_string(), fs::read(path).expect("a file"))],
    };
    entries.iter().flat_map(of).collect()
}

#[test]
fn a_run_without_its_dataset_is_rendered_exported_and_shown() {
    let folder = Folder::new();
    train(&folder);
    let write = |to: &str| {
        fs::create_dir(folder.path(to)).expect("a folder");
        for (run, _) in RUNS {
            folder.succeed(&format!("render {run} --path orbit --frames 3 --out {to}-{run}"));
            folder.succeed(&format!("render {run} --path camera rgb01 --times 0.1 --format exr --out {to}-exr-{run}"));
            folder.succeed(&format!("export {run} --instants 2 --out {to}-ply-{run}"));
            for format in ["html", "e4d", "4dgs", "gltf", "spz"] {
                folder.succeed(&format!("export {run} --to {format} --out {to}/{run}.{format}"));
            }
        }
        let folders = RUNS
            .iter()
            .flat_map(|(run, _)| [format!("{to}-{run}"), format!("{to}-exr-{run}"), format!("{to}-ply-{run}")]);
        folders.chain([to.to_owned()]).flat_map(|name| files(&folder.path(&name))).collect::<Vec<_>>()
    };
    let with = write("with");
    fs::rename(folder.path("ds"), folder.path("elsewhere")).expect("moved");
    let without = write("without");
    assert_eq!(with.len(), without.len());
    for ((name, with), (other, without)) in with.iter().zip(&without) {
        assert!(name == other && with == without, "{name} and {other} differ");
    }
    let served = Served::start(&folder, "bodies field");
    let (status, scene) = served.page.get("/api/scene/0");
    assert!(status == 200 && scene.len() > 1000, "{status}");
    // What compares with recorded frames still needs them.
    assert!(folder.fail(1, "eval free").contains("cannot open the dataset of run free"));
    folder.succeed("eval free --dataset elsewhere --pictures 0");
}

#[test]
fn a_run_of_an_earlier_version_is_opened_with_its_dataset() {
    let folder = Folder::new();
    film_small(&folder);
    folder.succeed("train ds --out run --motion free-time --iterations 8+12 --no-evaluation -q");
    folder.succeed("export run --to e4d --exact --out now.e4d");
    let file = RunFolder::open(folder.path("run")).expect("a run").checkpoint_file();
    let checkpoint = Checkpoint::load(&file).expect("a checkpoint");
    let before = Checkpoint { record: None, points: Vec::new(), ..checkpoint.clone() };
    before.save(&file).expect("saved");
    folder.succeed("export run --to e4d --exact --out before.e4d");
    let [now, then] = ["now.e4d", "before.e4d"].map(|name| fs::read(folder.path(name)).expect("a file"));
    assert!(now == then, "the files differ");

    fs::rename(folder.path("ds"), folder.path("elsewhere")).expect("moved");
    let stderr = folder.fail(1, "export run --to e4d --out none.e4d");
    assert!(
        stderr.contains("earlier version") && stderr.contains("--resume") && stderr.contains("--dataset"),
        "{stderr}"
    );
    folder.succeed("export run --to e4d --dataset elsewhere --out found.e4d");
    // Resuming it writes what was missing.
    folder.succeed("train elsewhere --out run --motion free-time --iterations 8+12 --no-evaluation -q --resume");
    let renewed = Checkpoint::load(&file).expect("a checkpoint");
    assert_eq!((renewed.record, renewed.points), (checkpoint.record, checkpoint.points));
    folder.succeed("export run --to e4d --out renewed.e4d");
}
