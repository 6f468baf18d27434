//! The stage: a small scene that can be rendered exactly from any camera at any time.
//!
//! A thrown ball that spins, a spinning fan and a swinging pendulum move before a furnished, textured room about 4 m
//! wide; or other things do, by name ([`Act`]). Everything is a closed-form function of time, with no state carried from one time to the next, so that a frame
//! with a true exposure integral, the events of an ideal sensor with microsecond crossing times, and the ground truth
//! (colour, depth, mask of what moves) can be had at any instant and from any viewpoint.
//!
//! Units are metres, y points down, the floor is y = 0; times are nanoseconds on the session clock ([`motion`] takes
//! seconds). Light is linear until [`colour::encode`].
//!
//! | module | what it knows |
//! |---|---|
//! | [`motion`] | where the ball, the fan and the pendulum are at a time |
//! | [`texture`], `paint` | band-limited procedural textures, and what each surface looks like |
//! | `shape`, `set` | the static primitives and the furniture built from them |
//! | [`act`], `cast` | what moves instead, by name and seed; the list of what moves |
//! | `path`, `form` | where each part of it is at a time; how a ray meets its shape |
//! | `actors` | the moving objects of a ray: order, colour |
//! | `light` | Lambert shading, the soft shadows |
//! | [`rig`] | where the cameras stand |
//! | [`view`] | one camera's pixels: colour, mask, depth at a time |
//! | [`events`] | the event sensor |
//! | [`truth`] | paths and surfaces of what moves, and which body a pixel shows |
//! | [`mod@film`] | the dataset writer |
//!
//! ```
//! use erfgs_stage::{RigOptions, Stage, StageOptions, StageView};
//! let stage = Stage::new(StageOptions::default());
//! let rig = RigOptions { width: 16, height: 12, rgb: 1, event: 0, test: 0, ..RigOptions::default() }.cameras(1)?;
//! let view = StageView::new(&stage, &rig[0].intrinsics, &rig[0].world_to_camera)?;
//! let pixels = view.frame(250_000_000); // linear light, a quarter of a second into the take
//! assert_eq!(pixels.len(), 16 * 12);
//! # Ok::<(), erfgs_stage::StageError>(())
//! ```

pub mod act;
mod activity;
mod actors;
mod cast;
pub mod colour;
mod error;
pub mod events;
pub mod film;
mod form;
mod light;
pub mod motion;
mod paint;
mod path;
mod pixel;
mod points;
pub mod rig;
mod set;
mod shape;
pub mod texture;
pub mod truth;
pub mod view;

use std::f64::consts::TAU;

pub use act::Act;
pub use error::StageError;
pub use events::EventOptions;
pub use film::{FilmOptions, FilmReport, film};
pub use points::truth_points;
pub use rig::{RigCamera, RigOptions, Role};
pub use truth::truth_bodies;
pub use view::StageView;

use self::{
    cast::Cast,
    light::Light,
    set::{Furniture, StageSet},
};

/// What can be chosen about a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct StageOptions {
    /// Seed of the textures.
    pub seed: u64,
    /// Whether the ball and the pendulum's bob cast shadows on the room, which then belong to the masks of what moves.
    /// (Furniture always casts them.)
    pub shadows: bool,
    /// Whether nothing moves: the room without the ball, the fan's blades and the pendulum.
    pub empty: bool,
    /// How the lamp flickers; it is steady without.
    pub flicker: Option<Flicker>,
    /// What happens, in place of the ball, the fan and the pendulum; an act that is named again counts once.
    pub acts: Vec<Act>,
    /// How long the take is that the acts happen in, seconds.
    pub seconds: f64,
    /// A pixel is the mean of `samples_per_axis` squared sub-pixel rays. At least 1.
    pub samples_per_axis: u32,
}

impl Default for StageOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            shadows: false,
            empty: false,
            flicker: None,
            acts: Vec::new(),
            seconds: 0.5,
            samples_per_axis: 3,
        }
    }
}

/// A lamp whose light goes up and down as a sine. The ambient light is steady.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flicker {
    /// How often, hertz: twice the mains' frequency for most lamps.
    pub hz: f64,
    /// The greatest deviation from the mean, as a share of it: 0 to 1.
    pub depth: f64,
}

/// The scene: what moves, what stands still, and the lamp.
#[derive(Clone, Debug)]
pub struct Stage {
    /// How it was made.
    pub options: StageOptions,
    cast: Cast,
    set: StageSet,
    light: Light,
}

impl Stage {
    /// Builds the scene. A `samples_per_axis` of 0 is taken as 1.
    #[must_use]
    pub fn new(options: StageOptions) -> Self {
        let options = StageOptions { samples_per_axis: options.samples_per_axis.clamp(1, 16), ..options };
        let (cast, furniture) = match options.acts.as_slice() {
            [] => (Cast::ordinary(), Furniture::ordinary()),
            acts => act::staged(acts, options.seed, options.seconds),
        };
        let set = StageSet::new(options.seed, &furniture);
        Self { options, cast, set, light: Light::default() }
    }

    /// Whether what moves casts shadows on the room.
    pub(crate) fn casts_shadows(&self) -> bool {
        self.options.shadows || self.options.acts.contains(&Act::Shadow)
    }

    /// The lamp's light at a time, seconds, as a share of its mean.
    pub(crate) fn lamp(&self, t: f64) -> f64 {
        self.options.flicker.map_or(1.0, |Flicker { hz, depth }| 1.0 + depth * (TAU * hz * t).sin())
    }
}

/// Seconds of a session time.
pub(crate) fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}
