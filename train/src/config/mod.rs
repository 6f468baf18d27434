//! The configuration of a training run. One TOML file, every field documented; the effective one is written into the
//! run folder. Where the paper and the released code of ERF-GS disagree, the field says so and [`Preset`] picks.

mod overrides;
mod presets;
mod ranges;

use serde::{Deserialize, Serialize};

pub use crate::cameras::{clock::CameraTimeOptions, colour::CameraColourOptions, pose::CameraPoseOptions};
pub use erfgs_splat::motion::{BodiesOptions, FreeTimeOptions, Guide};
pub use overrides::ConfigError;

/// What is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// 4D Gaussian splatting from frames alone (the baseline).
    #[serde(rename = "4dgs")]
    FourDgs,
    /// Event-RGB fusion: the same backbone with EARL and EDS.
    ErfGs,
}

/// Where the defaults come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// ERF-GS as the paper writes it.
    Paper,
    /// ERF-GS as its released code does it.
    ReleasedCode,
    /// Ours: what gives the best moving pixels per second.
    #[default]
    Default,
}

/// How the dynamic Gaussians move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionModel {
    /// A deformation field of planes and a network that all share (4DGS).
    #[default]
    #[serde(rename = "hexplane")]
    HexPlane,
    /// An instant, a velocity, an acceleration and a life for each Gaussian (after FreeTimeGS).
    FreeTime,
    /// Bodies whose Gaussians share paths for the whole recording, found before by `erfgs dataset bodies`; what no body explains is as
    /// with `free-time`.
    Bodies,
    /// Nothing moves: no motion is learned, and events, which tell of nothing else, are not looked at.
    Still,
    /// `free-time` where the dataset has points that are known to move, `still` where neither frames nor events show that
    /// anything does, else `hexplane`; see [`Config::settle`].
    Auto,
}

/// A switch that the program may decide from the data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Switch {
    /// On where the data needs it.
    #[default]
    Auto,
    /// Always on.
    On,
    /// Always off.
    Off,
}

/// Everything that decides a training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// What is trained.
    pub method: Method,
    /// Where the defaults came from.
    pub preset: Preset,
    /// Seed of everything random.
    pub seed: u64,
    /// Iterations of the coarse stage (no deformation, all times mixed).
    pub coarse_iterations: u32,
    /// Iterations of the fine stage.
    pub fine_iterations: u32,
    /// Samples an iteration.
    pub batch: u32,
    /// Colour behind everything, RGB in [0, 1].
    pub background: [f32; 3],
    /// Gaussians nearer than this are culled, metres; in a scene whose extent (how far the cameras stand apart) is less than five
    /// times that, a fifth of the extent.
    pub near_m: f32,
    /// Renderings from where no training camera stands leave out what is nearer than this share of the depth at which the
    /// initial points begin (0: off).
    pub near_share: f32,
    /// Gaussians that reach the camera with this many standard deviations are culled too (0: their centre counts).
    pub near_sigmas: f32,
    /// The SHA-256 of what stands still, where it is taken from another run and not learned ([`crate::static_set::StaticSet`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub static_set: Option<String>,
    /// Initialisation.
    pub init: InitConfig,
    /// Spherical harmonics.
    pub sh: ShConfig,
    /// Learning rates of all parameters, and how they decay.
    pub learning_rate: LearningRates,
    /// How the dynamic Gaussians move.
    #[serde(default)]
    pub motion: MotionModel,
    /// The deformation field, where the motion is `hexplane`.
    pub field: FieldOptions,
    /// Gaussians that are free in time, where the motion is `free-time` or, of those that no body carries, `bodies`.
    #[serde(default)]
    pub free_time: FreeTimeOptions,
    /// Bodies, where the motion is `bodies`.
    #[serde(default)]
    pub bodies: BodiesOptions,
    /// Adaptive density control.
    pub density: DensityConfig,
    /// Event-assisted regularised loss.
    pub earl: EarlConfig,
    /// Event-guided densification.
    pub eds: EdsConfig,
    /// The colour responses of the cameras.
    #[serde(default)]
    pub camera_colour: CameraColourOptions,
    /// The poses of the cameras.
    #[serde(default)]
    pub camera_pose: CameraPoseOptions,
    /// The clocks of the cameras.
    #[serde(default)]
    pub camera_time: CameraTimeOptions,
    /// Motion blur.
    pub blur: BlurConfig,
    /// Static Gaussians.
    pub dynamic: DynamicConfig,
    /// When to look at held-out cameras, and when to save.
    pub evaluation: EvaluationConfig,
}

