//! Whole trainings of a small film: what their length, the method, the motion and the field cost and bring.

use std::sync::{Arc, atomic::AtomicBool};

use erfgs_run::RunFolder;
use erfgs_train::{
    config::{Config, Method, MotionModel, Preset},
    evaluate::EvaluateOptions,
    scene::Scene,
    trainer::{Progress, TrainOptions, Trainer},
};

use crate::{Bench, Component, Measure, Result, Size, Stopwatch, Study, component::About, filmed::Filmed};

const MEASURES: &[Measure] = &[
    Measure { name: "error where things move, root mean square", unit: "of white", logarithmic: true },
    Measure { name: "the same between frames", unit: "of white", logarithmic: true },
    Measure { name: "error of a picture, root mean square", unit: "of white", logarithmic: true },
];
const WORK: &str = "the trainings of all seeds, one after another";

/// What all trainings have in common.
const TRUTH: &str = "0.4 s of the stage at 96 x 72: eight RGB cameras at 20 frames a second with 10 ms of exposure, three event cameras. \
    The truth is what two held-out cameras see 80 times a second. Each setting is trained with three seeds, and the errors are of their \
    mean PSNR: by chance it differs by 0.1 dB where things move and 0.2 dB of pictures (standard deviation), which are 1.5 and 3 % of an \
    error. 100+700 iterations, a sixth of what the default has, where no other number is told.";

const TRAINING: About = About { name: "training", truth: TRUTH, work: WORK, measures: MEASURES };
const MOTION: About = About { name: "motion, free in time", truth: TRUTH, work: WORK, measures: MEASURES };
const FIELD: About = About { name: "deformation field", truth: TRUTH, work: WORK, measures: MEASURES };

/// How the film is trained on.
#[derive(Clone, Debug, PartialEq)]
struct Setting {
    method: Method,
    preset: Preset,
    motion: Option<MotionModel>,
    /// Iterations of the coarse and of the fine stage.
    iterations: [u32; 2],
    /// Further settings.
    set: Vec<String>,
    seeds: u64,
}

impl Setting {
    fn new(size: Size) -> Self {
        let (iterations, seeds) = match size {
            Size::Small => ([30, 60], 1),
            Size::Full => ([100, 700], 3),
        };
        Self { method: Method::ErfGs, preset: Preset::Default, motion: None, iterations, set: Vec::new(), seeds }
    }

    /// The same with one more setting; as it is where that is what the preset has.
    fn with(&self, assignment: &str) -> Self {
        let mut setting = self.clone();
        setting.set.push(assignment.to_owned());
        let same = setting.config(1).is_ok_and(|config| self.config(1).is_ok_and(|before| before == config));
        if same { self.clone() } else { setting }
    }

    fn config(&self, seed: u64) -> Result<Config> {
        let mut config = Config::preset(self.method, self.preset);
        config.motion = self.motion.unwrap_or(config.motion);
        config.seed = seed;
        [config.coarse_iterations, config.fine_iterations] = self.iterations;
        config.evaluation.leave_alone();
        self.set.iter().try_for_each(|assignment| config.set(assignment))?;
        Ok(config)
    }

    /// Trains with each seed and judges all by the mean of their PSNR.
    fn learn(&self, filmed: &Filmed, bench: &Bench, stopwatch: &mut Stopwatch) -> Result<Vec<f64>> {
        let dataset = filmed.dataset()?;
        let folder = erfgs_base::scratch::Scratch::new()?;
        let options = TrainOptions { evaluate: false, ..TrainOptions::default() };
        let run = RunFolder::new(folder.path().join("run"));
        let mut trained = Vec::new();
        stopwatch.time(|| {
            trained.clear();
            for seed in 1..=self.seeds {
                let mut config = self.config(seed)?;
                config.settle(dataset, false)?;
                let scene = Scene::load(dataset.clone(), &config, false)?;
                let mut trainer = Trainer::new(&bench.gpu, scene, config, &options)?;
                trainer.run(&run, &options, &AtomicBool::new(false), &mut |_: &Progress| {})?;
                trained.push(trainer);
            }
            Ok(())
        })?;
        let mut sums = [0.0; 3];
        for trainer in &mut trained {
            let metrics = trainer.evaluate(&run, &EvaluateOptions::default(), &mut |_, _| {})?;
            let moving = metrics.dpsnr.ok_or("nothing moves in what the held-out cameras see")?;
            let between = metrics.between_frames.dpsnr.unwrap_or(moving);
            for (sum, psnr) in sums.iter_mut().zip([moving, between, metrics.psnr]) {
                *sum += psnr / self.seeds as f64;
            }
        }
        Ok(sums.map(|psnr| 10.0_f64.powf(-psnr / 20.0)).to_vec())
    }
}

