//! The MLP on a block of rows, small enough that its activations stay in the cache.

use crate::{
    field::{
        Layout, Linear, Outputs,
        layout::{Head, Target},
    },
    matrix::{Matrix, multiply},
};

/// Rows of a block.
pub const BLOCK: usize = 128;

/// Scratch and private gradient of one worker.
#[derive(Debug, Default)]
pub struct Lane {
    /// Activations of a block, where the tape does not keep them.
    activations: Vec<f32>,
    d_hidden: Vec<f32>,
    d_trunk: [Vec<f32>; 2],
    /// Gradient of the features, `[row, feature]`, after [`Lane::backward`].
    pub d_features: Vec<f32>,
    /// Gradient of the MLP's parameters, summed over the blocks of this lane.
    pub gradient: Vec<f32>,
}

/// The weights for forward products: those of each layer transposed, `[input, output]`, and those of the first layers of
/// all heads side by side. `gemm` is half as fast again with its right operand along its rows.
#[derive(Debug, Default)]
pub struct Transposed {
    values: Vec<f32>,
}

impl Transposed {
    /// Takes the current weights.
    pub fn refresh(&mut self, layout: &Layout, parameters: &[f32]) {
        self.values.resize(layout.total - layout.grid, 0.0);
        let fused = fused(&layout.heads).into_iter();
        for linear in layout.trunk.iter().cloned().chain(fused).chain(layout.heads.iter().map(|head| head.out.clone()))
        {
            let size = linear.inputs * linear.outputs;
            let to = &mut self.values[linear.weight - layout.grid..][..size];
            for (output, row) in parameters[linear.weight..][..size].chunks_exact(linear.inputs).enumerate() {
                for (input, weight) in row.iter().enumerate() {
                    to[input * linear.outputs + output] = *weight;
                }
            }
        }
    }

    /// The weights that start `offset` floats into the MLP, of which each input's lie `stride` floats apart.
    fn matrix(&self, offset: usize, linear: &Linear, stride: usize) -> Matrix<'_> {
        Matrix::new(&self.values[offset..], linear.inputs, linear.outputs, stride)
    }
}

/// All that a pass reads: where the parameters lie, what they are, and the weights transposed.
#[derive(Clone, Copy)]
pub struct Model<'a> {
    /// Where the parameters lie.
    pub layout: &'a Layout,
    /// All parameters.
    pub parameters: &'a [f32],
    /// Those of the MLP for forward products.
    pub transposed: &'a Transposed,
}

impl Model<'_> {
    /// Floats of activations a row: the trunk layers and the hidden layers of the heads, after their ReLUs.
    pub fn activations_per_row(&self, what: Outputs) -> usize {
        self.layout.config.width as usize * (self.layout.trunk.len() + self.layout.heads_of(what).len())
    }

    /// Evaluates trunk and hidden layers at `rows` rows: each trunk layer as `[row, width]`, one behind the other, then
    /// the hidden layers as `[row, head, width]`.
    fn activate(&self, features: &[f32], rows: usize, heads: &[Head], activations: &mut [f32]) {
        let width = self.layout.config.width as usize;
        let (trunk, hidden) = activations.split_at_mut(rows * width * self.layout.trunk.len());
        for (layer, linear) in self.layout.trunk.iter().enumerate() {
            let (done, rest) = trunk.split_at_mut(layer * rows * width);
            let input = if layer == 0 { features } else { &done[(layer - 1) * rows * width..] };
            let input = Matrix::new(input, rows, linear.inputs, linear.inputs);
            self.apply(&mut rest[..rows * width], width, linear, width, input);
            relu(&mut rest[..rows * width]);
        }
        if let Some(all) = fused(heads) {
            let top = &trunk[trunk.len() - rows * width..];
            let weight_stride = self.layout.heads.len() * width;
            self.apply(hidden, all.outputs, &all, weight_stride, Matrix::new(top, rows, width, width));
            relu(&mut hidden[..rows * all.outputs]);
        }
    }

    /// `out = input weights^T + bias`. The rows of `out` lie `stride` floats apart; the transposed weights `weight_stride`.
    fn apply(&self, out: &mut [f32], stride: usize, linear: &Linear, weight_stride: usize, input: Matrix<'_>) {
        let weights = self.transposed.matrix(linear.weight - self.layout.grid, linear, weight_stride);
        multiply(out, stride, input, weights, false);
        let bias = &self.parameters[linear.bias..][..linear.outputs];
        for row in out.chunks_mut(stride).take(input.rows()) {
            row.iter_mut().zip(bias).for_each(|(value, bias)| *value += bias);
        }
    }
}

/// The outputs of a block, or their gradient.
pub struct Rows<'a> {
    /// `[row, 12]`.
    pub core: &'a [f32],
    /// `[row, sh_stride]`; empty without SH.
    pub sh: &'a [f32],
}

impl Lane {
    /// Scratch for fields of this layout.
    pub fn new(layout: &Layout) -> Self {
        let (width, heads) = (layout.config.width as usize, layout.heads.len());
        let block = |across: usize| vec![0.0; BLOCK * across];
        Self {
            activations: block(width * (layout.trunk.len() + heads)),
            d_hidden: block(width * heads),
            d_trunk: [block(width), block(width)],
            d_features: block(layout.point_features()),
            gradient: vec![0.0; layout.total - layout.grid],
        }
    }

