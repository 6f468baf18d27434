//! Which bodies carry Gaussians: those that explain what took no part in a short training better than Gaussians that are free in time.
//!
//! Bodies are right for what is nearly rigid and was found well. What bends, or was followed wrongly, is better off with Gaussians that
//! are free in time. Which is which is not guessed: both are trained for a while on the same frames and events, of which a camera of
//! either kind is kept apart, and what these saw is compared with both where each body is.

mod errors;
mod held_out;

use erfgs_base::{Progress, cpu};
use erfgs_dataset::{Body, Dataset};
use serde::{Deserialize, Serialize};

pub use held_out::HeldOut;

use self::errors::Errors;
use crate::{
    checkpoint::Checkpoint,
    config::{Config, MotionModel},
    scene::Scene,
    schedule::{Budget, Stage},
    start::{SURE, agreement, silhouettes_agree},
    static_set::StaticSet,
    trainer::{TrainError, TrainOptions, Trainer},
};
use erfgs_splat::gpu::Gpu;

/// The trial takes no more than one in so many iterations of the fine stage.
const MOST_SHARE: u32 = 4;
/// And, where training may take a given time, its first two parts of three no more than this share of it.
const MOST_TIME: f64 = 0.13;
/// Trainings of fewer iterations tell nothing: bodies carry then.
const FEWEST: u32 = 40;
/// A body carries unless its error is so many times that of what is free in time: what is right a little becomes sharp in a longer
/// training, as what is free in time does not.
const WORSE: f64 = 1.01;
/// That is so where silhouettes of all instants agree on its shape. Where fewer of them do, it may bend, or be more than one thing, and
/// must explain more at once: by so much of what their share lacks of [`SURE`].
const DOUBT: f64 = 0.6;
/// Where no more than this share agrees, or a body in doubt explains too little more to be rigid, but explains what is seen of it better than
/// what is free in time all the same, it bends. So does one on whose shape silhouettes agree, and which explains less all the same: how it
/// turns was found wrongly. Only what is in view for the whole recording: of what comes and goes, as pieces that fly
/// apart, too little is seen to be followed.
const BENDS: f64 = 0.785;

/// How a body and Gaussians that are free in time explain what a body is seen by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tried {
    /// The body.
    pub body: String,
    /// Root mean square error of the frames of the camera that was kept apart, of 1, where the body is: carried by it, and free in time.
    pub frames: Option<[f64; 2]>,
    /// The share, root mean square, of what the events of a camera that was kept apart say there that is not explained, likewise.
    pub events: Option<[f64; 2]>,
    /// The ratio of these errors, below which it carries Gaussians.
    pub below: f64,
    /// Whether it carries Gaussians from now on.
    pub carries: bool,
    /// Whether it bends: it is followed, and its nodes may go where they are seen to go.
    #[serde(default)]
    pub bends: bool,
}

impl Tried {
    /// The error by the body beside that of what is free in time: the geometric mean of what frames and events say. None where nothing
    /// was seen.
    #[must_use]
    pub fn ratio(&self) -> Option<f64> {
        let ratios: Vec<f64> = [self.frames, self.events]
            .into_iter()
            .flatten()
            .map(|[carried, free]| (carried.max(1e-9) / free.max(1e-9)).ln())
            .collect();
        (!ratios.is_empty()).then(|| (ratios.iter().sum::<f64>() / ratios.len() as f64).exp())
    }
}

/// What a trial found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// Each body.
    pub bodies: Vec<Tried>,
    /// Iterations of the fine stage, of each of the two trainings.
    pub iterations: u32,
    /// The cameras that were kept apart.
    pub held_out: HeldOut,
    /// How long it took, seconds.
    pub seconds: f64,
    /// CPU time, seconds; 0 where the system does not tell.
    pub cpu_seconds: f64,
}

impl Trial {
    /// The bodies that carry nothing.
    #[must_use]
    pub fn free(&self) -> Vec<String> {
        self.those(|tried| !tried.carries)
    }

    /// The bodies that bend.
    #[must_use]
    pub fn bend(&self) -> Vec<String> {
        self.those(|tried| tried.bends)
    }

    fn those(&self, which: impl Fn(&Tried) -> bool) -> Vec<String> {
        self.bodies.iter().filter(|tried| which(tried)).map(|tried| tried.body.clone()).collect()
    }
}

/// Whether a training that begins with such settings has a trial: its motion is by bodies, and nobody said which are to carry.
#[must_use]
pub fn is_due(config: &Config) -> bool {
    let bodies = &config.bodies;
    let decided = !bodies.free.is_empty() || !bodies.bend.is_empty();
    config.motion == MotionModel::Bodies && short(config).fine_iterations >= FEWEST && !decided
}

/// What a trial is made with.
pub struct Setting<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The dataset, with bodies.
    pub dataset: &'a Dataset,
    /// The settings of the training, which are settled.
    pub config: &'a Config,
    /// What stands still, where another run learned it.
    pub static_set: Option<&'a StaticSet>,
    /// Bytes of memory that frames and events may take.
    pub memory: Option<u64>,
    /// Bytes of the device's memory that they may take there.
    pub device_memory: Option<u64>,
}

