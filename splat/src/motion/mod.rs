//! How the dynamic Gaussians move: what a motion model gives is each one's difference from its stored parameters at a time,
//! and it takes the gradients of those differences back.
//!
//! Three models stand behind [`Motion`]: the deformation field of 4DGS, whose planes and network all Gaussians share
//! ([`crate::field`]); rows of their own for each Gaussian, born at an instant with a velocity ([`free_time`]); and bodies, whose
//! paths many Gaussians share for the whole recording ([`bodies`]).

pub mod bodies;
pub mod free_time;
mod plan;
pub mod track;

use wgpu::Buffer;

pub use bodies::{Bodies, BodiesOptions, MOST_NODES};
pub use free_time::{FAR, FreeTime, FreeTimeOptions, Guide, MOST_BETWEEN, MOST_KNOTS, PathError};
pub use plan::MotionPlan;

use crate::{
    field::{Field, FieldError, FieldState, Outputs, Tape},
    gpu::Gpu,
    raster::Deltas,
};

/// What a rendering was compared with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Supervision {
    /// A frame: it knows what is there. Several renderings may share its exposure, of which this is such a share.
    Frame(f32),
    /// Events: they know what changed.
    Events,
}

/// The time that a rendering shows, in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// When everything is shown, but for what `free_t01` is about.
    pub t01: f64,
    /// When Gaussians that are free in time are shown beside bodies. They learn what an exposure looks like as a whole, as they do
    /// without bodies: several instants of it would show each only for a part of its short life.
    pub free_t01: f64,
}

impl From<f64> for Shown {
    fn from(t01: f64) -> Self {
        Self { t01, free_t01: t01 }
    }
}

impl From<f32> for Shown {
    fn from(t01: f32) -> Self {
        f64::from(t01).into()
    }
}

/// The dynamic Gaussians on the device: their parameters, and what the motion model keeps for each, with its gradients; a row
/// for each Gaussian. The latter two are empty where the model keeps nothing.
#[derive(Clone, Copy, Debug)]
pub struct MotionRows<'a> {
    /// Core rows of the Gaussians, the dynamic ones first.
    pub core: &'a Buffer,
    /// How many of them are dynamic.
    pub count: u32,
    /// What the motion model keeps.
    pub values: &'a Buffer,
    /// Their gradients.
    pub gradients: &'a Buffer,
}

/// A camera's row of gradients of times.
#[derive(Clone, Copy, Debug)]
pub struct ClockRow<'a> {
    /// [`ClockRow::FLOATS`] a row: the gradient of the time of its frames (RGB intervals), and how many renderings were added.
    pub sums: &'a Buffer,
    /// Which row.
    pub row: u32,
}

impl ClockRow<'_> {
    /// Floats of a row.
    pub const FLOATS: usize = 2;
}

/// A model of how the dynamic Gaussians move.
#[derive(Debug)]
pub enum Motion {
    /// A deformation field over space and time.
    HexPlane(Box<Field>),
    /// A trajectory and a life for each Gaussian.
    FreeTime(Box<FreeTime>),
    /// Bodies on paths that their Gaussians share; the others are free in time.
    Bodies(Box<Bodies>),
}

impl Motion {
    /// Fills `tape.deltas` for the dynamic rows at a time.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn forward(
        &mut self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        time: impl Into<Shown>,
        tape: &mut Tape,
        what: Outputs,
    ) -> Result<(), FieldError> {
        let time = time.into();
        let t01 = time.t01 as f32;
        match self {
            Self::HexPlane(field) => field.forward(gpu, rows.core, rows.count, t01, tape, what),
            Self::FreeTime(model) => model.forward(gpu, rows, t01, tape),
            Self::Bodies(model) => model.forward(gpu, rows, time, tape),
        }
    }

    /// Takes the gradients of the deltas of the pass on `tape` to the parameters of the model; those of the Gaussians
    /// themselves are added to `d_core`.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Mismatch`].
    pub fn backward(
        &mut self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        tape: &Tape,
        d_deltas: &Deltas,
        d_core: &Buffer,
        supervision: Supervision,
    ) -> Result<(), FieldError> {
        match self {
            Self::HexPlane(field) => field.backward(gpu, tape, d_deltas, d_core),
            Self::FreeTime(model) => model.backward(gpu, rows, tape, d_deltas, d_core, supervision),
            Self::Bodies(model) => model.backward(gpu, rows, tape, d_deltas, d_core, supervision),
        }
    }

    /// Adds the gradient of the time of the pass on `tape`, which was the last to be gone back through, to a camera's row, where the model
    /// tells it: a deformation field does not.
    pub fn clock(&self, gpu: &Gpu, rows: MotionRows<'_>, tape: &Tape, d_deltas: &Deltas, to: ClockRow<'_>) {
        match self {
            Self::HexPlane(_) => {}
            Self::FreeTime(model) => model.clock(gpu, rows, tape, d_deltas, to),
            Self::Bodies(model) => model.clock(gpu, rows, tape, d_deltas, to),
        }
    }

    /// The deformation field, where this is one.
    #[must_use]
    pub fn field(&self) -> Option<&Field> {
        match self {
            Self::HexPlane(field) => Some(field),
            Self::FreeTime(_) | Self::Bodies(_) => None,
        }
    }

    /// The deformation field, where this is one.
    pub fn field_mut(&mut self) -> Option<&mut Field> {
        match self {
            Self::HexPlane(field) => Some(field),
            Self::FreeTime(_) | Self::Bodies(_) => None,
        }
    }

    /// The bodies, where there are any.
    #[must_use]
    pub fn bodies(&self) -> Option<&Bodies> {
        match self {
            Self::Bodies(bodies) => Some(bodies),
            Self::HexPlane(_) | Self::FreeTime(_) => None,
        }
    }

    /// The bodies, where there are any.
    pub fn bodies_mut(&mut self) -> Option<&mut Bodies> {
        match self {
            Self::Bodies(bodies) => Some(bodies),
            Self::HexPlane(_) | Self::FreeTime(_) => None,
        }
    }

    /// What is shared by all Gaussians, if anything is: parameters, moments and step counter.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn state(&self, gpu: &Gpu) -> Result<Option<FieldState>, FieldError> {
        match self {
            Self::HexPlane(field) => Ok(Some(field.state(gpu)?)),
            Self::Bodies(bodies) => Ok(Some(bodies.state(gpu)?)),
            Self::FreeTime(_) => Ok(None),
        }
    }

    /// Goes on from what [`Motion::state`] gave.
    ///
    /// # Errors
    /// [`FieldError::State`] where that is of another model, or of one of another size.
    pub fn restore(&mut self, gpu: &Gpu, state: Option<&FieldState>) -> Result<(), FieldError> {
        match (self, state) {
            (Self::HexPlane(field), Some(state)) => field.restore(gpu, state),
            (Self::Bodies(bodies), Some(state)) => bodies.restore(gpu, state),
            (Self::FreeTime(_), None) => Ok(()),
            _ => {
                let reason = "it was saved with another motion model; resume with the same `motion`".into();
                Err(FieldError::State { reason })
            }
        }
    }
}
