//! What a training takes of its device's memory is foretold: bytes of buffers, counted on both forms of the kernels.

use std::sync::atomic::AtomicBool;

use erfgs_dataset::Dataset;
use erfgs_run::RunFolder;
use erfgs_splat::gpu::{AdapterChoice, Gpu, Shape};
use erfgs_train::{
    config::{Config, Method, MotionModel, Preset},
    scene::Scene,
    trainer::{DeviceMemory, Progress, TrainOptions, Trainer},
};

use super::{Folder, bodies::give_bodies, page::film_of};

/// What is foretold is no more than this many times what was taken. In pictures of 96 x 72 pixels what is rounded up weighs most.
const FACTOR: f64 = 2.0;
/// Gaussians that the settings allow: trainings here come to have nearly all of them.
const ALLOWED: u32 = 2000;

/// What was foretold for a training, what it took, and how many Gaussians it had at most.
fn trained(folder: &Folder, ds: &str, mut config: Config, shape: Shape) -> (DeviceMemory, u64, u32) {
    (config.coarse_iterations, config.fine_iterations) = (8, 16);
    (config.density.from, config.density.every, config.density.until) = (2, 2, 1.0);
    (config.density.gradient_threshold, config.density.prune_above) = (0.0, u32::MAX);
    (config.density.max_gaussians, config.eds.max_gaussians) = (ALLOWED, ALLOWED);
    (config.eds.from, config.eds.every, config.eds.until, config.eds.count) = (5, 5, 1.0, 50);
    (config.bodies.trial, config.bodies.spacing_px) = (0, 0.0);
    config.evaluation.leave_alone();
    config.evaluation.log_every = 10;
    let dataset = Dataset::load(&folder.path(ds)).expect("a dataset");
    config.settle(&dataset, false).expect("settings");
    let scene = Scene::load(dataset, &config, false).expect("a scene");
    let gpu = Gpu::open(&AdapterChoice { name: None, shape: Some(shape) }).expect("an adapter");
    let before = gpu.memory_taken().expect("a count");
    gpu.watch_memory();
    let options = TrainOptions { evaluate: true, ..TrainOptions::default() };
    let mut trainer = Trainer::new(&gpu, scene, config, &options).expect("a trainer");
    let foretold = trainer.device_memory().expect("an estimate");
    let scratch = Folder::new();
    let mut most = 0;
    let mut watch = |now: &Progress| most = most.max(now.gaussians);
    trainer
        .run(&RunFolder::new(scratch.path("run")), &options, &AtomicBool::new(false), &mut watch)
        .expect("a training");
    (foretold, gpu.most_memory_taken().expect("a count") - before, most)
}

#[test]
fn what_a_training_takes_of_a_device_is_foretold() {
    let folder = Folder::new();
    let sizes = [("small", [96, 72]), ("large", [320, 240])];
    for (name, size) in sizes {
        film_of(&folder, name, size);
        give_bodies(&folder.path(name));
    }
    let moving = |motion| Config { motion, ..Config::preset(Method::ErfGs, Preset::Default) };
    let mut bodies = moving(MotionModel::Bodies);
    bodies.bodies.exposure = 3;
    let mut wrong = Vec::new();
    // Each motion model, each form of the kernels and a larger picture, but not each with each, which takes minutes.
    for shape in [Shape::Cpu, Shape::Gpu] {
        for (what, config) in [
            ("4DGS", Config::preset(Method::FourDgs, Preset::Default)),
            ("free in time", moving(MotionModel::FreeTime)),
            ("bodies", bodies.clone()),
            ("the paper", Config::preset(Method::ErfGs, Preset::Paper)),
        ] {
            for (ds, _) in sizes {
                let is_small_work = match shape {
                    Shape::Cpu => ds == "small" || what == "bodies",
                    Shape::Gpu => ds == "small" && ["bodies", "the paper"].contains(&what),
                };
                if !is_small_work {
                    continue;
                }
                let (foretold, taken, gaussians) = trained(&folder, ds, config.clone(), shape);
                let [begun, allowed] = foretold.gaussians;
                let ratio = foretold.most as f64 / taken as f64;
                let line = format!(
                    "{what}, {ds}, {shape:?}: {:.1} to {:.1} MB for {begun} to {allowed} Gaussians; {:.1} MB taken with {gaussians}: {ratio:.2}",
                    foretold.start as f64 * 1e-6,
                    foretold.most as f64 * 1e-6,
                    taken as f64 * 1e-6
                );
                println!("{line}");
                let grown = begun < gaussians && gaussians <= allowed && 4 * gaussians >= 3 * allowed;
                if !grown || !(1.0..=FACTOR).contains(&ratio) || foretold.start >= foretold.most {
                    wrong.push(line);
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn what_a_training_will_take_is_told_before_it_and_what_to_do_where_it_may_be_too_much() {
    let folder = Folder::with_stage("ds");
    let train = "train ds --iterations 1+1 --no-evaluation";
    let stderr = |words: &str| String::from_utf8_lossy(&folder.run(words).stderr).into_owned();
    let plain = stderr(&format!("{train} --out plain --set density.max_gaussians=3000"));
    assert!(
        plain.contains("memory of ") && plain.contains("density.max_gaussians") && plain.contains("free"),
        "{plain}"
    );
    assert!(!plain.contains("may run out"), "{plain}");
    // No machine has so much; it begins with few, and may never come to have them.
    let many = stderr(&format!("{train} --out many --set density.max_gaussians=100000000"));
    assert!(many.contains("may run out of memory") && many.contains("goes to"), "{many}");
    let setting = many.split("enough with --set density.max_gaussians=").nth(1);
    let setting = setting.and_then(|rest| rest.split(' ').next()).and_then(|number| number.parse::<u32>().ok());
    let setting = setting.unwrap_or_else(|| panic!("how many fit: {many}"));
    assert!(setting > 100_000 && setting < 100_000_000, "{many}");
    assert!(folder.path("many/checkpoint.bin").is_file(), "{many}");
    let fewer = stderr(&format!(
        "{train} --out fewer --set density.max_gaussians={} --set eds.max_gaussians={}",
        setting / 2,
        setting / 2
    ));
    assert!(!fewer.contains("may run out"), "{fewer}");
}
