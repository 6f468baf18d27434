//! What a training will take of its device's memory, before it takes any.

use erfgs_base::memory;
use erfgs_splat::{
    field::{Field, Layout},
    gpu::{Gpu, Shape, stored},
    motion::{
        Bodies, FreeTime,
        bodies::{EXTRA_FLOATS, Start},
    },
    raster::{Deltas, GaussianBuffers, Gradients, Load},
};
use serde::Serialize;

use super::{TrainError, Trainer, model::field_config, step::Workspace};
use crate::{
    cameras::colour::CameraColours,
    config::{Config, MotionModel, Pairing, Switch},
    density::Statistics,
    losses::Levels,
    scene::Scene,
    schedule::Stage,
    start::unexplained,
};

/// A part of what a training takes of its device's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// Gaussians with their gradients and moments, and what moves them.
    Gaussians,
    /// Renderings: pictures, and which Gaussian lies in which tile.
    Renderings,
    /// Losses, and what is learned of pixels and cameras.
    Pictures,
    /// What is learned from, as far as it stays on the device.
    FramesAndEvents,
    /// What is on its way to the device, or about to be replaced.
    Passing,
}

/// What a run will take of its device's memory, bytes: buffers alone, by the functions that they are made by.
///
/// It is an estimate from above, but for one thing: how many tiles Gaussians lie in is known once they are drawn. Each is taken to lie in
/// four, and each tile to have 64 more besides ([`Load`]). What learns may all be moving, and the most Gaussians are those that the
/// settings allow, whether or not training comes to have so many.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct DeviceMemory {
    /// With the Gaussians that the fine stage begins with.
    pub start: u64,
    /// With as many as `density.max_gaussians` and `eds.max_gaussians` allow.
    pub most: u64,
    /// How many Gaussians those are.
    pub gaussians: [u32; 2],
    /// What takes most, with as many as are allowed, and how much that is.
    pub largest: (Part, u64),
    /// What the device has; of memory that it shares with the processor, what is free and what buffers have of it already. `None` where
    /// nobody says.
    pub has: Option<u64>,
    /// Where it has less than the most: the largest value of both settings for which it has enough, if there is one.
    pub setting: Option<u32>,
}

impl DeviceMemory {
    /// Whether the device has too little for as many Gaussians as are allowed.
    #[must_use]
    pub fn may_run_out(&self) -> bool {
        self.has.is_some_and(|has| self.most > has)
    }

    /// Whether it has too little for those of the start.
    #[must_use]
    pub fn begins_beyond(&self) -> bool {
        self.has.is_some_and(|has| self.start > has)
    }
}

/// Kernels, uniforms, counters, and what wgpu keeps for itself.
const SMALL: u64 = 2 << 20;

/// What decides how much is taken.
struct Plan<'a> {
    gpu: &'a Gpu,
    scene: &'a Scene,
    config: &'a Config,
    sh_degree: u32,
    /// Gaussians that there are, and those of them that do not learn.
    begun: u32,
    fixed: u32,
    /// Gaussians that come with the fine stage.
    born: u32,
    motion: Motion,
    /// Frames and events, and what of them is on the way at a time.
    feed: [u64; 2],
}

/// What the motion model needs to know.
enum Motion {
    Still,
    Field(Layout),
    FreeTime,
    Bodies(Box<Start>),
}