/// Initialisation of the Gaussians.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InitConfig {
    /// Points beyond this many are thinned out by a voxel grid.
    pub max_points: u32,
    /// Points to draw at random where the dataset has no point cloud and `random` is asked for.
    pub random_points: u32,
    /// Opacity at the start.
    pub opacity: f32,
}

/// Spherical harmonics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShConfig {
    /// Highest degree, 0 to 3.
    pub max_degree: u32,
    /// One degree more every this many iterations of the coarse stage and, where it is not at its highest by then, of
    /// the fine stage.
    pub raise_every: u32,
}

/// Learning rates. Those of positions, planes and the network are multiplied by the scene's extent and fall
/// exponentially from the first to the last value over `decay_steps` iterations of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearningRates {
    /// Positions: first, last.
    pub position: [f32; 2],
    /// The network of the field: first, last.
    pub network: [f32; 2],
    /// The planes of the field: first, last.
    pub planes: [f32; 2],
    /// SH coefficients of degree 0.
    pub sh_dc: f32,
    /// The other SH coefficients.
    pub sh_rest: f32,
    /// Opacity logits.
    pub opacity: f32,
    /// Log-scales.
    pub scale: f32,
    /// Quaternions.
    pub rotation: f32,
    /// Steps of the decay; 0 means the iterations of the stage.
    pub decay_steps: u32,
    /// What Adam adds to the root of the second moment.
    pub adam_epsilon: f32,
}

/// The deformation field (HexPlane and heads).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldOptions {
    /// Multipliers of the spatial resolution, one level each.
    pub levels: Vec<u32>,
    /// Features a plane.
    pub features: u32,
    /// Cells along x, y and z at multiplier 1.
    pub spatial_resolution: u32,
    /// Rows along time. 0 means two for each RGB frame time.
    pub time_resolution: u32,
    /// Whether only the upper half of the time axis is used, as 4DGS does.
    pub upper_half_time: bool,
    /// Width of the network.
    pub width: u32,
    /// Depth of the trunk (0 and 1 are the same).
    pub depth: u32,
    /// Whether the last layer of every head starts at zero, so that the fine stage starts where the coarse one ended.
    pub zero_heads: bool,
    /// Whether the opacity is deformed.
    pub opacity_head: bool,
    /// Whether log-scales are deformed.
    pub scale_head: bool,
    /// Whether rotations are deformed.
    pub rotation_head: bool,
    /// Whether SH coefficients are deformed.
    pub sh_head: bool,
    /// Weight of the spatial smoothness of the planes.
    pub weight_spatial: f32,
    /// Weight of the smoothness along time.
    pub weight_time: f32,
    /// Weight of |1 - p| on the time planes.
    pub weight_l1_time: f32,
    /// Apply the plane regularisers every this many iterations, times as strong.
    pub regularise_every: u32,
    /// Whether the box of the planes encloses the moving Gaussians alone (so that no cell is spent on the background)
    /// instead of the whole cloud.
    pub box_of_moving: bool,
}

/// Clone, split and prune.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensityConfig {
    /// First iteration (of each stage) that may densify.
    pub from: u32,
    /// Densify every this many iterations.
    pub every: u32,
    /// Last iteration, as a share of the stage's iterations.
    pub until: f32,
    /// Mean screen-space gradient (NDC units) beyond which a Gaussian grows.
    pub gradient_threshold: f32,
    /// Gaussians larger than this share of the extent split, smaller ones are cloned.
    pub split_extent: f32,
    /// Above this many Gaussians nothing is added; 0: as many as the largest image has pixels, at least 10,000.
    pub max_gaussians: u32,
    /// Prune only above this many Gaussians (0: always).
    pub prune_above: u32,
    /// Gaussians less opaque than this are pruned.
    pub min_opacity: f32,
    /// Gaussians larger than this share of the extent are pruned (0: never).
    pub max_extent: f32,
    /// Gaussians wider than this share of the image are pruned (0: never).
    pub max_screen: f32,
    /// Reset opacities to at most 0.01 every this many iterations (0: never).
    pub opacity_reset_every: u32,
}