/// Trains for a while with bodies, and without, and compares; `budget` is that of the training. `go_on` is told how far it is and says
/// whether it is to go on; nothing is found where it is not.
///
/// # Errors
/// [`TrainError`]: as a training's.
pub fn trial(
    setting: &Setting<'_>,
    budget: Budget,
    go_on: &mut dyn FnMut(Progress) -> bool,
) -> Result<Option<Trial>, TrainError> {
    let began = (std::time::Instant::now(), cpu::process_seconds());
    let (dataset, held_out) = held_out::keep_apart(setting.dataset);
    let config = short(setting.config);
    let lengths = [config.coarse_iterations, config.fine_iterations, config.fine_iterations].map(u64::from);
    let mut done = 0;
    let total = lengths.iter().sum();
    let mut on = |trainer: &Trainer<'_>, before: u64| {
        done = before + u64::from(trainer.clock.iteration);
        let what = match before {
            0 => "what stands still",
            before if before == lengths[0] => "free in time",
            _ => "bodies",
        };
        go_on(Progress { done, total, what })
    };
    let free_config = Config { motion: MotionModel::FreeTime, ..config.clone() };
    let scratch = std::env::temp_dir();
    let scene = Scene::load_within(dataset, &free_config, false, setting.memory, &scratch)?;
    let bodies = scene.carrying(&config)?;
    let seen = errors::HeldOutViews::new(&scene, &bodies, &held_out, &config)?;
    let part = |budget: Option<f64>| budget.map(|budget| budget * MOST_TIME);
    let budget = Budget { seconds: part(budget.seconds), cpu_seconds: part(budget.cpu_seconds) };
    let device_memory = setting.device_memory;
    let options = TrainOptions { budget, device_memory, ..TrainOptions::default() };
    let mut trainer = match setting.static_set {
        Some(set) => Trainer::within(setting.gpu, scene, free_config, &options, set)?,
        None => Trainer::new(setting.gpu, scene, free_config, &options)?,
    };
    if !trainer.train_quietly(Stage::Coarse, &mut |trainer| on(trainer, 0))? {
        return Ok(None);
    }
    let coarse = trainer.checkpoint()?;
    if !trainer.train_quietly(Stage::Fine, &mut |trainer| on(trainer, lengths[0]))? {
        return Ok(None);
    }
    let free = seen.errors(&mut trainer)?;
    // As many iterations as the other had, which take a little longer.
    let iterations = trainer.clock.iteration;
    let config = Config { motion: MotionModel::Bodies, fine_iterations: iterations, ..config };
    let checkpoint = Checkpoint { config, ..coarse };
    let options = TrainOptions { device_memory, ..TrainOptions::default() };
    let mut trainer = Trainer::resume(setting.gpu, trainer.into_scene(), checkpoint, &options)?;
    if !trainer.train_quietly(Stage::Fine, &mut |trainer| on(trainer, lengths[0] + lengths[1]))? {
        return Ok(None);
    }
    let carried = seen.errors(&mut trainer)?;
    let span = setting.dataset.manifest.span_ns;
    let tried = |(body, (carried, free)): (&Body, (&Errors, &Errors))| {
        let tried = judged(body, span, carried, free);
        Tried { carries: tried.carries || iterations < FEWEST, ..tried }
    };
    let bodies = std::iter::zip(&bodies, std::iter::zip(&carried, &free)).map(tried).collect();
    let cpu_seconds = began.1.zip(cpu::process_seconds()).map_or(0.0, |(from, to)| to - from);
    Ok(Some(Trial { bodies, iterations, held_out, seconds: began.0.elapsed().as_secs_f64(), cpu_seconds }))
}

/// The settings of each of the two trainings.
fn short(config: &Config) -> Config {
    let mut short = config.clone();
    let fine = config.bodies.trial.min(config.fine_iterations / MOST_SHARE).max(1);
    short.fine_iterations = fine;
    short.coarse_iterations = config.coarse_iterations.min(fine);
    (short.bodies.free, short.bodies.bend) = (Vec::new(), Vec::new());
    short
}

