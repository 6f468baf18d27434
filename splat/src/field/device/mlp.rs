//! The MLP on the device, chunk by chunk of rows.

use wgpu::Buffer;

use super::{
    DeviceTape,
    product::{Layer, Place, Products},
};
use crate::{
    field::{
        Layout, Linear, Outputs,
        backend::PassGradients,
        layout::{Head, Target},
    },
    gpu::{Commands, Gpu, GpuError, stored},
    raster::Deltas,
};

/// Bytes of the largest scratch buffer.
const SCRATCH: usize = 64 << 20;

/// Activations and gradients of a chunk.
#[derive(Debug)]
struct Scratch {
    rows: usize,
    /// Outputs of the trunk layers after their ReLU, `[row, width]` each.
    trunk: Vec<Buffer>,
    /// Hidden layers of the heads after their ReLU, `[row, head, width]`, and their gradient.
    hidden: [Buffer; 2],
    /// Gradients of the trunk layers, in turn.
    d_trunk: [Buffer; 2],
    d_features: Buffer,
}

/// The layers' kernels and scratch.
#[derive(Debug)]
pub struct Mlp {
    products: Products,
    scratch: Option<Scratch>,
    /// Rows of a chunk at most.
    pub most: usize,
}

impl Mlp {
    /// Compiles the kernels.
    pub fn new(gpu: &Gpu, layout: &Layout) -> Result<Self, GpuError> {
        let [largest, most] = Self::largest(layout);
        Ok(Self { products: Products::new(gpu, largest)?, scratch: None, most })
    }

    /// Weights and biases of the largest layer, and rows of a chunk at most.
    fn largest(layout: &Layout) -> [usize; 2] {
        let hidden = layout.config.width as usize * layout.heads.len();
        let largest = layout.config.width as usize * hidden.max(layout.point_features()) + hidden;
        [largest, (SCRATCH / 4 / hidden / 128 * 128).max(128)]
    }

    /// Rows that a pass of `rows` rows has scratch for.
    pub fn rows_at_once(layout: &Layout, rows: usize) -> usize {
        rows.min(Self::largest(layout)[1])
    }

    /// Bytes of products and scratch for passes of `rows` rows.
    pub fn bytes(layout: &Layout, rows: usize) -> u64 {
        let at_once = Self::rows_at_once(layout, rows);
        let [trunk, hidden, features] = across(layout).map(|across| stored(scratch_bytes(at_once, across)));
        let layers = layout.trunk.len() as u64;
        stored(Products::bytes(Self::largest(layout)[0])) + (layers + 2) * trunk + 2 * hidden + features
    }

    /// Evaluates the heads of `what` into zeroed deltas.
    pub fn forward(
        &mut self,
        commands: &mut Commands<'_>,
        layout: &Layout,
        parameters: &Buffer,
        what: Outputs,
        tape: &DeviceTape,
        deltas: &Deltas,
    ) -> Result<(), GpuError> {
        let all = tape.rows as usize;
        self.fit(commands.gpu(), layout, all)?;
        let Some(scratch) = &self.scratch else { return Ok(()) };
        let (width, heads) = (layout.config.width as usize, layout.heads_of(what));
        for first in (0..all).step_by(self.most) {
            let rows = self.most.min(all - first);
            self.activate(commands, layout, parameters, heads, tape, [first, rows]);
            for (slot, head) in heads.iter().enumerate() {
                let hidden = Place::new(&scratch.hidden[0], slot * width, heads.len() * width);
                let Some(out) = place(layout, head, first, &deltas.core, deltas.sh.as_ref()) else { continue };
                self.products.layer(commands, (layer(layout, &head.out), parameters), rows, hidden, out, false);
            }
        }
        Ok(())
    }

