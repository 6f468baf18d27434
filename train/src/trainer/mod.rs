//! The training loop.

mod clocks;
mod follow;
mod frame_sample;
mod grow;
mod level;
mod model;
mod poses;
mod progress;
mod quiet;
mod record;
mod render;
mod samples;
mod stages;
mod static_set;
mod step;
mod sums;

use std::{
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

use self::{clocks::Clocks, follow::Follow, poses::Poses, step::Workspace};
pub use self::{
    model::Model,
    progress::{Outcome, Progress, TrainError, TrainOptions, Watch},
    stages::StageTimes,
};
use crate::{
    camera_colour::{CameraColourState, CameraColours},
    checkpoint::Checkpoint,
    config::{Config, ConfigError, MotionModel},
    density::{Moments, Population, Statistics},
    evaluate::HeldOutMasks,
    feed::Feed,
    losses::Levels,
    scene::{Scene, SceneError, SceneView},
    schedule::{Budget, Clock, Schedule, Stage},
};
use erfgs_base::cpu;
use erfgs_dataset::Dataset;
use erfgs_run::{CameraColour, CameraPose, CameraTime, CurveRow, CurveWriter, Identity, LeftOut, RunFolder, RunInfo};
use erfgs_splat::{
    field::FieldState,
    gaussians::Gaussians,
    gpu::Gpu,
    model::Rendering,
    motion::Motion,
    optimiser::FiniteCheck,
    raster::{Region, View},
    trained::RecordedEvents,
};

/// A photometric loss that pictures without anything in them may not have: five grey levels.
const FAR_OFF: f64 = 0.02;

const GAUSSIANS_COLOURS: &str = "colours of the Gaussians";
const TRAJECTORIES: &str = "trajectories and lives of the Gaussians";
const PATHS: &str = "paths of the bodies";
const CAMERAS_COLOURS: &str = "colours of the cameras";

/// Time that counts as training, since a moment.
struct Lap {
    started: Instant,
    cpu_started: Option<f64>,
    before: [f64; 2],
}

impl Lap {
    fn begin(clock: &Clock) -> Self {
        let before = [clock.seconds, clock.cpu_seconds];
        Self { started: Instant::now(), cpu_started: cpu::process_seconds(), before }
    }

    fn tell(&self, clock: &mut Clock) {
        clock.seconds = self.before[0] + self.started.elapsed().as_secs_f64();
        if let (Some(from), Some(to)) = (self.cpu_started, cpu::process_seconds()) {
            clock.cpu_seconds = self.before[1] + to - from;
        }
    }
}

/// A training run.
#[derive(Debug)]
pub struct Trainer<'a> {
    gpu: &'a Gpu,
    /// What it trains on.
    pub scene: Scene,
    /// The configuration.
    pub config: Config,
    /// What it learned so far.
    pub model: Model,
    /// Where it stands.
    pub clock: Clock,
    /// Where the time goes, if it is measured.
    pub times: StageTimes,
    schedule: Schedule,
    statistics: Statistics,
    finite: FiniteCheck,
    work: Workspace,
    /// What is learned from, on the device.
    feed: Feed,
    /// The levels of the event cameras' pixels, where they are learned.
    levels: Vec<Levels>,
    /// Their near planes, metres.
    event_near: Vec<f32>,
    /// How the cameras show colours.
    colours: CameraColours,
    /// Whether that is learned.
    colours_differ: bool,
    /// Where the cameras are found to stand, where that is learned.
    poses: Option<Poses>,
    /// When they are found to have taken their frames, where that is learned.
    clocks: Option<Clocks>,
    /// How bodies are followed.
    follow: Option<Follow>,
    left_out: Vec<LeftOut>,
    deterministic: bool,
    viewer: Option<Rendering>,
    /// Where things move in every view, in the fine stage.
    regions: Vec<Option<Arc<Region>>>,
    /// When events came, once that is counted.
    counted: OnceLock<RecordedEvents>,
    pub(crate) held_out_masks: Option<HeldOutMasks>,
}