fn judged(body: &Body, span_ns: [i64; 2], carried: &Errors, free: &Errors) -> Tried {
    let both = |of: fn(&Errors) -> Option<f64>| Some([of(carried)?, of(free)?]);
    let agree = agreement(body);
    let below = WORSE - DOUBT * (SURE - agree.unwrap_or(SURE).clamp(0.0, SURE));
    let (frames, events) = (both(Errors::frames), both(Errors::events));
    let mut tried = Tried { body: body.name.clone(), frames, events, below, carries: true, bends: false };
    let stays = body.span_ns[0] <= span_ns[0] && body.span_ns[1] >= span_ns[1];
    let loose = |ratio: f64| agree.is_some_and(|agree| agree < BENDS) || ratio >= below;
    let bends = |ratio: f64| if silhouettes_agree(body) { ratio >= below } else { ratio < 1.0 && loose(ratio) };
    tried.bends = stays && tried.ratio().is_some_and(bends);
    tried.carries = tried.bends || tried.ratio().is_none_or(|ratio| ratio < below);
    tried
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPAN: [i64; 2] = [0, 1];

    /// A ball, on whose shape such a share of silhouettes agrees.
    fn ball(agree: Option<f64>) -> Body {
        let found_by = agree.map(|agree| ("carving_agreement".into(), agree.into())).into_iter().collect();
        Body { name: "ball".into(), span_ns: SPAN, poses: Vec::new(), points: Vec::new(), found_by }
    }

    #[test]
    fn a_body_carries_where_its_errors_are_smaller_in_the_mean_or_nothing_tells() {
        let carries = |frames: Option<[f64; 2]>, events: Option<[f64; 2]>| {
            let [carried, free] =
                [0, 1].map(|which| Errors::of(frames.map(|of| of[which]), events.map(|of| of[which])));
            judged(&ball(None), SPAN, &carried, &free).carries
        };
        assert!(carries(Some([0.1, 0.11]), Some([0.5, 0.5])));
        assert!(!carries(Some([0.12, 0.11]), Some([0.5, 0.5])));
        // Frames are a little worse, and events much better.
        assert!(carries(Some([0.12, 0.11]), Some([0.4, 0.5])));
        assert!(!carries(None, Some([0.6, 0.5])) && carries(Some([0.1, 0.2]), None) && carries(None, None));
    }

    #[test]
    fn a_body_on_whose_shape_silhouettes_do_not_agree_must_explain_more() {
        let carries = |agree: Option<f64>, carried: f64| {
            let [carried, free] = [carried, 0.1].map(|error| Errors::of(Some(error), None));
            // It comes within the recording: whether it bends is not asked.
            judged(&ball(agree), [-5, 1], &carried, &free).carries
        };
        assert!(carries(None, 0.1005) && carries(Some(0.86), 0.1005));
        assert!(!carries(Some(0.74), 0.097) && carries(Some(0.74), 0.092));
        assert!(!carries(Some(0.82), 0.0995) && carries(Some(0.82), 0.098));
    }

    #[test]
    fn a_body_whose_silhouettes_do_not_agree_bends_where_it_explains_more_than_what_is_free() {
        let within = |span: [i64; 2], agree: Option<f64>, carried: f64| {
            let [carried, free] = [carried, 0.1].map(|error| Errors::of(Some(error), None));
            let tried = judged(&ball(agree), span, &carried, &free);
            (tried.carries, tried.bends)
        };
        let tried = |agree: Option<f64>, carried: f64| within(SPAN, agree, carried);
        assert_eq!(within([-5, 1], Some(0.78), 0.099), (false, false), "it comes within the recording");
        assert_eq!(tried(Some(0.78), 0.099), (true, true));
        assert_eq!(tried(Some(0.78), 0.1005), (false, false));
        assert_eq!(tried(Some(0.82), 0.09), (true, false), "it is rigid");
        assert_eq!(tried(Some(0.82), 0.099), (true, true), "it explains too little more to be rigid");
        assert_eq!(within([-5, 1], Some(0.82), 0.099), (false, false));
        assert_eq!(tried(None, 0.05), (true, false), "nobody carved it");
        assert_eq!(tried(None, 0.12), (false, false));
        assert_eq!(tried(Some(0.86), 0.1005), (true, false), "it is rigid");
        assert_eq!(tried(Some(0.86), 0.105), (true, true), "it has a shape, and turns in another way than was found");
        assert_eq!(within([-5, 1], Some(0.86), 0.105), (false, false));
        let nothing = Errors::of(None, None);
        assert!(!judged(&ball(Some(0.7)), SPAN, &nothing, &nothing).bends, "nothing was seen");
    }

    #[test]
    fn a_trial_is_a_fraction_of_the_training_and_made_where_nobody_decided() {
        let mut config = Config { motion: MotionModel::Bodies, ..Config::default() };
        assert!(is_due(&config));
        config.fine_iterations = 4 * FEWEST - 1;
        assert!(!is_due(&config), "it would tell nothing");
        config.fine_iterations = 200;
        assert_eq!(short(&config).fine_iterations, 50);
        config.fine_iterations = 100_000;
        assert_eq!(short(&config).fine_iterations, config.bodies.trial);
        config.bodies.free = vec!["ball".into()];
        assert!(!is_due(&config) && short(&config).bodies.free.is_empty());
        (config.bodies.free, config.bodies.bend) = (Vec::new(), vec!["ball".into()]);
        assert!(!is_due(&config) && short(&config).bodies.bend.is_empty());
        assert!(!is_due(&Config { motion: MotionModel::FreeTime, ..Config::default() }));
    }
}