impl Plan<'_> {
    fn uses_events(&self) -> bool {
        self.config.earl.enabled && !self.scene.events.is_empty()
    }

    /// Renderings that are there at once: those of an exposure or of an event sample, on a graphics processor of each sample.
    fn renderings(&self) -> u64 {
        let config = self.config;
        let bodies = matches!(self.motion, Motion::Bodies(_)) && config.bodies.exposure > 1;
        let of_exposure = match (bodies, self.scene.has_blur()) {
            (_, false) => 1,
            (true, true) => config.bodies.exposure,
            (false, true) if config.blur.model != Switch::Off => config.blur.samples.max(1),
            (false, true) => 1,
        };
        let of_events = match (self.uses_events(), config.earl.pairing) {
            (false, _) => 0,
            (true, Pairing::Level) => 1,
            (true, _) => 2,
        };
        let [of_exposure, of_events, batch] = [of_exposure, of_events, config.batch].map(u64::from);
        let of_sample = of_exposure.max(of_events);
        match self.gpu.shape {
            Shape::Cpu => of_sample,
            Shape::Gpu => batch * of_sample + of_events + if bodies { batch * of_exposure } else { 0 },
        }
    }

    /// The most Gaussians where both settings are so, or as they are.
    fn most(&self, setting: Option<u32>) -> u32 {
        let most = |own: u32| super::grow::most(self.scene, setting.unwrap_or(own));
        let eds = &self.config.eds;
        let learning = self.begun - self.fixed;
        let by_events =
            if eds.enabled && self.uses_events() { most(eds.max_gaussians).saturating_add(2 * eds.count) } else { 0 };
        let most = most(self.config.density.max_gaussians).max(learning).saturating_add(self.born).max(by_events);
        most.saturating_add(self.fixed)
    }

    fn bytes(&self, gaussians: u32) -> u64 {
        SMALL + self.parts(gaussians).iter().map(|(_, bytes)| bytes).sum::<u64>()
    }

    /// Bytes of each part with so many Gaussians.
    fn parts(&self, gaussians: u32) -> [(Part, u64); 5] {
        let (gpu, scene, config) = (self.gpu, self.scene, self.config);
        let [core, sh] = GaussianBuffers::sizes(gaussians, self.sh_degree);
        let gradients: u64 = Gradients::sizes(gaussians, self.sh_degree).iter().sum();
        let free = matches!(self.motion, Motion::FreeTime | Motion::Bodies(_));
        let aside = if free && config.free_time.events_move_only { core + sh } else { 0 };
        let row_floats = match self.motion {
            Motion::Still | Motion::Field(_) => 0,
            Motion::FreeTime => config.free_time.floats(),
            Motion::Bodies(_) => config.free_time.floats() + EXTRA_FLOATS,
        };
        let rows = stored(u64::from(gaussians) * row_floats as u64 * 4);
        let deltas = Deltas::bytes(gaussians, None);
        let sh_stride = erfgs_splat::raster::sh_stride(self.sh_degree);
        let ([motion, tape], d_deltas) = match &self.motion {
            Motion::Still => ([0, 0], 0),
            Motion::Field(layout) => (
                Field::bytes(gpu, layout, gaussians),
                Deltas::bytes(gaussians, config.field.sh_head.then_some(sh_stride)),
            ),
            Motion::FreeTime => ([FreeTime::BYTES, deltas], deltas),
            Motion::Bodies(start) => ([Bodies::bytes(start, gaussians), deltas], deltas),
        };
        let statistics = Statistics::bytes(gaussians);
        let learned = 3 * (core + sh) + 3 * rows + statistics;
        let of_gaussians = learned + gradients + aside + rows + d_deltas + motion;

        let views = scene.views.iter().map(|view| Load::new(gpu, gaussians, [view.view.width, view.view.height]));
        let (frame, shared) =
            views.fold((0, 0), |(frame, shared), load| (load.frame().max(frame), load.shared().max(shared)));
        // One more is the viewer's, that of evaluations; and passes without a rendering.
        let renderings = self.renderings() + 1;
        let field = matches!(self.motion, Motion::Field(_)) && self.uses_events();
        let tapes = renderings + if field { 3 } else { 1 };
        let drawn = renderings * frame + tapes * tape + shared;

        let pixels = scene.max_pixels();
        let levels: u64 = match config.earl.pairing {
            Pairing::Level => scene.events.iter().map(|events| Levels::bytes(events.pixels())).sum(),
            _ => 0,
        };
        let of_images = Workspace::bytes(pixels) + CameraColours::bytes(scene.views.len(), pixels) + levels;
        // What is uploaded lies in memory a second time until it is there, and what is replaced until the next is.
        let parameters = match &self.motion {
            Motion::Field(layout) if gpu.shape == Shape::Gpu => 4 * layout.total as u64,
            _ => 0,
        };
        let [held, on_the_way] = self.feed;
        let replaced = 2 * (core + sh);
        let passing = (learned + parameters + replaced).max(levels + learned).max(on_the_way);
        [
            (Part::Gaussians, of_gaussians),
            (Part::Renderings, drawn),
            (Part::Pictures, of_images),
            (Part::FramesAndEvents, held),
            (Part::Passing, passing),
        ]
    }

    fn estimate(&self, has: Option<u64>) -> DeviceMemory {
        let gaussians = [self.begun.saturating_add(self.born), self.most(None)];
        let [start, most] = gaussians.map(|gaussians| self.bytes(gaussians));
        let fits = |setting: u32| has.is_some_and(|has| self.bytes(self.most(Some(setting))) <= has);
        let setting = has.filter(|&has| most > has).and_then(|_| {
            // 1 is the least that is no default.
            let (mut fitting, mut too_many) = (1, gaussians[1].max(2));
            if !fits(fitting) {
                return None;
            }
            while too_many - fitting > 1 + fitting / 100 {
                let middle = fitting + (too_many - fitting) / 2;
                if fits(middle) { fitting = middle } else { too_many = middle }
            }
            Some(fitting)
        });
        let mut parts = self.parts(gaussians[1]);
        parts.sort_by_key(|(_, bytes)| std::cmp::Reverse(*bytes));
        DeviceMemory { start, most, gaussians, largest: parts[0], has, setting }
    }
}