fn study(about: About, filmed: &Arc<Filmed>) -> Study<Setting> {
    let filmed = filmed.clone();
    Study::new(about, move |bench: &Bench, stopwatch: &mut Stopwatch, setting: &Setting| {
        setting.learn(&filmed, bench, stopwatch)
    })
    .weighing(|setting| {
        let dear =
            if setting.motion == Some(MotionModel::HexPlane) || setting.preset != Preset::Default { 6.0 } else { 1.0 };
        dear * f64::from(setting.iterations[1]) / 40.0
    })
}

/// A knob that is turned by one setting.
fn turned<'a>(of: &'a Setting, key: &'a str, values: &'a [&'a str]) -> impl Iterator<Item = (String, Setting)> + 'a {
    values.iter().map(move |value| ((*value).to_owned(), of.with(&format!("{key}={value}"))))
}

/// The knobs of the trainer.
#[must_use]
pub(crate) fn component(size: Size, filmed: &Arc<Filmed>) -> Component {
    let default = Setting::new(size);
    let study = study(TRAINING, filmed);
    if size == Size::Small {
        let short = Setting { iterations: [5, 5], ..default.clone() };
        return study.knob("iterations", &default, [("5+5", short), ("30+60", default.clone())]).component();
    }
    // EDS makes Gaussians later than a short training ends.
    let long = Setting { iterations: [600, 4000], ..default.clone() };
    let methods = [
        ("4DGS", Setting { method: Method::FourDgs, ..long.clone() }),
        ("ERF-GS without EARL", long.with("earl.enabled=false")),
        ("ERF-GS without EDS", long.with("eds.enabled=false")),
        ("ERF-GS", long.clone()),
    ];
    let iterations = [[50, 350], [100, 700], [200, 1400], [600, 4000]];
    let knob = |study: Study<Setting>, name: &str, key: &str, values: &[&str]| {
        study.knob(name, &default, turned(&default, key, values))
    };
    let mut study = study
        .knob(
            "iterations, coarse and fine",
            &long,
            iterations.map(|iterations| {
                (format!("{}+{}", iterations[0], iterations[1]), Setting { iterations, ..default.clone() })
            }),
        )
        .knob("method, 600+4000 iterations", &long, methods);
    for (name, key, values) in [
        ("times that an event sample compares", "earl.pairing", &["frame-anchored", "any", "level"][..]),
        ("event samples an iteration", "earl.share", &["0.25", "0.5", "1"]),
        ("whole images, each n-th frame sample", "dynamic.whole_image_every", &["1", "2", "4", "8"]),
        ("model of the exposure", "blur.model", &["off", "on"]),
    ] {
        study = knob(study, name, key, values);
    }
    // The preset `released-code` is the same until EDS begins, after all of these.
    let presets = [("paper", Preset::Paper), ("default", Preset::Default)];
    study
        .knob("preset", &default, presets.map(|(name, preset)| (name, Setting { preset, ..default.clone() })))
        .component()
}

/// The knobs of paths and lives.
#[must_use]
pub(crate) fn motion(size: Size, filmed: &Arc<Filmed>) -> Component {
    let default = Setting { motion: Some(MotionModel::FreeTime), ..Setting::new(size) };
    let knots =
        turned(&default, "free_time.knots", if size == Size::Small { &["0", "2"] } else { &["0", "2", "3", "4"] });
    let mut study = study(MOTION, filmed).knob("knots of a path on either side", &default, knots);
    if size == Size::Small {
        return study.component();
    }
    study = study.knob(
        "intervals from a knot to the next",
        &default,
        turned(&default, "free_time.spacing", &["0.25", "0.5", "1", "2"]),
    );
    let life = |least: f32| {
        // A first life may not be shorter than the shortest.
        let setting = default.with(&format!("free_time.least_life={least}"));
        let setting = setting.with(&format!("free_time.first_life={}", 2.0 * least));
        (least.to_string(), setting)
    };
    let lives = [0.0625, 0.125, 0.25, 0.5, 1.0].map(life);
    let by_the_data = [("by the data".to_owned(), default.clone())];
    study.knob("shortest life, intervals", &default, lives.into_iter().chain(by_the_data)).component()
}

/// The knobs of the deformation field.
#[must_use]
pub(crate) fn field(size: Size, filmed: &Arc<Filmed>) -> Component {
    let default = Setting { motion: Some(MotionModel::HexPlane), ..Setting::new(size) };
    let levels: &[&str] = if size == Size::Small { &["[1]", "[1, 2]"] } else { &["[1]", "[1, 2]", "[1, 2, 4]"] };
    let mut study =
        study(FIELD, filmed).knob("levels of the planes", &default, turned(&default, "field.levels", levels));
    if size == Size::Small {
        return study.component();
    }
    for (name, key, values) in [
        ("features of a plane", "field.features", &["8", "16", "32"][..]),
        ("width of the network", "field.width", &["32", "64", "128"]),
    ] {
        study = study.knob(name, &default, turned(&default, key, values));
    }
    study.component()
}
