//! The deformation field in double precision, as plain loops: every plane by its four taps, every layer by its sums.

use crate::field::{
    FieldError, Layout, Linear, Outputs, PlaneLosses, PlaneWeights, SpatialSmoothness, TimeAxis,
    layout::{Plane, TIME, Target},
};

/// A field in double precision.
#[derive(Clone, Debug)]
pub struct FieldTwin {
    /// Where the parameters lie.
    pub layout: Layout,
    /// Lower and upper corner of its box.
    pub aabb: [[f64; 3]; 2],
    /// All parameters.
    pub parameters: Vec<f64>,
}

/// Outputs of a pass, or their gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct TwinDeltas {
    /// 12 values a row.
    pub core: Vec<f64>,
    /// `sh_stride` values a row; zero without an SH head.
    pub sh: Vec<f64>,
}

/// Gradients of a pass.
#[derive(Clone, Debug)]
pub struct TwinGradients {
    /// Of all parameters.
    pub parameters: Vec<f64>,
    /// Of the means.
    pub means: Vec<[f64; 3]>,
}

/// A tap of a plane: its place in the flat vector, its weight, and the derivatives of the weight along columns and rows.
type Tap = (usize, f64, [f64; 2]);

/// What the layers saw at one point.
struct Trace {
    /// Value of every plane and feature.
    planes: Vec<Vec<f64>>,
    /// Input of each trunk layer after its ReLU, then that of the heads.
    trunk: Vec<Vec<f64>>,
    /// Of each head: its hidden layer after the ReLU.
    hidden: Vec<Vec<f64>>,
}

impl FieldTwin {
    /// A twin with these parameters.
    ///
    /// # Errors
    /// [`FieldError::Config`].
    pub fn new(
        config: &crate::field::FieldConfig,
        aabb: [[f64; 3]; 2],
        parameters: Vec<f64>,
    ) -> Result<Self, FieldError> {
        Ok(Self { layout: Layout::new(config)?, aabb, parameters })
    }

    /// The deltas at `means` and `t01`.
    #[must_use]
    pub fn forward(&self, means: &[[f64; 3]], t01: f64, what: Outputs) -> TwinDeltas {
        let stride = self.layout.config.sh_stride as usize;
        let mut deltas = TwinDeltas { core: vec![0.0; means.len() * 12], sh: vec![0.0; means.len() * stride] };
        for (row, mean) in means.iter().enumerate() {
            let trace = self.trace(mean, t01, what);
            for (head, hidden) in self.layout.heads_of(what).iter().zip(&trace.hidden) {
                let out = self.apply(&head.out, hidden);
                match head.target {
                    Target::Core(column) => deltas.core[row * 12 + column..][..out.len()].copy_from_slice(&out),
                    Target::Sh => deltas.sh[row * stride..][..out.len()].copy_from_slice(&out),
                }
            }
        }
        deltas
    }

    /// The gradients of the pass at `means` and `t01` for the gradient `d_deltas` of its outputs.
    #[must_use]
    pub fn backward(&self, means: &[[f64; 3]], t01: f64, what: Outputs, d_deltas: &TwinDeltas) -> TwinGradients {
        let layout = &self.layout;
        let stride = layout.config.sh_stride as usize;
        let mut gradients = TwinGradients { parameters: vec![0.0; layout.total], means: vec![[0.0; 3]; means.len()] };
        for (row, mean) in means.iter().enumerate() {
            let trace = self.trace(mean, t01, what);
            let top = &trace.trunk[layout.trunk.len()];
            let mut d_top = vec![0.0; top.len()];
            for (head, hidden) in layout.heads_of(what).iter().zip(&trace.hidden) {
                let d_out = match head.target {
                    Target::Core(column) => &d_deltas.core[row * 12 + column..][..head.out.outputs],
                    Target::Sh => &d_deltas.sh[row * stride..][..head.out.outputs],
                };
                let d_hidden = self.pull(&head.out, hidden, d_out, true, &mut gradients.parameters);
                let d_input = self.pull(&head.hidden, top, &d_hidden, true, &mut gradients.parameters);
                d_top.iter_mut().zip(d_input).for_each(|(sum, d)| *sum += d);
            }
            let mut d = d_top;
            for (layer, linear) in layout.trunk.iter().enumerate().rev() {
                d = self.pull(linear, &trace.trunk[layer], &d, layer > 0, &mut gradients.parameters);
            }
            self.pull_planes(mean, t01, &trace, &d, &mut gradients.parameters, &mut gradients.means[row]);
        }
        gradients
    }