impl<'a> Trainer<'a> {
    /// A run that starts from the scene's points.
    ///
    /// # Errors
    /// [`TrainError`] where the device has no room.
    pub fn new(gpu: &'a Gpu, scene: Scene, config: Config, options: &TrainOptions) -> Result<Self, TrainError> {
        config.validate()?;
        if config.motion == MotionModel::Bodies {
            // What is wrong with them is said before the coarse stage, not after it.
            scene.carrying(&config)?;
        }
        // What is free in time is born at its own instant, when the fine stage begins.
        let points = match config.motion {
            MotionModel::HexPlane | MotionModel::Auto => grow::thin(&scene.points, config.init.max_points as usize),
            MotionModel::FreeTime if scene.moving_points().is_empty() => {
                return Err(SceneError::NoMovingPoints { path: scene.dataset.root.clone() }.into());
            }
            MotionModel::FreeTime | MotionModel::Bodies | MotionModel::Still => {
                grow::thin(&scene.still_points(), config.init.max_points as usize)
            }
        };
        let gaussians = Gaussians::from_points(&points, config.sh.max_degree, config.init.opacity);
        let moments = Moments::zero(&gaussians);
        let population = Population { gaussians, moments };
        let mut trainer = Self::assemble(gpu, scene, config, options, &population, Clock::default(), &[])?;
        trainer.find_regions()?;
        Ok(trainer)
    }

    /// A run that goes on from a checkpoint.
    ///
    /// # Errors
    /// [`TrainError::Field`] where the checkpoint's field does not fit the configuration.
    pub fn resume(
        gpu: &'a Gpu,
        scene: Scene,
        checkpoint: Checkpoint,
        options: &TrainOptions,
    ) -> Result<Self, TrainError> {
        let Checkpoint { config, clock, step, population, field_box, field, seen, levels, left_out, .. } = checkpoint;
        let (camera_colours, camera_poses) = (checkpoint.camera_colours, checkpoint.camera_poses);
        let fixed = checkpoint.fixed as u32;
        let camera_times = checkpoint.camera_times;
        let mut trainer = Self::assemble(gpu, scene, config, options, &population, clock, &levels)?;
        trainer.model.fixed = fixed;
        trainer.restore_poses(camera_poses)?;
        trainer.find_regions()?;
        if clock.stage == Stage::Fine {
            trainer.model.start_motion(gpu, &trainer.config, &trainer.scene, field_box)?;
            if let Some(motion) = &mut trainer.model.drawn.motion {
                motion.restore(gpu, field.as_ref())?;
            }
            trainer.start_following();
        }
        // After all that is found from the frames as the dataset has them, as in a run that was not stopped.
        trainer.restore_clocks(camera_times)?;
        trainer.model.step = step;
        trainer.statistics.replace(gpu, &seen)?;
        if let Some(state) = camera_colours.as_ref().filter(|_| trainer.colours_differ) {
            let (saved, views) = (state.steps.len(), trainer.scene.views.len());
            if saved != views {
                return Err(TrainError::Cameras { saved, views });
            }
            trainer.colours.restore(gpu, state);
        }
        trainer.left_out = left_out;
        if let Some(sums) = &checkpoint.loss_sums {
            trainer.work.sums.restore(gpu, sums);
        }
        Ok(trainer)
    }

    fn assemble(
        gpu: &'a Gpu,
        scene: Scene,
        config: Config,
        options: &TrainOptions,
        population: &Population,
        clock: Clock,
        levels: &[Vec<f32>],
    ) -> Result<Self, TrainError> {
        let work = Workspace::new(gpu, scene.max_pixels())?;
        let takes_frames: Vec<bool> = (0..scene.views.len()).map(|view| scene.has_frames(view)).collect();
        // With one camera there is nobody to differ from.
        let several = takes_frames.iter().filter(|takes| **takes).count() > 1;
        let colours_differ = config.camera_colour.enabled && several;
        let neutral = CameraColourState::neutral(&takes_frames);
        let colours = CameraColours::new(gpu, &neutral, scene.max_pixels())?;
        let mut trainer = Self {
            gpu,
            model: Model::new(gpu, population)?,
            schedule: Schedule::new(&config, options.budget),
            statistics: Statistics::new(gpu, population.gaussians.len() as u32)?,
            finite: FiniteCheck::new(gpu)?,
            work,
            feed: Feed::new(gpu, &scene, options.device_memory)?,
            levels: level::levels(gpu, &scene, config.earl.pairing, levels)?,
            event_near: Vec::new(),
            colours,
            colours_differ,
            poses: Poses::new(gpu, &scene, &config.camera_pose)?,
            clocks: Clocks::new(gpu, &scene, &config)?,
            follow: None,
            left_out: Vec::new(),
            deterministic: options.deterministic,
            times: StageTimes::default(),
            viewer: None,
            regions: Vec::new(),
            counted: OnceLock::new(),
            held_out_masks: None,
            scene,
            config,
            clock,
        };
        let views = trainer.scene.events.iter().map(|events| &trainer.scene.views[events.view].view);
        trainer.event_near = views.map(|view| trainer.near(view)).collect();
        Ok(trainer)
    }

