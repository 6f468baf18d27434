//! Trainings at their edges: a scene of sixty Gaussians is filmed exactly, trained on, and rendered again.

use std::sync::atomic::AtomicBool;

use erfgs_base::scratch::Scratch;
use erfgs_run::RunFolder;
use erfgs_train::{
    config::{Config, Method, MotionModel, Preset},
    scene::Scene,
    trainer::{Progress, TrainOptions, Trainer},
};

use crate::{Bench, Bound, Case, Expected, Measured, Refusal, Size, filmed::Filmed};

const PART: &str = "training";

/// Its name, and the truth of its cases.
pub(crate) const ABOUT: [&str; 2] = [
    PART,
    "A scene of sixty Gaussians is filmed by the `f64` twin (32 x 24 pixels, four cameras, six frames), trained on for 300 iterations unless another number is given, and rendered again; the error is over all training pictures.",
];

const LEARNED: Bound = Bound {
    most: 0.5,
    unit: "of an even picture's error",
    why: "a training that learned nothing shows one colour at best; half of that picture's rms error is 6 dB better",
};
const MOVES: Bound = Bound {
    most: 0.9,
    unit: "of the best still picture's error",
    why: "what learned no motion shows at best what each pixel is in the mean over time",
};
const BLACK: Bound =
    Bound { most: 2.0 / 255.0, unit: "of white", why: "two grey levels of light in a picture without light" };
const ANYTHING: Bound = Bound {
    most: 1.0,
    unit: "of an even picture's error",
    why: "a training that goes on must show more than one colour would",
};
const ELSEWHERE: Bound =
    Bound { most: 0.5, unit: "dB lost", why: "less than five seeds differ by (0.8 dB after 10,000 iterations)" };
const NO_WORSE: Bound = Bound {
    most: 0.5,
    unit: "dB lost",
    why: "events that tell of light and not of motion must not cost more than another seed may (0.8 dB after 10,000 iterations)",
};

/// How a scene is trained on.
#[derive(Clone, Debug)]
struct Training {
    filmed: Filmed,
    motion: MotionModel,
    /// Iterations of the coarse and of the fine stage.
    iterations: [u32; 2],
    seed: u64,
    /// Whether events, where there are any, play no part.
    frames_alone: bool,
    set: Vec<String>,
}

impl Training {
    fn of(filmed: Filmed) -> Self {
        let motion = if filmed.moving > 0.0 { MotionModel::FreeTime } else { MotionModel::HexPlane };
        Self { filmed, motion, iterations: [100, 200], seed: 1, frames_alone: false, set: Vec::new() }
    }

    fn config(&self) -> Result<Config, Refusal> {
        let method = if self.filmed.events > 0 && !self.frames_alone { Method::ErfGs } else { Method::FourDgs };
        let mut config = Config::preset(method, Preset::Default);
        config.motion = self.motion;
        config.seed = self.seed;
        [config.coarse_iterations, config.fine_iterations] = self.iterations;
        config.evaluation.leave_alone();
        self.set.iter().try_for_each(|assignment| config.set(assignment))?;
        Ok(config)
    }

    /// The rms error of all training pictures, that of an even picture of their mean colour, the largest value of a pixel,
    /// and how many pixels are not finite.
    fn run(&self, bench: &Bench) -> Result<Learned, Refusal> {
        let folder = Scratch::new()?;
        // A refusal is the same wherever the folder lies.
        let placeless = |error: Refusal| error.to_string().replace(&folder.path().display().to_string(), "...").into();
        self.run_in(&folder, bench).map_err(placeless)
    }

