//! The field on the device: planes, MLP, gradients and moments stay in its memory.
//!
//! A pass runs over its rows in chunks, so that the activations of the MLP fit in a bounded scratch; the backward pass
//! evaluates them again. Every sum has an order of its own that no scheduling changes: products and reductions by
//! construction, and the gradients of the planes because they are added as integers (`pull.wgsl`).

mod mlp;
mod planes;
mod product;

use wgpu::Buffer;

use super::{
    FieldError, Layout, PlaneLosses, PlaneWeights, Tape,
    backend::{Backend, Domain, PassGradients, Vectors},
};
use crate::{
    gpu::{Commands, Gpu, GpuError, stored},
    optimiser::{Adam, AdamBuffers, AdamConfig, FiniteCheck},
};
use mlp::Mlp;
use planes::Planes;

/// Parameters with gradients and moments, each a buffer of `floats` f32.
#[derive(Debug)]
struct Part {
    floats: usize,
    parameters: Buffer,
    gradients: Buffer,
    moments: [Buffer; 2],
}

/// A field in device memory.
#[derive(Debug)]
pub struct Device {
    grid: Part,
    mlp: Part,
    planes: Planes,
    layers: Mlp,
    adam: Adam,
    check: FiniteCheck,
}

/// What the backward pass needs again.
#[derive(Debug)]
pub struct DeviceTape {
    /// Rows that the buffers hold.
    rows: u32,
    /// Coordinates in the box, a vec4 a row.
    points: Buffer,
    /// Features, `[row, level, feature]`.
    features: Buffer,
}

impl DeviceTape {
    fn sizes(layout: &Layout, rows: u32) -> [u64; 2] {
        [16, 4 * layout.point_features() as u64].map(|each| u64::from(rows) * each)
    }

    /// Bytes that passes of so many rows leave.
    pub fn bytes(layout: &Layout, rows: u32) -> u64 {
        Self::sizes(layout, rows).into_iter().map(stored).sum()
    }
}

impl Part {
    fn new(gpu: &Gpu, label: &str, parameters: &[f32]) -> Result<Self, GpuError> {
        let empty = |what: &str| gpu.storage(&format!("{what} of the {label}"), size_of_val(parameters) as u64);
        Ok(Self {
            floats: parameters.len(),
            parameters: gpu.storage_from(label, parameters)?,
            gradients: empty("gradients")?,
            moments: [empty("first moments")?, empty("second moments")?],
        })
    }

    fn step(
        &self,
        commands: &mut Commands<'_>,
        adam: &Adam,
        rate: f32,
        config: &AdamConfig,
        step: u32,
    ) -> Result<(), GpuError> {
        let buffers = AdamBuffers {
            parameters: &self.parameters,
            gradients: &self.gradients,
            first_moment: &self.moments[0],
            second_moment: &self.moments[1],
            rows: self.floats.div_ceil(4) as u32,
            stride: 4,
            mask: None,
        };
        adam.step(commands, &buffers, &[rate; 4], config, step)?;
        commands.clear(&self.gradients);
        Ok(())
    }
}

impl Device {
    /// A field with these parameters and zero moments.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, layout: &Layout, parameters: &[f32]) -> Result<Self, GpuError> {
        let (grid, mlp) = parameters.split_at(layout.grid);
        Ok(Self {
            grid: Part::new(gpu, "planes of the field", grid)?,
            mlp: Part::new(gpu, "MLP of the field", mlp)?,
            planes: Planes::new(gpu, layout)?,
            layers: Mlp::new(gpu, layout)?,
            adam: Adam::new(gpu),
            check: FiniteCheck::new(gpu)?,
        })
    }

    /// Bytes of the device's memory that it takes where passes have `rows` rows.
    pub fn bytes(layout: &Layout, rows: u32) -> u64 {
        let parts = [layout.grid, layout.total - layout.grid];
        let parameters: u64 = parts.into_iter().map(|floats| 4 * stored(floats as u64 * 4)).sum();
        let at_once = Mlp::rows_at_once(layout, rows as usize);
        parameters + Planes::bytes(layout, at_once) + Mlp::bytes(layout, rows as usize)
    }

    /// Makes chunks of at most this many rows.
    #[cfg(test)]
    pub fn chunks_of(&mut self, rows: usize) {
        self.layers.most = rows;
    }
}