    /// Evaluates the MLP at rows of `features` and writes the columns of the heads of `what`, for as many rows as `core`
    /// has. The activations go to `keep` unless it is empty.
    pub fn forward(
        &mut self,
        model: Model<'_>,
        (features, keep): (&[f32], &mut [f32]),
        what: Outputs,
        core: &mut [f32],
        sh: &mut [f32],
    ) {
        let layout = model.layout;
        let rows = core.len() / 12;
        let heads = layout.heads_of(what);
        let activations = if keep.is_empty() { &mut self.activations[..] } else { keep };
        model.activate(features, rows, heads, activations);
        let width = layout.config.width as usize;
        let hidden = &activations[rows * width * layout.trunk.len()..];
        for (slot, head) in heads.iter().enumerate() {
            let input = Matrix::new(&hidden[slot * width..], rows, width, heads.len() * width);
            match head.target {
                Target::Core(column) => model.apply(&mut core[column..], 12, &head.out, head.out.outputs, input),
                Target::Sh => {
                    model.apply(sh, layout.config.sh_stride as usize, &head.out, head.out.outputs, input);
                }
            }
        }
    }

    /// Adds the gradient of the weights and biases to `self.gradient` and leaves that of the features in
    /// `self.d_features`. The activations are those of `kept`, or are evaluated again where it is empty.
    pub fn backward(
        &mut self,
        model: Model<'_>,
        (features, kept): (&[f32], &[f32]),
        rows: usize,
        what: Outputs,
        d_out: &Rows<'_>,
    ) {
        let Model { layout, parameters, .. } = model;
        let heads = layout.heads_of(what);
        let activations = if kept.is_empty() {
            model.activate(features, rows, heads, &mut self.activations);
            &self.activations
        } else {
            kept
        };
        let width = layout.config.width as usize;
        let stride = heads.len() * width;
        let mlp = layout.grid;
        let (trunk, hidden) = activations.split_at(rows * width * layout.trunk.len());
        for (slot, head) in heads.iter().enumerate() {
            let (d, d_stride) = match head.target {
                Target::Core(column) => (&d_out.core[column..], 12),
                Target::Sh => (d_out.sh, layout.config.sh_stride as usize),
            };
            let d = Matrix::new(d, rows, head.out.outputs, d_stride);
            let hidden = Matrix::new(&hidden[slot * width..], rows, width, stride);
            pull_weights(&mut self.gradient, mlp, &head.out, d, hidden);
            multiply(&mut self.d_hidden[slot * width..], stride, d, weights(parameters, &head.out), false);
        }
        mask(&mut self.d_hidden[..rows * stride], hidden);
        let [d_top, d_next] = &mut self.d_trunk;
        let trunk_layer = |layer: usize| &trunk[layer * rows * width..][..rows * width];
        let top = trunk_layer(layout.trunk.len() - 1);
        if let Some(all) = fused(heads) {
            let d_hidden = Matrix::new(&self.d_hidden, rows, stride, stride);
            pull_weights(&mut self.gradient, mlp, &all, d_hidden, Matrix::new(top, rows, width, width));
            multiply(d_top, width, d_hidden, weights(parameters, &all), false);
            mask(&mut d_top[..rows * width], top);
        }
        for (layer, linear) in layout.trunk.iter().enumerate().rev() {
            let d = Matrix::new(d_top, rows, width, width);
            if layer == 0 {
                let inputs = linear.inputs;
                pull_weights(&mut self.gradient, mlp, linear, d, Matrix::new(features, rows, inputs, inputs));
                multiply(&mut self.d_features, inputs, d, weights(parameters, linear), false);
            } else {
                let input = trunk_layer(layer - 1);
                pull_weights(&mut self.gradient, mlp, linear, d, Matrix::new(input, rows, width, width));
                multiply(d_next, width, d, weights(parameters, linear), false);
                mask(&mut d_next[..rows * width], input);
                std::mem::swap(d_top, d_next);
            }
        }
    }
}

/// The hidden layers of all heads as one layer.
fn fused(heads: &[Head]) -> Option<Linear> {
    let first = &heads.first()?.hidden;
    Some(Linear { outputs: first.outputs * heads.len(), ..first.clone() })
}

fn weights<'a>(parameters: &'a [f32], linear: &Linear) -> Matrix<'a> {
    Matrix::new(&parameters[linear.weight..], linear.outputs, linear.inputs, linear.inputs)
}

/// Adds the gradients of weights and biases; `gradient` starts at parameter `base`.
fn pull_weights(gradient: &mut [f32], base: usize, linear: &Linear, d_out: Matrix<'_>, input: Matrix<'_>) {
    multiply(&mut gradient[linear.weight - base..], linear.inputs, d_out.transposed(), input, true);
    let bias = &mut gradient[linear.bias - base..][..linear.outputs];
    for row in d_out.each_row() {
        bias.iter_mut().zip(row).for_each(|(sum, d)| *sum += d);
    }
}

fn relu(values: &mut [f32]) {
    values.iter_mut().for_each(|value| *value = if *value > 0.0 || value.is_nan() { *value } else { 0.0 });
}

/// Zeroes the gradient where the ReLU gave zero.
fn mask(gradient: &mut [f32], activation: &[f32]) {
    gradient.iter_mut().zip(activation).for_each(|(d, value)| *d = if *value == 0.0 { 0.0 } else { *d });
}