    fn run_in(&self, folder: &Scratch, bench: &Bench) -> Result<Learned, Refusal> {
        let dataset = self.filmed.dataset(&folder.path().join("ds"), self.motion == MotionModel::FreeTime)?;
        let mut config = self.config()?;
        config.settle(&dataset, false)?;
        let scene = Scene::load(dataset, &config, false)?;
        let options = TrainOptions { evaluate: false, ..TrainOptions::default() };
        let mut trainer = Trainer::new(&bench.gpu, scene, config, &options)?;
        let run = RunFolder::new(folder.path().join("run"));
        trainer.run(&run, &options, &AtomicBool::new(false), &mut |_: &Progress| {})?;
        let mut learned = Learned::default();
        let pictures = self.filmed.pictures()?;
        let values = pictures.iter().map(|(.., truth)| truth.len()).sum::<usize>() as f64;
        let mean: [f64; 3] = std::array::from_fn(|channel| {
            let all = pictures.iter().flat_map(|(.., truth)| truth.iter().skip(channel).step_by(3));
            all.sum::<f64>() / (values / 3.0)
        });
        let still = |camera: usize, index: usize| {
            let of_camera = pictures.iter().filter(|(of, ..)| *of == camera);
            of_camera.map(|(.., truth)| truth[index]).sum::<f64>() / self.filmed.frames as f64
        };
        for (camera, share, truth) in &pictures {
            let view = trainer.scene.views[*camera].view;
            let rendered = trainer.render(&view, *share)?;
            for (index, (&value, &truth)) in rendered.rgb.iter().zip(truth).enumerate() {
                let value = f64::from(value);
                learned.not_finite += u64::from(!value.is_finite());
                learned.largest = learned.largest.max(value);
                learned.rms += (value.clamp(0.0, 1.0) - truth).powi(2) / values;
                learned.even += (mean[index % 3] - truth).powi(2) / values;
                learned.still += (still(*camera, index) - truth).powi(2) / values;
            }
        }
        for squared in [&mut learned.rms, &mut learned.even, &mut learned.still] {
            *squared = squared.sqrt();
        }
        Ok(learned)
    }
}

/// What a training came to.
#[derive(Clone, Copy, Debug, Default)]
struct Learned {
    rms: f64,
    even: f64,
    /// That of the picture that each camera has in the mean over time.
    still: f64,
    largest: f64,
    not_finite: u64,
}

impl Learned {
    fn measured(self, error: f64) -> Measured {
        Measured { error, not_finite: self.not_finite }
    }
}

fn learns(name: impl Into<String>, training: Training) -> Case {
    Case::new(PART, name, Expected::Within(LEARNED), move |bench| {
        let learned = training.run(bench)?;
        Ok(learned.measured(learned.rms / learned.even))
    })
    .weighing(20.0)
}

