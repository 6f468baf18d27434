//! The deformation field: a HexPlane and an MLP that say how every dynamic Gaussian differs from its canonical self at
//! a time (4DGS, Wu et al. 2024).

mod config;

use wgpu::Buffer;

pub use config::{FieldConfig, FieldError, HeadInit, Heads, TimeAxis};

use crate::{gpu::Gpu, optimiser::AdamConfig, raster::Deltas};

/// Which outputs a forward pass computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outputs {
    /// Every head that is on.
    All,
    /// The position head alone; the other columns of the deltas are zero and there are no SH deltas.
    PositionOnly,
}

/// Weights of the regularisers of the planes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneWeights {
    /// Smoothness of the spatial planes (`plane_tv` in 4DGS).
    pub space: f32,
    /// Smoothness of the time planes along time (`time_smoothness` in 4DGS).
    pub time: f32,
    /// Distance of the time planes from 1 (`l1_time_planes` in 4DGS).
    pub time_l1: f32,
    /// What smoothness of a spatial plane means.
    pub form: SpatialSmoothness,
}

/// What smoothness of a spatial plane means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpatialSmoothness {
    /// Mean squared second difference along the plane's first stored axis alone (y of xy, z of xz and yz), as in 4DGS.
    #[default]
    SecondDifference,
    /// Total variation: mean squared first difference, along both axes.
    TotalVariation,
}

/// Values of the regularisers, before their weights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneLosses {
    /// Smoothness of the spatial planes, summed over levels and planes.
    pub space: f64,
    /// Smoothness of the time planes along time, summed over levels and planes.
    pub time: f64,
    /// Mean distance of the time planes from 1, summed over levels and planes.
    pub time_l1: f64,
}

/// A named vector of a saved state.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedVector {
    /// Such as `grid.level0.xy`, `trunk.0.weight`, `head.position.1.bias`; moments end in `.m` and `.v`.
    pub name: String,
    /// Its values. The layout of each is documented at [`Field::state`].
    pub values: Vec<f32>,
}

/// Parameters, moments and step counter of a field.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldState {
    /// Optimiser steps taken since the moments were zero.
    pub step: u32,
    /// All vectors, in a fixed order.
    pub vectors: Vec<NamedVector>,
}

/// What one forward pass leaves for its backward pass. Several may be alive at once.
#[derive(Debug)]
pub struct Tape {
    /// The outputs of the pass.
    pub deltas: Deltas,
}

impl Tape {
    /// An empty tape; a forward pass sizes it.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, FieldError> {
        Ok(Self { deltas: Deltas::new(gpu, "deltas", 0, None)? })
    }
}

/// The deformation field with its gradients and optimiser state.
#[derive(Debug)]
pub struct Field {}

impl Field {
    /// A freshly initialised field over the box `aabb` (lower and upper corner, metres).
    ///
    /// # Errors
    /// [`FieldError::Config`] and [`FieldError::Gpu`].
    pub fn new(_gpu: &Gpu, _config: &FieldConfig, _aabb: [[f32; 3]; 2], _seed: u64) -> Result<Self, FieldError> {
        todo!()
    }

    /// Evaluates the field at rows `0..rows` of `core` (12 floats a row) and time `t01`, clamped to [0, 1]. Fills
    /// `tape.deltas`, whose buffers are replaced where they do not fit.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn forward(
        &mut self,
        _gpu: &Gpu,
        _core: &Buffer,
        _rows: u32,
        _t01: f32,
        _tape: &mut Tape,
        _what: Outputs,
    ) -> Result<(), FieldError> {
        todo!()
    }

    /// Adds the gradients of planes, weights and biases for the pass on `tape` to the field, and those of the means to
    /// columns 0..3 of rows `0..rows` of `d_core` (12 floats a row).
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Mismatch`] where `d_deltas` has other rows than the tape.
    pub fn backward(
        &mut self,
        _gpu: &Gpu,
        _tape: &Tape,
        _d_deltas: &Deltas,
        _d_core: &Buffer,
    ) -> Result<(), FieldError> {
        todo!()
    }

    /// The trajectory regulariser: the mean over rows and axes of |x' - r|, where x' are the position deltas of `tape`
    /// and r = (1 - blend) `before` + `blend` `after`, which get no gradient. Adds `weight` times its gradient to columns
    /// 0..3 of `d_deltas`. Give the same deltas twice for a fixed reference.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Mismatch`] where the rows differ.
    pub fn trajectory_loss(
        &self,
        _gpu: &Gpu,
        _tape: &Tape,
        _reference: Blend<'_>,
        _weight: f32,
        _d_deltas: &Deltas,
    ) -> Result<f64, FieldError> {
        todo!()
    }

    /// Adds the gradients of the regularisers of the planes and returns their values.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn regularise(&mut self, _gpu: &Gpu, _weights: &PlaneWeights) -> Result<PlaneLosses, FieldError> {
        todo!()
    }

    /// One step of Adam over planes and MLP; the gradients are zero afterwards.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Diverged`] where a gradient is not finite: the parameters are then unchanged.
    pub fn step(&mut self, _gpu: &Gpu, _lr_grid: f32, _lr_mlp: f32, _config: &AdamConfig) -> Result<(), FieldError> {
        todo!()
    }

    /// Number of parameters: of the planes, of the MLP.
    #[must_use]
    pub fn parameters(&self) -> (usize, usize) {
        todo!()
    }

    /// Everything that a checkpoint needs.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn state(&self, _gpu: &Gpu) -> Result<FieldState, FieldError> {
        todo!()
    }

    /// Takes over a saved state.
    ///
    /// # Errors
    /// [`FieldError::State`] where it does not fit, [`FieldError::Gpu`].
    pub fn restore(&mut self, _gpu: &Gpu, _state: &FieldState) -> Result<(), FieldError> {
        todo!()
    }
}

/// A reference between two sets of deltas.
#[derive(Clone, Copy, Debug)]
pub struct Blend<'a> {
    /// The deltas at blend 0.
    pub before: &'a Deltas,
    /// The deltas at blend 1.
    pub after: &'a Deltas,
    /// Where between them.
    pub blend: f32,
}