impl Backend for Device {
    fn forward(&mut self, gpu: &Gpu, domain: &Domain, core: &Buffer, tape: &mut Tape) -> Result<(), FieldError> {
        let Some(pass) = tape.pass else { return Ok(()) };
        let rows = tape.deltas.rows;
        if tape.device.as_ref().is_none_or(|held| held.rows != rows) {
            let [points, features] = DeviceTape::sizes(&domain.layout, rows);
            tape.device = Some(DeviceTape {
                rows,
                points: gpu.storage("points of a pass", points)?,
                features: gpu.storage("features of a pass", features)?,
            });
        }
        let Some(held) = &tape.device else { return Ok(()) };
        let mut commands = gpu.commands();
        self.planes.gather(&mut commands, domain, pass, &self.grid.parameters, core, held);
        commands.clear(&tape.deltas.core);
        if let Some(sh) = &tape.deltas.sh {
            commands.clear(sh);
        }
        self.layers.forward(&mut commands, &domain.layout, &self.mlp.parameters, pass.what, held, &tape.deltas)?;
        commands.submit();
        Ok(())
    }

    fn backward(&mut self, gpu: &Gpu, domain: &Domain, tape: &Tape, d: &PassGradients<'_>) -> Result<(), FieldError> {
        let (Some(pass), Some(held)) = (tape.pass, &tape.device) else { return Ok(()) };
        let mut commands = gpu.commands();
        self.planes.blend_lines(&mut commands, pass, &self.grid.parameters);
        let (planes, grid, check) = (&mut self.planes, &self.grid, &self.check);
        self.layers.backward(
            &mut commands,
            &domain.layout,
            [&self.mlp.parameters, &self.mlp.gradients],
            (held, pass.what),
            d,
            |commands, first, rows, d_features| {
                planes.pull(
                    commands,
                    domain,
                    &grid.parameters,
                    held,
                    [first, rows],
                    d_features,
                    check.counter(),
                    d.d_core,
                )
            },
        )?;
        self.planes.flush(&mut commands, &domain.layout, pass, &self.grid.gradients);
        commands.submit();
        Ok(())
    }

    fn regularise(&mut self, gpu: &Gpu, layout: &Layout, weights: &PlaneWeights) -> Result<PlaneLosses, FieldError> {
        Ok(self.planes.regularise(gpu, layout, [&self.grid.parameters, &self.grid.gradients], weights)?)
    }

    fn bad_gradients(&mut self, gpu: &Gpu) -> Result<u64, FieldError> {
        let mut commands = gpu.commands();
        for part in [&self.grid, &self.mlp] {
            self.check.scan(&mut commands, &part.gradients, part.floats as u32);
        }
        commands.submit();
        Ok(u64::from(self.check.take(gpu)?))
    }

    fn step(
        &mut self,
        gpu: &Gpu,
        _: &Layout,
        rates: [f32; 2],
        config: &AdamConfig,
        step: u32,
    ) -> Result<(), FieldError> {
        let mut commands = gpu.commands();
        self.grid.step(&mut commands, &self.adam, rates[0], config, step)?;
        self.mlp.step(&mut commands, &self.adam, rates[1], config, step)?;
        commands.submit();
        Ok(())
    }

    fn vectors(&self, gpu: &Gpu) -> Result<Vectors, FieldError> {
        let both = |of: fn(&Part) -> &Buffer| -> Result<Vec<f32>, GpuError> {
            let mut values = gpu.download(of(&self.grid), self.grid.floats)?;
            values.extend(gpu.download::<f32>(of(&self.mlp), self.mlp.floats)?);
            Ok(values)
        };
        Ok([both(|part| &part.parameters)?, both(|part| &part.moments[0])?, both(|part| &part.moments[1])?])
    }

    fn replace(&mut self, gpu: &Gpu, layout: &Layout, vectors: Vectors) -> Result<(), FieldError> {
        let mut commands = gpu.commands();
        let [parameters, first, second] = vectors.each_ref().map(|values| values.split_at(layout.grid));
        for (part, [parameters, first, second]) in
            [(&self.grid, [parameters.0, first.0, second.0]), (&self.mlp, [parameters.1, first.1, second.1])]
        {
            gpu.upload(&part.parameters, 0, parameters);
            gpu.upload(&part.moments[0], 0, first);
            gpu.upload(&part.moments[1], 0, second);
            commands.clear(&part.gradients);
        }
        commands.submit();
        Ok(())
    }

    #[cfg(test)]
    fn gradients(&self, gpu: &Gpu) -> Result<Vec<f32>, FieldError> {
        let mut values = gpu.download(&self.grid.gradients, self.grid.floats)?;
        values.extend(gpu.download::<f32>(&self.mlp.gradients, self.mlp.floats)?);
        Ok(values)
    }
}