    /// Trains until the schedule is over or `stop` is set, writing `run` as it goes.
    ///
    /// # Errors
    /// [`TrainError::Diverged`] names the quantity; the last checkpoint is then still there. Where a file of the dataset cannot be read
    /// any more, what was trained until then is saved.
    pub fn run(
        &mut self,
        run: &RunFolder,
        options: &TrainOptions,
        stop: &AtomicBool,
        watch: &mut dyn Watch,
    ) -> Result<Outcome, TrainError> {
        let outcome = self.train(run, options, stop, watch);
        if let Err(TrainError::Scene(_)) = &outcome {
            self.check_finite()?;
            self.checkpoint()?.save(&run.checkpoint_file())?;
            self.write_info(run)?;
        }
        outcome
    }

    fn train(
        &mut self,
        run: &RunFolder,
        options: &TrainOptions,
        stop: &AtomicBool,
        watch: &mut dyn Watch,
    ) -> Result<Outcome, TrainError> {
        run.write_config(&self.config.to_toml()?)?;
        run.write_dataset(&self.scene.dataset.manifest)?;
        // From here on a run is there for whoever looks, and says what it is.
        self.write_info(run)?;
        let mut curve = match self.schedule.done(&self.clock) {
            0 => run.create_curve()?,
            done => run.resume_curve(done)?,
        };
        let mut lap = Lap::begin(&self.clock);
        let mut looked = self.looks();
        // What was logged before a run was stopped is in its curve.
        let mut logged = Some(self.schedule.done(&self.clock)).filter(|&done| done > 0);
        let mut saved = Instant::now();
        loop {
            while self.schedule.is_over(&self.clock) {
                match self.clock.stage {
                    Stage::Coarse => {
                        self.begin_fine()?;
                        self.write_info(run)?;
                    }
                    Stage::Fine => {
                        self.end_following()?;
                        self.gpu.wait("training")?;
                        lap.tell(&mut self.clock);
                        if logged != Some(self.schedule.done(&self.clock)) {
                            self.check_finite()?;
                            self.log(&mut curve, options.evaluate, watch)?;
                        }
                        self.checkpoint()?.save(&run.checkpoint_file())?;
                        self.write_info(run)?;
                        return Ok(Outcome::Finished);
                    }
                }
            }
            self.iterate()?;
            self.control_density()?;
            let done = self.schedule.done(&self.clock);
            let looks = self.looks();
            let (log, evaluate, save) = {
                let evaluation = &self.config.evaluation;
                let due = |every: u32| every > 0 && done.is_multiple_of(u64::from(every));
                let evaluate = options.evaluate && (due(evaluation.every) || looks > looked);
                let seconds = 60.0 * evaluation.checkpoint_minutes;
                let by_clock = seconds > 0.0 && saved.elapsed().as_secs_f32() >= seconds;
                let save = due(evaluation.checkpoint_every) || by_clock || watch.wants_checkpoint();
                (due(evaluation.log_every), evaluate, save)
            };
            looked = looks;
            let look = watch.wants_look();
            let stopping = stop.load(Ordering::Relaxed);
            let pause = log || evaluate || save || stopping || look;
            if pause {
                self.gpu.wait("training")?;
            }
            lap.tell(&mut self.clock);
            if log || evaluate {
                self.check_finite()?;
                self.log(&mut curve, evaluate, watch)?;
                logged = Some(done);
            } else {
                watch.progress(&self.progress(None, None));
            }
            if save || stopping {
                // What is kept is whole: the last checkpoint is what a run that diverged is gone on with.
                self.check_finite()?;
                self.checkpoint()?.save(&run.checkpoint_file())?;
                saved = Instant::now();
            }
            if look {
                watch.look(self)?;
            }
            if stopping {
                self.write_info(run)?;
                return Ok(Outcome::Stopped);
            }
            if pause {
                // Evaluation, saving and looking are not training.
                lap = Lap::begin(&self.clock);
            }
        }
    }