/// What the device has; of memory that it shares with the processor, what is free and what buffers have of it already.
fn has(gpu: &Gpu) -> Option<u64> {
    if !gpu.shares_memory() {
        return gpu.memory();
    }
    memory::available().map(|free| free.saturating_add(gpu.memory_taken().unwrap_or(0)))
}

impl Trainer<'_> {
    /// What the run takes of its device's memory from where it stands.
    ///
    /// # Errors
    /// [`TrainError`] where what it starts from cannot be read.
    pub fn device_memory(&self) -> Result<DeviceMemory, TrainError> {
        let (scene, config) = (&self.scene, &self.config);
        let births = |points: usize| match config.free_time.knots {
            0 => points,
            _ => points.saturating_mul(1 + config.free_time.between as usize),
        };
        let (motion, born) = match config.motion {
            MotionModel::Still => (Motion::Still, 0),
            MotionModel::HexPlane | MotionModel::Auto => {
                let field = field_config(&config.field, config.sh.max_degree, scene.frame_times.len());
                (Motion::Field(Layout::new(&field)?), 0)
            }
            MotionModel::FreeTime => (Motion::FreeTime, births(scene.moving_points().len())),
            MotionModel::Bodies => {
                let start = scene.bodies(config)?;
                let rest = unexplained(&start, &scene.moving_points(), scene.recording().length());
                let born = start.gaussians.len() + births(rest.len());
                (Motion::Bodies(Box::new(start)), born)
            }
        };
        let begun = self.model.drawn.gaussians.count;
        // Which of them learn beside a static set is found later; some of its own points do.
        let (fixed, own) = match config.static_set {
            Some(_) => (begun, scene.still_points().len().min(config.init.max_points as usize)),
            None => (0, 0),
        };
        let born = match self.clock.stage {
            Stage::Fine => 0,
            Stage::Coarse => u32::try_from(born.saturating_add(own)).unwrap_or(u32::MAX),
        };
        let feed = self.feed.bytes(scene, config.earl.enabled);
        let sh_degree = config.sh.max_degree;
        let plan = Plan { gpu: self.gpu, scene, config, sh_degree, begun, fixed, born, motion, feed };
        Ok(plan.estimate(has(self.gpu)))
    }
}