/// How a rendered brightness change is compared with an event count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantise {
    /// Truncate towards zero with a straight-through gradient (paper and code).
    TruncateSte,
    /// No loss while the change is within one threshold of the count, since the sensor's reference level at the start
    /// of the window is unknown by that much.
    DeadZone,
    /// Compare the change itself.
    None,
}

/// How the two times of an event sample are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pairing {
    /// t is an RGB frame time, t' the end of a random bin before the next one (paper and code).
    FrameAnchored,
    /// t is any bin boundary, t' any later one up to an RGB interval away.
    Any,
    /// t is any bin boundary, and there is no other: what a pixel's light was where its counts begin is learned beside the scene.
    Level,
}

/// The norm of the event loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Norm {
    /// Mean absolute difference (released code).
    L1,
    /// Mean squared difference (the paper's formula).
    L2,
}

/// Event-assisted regularised loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EarlConfig {
    /// Whether events are used in the loss.
    pub enabled: bool,
    /// Weight of the event loss. An error of so much light costs the same for sensors of all thresholds: one of 20 % is the unit.
    pub weight: f32,
    /// What that is multiplied by where frames tell of paths ([`Guide::Frames`]).
    #[serde(default = "one")]
    pub beside_frames: f32,
    /// Weight of the trajectory regulariser.
    pub weight_trajectory: f32,
    /// Weight of the colour regulariser.
    pub weight_colour: f32,
    /// Share of the iterations that have an event sample besides their frames; 0 means that event samples are drawn from
    /// one pool with the frames, in their place (released code).
    pub share: f32,
    /// First iteration of the fine stage with events.
    pub from: u32,
    /// How a change is compared with a count.
    pub quantise: Quantise,
    /// Norm of the difference between change and count.
    pub norm: Norm,
    /// Whether pixels are weighted by 1 / max(|E|, 1).
    pub confidence: bool,
    /// How the two times are drawn.
    pub pairing: Pairing,
    /// Bins an RGB interval; 0 means the subsampling factor of the dataset, or 8.
    pub bins: u32,
    /// Drop events without a neighbour in their bin (3 x 3 mean of the count at most 0.2).
    pub denoise: bool,
    /// Whether the ratio of the thresholds for ON and OFF is taken from the events where they tell another one than is stated (at
    /// most pixels the one adds what the other takes away), and what leaks and noise add up to is taken away.
    #[serde(default)]
    pub balance: bool,
    /// Whether events are read at the peaks of the light where it flickers, which then tell of everything else alone. Where pairs are
    /// tied to frames they cannot be.
    #[serde(default)]
    pub flicker: bool,
    /// Whether Gaussians that stand still learn from events, too.
    #[serde(default = "yes")]
    pub still_learn: bool,
}

impl Config {
    /// The weight of the event loss, by what tells of paths.
    pub(crate) fn event_weight(&self) -> f32 {
        let beside = self.motion == MotionModel::FreeTime && self.free_time.guide == Guide::Frames;
        self.earl.weight * if beside { self.earl.beside_frames } else { 1.0 }
    }
}

/// Which candidates EDS keeps by their distance from the Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coherence {
    /// The nearest (paper).
    Smallest,
    /// The farthest (released code).
    Largest,
}

/// What a ray gives where several depths on it survive the cross-validation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Uniqueness {
    /// The point nearest to the camera (paper).
    SmallestDepth,
    /// The middle of the depths, where they follow each other, and nothing where there is a gap: two things are on the ray, and
    /// events do not say which of them moved.
    #[default]
    OnlyRun,
}