    /// Adds the gradients of weights and biases. For each chunk, `pull(commands, first, rows, d_features)` is called with
    /// the gradient of its features.
    pub fn backward(
        &mut self,
        commands: &mut Commands<'_>,
        layout: &Layout,
        [parameters, gradients]: [&Buffer; 2],
        (tape, what): (&DeviceTape, Outputs),
        d: &PassGradients<'_>,
        mut pull: impl FnMut(&mut Commands<'_>, usize, usize, &Buffer) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let all = tape.rows as usize;
        self.fit(commands.gpu(), layout, all)?;
        let Some(scratch) = &self.scratch else { return Ok(()) };
        let (width, heads) = (layout.config.width as usize, layout.heads_of(what));
        let (across, products) = (heads.len() * width, &self.products);
        for first in (0..all).step_by(self.most) {
            let rows = self.most.min(all - first);
            self.activate(commands, layout, parameters, heads, tape, [first, rows]);
            for (slot, head) in heads.iter().enumerate() {
                let Some(d_out) = place(layout, head, first, d.core, d.sh) else { continue };
                let [hidden, d_hidden] =
                    scratch.hidden.each_ref().map(|buffer| Place::new(buffer, slot * width, across));
                let out = layer(layout, &head.out);
                products.weight_gradient(commands, (out, gradients), rows, d_out, hidden);
                products.input_gradient(commands, (out, parameters), rows, d_out, d_hidden, Some(hidden));
            }
            let Some(fused) = fused(layout, heads) else { return Ok(()) };
            let d_hidden = Place::new(&scratch.hidden[1], 0, across);
            let activation = |layer: usize| Place::new(&scratch.trunk[layer], 0, width);
            let (mut now, last) = (0, layout.trunk.len() - 1);
            let d_trunk = |which: usize| Place::new(&scratch.d_trunk[which], 0, width);
            products.weight_gradient(commands, (fused, gradients), rows, d_hidden, activation(last));
            products.input_gradient(
                commands,
                (fused, parameters),
                rows,
                d_hidden,
                d_trunk(now),
                Some(activation(last)),
            );
            for (index, linear) in layout.trunk.iter().enumerate().rev() {
                let linear = layer(layout, linear);
                if index == 0 {
                    let features = features(layout, tape, first);
                    let d_features = Place::new(&scratch.d_features, 0, linear.inputs);
                    products.weight_gradient(commands, (linear, gradients), rows, d_trunk(now), features);
                    products.input_gradient(commands, (linear, parameters), rows, d_trunk(now), d_features, None);
                } else {
                    let input = activation(index - 1);
                    products.weight_gradient(commands, (linear, gradients), rows, d_trunk(now), input);
                    products.input_gradient(
                        commands,
                        (linear, parameters),
                        rows,
                        d_trunk(now),
                        d_trunk(1 - now),
                        Some(input),
                    );
                    now = 1 - now;
                }
            }
            pull(commands, first, rows, &scratch.d_features)?;
        }
        Ok(())
    }

    /// Fills the activations of trunk and hidden layers.
    fn activate(
        &self,
        commands: &mut Commands<'_>,
        layout: &Layout,
        parameters: &Buffer,
        heads: &[Head],
        tape: &DeviceTape,
        [first, rows]: [usize; 2],
    ) {
        let Some(scratch) = &self.scratch else { return };
        let width = layout.config.width as usize;
        let mut input = features(layout, tape, first);
        for (linear, out) in layout.trunk.iter().zip(&scratch.trunk) {
            let out = Place::new(out, 0, width);
            self.products.layer(commands, (layer(layout, linear), parameters), rows, input, out, true);
            input = out;
        }
        if let Some(fused) = fused(layout, heads) {
            let out = Place::new(&scratch.hidden[0], 0, fused.outputs);
            self.products.layer(commands, (fused, parameters), rows, input, out, true);
        }
    }

    /// Sizes the scratch for `rows` rows, or for a chunk.
    fn fit(&mut self, gpu: &Gpu, layout: &Layout, rows: usize) -> Result<(), GpuError> {
        let rows = rows.min(self.most);
        if self.scratch.as_ref().is_some_and(|scratch| scratch.rows >= rows) {
            return Ok(());
        }
        let [width, hidden, features] = across(layout);
        let buffer = |label: &str, across: usize| gpu.storage(label, scratch_bytes(rows, across));
        self.scratch = Some(Scratch {
            rows,
            trunk: layout.trunk.iter().map(|_| buffer("trunk of the field", width)).collect::<Result<_, _>>()?,
            hidden: [buffer("hidden layers of the field", hidden)?, buffer("gradient of the hidden layers", hidden)?],
            d_trunk: [buffer("gradient of the trunk", width)?, buffer("gradient of the trunk", width)?],
            d_features: buffer("gradient of the features", features)?,
        });
        Ok(())
    }
}

/// Floats of a row of the trunk, of the hidden layers and of the features.
fn across(layout: &Layout) -> [usize; 3] {
    let width = layout.config.width as usize;
    [width, width * layout.heads.len(), layout.point_features()]
}

fn scratch_bytes(rows: usize, across: usize) -> u64 {
    (rows * across * 4) as u64
}

/// A layer within the buffers of the MLP.
fn layer(layout: &Layout, linear: &Linear) -> Layer {
    Layer {
        inputs: linear.inputs,
        outputs: linear.outputs,
        weight: linear.weight - layout.grid,
        bias: linear.bias - layout.grid,
    }
}

/// The hidden layers of all heads as one layer.
fn fused(layout: &Layout, heads: &[Head]) -> Option<Layer> {
    let first = layer(layout, &heads.first()?.hidden);
    Some(Layer { outputs: first.outputs * heads.len(), ..first })
}

fn features<'a>(layout: &Layout, tape: &'a DeviceTape, first: usize) -> Place<'a> {
    let across = layout.point_features();
    Place::new(&tape.features, first * across, across)
}

/// Where a head's outputs, or their gradients, lie from row `first` on.
fn place<'a>(
    layout: &Layout,
    head: &Head,
    first: usize,
    core: &'a Buffer,
    sh: Option<&'a Buffer>,
) -> Option<Place<'a>> {
    let stride = layout.config.sh_stride as usize;
    match head.target {
        Target::Core(column) => Some(Place::new(core, first * 12 + column, 12)),
        Target::Sh => sh.map(|sh| Place::new(sh, first * stride, stride)),
    }
}
