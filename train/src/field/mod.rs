//! The deformation field: a HexPlane and an MLP that say how every dynamic Gaussian differs from its canonical self at
//! a time (4DGS, Wu et al. 2024).

mod config;
mod host;
pub mod layout;
#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

pub use config::{FieldConfig, FieldError, HeadInit, Heads, TimeAxis};
pub use layout::{Layout, Linear};

use host::{Host, HostTape, Rows};

use crate::{
    gpu::{Gpu, Kernel},
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

/// What one forward pass leaves for its backward pass. Several may be alive at once; one may be used again and again.
///
/// It holds the coordinates and the grid features of the rows, and no activations of the MLP: the backward pass
/// evaluates the hidden layers again, block by block, which costs less than to write and read them.
#[derive(Debug)]
pub struct Tape {
    /// The outputs of the pass.
    pub deltas: Deltas,
    host: HostTape,
}

impl Tape {
    /// An empty tape; a forward pass sizes it.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, FieldError> {
        Ok(Self { deltas: Deltas::new(gpu, "deltas", 0, None)?, host: HostTape::default() })
    }

    /// Replaces the buffers of the deltas where they do not fit.
    fn fit(&mut self, gpu: &Gpu, rows: u32, sh_stride: Option<u32>) -> Result<(), FieldError> {
        if self.deltas.rows != rows || self.deltas.sh.is_some() != sh_stride.is_some() {
            self.deltas = Deltas::new(gpu, "deltas", rows, sh_stride)?;
        }
        Ok(())
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

/// The deformation field with its gradients and optimiser state.
#[derive(Debug)]
pub struct Field {
    layout: Layout,
    /// Lower corner of the box, and 1 / its extent (0 along an axis where it is flat).
    origin: [f32; 3],
    scale: [f32; 3],
    /// Adam steps taken.
    steps: u32,
    host: Host,
    add_means: Kernel,
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
        Ok(Self {
            origin: aabb[0],
            scale: extent.map(|extent| if extent > 0.0 { 1.0 / extent } else { 0.0 }),
            steps: 0,
            host: Host::new(&layout, parameters),
            add_means: gpu.kernel("add the gradient of the means", &[include_str!("add_means.wgsl")]),
            trajectory: gpu.kernel("trajectory regulariser", &[include_str!("trajectory.wgsl")]),
            layout,
        })
    }

    /// Where every parameter lies.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
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
        let with_sh = self.layout.config.heads.sh && what == Outputs::All;
        let stride = self.layout.config.sh_stride;
        tape.fit(gpu, rows, with_sh.then_some(stride))?;
        let count = rows as usize;
        let on = !self.layout.heads_of(what).is_empty();
        let host = &mut tape.host;
        host.what = on.then_some(what);
        host.time = self.layout.time_row(t01);
        host.points.resize(count, [0.0; 3]);
        if count > 0 {
            gpu.read(&[(core, count * 12)], |slices: &[&[f32]]| {
                for (point, row) in host.points.iter_mut().zip(slices[0].chunks_exact(12)) {
                    *point = std::array::from_fn(|axis| (row[axis] - self.origin[axis]) * self.scale[axis]);
                }
            })?;
        }
        let mut core = vec![0.0; count * 12];
        let mut sh = vec![0.0; if with_sh { count * stride as usize } else { 0 }];
        self.host.forward(&self.layout, host, &mut core, &mut sh);
        gpu.upload(&tape.deltas.core, 0, &core);
        if let Some(buffer) = &tape.deltas.sh {
            gpu.upload(buffer, 0, &sh);
        }
        Ok(())
    }

    /// Adds the gradients of planes, weights and biases for the pass on `tape` to the field, and those of the means to
    /// columns 0..3 of rows `0..rows` of `d_core` (12 floats a row). The parameters must be those of the forward pass.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Mismatch`] where `d_deltas` does not have the shape of the tape's deltas.
    pub fn backward(&mut self, gpu: &Gpu, tape: &Tape, d_deltas: &Deltas, d_core: &Buffer) -> Result<(), FieldError> {
        let rows = tape.deltas.rows as usize;
        let mismatch = |reason: String| FieldError::Mismatch { doing: "going backward".into(), reason };
        if d_deltas.rows as usize != rows {
            return Err(mismatch(format!("{} rows of gradients for {rows} of deltas", d_deltas.rows)));
        }
        let mut buffers = vec![(&d_deltas.core, rows * 12)];
        if tape.deltas.sh.is_some() {
            let sh = d_deltas.sh.as_ref().ok_or_else(|| mismatch("the gradient of the SH deltas is missing".into()))?;
            buffers.push((sh, rows * self.layout.config.sh_stride as usize));
        }
        if rows == 0 || tape.host.what.is_none() {
            return Ok(());
        }
        let (layout, host) = (&self.layout, &mut self.host);
        let mut d_points = gpu.read(&buffers, |slices: &[&[f32]]| {
            let d_out = Rows { core: slices[0], sh: slices.get(1).copied().unwrap_or_default() };
            host.backward(layout, &tape.host, &d_out)
        })?;
        for d_point in &mut d_points {
            for (d, scale) in d_point.iter_mut().zip(self.scale) {
                *d *= scale;
            }
        }
        let count = gpu.uniform("rows", &[rows as u32, 0, 0, 0]);
        let d_means = gpu.storage_from("gradient of the means", &d_points)?;
        let mut commands = gpu.commands();
        commands.dispatch(&self.add_means, &[&count, &d_means, d_core], (rows as u32).div_ceil(256));
        commands.submit();
        Ok(())
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
    pub fn regularise(&mut self, _gpu: &Gpu, weights: &PlaneWeights) -> Result<PlaneLosses, FieldError> {
        Ok(self.host.regularise(&self.layout, weights))
    }

    /// One step of Adam over planes and MLP; the gradients are zero afterwards.
    ///
    /// # Errors
    /// [`FieldError::Gpu`], [`FieldError::Diverged`] where a gradient is not finite: the parameters are then unchanged.
    pub fn step(&mut self, _gpu: &Gpu, lr_grid: f32, lr_mlp: f32, config: &AdamConfig) -> Result<(), FieldError> {
        let count = host::not_finite(&self.host.gradients);
        if count > 0 {
            return Err(FieldError::Diverged { what: "gradients".into(), count });
        }
        self.steps += 1;
        self.host.step(&self.layout, [lr_grid, lr_mlp], config, self.steps);
        Ok(())
    }

    /// Number of parameters: of the planes, of the MLP.
    #[must_use]
    pub fn parameters(&self) -> (usize, usize) {
        (self.layout.grid, self.layout.total - self.layout.grid)
    }

    /// Everything that a checkpoint needs. Planes are `[row, column, feature]` (rows along the later axis of the name,
    /// columns along the earlier one); weights are `[output, input]`. After each vector come its moments, `.m` and `.v`.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn state(&self, _gpu: &Gpu) -> Result<FieldState, FieldError> {
        let [first, second] = &self.host.moments;
        let sources = [("", &self.host.parameters), (".m", first), (".v", second)];
        let vectors = self
            .layout
            .vectors()
            .into_iter()
            .flat_map(|(name, offset, length)| {
                sources.map(|(suffix, values)| NamedVector {
                    name: format!("{name}{suffix}"),
                    values: values[offset..offset + length].to_vec(),
                })
            })
            .collect();
        Ok(FieldState { step: self.steps, vectors })
    }

    /// Takes over a saved state; gradients are zero afterwards.
    ///
    /// # Errors
    /// [`FieldError::State`] where it does not fit, [`FieldError::Gpu`].
    pub fn restore(&mut self, _gpu: &Gpu, state: &FieldState) -> Result<(), FieldError> {
        let fail = |reason: String| Err(FieldError::State { reason });
        let places = self.layout.vectors();
        if state.vectors.len() != 3 * places.len() {
            return fail(format!("it has {} vectors, not {}", state.vectors.len(), 3 * places.len()));
        }
        let mut flat = [const { Vec::new() }; 3];
        flat.iter_mut().for_each(|flat| flat.resize(self.layout.total, 0.0_f32));
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
        let [parameters, first, second] = flat;
        self.steps = state.step;
        self.host.parameters = parameters;
        self.host.moments = [first, second];
        self.host.gradients.fill(0.0);
        Ok(())
    }

    /// The gradients of all parameters.
    #[cfg(test)]
    fn gradients(&self, _gpu: &Gpu) -> Result<Vec<f32>, FieldError> {
        Ok(self.host.gradients.clone())
    }
}