/// Event-guided densification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EdsConfig {
    /// Whether events add Gaussians.
    pub enabled: bool,
    /// First iteration of the fine stage.
    pub from: u32,
    /// Every this many iterations.
    pub every: u32,
    /// Last iteration, as a share of the fine stage.
    pub until: f32,
    /// Nothing is added above this many Gaussians; 0: as many as the largest image has pixels, at least 10,000.
    pub max_gaussians: u32,
    /// Depths tried along a ray.
    pub depths: u32,
    /// Every how many pixels (along each axis) a ray starts.
    pub stride: u32,
    /// Source views a call, where there are more than this many event views; else one.
    pub sources: u32,
    /// Events (signed count) that a pixel needs.
    pub min_events: f32,
    /// Gaussians added a call.
    pub count: u32,
    /// Neighbours asked.
    pub neighbours: u32,
    /// What a ray gives where several of its depths survive.
    #[serde(default)]
    pub uniqueness: Uniqueness,
    /// A camera saw a point move if there are events within this many pixels of its projection.
    #[serde(default)]
    pub tolerance_px: u32,
    /// Whether a camera that does not have a point in its image refuses it. Where not, two cameras must have seen it move.
    #[serde(default = "yes")]
    pub all_must_see: bool,
    /// Whether the distance from the Gaussians is the lesser of those at both ends of the bin (paper), and not that at its
    /// beginning.
    #[serde(default)]
    pub both_ends: bool,
    /// Whether a candidate must end near its neighbours where the field itself takes it (paper), and not where it stands.
    #[serde(default)]
    pub own_deformation: bool,
    /// Which candidates are coherent.
    pub coherence: Coherence,
    /// A candidate moves with its neighbours if they stay within this distance, as a share of the extent.
    pub max_distance: f32,
    /// Opacity logit of a new Gaussian.
    pub opacity_logit: f32,
}

fn one() -> f32 {
    1.0
}

fn yes() -> bool {
    true
}

fn ten() -> f32 {
    10.0
}

/// Motion blur of the frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlurConfig {
    /// Whether a frame is compared with the mean of renderings over its exposure. `auto`: in the fine stage, where the
    /// manifest says that an exposure is longer than an instant.
    pub model: Switch,
    /// Renderings an exposure, spread evenly with both ends included.
    pub samples: u32,
    /// Whether only one of the renderings, drawn at random, is gone back through, with the weight of all of them: the
    /// same gradient on average at a third of the cost.
    pub one_gradient: bool,
    /// Where the blur model is off: the instant that a frame stands for, as a share of its exposure. `null` means the
    /// label in the manifest, or, where the motion is `free-time`, the middle.
    pub instant: Option<f32>,
}

/// Which Gaussians the field deforms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DynamicConfig {
    /// Whether Gaussians in parts of the scene where nothing moves skip the field.
    pub skip_static: bool,
    /// A pixel moves if its colour leaves its median over time by more than this (of 1).
    pub motion_threshold: f32,
    /// Moving pixels are grown by this many pixels.
    pub grow_px: u32,
    /// A Gaussian moves if it projects onto moving pixels in at least this share of the cameras that have it in view.
    pub share: f32,
    /// Only each n-th frame sample of the fine stage looks at the whole image, the others (and all event samples) at the
    /// parts where something moves. 1 means always the whole image.
    pub whole_image_every: u32,
    /// Whether the coarse stage, which knows no time, looks past the parts where something moves, so that what moves is
    /// not averaged away before the fine stage begins.
    pub coarse_without_moving: bool,
}

/// Evaluation and checkpoints during training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Evaluate on the held-out cameras every this many iterations, besides the evaluations of `count` (0: no more).
    pub every: u32,
    /// Evaluate so often, spread geometrically over the run by iterations or by the clock (0: never).
    #[serde(default)]
    pub count: u32,
    /// Use so many held-out frames during training, spread over cameras and time (0: all); the final evaluation uses all.
    #[serde(default)]
    pub frames: u32,
    /// Use each n-th held-out frame during training, before `frames` picks among them.
    pub frame_stride: u32,
    /// Save a checkpoint every this many iterations (0: not by iterations).
    pub checkpoint_every: u32,
    /// Save a checkpoint every this many minutes by the wall clock (0: not by the clock).
    #[serde(default = "ten")]
    pub checkpoint_minutes: f32,
    /// Write a row of the curve every this many iterations.
    pub log_every: u32,
}

impl EvaluationConfig {
    /// No looks at held-out cameras, and no checkpoint before the end: for runs that nobody watches or goes on with.
    pub fn leave_alone(&mut self) {
        (self.every, self.count, self.checkpoint_every, self.checkpoint_minutes) = (0, 0, 0, 0.0);
    }
}