    /// The regularisers of the planes, and their weighted gradient.
    #[must_use]
    pub fn regularise(&self, weights: &PlaneWeights) -> (PlaneLosses, Vec<f64>) {
        let features = self.layout.config.features as usize;
        let (mut losses, mut gradient) = (PlaneLosses::default(), vec![0.0; self.layout.total]);
        for plane in &self.layout.planes {
            let (rows, cols) = (plane.rows, plane.cols);
            let at = |row: usize, col: usize, feature: usize| plane.offset + (row * cols + col) * features + feature;
            let every = |rows: usize, cols: usize| {
                (0..rows).flat_map(move |row| {
                    (0..cols).flat_map(move |col| (0..features).map(move |feature| (row, col, feature)))
                })
            };
            // The mean square of a stencil over `rows` x `cols` of its places.
            let mut stencil = |rows: usize, cols: usize, step: [usize; 2], taps: &[f64], weight: f32| {
                let count = (rows * cols * features) as f64;
                let mut loss = 0.0;
                for (row, col, feature) in every(rows, cols) {
                    let place = |tap: usize| at(row + tap * step[0], col + tap * step[1], feature);
                    let value: f64 = taps.iter().enumerate().map(|(tap, by)| by * self.parameters[place(tap)]).sum();
                    loss += value * value / count;
                    for (tap, by) in taps.iter().enumerate() {
                        gradient[place(tap)] += f64::from(weight) * 2.0 * value * by / count;
                    }
                }
                loss
            };
            const SECOND: [f64; 3] = [1.0, -2.0, 1.0];
            if !plane.is_time() {
                losses.space += match weights.form {
                    SpatialSmoothness::SecondDifference if rows < 3 => 0.0,
                    SpatialSmoothness::SecondDifference => stencil(rows - 2, cols, [1, 0], &SECOND, weights.space),
                    SpatialSmoothness::TotalVariation => {
                        stencil(rows - 1, cols, [1, 0], &[-1.0, 1.0], weights.space)
                            + stencil(rows, cols - 1, [0, 1], &[-1.0, 1.0], weights.space)
                    }
                };
                continue;
            }
            if rows >= 3 {
                losses.time += stencil(rows - 2, cols, [1, 0], &SECOND, weights.time);
            }
            let count = (rows * cols * features) as f64;
            for (row, col, feature) in every(rows, cols) {
                let off = self.parameters[at(row, col, feature)] - 1.0;
                losses.time_l1 += off.abs() / count;
                let sign = if off == 0.0 { 0.0 } else { off.signum() };
                gradient[at(row, col, feature)] += f64::from(weights.time_l1) * sign / count;
            }
        }
        (losses, gradient)
    }

    fn trace(&self, mean: &[f64; 3], t01: f64, what: Outputs) -> Trace {
        let layout = &self.layout;
        let features = layout.config.features as usize;
        let planes: Vec<Vec<f64>> = layout
            .planes
            .iter()
            .map(|plane| {
                let taps = self.taps(plane, mean, t01);
                let value = |feature| taps.iter().map(|(at, weight, _)| weight * self.parameters[at + feature]).sum();
                (0..features).map(value).collect()
            })
            .collect();
        let point: Vec<f64> = planes
            .chunks(6)
            .flat_map(|level| (0..features).map(|feature| level.iter().map(|plane| plane[feature]).product()))
            .collect();
        let mut trunk = vec![point];
        for (layer, linear) in layout.trunk.iter().enumerate() {
            let out = self.apply(linear, &trunk[layer]);
            trunk.push(relu(out));
        }
        let top = &trunk[layout.trunk.len()];
        let hidden = layout.heads_of(what).iter().map(|head| relu(self.apply(&head.hidden, top))).collect();
        Trace { planes, trunk, hidden }
    }

