//! The deformation field: a HexPlane and an MLP that say how every dynamic Gaussian differs from its canonical self at
//! a time (4DGS, Wu et al. 2024).

mod backend;
mod config;
mod device;
mod host;
pub mod layout;
#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

pub use backend::Tape;
pub use config::{FieldConfig, FieldError, HeadInit, Heads, TimeAxis};
pub use layout::{Layout, Linear};

use backend::{Backend, Domain, Pass, PassGradients};
use device::{Device, DeviceTape};
use host::Host;

use crate::{
    gpu::{Gpu, Kernel, Shape},
    optimiser::AdamConfig,
    raster::Deltas,
};

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

/// The deformation field with its gradients and optimiser state.
#[derive(Debug)]
pub struct Field {
    domain: Domain,
    /// Adam steps taken.
    steps: u32,
    backend: Box<dyn Backend>,
    trajectory: Kernel,
}

impl Field {
    /// A freshly initialised field over the box `aabb` (lower and upper corner, metres).
    ///
    /// # Errors
    /// [`FieldError::Config`] and [`FieldError::Gpu`].
    pub fn new(gpu: &Gpu, config: &FieldConfig, aabb: [[f32; 3]; 2], seed: u64) -> Result<Self, FieldError> {
        let layout = Layout::new(config)?;
        let extent: [f32; 3] = std::array::from_fn(|axis| aabb[1][axis] - aabb[0][axis]);
        if !extent.iter().all(|extent| extent.is_finite() && *extent >= 0.0) {
            return Err(FieldError::Config { reason: format!("its box {aabb:?} is not a box") });
        }
        let parameters = layout.initial(seed);
        let backend: Box<dyn Backend> = match gpu.shape {
            Shape::Cpu => Box::new(Host::new(gpu, &layout, parameters)),
            Shape::Gpu => Box::new(Device::new(gpu, &layout, &parameters)?),
        };
        let scale = extent.map(|extent| if extent > 0.0 { 1.0 / extent } else { 0.0 });
        Ok(Self {
            domain: Domain { layout, origin: aabb[0], scale },
            steps: 0,
            backend,
            trajectory: gpu.kernel("trajectory regulariser", &[include_str!("trajectory.wgsl")]),
        })
    }

    /// Bytes of the device's memory that a field takes where passes have `rows` rows: of itself, and of the tape of each pass.
    #[must_use]
    pub fn bytes(gpu: &Gpu, layout: &Layout, rows: u32) -> [u64; 2] {
        let with_sh = layout.config.heads.sh.then_some(layout.config.sh_stride);
        let deltas = Deltas::bytes(rows, with_sh);
        match gpu.shape {
            Shape::Cpu => [Host::bytes(rows), deltas],
            Shape::Gpu => [Device::bytes(layout, rows), deltas + DeviceTape::bytes(layout, rows)],
        }
    }

