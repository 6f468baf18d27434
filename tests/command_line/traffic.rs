//! How much passes between the host and a graphics processor in an iteration, counted on the form of the kernels that runs there.

use std::sync::atomic::{AtomicBool, Ordering};

use erfgs_dataset::Dataset;
use erfgs_run::RunFolder;
use erfgs_splat::gpu::{AdapterChoice, Gpu, Shape, Traffic};
use erfgs_train::{
    config::{Config, Method, MotionModel, Preset},
    scene::Scene,
    trainer::{Progress, TrainOptions, Trainer},
};

use super::{
    Folder,
    bodies::give_bodies,
    page::{film_of, film_small},
};

/// What passes in the fine iterations 12 to 25 of training on a dataset while the cameras' `poses` are learned or not: in all, the most in one,
/// and how many Gaussians there are.
fn counted(folder: &Folder, ds: &str, method: Method, points: u32, poses: bool) -> (Traffic, Traffic, u32) {
    let mut config = Config::preset(method, Preset::Default);
    (config.coarse_iterations, config.fine_iterations) = (5, 25);
    config.init.max_points = points;
    config.density.from = 1000;
    config.eds.enabled = false;
    (config.camera_pose.enabled, config.camera_pose.fewest) = (poses, 3);
    config.evaluation.leave_alone();
    config.evaluation.log_every = u32::MAX;
    let dataset = Dataset::load(&folder.path(ds)).expect("a dataset");
    config.settle(&dataset, false).expect("settings");
    let scene = Scene::load(dataset, &config, false).expect("a scene");
    let gpu = Gpu::open(&AdapterChoice { name: None, shape: Some(Shape::Gpu) }).expect("an adapter");
    let options = TrainOptions { evaluate: false, ..TrainOptions::default() };
    let mut trainer = Trainer::new(&gpu, scene, config, &options).expect("a trainer");
    let run = RunFolder::new(folder.path(&format!("{ds}-{method:?}-{points}-{poses}")));
    let warm = AtomicBool::new(false);
    let mut watch = |now: &Progress| warm.store(now.iteration >= 15, Ordering::Relaxed);
    trainer.run(&run, &options, &warm, &mut watch).expect("a warm-up");
    trainer.times.count();
    trainer.run(&run, &options, &AtomicBool::new(false), &mut |_: &Progress| {}).expect("a training");
    (trainer.times.traffic, trainer.times.most, trainer.model.drawn.gaussians.count)
}

/// What a training of 4 and 9 iterations on a dataset saves, and how often it submitted, where recordings are handed over together or each
/// stage is waited for.
fn trained(folder: &Folder, ds: &str, mut config: Config, together: bool) -> (Vec<u8>, u64) {
    (config.coarse_iterations, config.fine_iterations) = (4, 9);
    config.init.max_points = 150;
    config.evaluation.leave_alone();
    config.evaluation.log_every = 3;
    let dataset = Dataset::load(&folder.path(ds)).expect("a dataset");
    config.settle(&dataset, false).expect("settings");
    let scene = Scene::load(dataset, &config, false).expect("a scene");
    let gpu = Gpu::open(&AdapterChoice { name: None, shape: Some(Shape::Gpu) }).expect("an adapter");
    let options = TrainOptions { evaluate: false, deterministic: true, ..TrainOptions::default() };
    let mut trainer = Trainer::new(&gpu, scene, config, &options).expect("a trainer");
    if !together {
        trainer.times.start();
    }
    let scratch = Folder::new();
    let run = RunFolder::new(scratch.path("run"));
    let before = gpu.traffic();
    trainer.run(&run, &options, &AtomicBool::new(false), &mut |_: &Progress| {}).expect("a training");
    let submissions = gpu.traffic().since(before).submissions;
    (std::fs::read(run.checkpoint_file()).expect("a checkpoint"), submissions)
}

#[test]
fn recordings_that_are_handed_over_together_teach_the_same() {
    let folder = Folder::new();
    film_small(&folder);
    film_of(&folder, "carried", [64, 48]);
    give_bodies(&folder.path("carried"));
    let preset = Config::preset;
    let moving = |motion| Config { motion, ..preset(Method::ErfGs, Preset::Default) };
    let poses = |mut config: Config| {
        (config.camera_pose.enabled, config.camera_pose.fewest, config.camera_pose.from) = (true, 3, 0.0);
        config
    };
    let mut bodies = moving(MotionModel::Bodies);
    (bodies.bodies.trial, bodies.bodies.exposure) = (0, 4);
    for (what, ds, config) in [
        ("4DGS", "ds", poses(preset(Method::FourDgs, Preset::Default))),
        ("free in time", "ds", moving(MotionModel::FreeTime)),
        ("bodies", "carried", poses(bodies)),
        ("the paper", "ds", preset(Method::ErfGs, Preset::Paper)),
    ] {
        let (by_one, many) = trained(&folder, ds, config.clone(), false);
        let (at_once, few) = trained(&folder, ds, config, true);
        assert!(at_once == by_one, "{what}");
        assert!(few < many, "{what}: {few} and {many} submissions");
    }
}

