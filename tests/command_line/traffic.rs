//! How much passes between the host and a graphics processor in an iteration, counted on the form of the kernels that runs there.

use std::sync::atomic::{AtomicBool, Ordering};

use erfgs_dataset::Dataset;
use erfgs_run::RunFolder;
use erfgs_splat::gpu::{AdapterChoice, Gpu, Shape, Traffic};
use erfgs_train::{
    config::{Config, Method, Preset},
    scene::Scene,
    trainer::{Progress, TrainOptions, Trainer},
};

use super::{Folder, page::film_small};

/// What passes in the fine iterations 11 to 25 while the cameras' `poses` are learned or not, and how many Gaussians there are.
fn counted(folder: &Folder, method: Method, points: u32, poses: bool) -> (Traffic, u32) {
    let mut config = Config::preset(method, Preset::Default);
    (config.coarse_iterations, config.fine_iterations) = (5, 25);
    config.init.max_points = points;
    config.density.from = 1000;
    config.eds.enabled = false;
    (config.camera_pose.enabled, config.camera_pose.fewest) = (poses, 3);
    config.evaluation.leave_alone();
    config.evaluation.log_every = u32::MAX;
    let dataset = Dataset::load(&folder.path("ds")).expect("a dataset");
    config.settle(&dataset, false).expect("settings");
    let scene = Scene::load(dataset, &config, false).expect("a scene");
    let gpu = Gpu::open(&AdapterChoice { name: None, shape: Some(Shape::Gpu) }).expect("an adapter");
    let options = TrainOptions { evaluate: false, ..TrainOptions::default() };
    let mut trainer = Trainer::new(&gpu, scene, config, &options).expect("a trainer");
    let run = RunFolder::new(folder.path(&format!("{method:?}-{points}-{poses}")));
    let warm = AtomicBool::new(false);
    let mut watch = |now: &Progress| warm.store(now.iteration >= 15, Ordering::Relaxed);
    trainer.run(&run, &options, &warm, &mut watch).expect("a warm-up");
    trainer.times.start();
    trainer.run(&run, &options, &AtomicBool::new(false), &mut |_: &Progress| {}).expect("a training");
    (trainer.times.traffic, trainer.model.drawn.gaussians.count)
}

#[test]
fn little_passes_between_host_and_graphics_processor_in_an_iteration() {
    const ITERATIONS: u64 = 15;
    // A frame of the dataset, four bytes a pixel; its event counts take as many.
    const PICTURE: u64 = 64 * 48 * 4;
    let folder = Folder::new();
    film_small(&folder);
    for (method, renderings) in [(Method::FourDgs, ITERATIONS), (Method::ErfGs, 2 * ITERATIONS)] {
        let (few, gaussians) = counted(&folder, method, 50, false);
        let (many, more) = counted(&folder, method, 400, false);
        assert!(gaussians < more, "{gaussians} and {more}");
        for (traffic, gaussians) in [(few, gaussians), (many, more)] {
            let each = |sum: u64| sum as f64 / ITERATIONS as f64;
            let said = format!("{method:?}, {gaussians} Gaussians: {traffic:?}");
            // The host reads how many tiles the rendering before covered, and nothing else: no parameter, no gradient.
            assert!(traffic.maps > 0 && traffic.maps <= renderings && traffic.read <= 64 * renderings, "{said}");
            assert!(each(traffic.submissions) <= 18.0 && (20.0..=130.0).contains(&each(traffic.dispatches)), "{said}");
            assert!(each(traffic.written) <= 2.0 * PICTURE as f64 + 4000.0, "{said}");
        }
        assert_eq!(few.read / few.maps, 64);
        // What passes is as much whatever is trained.
        assert_eq!((few.maps, few.submissions, few.written), (many.maps, many.submissions, many.written));
        // Poses take eight numbers of each camera, once in as many iterations as there are cameras that take frames.
        let (posed, _) = counted(&folder, method, 50, true);
        let [maps, read] = [posed.maps - few.maps, posed.read - few.read];
        assert!((1..=ITERATIONS / 3).contains(&maps) && read <= maps * 32 * 16, "{posed:?} and {few:?}");
    }
}
