//! A training: what it consists of, and how it begins.

mod clocks;
mod follow;
mod frame_sample;
mod grow;
mod info;
mod level;
mod log;
mod memory;
mod model;
mod poses;
mod progress;
mod quiet;
mod record;
mod render;
mod samples;
mod saved;
mod stages;
mod static_set;
mod step;
mod summed;
mod sums;
mod training;

use std::sync::{Arc, OnceLock};

use self::{clocks::Clocks, follow::Follow, poses::Poses, step::Workspace};
pub use self::{
    memory::{DeviceMemory, Part},
    model::Model,
    progress::{Outcome, Progress, TrainError, TrainOptions, Watch},
    stages::StageTimes,
};
use crate::{
    cameras::colour::{CameraColourState, CameraColours},
    config::{Config, MotionModel},
    density::{Moments, Population, Statistics},
    evaluate::HeldOutMasks,
    feed::Feed,
    losses::Levels,
    scene::{Scene, SceneError},
    schedule::{Clock, Schedule},
};
use erfgs_run::LeftOut;
use erfgs_splat::{
    field::FieldState, gaussians::Gaussians, gpu::Gpu, model::Rendering, optimiser::FiniteCheck, raster::Region,
    trained::RecordedEvents,
};

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
            poses: Poses::find(gpu, &scene, &config.camera_pose)?,
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

    /// Bytes of the device's memory that frames and events may take, and what all of them take.
    #[must_use]
    pub fn device_room(&self) -> [u64; 2] {
        self.feed.room(&self.scene, self.config.earl.enabled)
    }

    /// The gains and offsets of all cameras.
    pub(crate) fn colour_state(&self) -> Result<CameraColourState, TrainError> {
        Ok(self.colours.state(self.gpu)?)
    }
}
