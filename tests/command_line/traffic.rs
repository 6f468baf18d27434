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

use super::{
    Folder,
    page::{film_of, film_small},
};

/// What passes in the fine iterations 11 to 25 of training on a dataset while the cameras' `poses` are learned or not: in all, the most in one,
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
    trainer.times.start();
    trainer.run(&run, &options, &AtomicBool::new(false), &mut |_: &Progress| {}).expect("a training");
    (trainer.times.traffic, trainer.times.most, trainer.model.drawn.gaussians.count)
}

/// Iterations that are counted.
const ITERATIONS: u64 = 15;

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
            let said = format!("{method:?}, {gaussians} Gaussians: {traffic:?}");
            // The host reads how many tiles the rendering before covered, and nothing else: no parameter, no gradient.
            assert!(traffic.maps > 0 && traffic.maps <= renderings && traffic.read <= 64 * renderings, "{said}");
            assert!(each(traffic.submissions) <= 18.0 && (20.0..=130.0).contains(&each(traffic.dispatches)), "{said}");
            // What the kernels are told. A frame would take 9 kB.
            assert!(each(traffic.written) <= 6000.0, "{said}");
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
            assert!(most.submissions <= 24 && most.written * ITERATIONS >= all.written, "{method:?}, {name}: {most:?}");
            all
        });
        // The kernels are told no more of a larger image; of how many pieces counts are added up depends on the events.
        assert!(large.written.abs_diff(small.written) <= 200 * ITERATIONS, "{method:?}: {small:?} and {large:?}");
        assert!(large.submissions.abs_diff(small.submissions) <= ITERATIONS, "{method:?}: {small:?} and {large:?}");
    }
    // The benchmark tells it.
    let figures =
        folder.figures("bench train large --iterations 10 --shape gpu --set density.from=1000 --set eds.enabled=false");
    let figure = |key: &str| figures["an_iteration"][key].as_f64().unwrap_or_else(|| panic!("no {key} in {figures}"));
    let most = figure("bytes_written_most");
    assert!(most <= 65536.0 && (1000.0..=most).contains(&figure("bytes_written")), "{figures}");
    assert!((5.0..24.0).contains(&figure("submissions")) && figure("maps") > 0.0, "{figures}");
    assert!(figures["cpu_ms_an_iteration"].as_f64().is_some_and(|ms| ms > 0.1), "{figures}");
}