    /// The four taps of a plane at a point.
    fn taps(&self, plane: &Plane, mean: &[f64; 3], t01: f64) -> [Tap; 4] {
        let features = self.layout.config.features as usize;
        let [(col, x, dx), (row, y, dy)] =
            [(plane.axes[0], plane.cols), (plane.axes[1], plane.rows)].map(|(axis, cells)| {
                let (along, scale) = if axis == TIME {
                    match self.layout.config.time_axis {
                        TimeAxis::UpperHalf => (0.5 + 0.5 * t01.clamp(0.0, 1.0), 0.0),
                        TimeAxis::Full => (t01.clamp(0.0, 1.0), 0.0),
                    }
                } else {
                    let extent = self.aabb[1][axis] - self.aabb[0][axis];
                    ((mean[axis] - self.aabb[0][axis]) / extent, 1.0 / extent)
                };
                let inside = along > 0.0 && along < 1.0;
                let last = (cells - 1) as f64;
                let position = along.clamp(0.0, 1.0) * last;
                let cell = (position.floor() as usize).min(cells - 2);
                (cell, position - cell as f64, if inside { last * scale } else { 0.0 })
            });
        let at = |row: usize, col: usize| plane.offset + (row * plane.cols + col) * features;
        [
            (at(row, col), (1.0 - x) * (1.0 - y), [-(1.0 - y) * dx, -(1.0 - x) * dy]),
            (at(row, col + 1), x * (1.0 - y), [(1.0 - y) * dx, -x * dy]),
            (at(row + 1, col), (1.0 - x) * y, [-y * dx, (1.0 - x) * dy]),
            (at(row + 1, col + 1), x * y, [y * dx, x * dy]),
        ]
    }

    fn apply(&self, linear: &Linear, input: &[f64]) -> Vec<f64> {
        (0..linear.outputs)
            .map(|output| {
                let weights = &self.parameters[linear.weight + output * linear.inputs..][..linear.inputs];
                let product: f64 = weights.iter().zip(input).map(|(weight, value)| weight * value).sum();
                product + self.parameters[linear.bias + output]
            })
            .collect()
    }

    /// Adds the gradients of a layer and returns that of its input, through the ReLU that made the input if it had one.
    fn pull(&self, linear: &Linear, input: &[f64], d_out: &[f64], relu: bool, gradient: &mut [f64]) -> Vec<f64> {
        let mut d_input = vec![0.0; linear.inputs];
        for (output, d) in d_out.iter().enumerate() {
            gradient[linear.bias + output] += d;
            for (i, value) in input.iter().enumerate() {
                let at = linear.weight + output * linear.inputs + i;
                gradient[at] += d * value;
                d_input[i] += d * self.parameters[at];
            }
        }
        if relu {
            d_input.iter_mut().zip(input).filter(|(_, value)| **value <= 0.0).for_each(|(d, _)| *d = 0.0);
        }
        d_input
    }

    fn pull_planes(
        &self,
        mean: &[f64; 3],
        t01: f64,
        trace: &Trace,
        d_features: &[f64],
        gradient: &mut [f64],
        d_mean: &mut [f64; 3],
    ) {
        let features = self.layout.config.features as usize;
        for (index, plane) in self.layout.planes.iter().enumerate() {
            let siblings = (plane.level * 6..plane.level * 6 + 6).filter(|other| *other != index);
            for feature in 0..features {
                let others: f64 = siblings.clone().map(|other| trace.planes[other][feature]).product();
                let d = d_features[plane.level * features + feature] * others;
                for (at, weight, slopes) in self.taps(plane, mean, t01) {
                    gradient[at + feature] += d * weight;
                    for (axis, slope) in plane.axes.into_iter().zip(slopes).filter(|(axis, _)| *axis != TIME) {
                        d_mean[axis] += d * slope * self.parameters[at + feature];
                    }
                }
            }
        }
    }
}

fn relu(mut values: Vec<f64>) -> Vec<f64> {
    values.iter_mut().for_each(|value| *value = value.max(0.0));
    values
}
