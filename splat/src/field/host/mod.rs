//! The field on the host, for software adapters: it reads means and gradients through mapped buffers, and writes deltas
//! back.

mod adam;
mod compute;
mod grid;
mod mlp;
mod regular;

use wgpu::Buffer;

use super::{
    FieldError, Layout, PlaneLosses, PlaneWeights, Tape,
    backend::{Backend, Domain, PassGradients, Vectors},
};
use crate::{
    gpu::{Gpu, Kernel, stored},
    optimiser::AdamConfig,
};
use compute::Compute;
pub use compute::HostTape;
use mlp::Rows;

/// A field in host memory.
#[derive(Debug)]
pub struct Host {
    compute: Compute,
    add_means: Kernel,
    /// Gradients of the means of a pass, as many as there were at most.
    d_means: Option<Buffer>,
}

impl Host {
    /// A field with these parameters and zero moments.
    pub fn new(gpu: &Gpu, layout: &Layout, parameters: Vec<f32>) -> Self {
        Self {
            compute: Compute::new(layout, parameters),
            add_means: gpu.kernel("add the gradient of the means", &[include_str!("add_means.wgsl")]),
            d_means: None,
        }
    }

    fn size_of_means(rows: u32) -> u64 {
        u64::from(rows) * 12
    }

    /// Bytes of the device's memory that passes of so many rows take.
    pub fn bytes(rows: u32) -> u64 {
        stored(Self::size_of_means(rows))
    }

    /// Makes tapes keep at most this many floats of activations.
    #[cfg(test)]
    pub fn keep_at_most(&mut self, floats: usize) {
        self.compute.keep = floats;
    }
}

impl Backend for Host {
    fn forward(&mut self, gpu: &Gpu, domain: &Domain, core: &Buffer, tape: &mut Tape) -> Result<(), FieldError> {
        let Some(pass) = tape.pass else { return Ok(()) };
        let (layout, rows) = (&domain.layout, tape.deltas.rows as usize);
        tape.host.points.resize(rows, [0.0; 3]);
        gpu.read(&[(core, rows * 12)], |slices: &[&[f32]]| {
            for (point, row) in tape.host.points.iter_mut().zip(slices[0].chunks_exact(12)) {
                *point = std::array::from_fn(|axis| (row[axis] - domain.origin[axis]) * domain.scale[axis]);
            }
        })?;
        let stride = layout.config.sh_stride as usize;
        let mut core = vec![0.0; rows * 12];
        let mut sh = vec![0.0; if tape.deltas.sh.is_some() { rows * stride } else { 0 }];
        self.compute.forward(layout, pass, &mut tape.host, &mut core, &mut sh);
        gpu.upload(&tape.deltas.core, 0, &core);
        if let Some(buffer) = &tape.deltas.sh {
            gpu.upload(buffer, 0, &sh);
        }
        Ok(())
    }

    fn backward(&mut self, gpu: &Gpu, domain: &Domain, tape: &Tape, d: &PassGradients<'_>) -> Result<(), FieldError> {
        let Some(pass) = tape.pass else { return Ok(()) };
        let rows = tape.deltas.rows;
        let mut buffers = vec![(d.core, rows as usize * 12)];
        buffers.extend(d.sh.map(|sh| (sh, rows as usize * domain.layout.config.sh_stride as usize)));
        let mut d_points = gpu.read(&buffers, |slices: &[&[f32]]| {
            let d_out = Rows { core: slices[0], sh: slices.get(1).copied().unwrap_or_default() };
            self.compute.backward(&domain.layout, pass, &tape.host, &d_out)
        })?;
        for d_point in &mut d_points {
            for (d, scale) in d_point.iter_mut().zip(domain.scale) {
                *d *= scale;
            }
        }
        let count = gpu.uniform("rows", &[rows, 0, 0, 0]);
        let bytes = Self::size_of_means(rows);
        let d_means = match self.d_means.take() {
            Some(buffer) if buffer.size() >= bytes => buffer,
            _ => gpu.storage("gradient of the means", bytes)?,
        };
        let d_means = &*self.d_means.insert(d_means);
        gpu.upload(d_means, 0, &d_points);
        let mut commands = gpu.commands();
        commands.dispatch(&self.add_means, &[&count, d_means, d.d_core], rows.div_ceil(256));
        commands.submit();
        Ok(())
    }

    fn regularise(&mut self, _: &Gpu, layout: &Layout, weights: &PlaneWeights) -> Result<PlaneLosses, FieldError> {
        Ok(self.compute.regularise(layout, weights))
    }

    fn bad_gradients(&mut self, _: &Gpu) -> Result<u64, FieldError> {
        Ok(adam::not_finite(&self.compute.gradients))
    }

    fn step(
        &mut self,
        _: &Gpu,
        layout: &Layout,
        rates: [f32; 2],
        config: &AdamConfig,
        step: u32,
    ) -> Result<(), FieldError> {
        self.compute.step(layout, rates, config, step);
        Ok(())
    }

    fn vectors(&self, _: &Gpu) -> Result<Vectors, FieldError> {
        let [first, second] = &self.compute.moments;
        Ok([self.compute.parameters.clone(), first.clone(), second.clone()])
    }

    fn replace(&mut self, _: &Gpu, layout: &Layout, vectors: Vectors) -> Result<(), FieldError> {
        self.compute.replace(layout, vectors);
        Ok(())
    }

    #[cfg(test)]
    fn gradients(&self, _: &Gpu) -> Result<Vec<f32>, FieldError> {
        Ok(self.compute.gradients.clone())
    }
}