    /// Where every parameter lies.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.domain.layout
    }

    /// Evaluates the field at rows `0..rows` of `core` (12 floats a row) and time `t01`, clamped to [0, 1]. Fills
    /// `tape.deltas`, whose buffers are replaced where they do not fit. A mean outside the box is clamped to it, as is
    /// one that is not a number (to its lower corner).
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn forward(
        &mut self,
        gpu: &Gpu,
        core: &Buffer,
        rows: u32,
        t01: f32,
        tape: &mut Tape,
        what: Outputs,
    ) -> Result<(), FieldError> {
        let layout = &self.domain.layout;
        let with_sh = layout.config.heads.sh && what == Outputs::All;
        tape.t01 = t01;
        tape.fit(gpu, rows, with_sh.then_some(layout.config.sh_stride))?;
        if rows == 0 || layout.heads_of(what).is_empty() {
            tape.pass = None;
            let mut commands = gpu.commands();
            commands.clear(&tape.deltas.core);
            commands.submit();
            return Ok(());
        }
        tape.pass = Some(Pass { what, time: layout.time_row(t01) });
        self.backend.forward(gpu, &self.domain, core, tape)
    }

    /// Adds the gradients of planes, weights and biases for the pass on `tape` to the field, and those of the means to
    /// columns 0..3 of rows `0..rows` of `d_core` (12 floats a row). The parameters must be those of the forward pass.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Mismatch`] where `d_deltas` does not have the shape of the tape's deltas.
    pub fn backward(&mut self, gpu: &Gpu, tape: &Tape, d_deltas: &Deltas, d_core: &Buffer) -> Result<(), FieldError> {
        let mismatch = |reason: String| FieldError::Mismatch { doing: "going backward".into(), reason };
        if d_deltas.rows != tape.deltas.rows {
            return Err(mismatch(format!("{} rows of gradients for {} of deltas", d_deltas.rows, tape.deltas.rows)));
        }
        if tape.deltas.sh.is_some() && d_deltas.sh.is_none() {
            return Err(mismatch("the gradient of the SH deltas is missing".into()));
        }
        let sh = d_deltas.sh.as_ref().filter(|_| tape.deltas.sh.is_some());
        let gradients = PassGradients { core: &d_deltas.core, sh, d_core };
        self.backend.backward(gpu, &self.domain, tape, &gradients)
    }

    /// The trajectory regulariser: the mean over rows and axes of |x' - r|, where x' are the position deltas of `tape`
    /// and r = (1 - blend) `before` + `blend` `after`, which get no gradient. Adds `weight` times its gradient to columns
    /// 0..3 of `d_deltas`. Give the same deltas twice for a fixed reference.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Mismatch`] where the rows differ.
    pub fn trajectory_loss(
        &self,
        gpu: &Gpu,
        tape: &Tape,
        reference: Blend<'_>,
        weight: f32,
        d_deltas: &Deltas,
    ) -> Result<f64, FieldError> {
        #[repr(C)]
        #[derive(Clone, Copy, Pod, Zeroable)]
        struct Uniform {
            rows: u32,
            blend: f32,
            scale: f32,
            padding: u32,
        }
        const ROWS: u32 = 16;
        let rows = tape.deltas.rows;
        let all = [reference.before.rows, reference.after.rows, d_deltas.rows];
        if all.iter().any(|other| *other != rows) {
            return Err(FieldError::Mismatch {
                doing: "regularising trajectories".into(),
                reason: format!("the passes have {rows} and {all:?} rows"),
            });
        }
        if rows == 0 {
            return Ok(0.0);
        }
        let scale = weight / (3.0 * rows as f32);
        let uniform = gpu.uniform("trajectory", &Uniform { rows, blend: reference.blend, scale, padding: 0 });
        let owners = rows.div_ceil(ROWS);
        let sums = gpu.storage("trajectory sums", u64::from(owners) * 4)?;
        let mut commands = gpu.commands();
        let inputs = [&tape.deltas.core, &reference.before.core, &reference.after.core];
        let bindings = [&uniform, inputs[0], inputs[1], inputs[2], &d_deltas.core, &sums];
        commands.dispatch(&self.trajectory, &bindings, owners.div_ceil(64));
        commands.submit();
        let sum = gpu.read(&[(&sums, owners as usize)], |slices: &[&[f32]]| {
            slices[0].iter().map(|sum| f64::from(*sum)).sum::<f64>()
        })?;
        Ok(sum / (3.0 * f64::from(rows)))
    }

    /// Adds the gradients of the regularisers of the planes and returns their values.
    ///
    /// Axes: a plane's rows run along the later of its two axes (y of xy, z of xz and yz, t of the time planes), which is
    /// the first one that 4DGS stores; second differences are taken along the rows. A plane of fewer than three rows has
    /// none.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn regularise(&mut self, gpu: &Gpu, weights: &PlaneWeights) -> Result<PlaneLosses, FieldError> {
        self.backend.regularise(gpu, &self.domain.layout, weights)
    }

    /// One step of Adam over planes and MLP; the gradients are zero afterwards.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Diverged`] where a gradient is not finite: the parameters are then unchanged.
    pub fn step(&mut self, gpu: &Gpu, lr_grid: f32, lr_mlp: f32, config: &AdamConfig) -> Result<(), FieldError> {
        let count = self.backend.bad_gradients(gpu)?;
        if count > 0 {
            return Err(FieldError::Diverged { what: "gradients".into(), count });
        }
        self.steps += 1;
        self.backend.step(gpu, &self.domain.layout, [lr_grid, lr_mlp], config, self.steps)
    }

    /// Number of parameters: of the planes, of the MLP.
    #[must_use]
    pub fn parameters(&self) -> (usize, usize) {
        let layout = &self.domain.layout;
        (layout.grid, layout.total - layout.grid)
    }

    /// Everything that a checkpoint needs. Planes are `[row, column, feature]` (rows along the later axis of the name,
    /// columns along the earlier one); weights are `[output, input]`. After each vector come its moments, `.m` and `.v`.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn state(&self, gpu: &Gpu) -> Result<FieldState, FieldError> {
        let [parameters, first, second] = self.backend.vectors(gpu)?;
        let sources = [("", parameters), (".m", first), (".v", second)];
        let places = self.domain.layout.vectors();
        let vectors = places.into_iter().flat_map(|(name, offset, length)| {
            let of = |(suffix, values): &(&str, Vec<f32>)| NamedVector {
                name: format!("{name}{suffix}"),
                values: values[offset..offset + length].to_vec(),
            };
            sources.each_ref().map(of)
        });
        Ok(FieldState { step: self.steps, vectors: vectors.collect() })
    }

    /// Takes over a saved state; gradients are zero afterwards.
    ///
    /// # Errors
    /// [`FieldError::State`] where it does not fit, [`FieldError::Gpu`].
    pub fn restore(&mut self, gpu: &Gpu, state: &FieldState) -> Result<(), FieldError> {
        let fail = |reason: String| Err(FieldError::State { reason });
        let layout = &self.domain.layout;
        let places = layout.vectors();
        if state.vectors.len() != 3 * places.len() {
            return fail(format!("it has {} vectors, not {}", state.vectors.len(), 3 * places.len()));
        }
        let mut flat = [0; 3].map(|_| vec![0.0_f32; layout.total]);
        for ((name, offset, length), vectors) in places.into_iter().zip(state.vectors.chunks_exact(3)) {
            for ((suffix, vector), flat) in ["", ".m", ".v"].into_iter().zip(vectors).zip(&mut flat) {
                if vector.name != format!("{name}{suffix}") || vector.values.len() != length {
                    let (found, values) = (&vector.name, vector.values.len());
                    return fail(format!(
                        "'{found}' of {values} values stands where '{name}{suffix}' of {length} should"
                    ));
                }
                flat[offset..offset + length].copy_from_slice(&vector.values);
            }
        }
        self.backend.replace(gpu, layout, flat)?;
        self.steps = state.step;
        Ok(())
    }

    /// The gradients of all parameters.
    #[cfg(test)]
    fn gradients(&self, gpu: &Gpu) -> Result<Vec<f32>, FieldError> {
        self.backend.gradients(gpu)
    }
}