    /// How many of the evaluations that `evaluation.count` asks for are due by now. They are spread over the run
    /// geometrically, from a hundredth of it on: early on, quality changes fast.
    fn looks(&self) -> u32 {
        const FIRST: f64 = 0.01;
        let steps = f64::from(self.config.evaluation.count.max(1) - 1).max(1.0);
        let share = self.share();
        let due = |look: u32| FIRST.powf(1.0 - f64::from(look) / steps) <= share + 1e-9;
        (0..self.config.evaluation.count).take_while(|&look| due(look)).count() as u32
    }

    fn log(&mut self, curve: &mut CurveWriter, evaluate: bool, watch: &mut dyn Watch) -> Result<(), TrainError> {
        let sums = &mut self.work.sums;
        let mean = |sum: f64, count: f64| (count > 0.0).then(|| sum / count);
        let rgb = mean(sums.rgb.take(self.gpu)?, std::mem::take(&mut sums.rgb_values));
        let event = mean(sums.event.take(self.gpu)?, std::mem::take(&mut sums.event_values));
        let trajectory = mean(std::mem::take(&mut sums.trajectory), std::mem::take(&mut sums.trajectory_samples));
        let colour = mean(sums.colour.take(self.gpu)?, std::mem::take(&mut sums.colour_samples));
        let plane = mean(std::mem::take(&mut sums.plane), std::mem::take(&mut sums.plane_samples));
        let iteration = self.schedule.done(&self.clock);
        for (what, value) in
            [("photometric loss", rgb), ("event loss", event), ("trajectory loss", trajectory), ("colour loss", colour)]
        {
            if value.is_some_and(|value| !value.is_finite()) {
                return Err(self.diverged(what));
            }
        }
        if let Some(loss) = rgb.filter(|&loss| loss > FAR_OFF)
            && self.sees_nothing()?
        {
            let lower = format!("learning_rate.scale={:e}", 0.5 * self.config.learning_rate.scale);
            return Err(TrainError::Vanished { iteration, loss, lower });
        }
        let quality = if evaluate { Some(self.evaluate_quickly()?) } else { None };
        let (psnr, dpsnr) = quality.map_or((None, None), |quality| (Some(quality.psnr), quality.dpsnr));
        curve.append(&CurveRow {
            iteration,
            stage: self.clock.stage.name().into(),
            wall_seconds: self.clock.seconds,
            loss_rgb: rgb,
            loss_event: event,
            loss_trajectory: trajectory,
            loss_colour: colour,
            loss_plane: plane,
            gaussians: u64::from(self.model.drawn.gaussians.count),
            dynamic: self.dynamic_count(),
            psnr,
            dpsnr,
            psnr_static: quality.and_then(|quality| quality.psnr_static),
            cpu_seconds: cpu::process_seconds().map(|_| self.clock.cpu_seconds),
        })?;
        watch.progress(&Progress { loss_rgb: rgb, loss_event: event, ..self.progress(psnr, dpsnr) });
        Ok(())
    }