/// Iterations that are counted.
const ITERATIONS: u64 = 14;

#[test]
fn little_passes_between_host_and_graphics_processor_in_an_iteration() {
    let folder = Folder::new();
    film_small(&folder);
    for (method, renderings) in [(Method::FourDgs, ITERATIONS), (Method::ErfGs, 2 * ITERATIONS)] {
        let (few, _, gaussians) = counted(&folder, "ds", method, 50, false);
        let (many, _, more) = counted(&folder, "ds", method, 400, false);
        assert!(gaussians < more, "{gaussians} and {more}");
        for (traffic, gaussians) in [(few, gaussians), (many, more)] {
            let each = |sum: u64| sum as f64 / ITERATIONS as f64;
            let case = format!("{method:?}, {gaussians} Gaussians: {traffic:?}");
            // The host reads how many tiles the rendering before covered, and nothing else: no parameter, no gradient.
            assert!(traffic.maps > 0 && traffic.maps <= renderings && traffic.read <= 64 * renderings, "{case}");
            // What is drawn; what it says, and drawing the events of the iteration; what these say, and the step.
            let most = if method == Method::FourDgs { 2 } else { 3 };
            assert!((2 * ITERATIONS..=most * ITERATIONS).contains(&traffic.submissions), "{case}");
            assert!((20.0..=130.0).contains(&each(traffic.dispatches)), "{case}");
            // What the kernels are told. A frame would take 9 kB.
            assert!(each(traffic.written) <= 6000.0, "{case}");
        }
        assert_eq!(few.read / few.maps, 64);
        // What passes is as much whatever is trained.
        assert_eq!((few.maps, few.submissions, few.written), (many.maps, many.submissions, many.written));
        // Poses take eight numbers of each camera, once in as many iterations as there are cameras that take frames.
        let (posed, ..) = counted(&folder, "ds", method, 50, true);
        let [maps, read] = [posed.maps - few.maps, posed.read - few.read];
        assert!((1..=ITERATIONS / 3).contains(&maps) && read <= maps * 32 * 16, "{posed:?} and {few:?}");
    }
}

#[test]
fn nothing_of_the_size_of_an_image_is_written_in_an_iteration() {
    let folder = Folder::new();
    // Four bytes a pixel would be 12 kB and 77 kB.
    let sizes = [("small", [64, 48]), ("large", [160, 120])];
    sizes.iter().for_each(|(name, size)| film_of(&folder, name, *size));
    for method in [Method::FourDgs, Method::ErfGs] {
        let [small, large] = sizes.map(|(name, _)| {
            let (all, most, _) = counted(&folder, name, method, 400, false);
            assert!(most.written > 0 && most.written <= 64 << 10, "{method:?}, {name}: {most:?} in one iteration");
            assert!(most.submissions <= 3 && most.written * ITERATIONS >= all.written, "{method:?}, {name}: {most:?}");
            all
        });
        // The kernels are told no more of a larger image; of how many pieces counts are added up depends on the events.
        assert!(large.written.abs_diff(small.written) <= 200 * ITERATIONS, "{method:?}: {small:?} and {large:?}");
        assert_eq!(large.submissions, small.submissions, "{method:?}");
    }
    // The benchmark tells it. A deformation field would be asked for numbers that are none in each step.
    let figures =
        folder.figures("bench train large --iterations 10 --shape gpu --set motion=free-time --set density.from=1000 --set eds.enabled=false");
    let figure = |key: &str| figures["an_iteration"][key].as_f64().unwrap_or_else(|| panic!("no {key} in {figures}"));
    let most = figure("bytes_written_most");
    assert!(most <= 65536.0 && (100.0..=most).contains(&figure("bytes_written")), "{figures}");
    assert!((1.0..=3.0).contains(&figure("submissions")) && figure("maps") > 0.0, "{figures}");
    let [cpu, thread] =
        ["cpu_ms_an_iteration", "thread_ms_an_iteration"].map(|key| figures[key].as_f64().expect("milliseconds"));
    assert!(thread > 0.1 && thread <= cpu, "{figures}");
}