/// The cases of training.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    let full = size == Size::Full;
    let usual = Filmed::default();
    let mut cases = Vec::new();
    let mut add = |always: bool, name: &str, filmed: Filmed| {
        if full || always {
            cases.push(learns(name, Training::of(filmed)));
        }
    };
    add(false, "four cameras, 30 % moves, for comparison", usual);
    add(false, "one camera", Filmed { cameras: 1, ..usual });
    add(false, "two cameras", Filmed { cameras: 2, ..usual });
    add(false, "64 cameras", Filmed { cameras: 64, frames: 3, ..usual });
    add(false, "nothing moves", Filmed { moving: 0.0, ..usual });
    add(true, "everything moves", Filmed { moving: 1.0, ..usual });
    add(false, "a recording of 1 ms", Filmed { span_ns: 1_000_000, ..usual });
    add(false, "a recording of 1 h", Filmed { span_ns: 3_600_000_000_000, ..usual });
    add(false, "saturated: colours up to five times white", Filmed { light: 5.0, ..usual });
    for every in [1, 2, 4, 8, 16, 32] {
        let name = format!("events of {every} pictures a frame (f = {every})");
        add(every == 8, &name, Filmed { events: every, ..usual });
    }
    for (name, cameras) in [("four cameras", 4), ("one camera", 1)].into_iter().filter(|_| full) {
        let mut training = Training::of(Filmed { cameras, moving: 1.0, ..usual });
        (training.motion, training.iterations) = (MotionModel::HexPlane, [200, 1300]);
        let name = format!("{name}, everything moves, learned by the field");
        cases.push(
            Case::new(PART, name, Expected::Within(MOVES), move |bench| {
                let learned = training.run(bench)?;
                Ok(learned.measured(learned.rms / learned.still))
            })
            .weighing(150.0),
        );
    }
    let black = Training::of(Filmed { light: 0.0, ..usual });
    cases.extend(full.then(|| {
        Case::new(PART, "all black", Expected::Within(BLACK), move |bench| {
            let learned = black.run(bench)?;
            Ok(learned.measured(learned.largest))
        })
        .weighing(20.0)
    }));
    for (name, filmed) in [
        ("every length times 1e-4", Filmed { scale: 1e-4, ..usual }),
        ("every length times 1e4", Filmed { scale: 1e4, ..usual }),
        ("100 m from the origin", Filmed { away: 100.0, ..usual }),
        ("1e5 m from the origin", Filmed { away: 1e5, ..usual }),
    ]
    .into_iter()
    .filter(|(_, filmed)| full || filmed.scale < 1.0)
    {
        cases.push(
            Case::new(PART, name, Expected::Within(ELSEWHERE), move |bench| {
                let [there, here] = [filmed, usual].map(|filmed| Training::of(filmed).run(bench));
                let (there, here) = (there?, here?);
                Ok(there.measured(20.0 * (there.rms / here.rms).log10()))
            })
            .weighing(40.0),
        );
    }
    for (name, filmed) in [
        ("a background that flickers by 30 %", Filmed { events: 8, flicker: 0.3, ..usual }),
        ("what moves is dark, a twentieth of the light", Filmed { events: 8, dark: 0.05, ..usual }),
    ] {
        if !full {
            continue;
        }
        cases.push(
            Case::new(PART, format!("{name}: what events cost"), Expected::Within(NO_WORSE), move |bench| {
                let training = Training::of(filmed);
                let with = training.run(bench)?;
                let without = Training { frames_alone: true, ..training }.run(bench)?;
                Ok(with.measured((20.0 * (with.rms / without.rms).log10()).max(0.0)))
            })
            .weighing(50.0),
        );
    }
    let far = Training::of(Filmed { away: 1e5, focal: 1000.0, ..usual });
    let refused = Expected::Refusal("from the origin");
    cases.push(Case::new(PART, "1e5 m from the origin, in pictures of a thousand pixels", refused, move |bench| {
        let learned = far.run(bench)?;
        Ok(learned.measured(learned.rms))
    }));
    let fast = |name: &str, set: &[&str], expected: Expected| {
        let mut training = Training::of(usual);
        training.set = set.iter().map(|&assignment| assignment.to_owned()).collect();
        Case::new(PART, name, expected, move |bench| {
            let learned = training.run(bench)?;
            Ok(learned.measured(learned.rms / learned.even))
        })
        .weighing(20.0)
    };
    const CORE: &str = "positions, scales, rotations and opacities";
    const COLOURS: &str = "colours of the Gaussians";
    const ROWS: &str = "trajectories and lives";
    let rates = [
        ("positions", "learning_rate.position=", "[0.16,0.0016]", "[1e38,1e38]", CORE),
        ("sizes", "learning_rate.scale=", "0.5", "1e38", CORE),
        ("rotations", "learning_rate.rotation=", "0.1", "1e38", CORE),
        ("opacities", "learning_rate.opacity=", "5.0", "1e38", CORE),
        ("colours", "learning_rate.sh_dc=", "0.25", "1e38", COLOURS),
        ("lives", "free_time.life=", "0.3", "1e38", ROWS),
        ("instants", "free_time.instant=", "1.0", "1e38", ROWS),
    ];
    let either = Expected::Either(ANYTHING, "training diverged");
    let hundredfold: Vec<String> =
        rates.iter().map(|(_, key, hundredfold, ..)| format!("{key}{hundredfold}")).collect();
    let all: Vec<&str> = hundredfold.iter().map(String::as_str).collect();
    cases.extend(full.then(|| fast("all learning rates times 100", &all, either)));
    for ((what, key, _, endless, names), hundredfold) in rates.into_iter().zip(&all) {
        if full || what == "sizes" {
            cases.push(fast(&format!("learning rate of {what} times 100"), &[hundredfold], either));
        }
        if full || what == "colours" {
            let name = format!("learning rate of {what} 1e38");
            cases.push(fast(&name, &[&format!("{key}{endless}")], Expected::Refusal(names)));
        }
    }
    if full {
        for seed in 1..=5 {
            let mut training = Training::of(Filmed { events: 8, ..usual });
            (training.seed, training.iterations) = (seed, [2000, 8000]);
            cases.push(learns(format!("10,000 iterations, seed {seed}"), training).weighing(800.0));
        }
    }
    cases
}