    /// Whether no training camera shows any Gaussian at any of its frames. Before the fine stage nothing is said: what moves may be
    /// born with it.
    fn sees_nothing(&mut self) -> Result<bool, TrainError> {
        let count = self.model.drawn.gaussians.count as usize;
        let seen: Vec<[f32; 4]> = self.gpu.download(&self.model.gradients.screen, count)?;
        if self.clock.stage == Stage::Coarse || seen.iter().any(|row| row[3] > 0.0) {
            return Ok(false);
        }
        let looks: Vec<(View, f64)> =
            self.scene.frames.iter().map(|frame| (self.scene.views[frame.view].view, frame.t01)).collect();
        for (view, time) in looks {
            if self.render(&view, time)?.transmittance.iter().any(|&light| light < 0.99) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn dynamic_count(&self) -> u64 {
        if self.clock.stage == Stage::Fine { u64::from(self.model.drawn.dynamic) } else { 0 }
    }

    fn progress(&self, psnr: Option<f64>, dpsnr: Option<f64>) -> Progress {
        Progress {
            stage: self.clock.stage,
            iteration: self.schedule.done(&self.clock),
            iterations: self.schedule.iterations.iter().map(|&n| u64::from(n)).sum(),
            share: self.share(),
            seconds: self.clock.seconds,
            cpu_seconds: self.clock.cpu_seconds,
            gaussians: self.model.drawn.gaussians.count,
            dynamic: self.dynamic_count() as u32,
            loss_rgb: None,
            loss_event: None,
            psnr,
            dpsnr,
        }
    }

    /// How much of the whole run is done, 0 to 1.
    fn share(&self) -> f64 {
        let [coarse, fine] = self.schedule.iterations.map(f64::from);
        let total = (coarse + fine).max(1.0);
        let progress = self.schedule.progress(&self.clock);
        match self.clock.stage {
            Stage::Coarse => progress * coarse / total,
            Stage::Fine => (coarse + progress * fine) / total,
        }
    }

    fn check_finite(&self) -> Result<(), TrainError> {
        let gaussians = &self.model.drawn.gaussians;
        let (rows, row_floats) = self.model.motion_values();
        let [(paths, path_floats), (nodes, node_floats)] =
            self.model.drawn.motion.as_ref().and_then(Motion::bodies).map_or([(rows, 0); 2], |bodies| bodies.values());
        for (what, buffer, floats) in [
            ("positions, scales, rotations and opacities of the Gaussians", &gaussians.core, gaussians.count * 12),
            (GAUSSIANS_COLOURS, &gaussians.sh, gaussians.count * erfgs_splat::raster::sh_stride(gaussians.sh_degree)),
            (TRAJECTORIES, rows, row_floats),
            (PATHS, paths, path_floats),
            (PATHS, nodes, node_floats),
            (CAMERAS_COLOURS, &self.colours.values, self.colours.floats()),
        ] {
            let mut commands = self.gpu.commands();
            self.finite.scan(&mut commands, buffer, floats);
            commands.submit();
            if self.finite.take(self.gpu)? > 0 {
                return Err(self.diverged(what));
            }
        }
        Ok(())
    }

    fn diverged(&self, what: &str) -> TrainError {
        let two = |key: &str, [first, last]: [f32; 2]| format!("{key}=[{:e},{:e}]", 0.5 * first, 0.5 * last);
        let rates = &self.config.learning_rate;
        let lower = match what {
            GAUSSIANS_COLOURS => format!("learning_rate.sh_dc={:e}", 0.5 * rates.sh_dc),
            TRAJECTORIES => format!("free_time.velocity={:e}", 0.5 * self.config.free_time.velocity),
            PATHS => two("bodies.path", self.config.bodies.path),
            CAMERAS_COLOURS => two("camera_colour.rate", self.config.camera_colour.rate),
            _ => two("learning_rate.position", rates.position),
        };
        TrainError::Diverged { what: what.into(), iteration: self.schedule.done(&self.clock), lower }
    }

    /// Iterations done, over both stages.
    #[must_use]
    pub fn iterations_done(&self) -> u64 {
        self.schedule.done(&self.clock)
    }

    /// Everything that the run needs to go on.
    ///
    /// # Errors
    /// [`TrainError::Gpu`] where the device fails.
    pub fn checkpoint(&self) -> Result<Checkpoint, TrainError> {
        let Clock { stage, iteration, coarse, followed, .. } = self.clock;
        let timeless = Clock { stage, iteration, coarse, followed, ..Clock::default() };
        let field = self.field()?;
        Ok(Checkpoint {
            config: self.config.clone(),
            clock: if self.deterministic { timeless } else { self.clock },
            step: self.model.step,
            population: self.model.population(self.gpu)?,
            fixed: self.model.fixed as usize,
            field_box: self.model.field_box,
            record: Some(self.record(field.as_ref())?),
            points: self.initial_points(),
            field,
            seen: self.statistics.read(self.gpu)?,
            camera_colours: match self.colours_differ {
                true => Some(self.colour_state()?),
                false => None,
            },
            camera_poses: self.poses.as_ref().map(|poses| poses.state(self.gpu)).transpose()?,
            camera_times: self.clocks.as_ref().map(|clocks| clocks.state(self.gpu)).transpose()?,
            levels: self.levels.iter().map(|levels| levels.read(self.gpu)).collect::<Result<_, _>>()?,
            loss_sums: self.work.sums.state(self.gpu)?,
            left_out: self.left_out.clone(),
        })
    }

    /// The Gaussians as they stand, without what only training needs.
    ///
    /// # Errors
    /// [`TrainError::Gpu`] where the device fails.
    pub fn gaussians(&self) -> Result<Gaussians, TrainError> {
        Ok(self.model.drawn.gaussians(self.gpu)?)
    }

    /// What all Gaussians share of the motion, where they do: the deformation field, or the paths of bodies.
    ///
    /// # Errors
    /// [`TrainError::Field`] where the device fails.
    pub fn field(&self) -> Result<Option<FieldState>, TrainError> {
        Ok(self.model.drawn.motion.as_ref().map(|motion| motion.state(self.gpu)).transpose()?.flatten())
    }

    /// What the scene turned out not to need.
    #[must_use]
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// What a run with this scene, configuration and budget is.
    ///
    /// # Errors
    /// [`TrainError::Config`] where the configuration cannot be written.
    pub fn identity(dataset: &Dataset, config: &Config, budget: Budget) -> Result<Identity, TrainError> {
        Ok(Identity {
            dataset_sha256: dataset.sha256(),
            config: toml::Table::try_from(config).map_err(ConfigError::from)?,
            budget: [budget.seconds, budget.cpu_seconds],
            version: env!("CARGO_PKG_VERSION").into(),
        })
    }

    fn write_info(&self, run: &RunFolder) -> Result<(), TrainError> {
        let budget = self.schedule.budget;
        Ok(run.write_info(&RunInfo {
            format: RunInfo::FORMAT.into(),
            format_version: RunInfo::FORMAT_VERSION,
            method: match self.config.method {
                crate::config::Method::FourDgs => "4dgs".into(),
                crate::config::Method::ErfGs => "erf-gs".into(),
            },
            preset: match self.config.preset {
                crate::config::Preset::Paper => "paper".into(),
                crate::config::Preset::ReleasedCode => "released-code".into(),
                crate::config::Preset::Default => "default".into(),
            },
            dataset: self.scene.dataset.root.clone(),
            dataset_name: self.scene.dataset.manifest.name.clone(),
            dataset_sha256: Some(self.scene.dataset.sha256()),
            adapter: self.gpu.info.name.clone(),
            driver: format!("{} {}", self.gpu.info.driver, self.gpu.info.driver_info),
            version: env!("CARGO_PKG_VERSION").into(),
            seed: self.config.seed,
            minutes: budget.seconds.map(|seconds| seconds / 60.0),
            cpu_minutes: budget.cpu_seconds.map(|seconds| seconds / 60.0),
            identity: Some(Self::identity(&self.scene.dataset, &self.config, budget)?.sha256()),
            // Whoever writes what comes after the training says that it is there.
            finished: false,
            left_out: self.left_out.clone(),
            bodies: self.body_names(),
            camera_colours: self.camera_colours()?,
            camera_poses: self.camera_poses(),
            camera_times: self.camera_times(),
        })?)
    }

    /// What the bodies are called that carry Gaussians by now.
    fn body_names(&self) -> Vec<String> {
        self.model.drawn.motion.as_ref().and_then(Motion::bodies).map_or(Vec::new(), |bodies| bodies.names().to_vec())
    }

    /// Bytes of the device's memory that frames and events may take, and what all of them take.
    #[must_use]
    pub fn device_room(&self) -> [u64; 2] {
        self.feed.room(&self.scene, self.config.earl.enabled)
    }

    /// Where the cameras were found to stand, beside their calibration; nothing where that is not learned.
    #[must_use]
    pub fn camera_poses(&self) -> Vec<CameraPose> {
        self.poses.as_ref().map_or(Vec::new(), |poses| poses.told(&self.scene))
    }

    /// How much later the cameras are found to have taken their frames than these say; nothing where that is not learned.
    #[must_use]
    pub fn camera_times(&self) -> Vec<CameraTime> {
        self.clocks.as_ref().map_or(Vec::new(), |clocks| clocks.told(&self.scene))
    }

    /// The gains and offsets of all cameras.
    pub(crate) fn colour_state(&self) -> Result<CameraColourState, TrainError> {
        Ok(self.colours.state(self.gpu)?)
    }

    /// The gains and offsets of the cameras that have learned any.
    fn camera_colours(&self) -> Result<Vec<CameraColour>, TrainError> {
        let state = self.colour_state()?;
        let learned = self.scene.views.iter().enumerate().filter(|(view, _)| state.steps[*view] > 0);
        let colour = |(view, of): (usize, &SceneView)| {
            let [gain, offset] = state.of(view);
            CameraColour { camera: of.name.clone(), gain, offset }
        };
        Ok(learned.map(colour).collect())
    }
}
