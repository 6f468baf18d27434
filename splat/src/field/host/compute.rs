//! What the field computes on the host: planes and MLP in f32, rows spread over threads in blocks.
//!
//! Nothing depends on the number of threads. Rows go to a fixed number of lanes; each lane sums the gradient of the MLP
//! over its own blocks, and the lanes are added in order. The gradient of each plane is summed by one task, in the order
//! of the rows.

use rayon::prelude::*;

use super::{
    adam, grid,
    mlp::{BLOCK, Lane, Model, Rows, Transposed},
    regular,
};
use crate::{
    field::{Layout, PlaneLosses, PlaneWeights, backend::Pass},
    optimiser::AdamConfig,
};

/// Workers with a gradient of their own.
const LANES: usize = 16;
/// Rows of a lane in one round of the backward pass.
const LANE_ROWS: usize = 512;

/// Floats of activations that a tape keeps at most (256 MiB). Beyond them the backward pass evaluates the layers again:
/// half as many products more, against 2 to 3 KB a row.
const KEEP: usize = 64 << 20;

/// The numbers of a field.
#[derive(Debug)]
pub struct Compute {
    /// All parameters, as [`Layout`] places them.
    pub parameters: Vec<f32>,
    /// Their gradients.
    pub gradients: Vec<f32>,
    /// First and second moments.
    pub moments: [Vec<f32>; 2],
    /// Floats of activations that a tape keeps at most.
    pub keep: usize,
    transposed: Transposed,
    lanes: Vec<Lane>,
    /// Gradient of the planes' values, `[row, level, plane, feature]`, for the rows of one round.
    d_planes: Vec<f32>,
}

/// What the backward pass needs again.
#[derive(Debug, Default)]
pub struct HostTape {
    /// Coordinates in the box, 0 to 1 inside.
    pub points: Vec<[f32; 3]>,
    /// Features of the points, `[row, level, feature]`.
    pub features: Vec<f32>,
    /// Activations of the MLP, block by block; empty beyond [`Compute::keep`].
    pub activations: Vec<f32>,
}

/// Calls a function that is generic over the number of features.
macro_rules! with_features {
    ($features:expr, $function:ident :: <F>($($argument:expr),*)) => {
        match $features {
            4 => grid::$function::<4>($($argument),*),
            8 => grid::$function::<8>($($argument),*),
            16 => grid::$function::<16>($($argument),*),
            32 => grid::$function::<32>($($argument),*),
            _ => grid::$function::<64>($($argument),*),
        }
    };
}

impl Compute {
    /// A field with these parameters and zero moments.
    pub fn new(layout: &Layout, parameters: Vec<f32>) -> Self {
        let mut transposed = Transposed::default();
        transposed.refresh(layout, &parameters);
        Self {
            keep: KEEP,
            transposed,
            gradients: vec![0.0; parameters.len()],
            moments: [vec![0.0; parameters.len()], vec![0.0; parameters.len()]],
            lanes: (0..LANES).map(|_| Lane::new(layout)).collect(),
            d_planes: Vec::new(),
            parameters,
        }
    }

    /// Evaluates the field at `tape.points` into zeroed rows of deltas; `sh` is empty if it is not wanted.
    pub fn forward(&mut self, layout: &Layout, pass: Pass, tape: &mut HostTape, core: &mut [f32], sh: &mut [f32]) {
        let what = pass.what;
        let parameters = &self.parameters;
        let model = Model { layout, parameters, transposed: &self.transposed };
        let per_point = layout.point_features();
        let stride = layout.config.sh_stride as usize;
        let rows = tape.points.len();
        tape.features.resize(rows * per_point, 0.0);
        let kept = Some(model.activations_per_row(what)).filter(|floats| rows * floats <= self.keep).unwrap_or(0);
        tape.activations.resize(rows * kept, 0.0);
        let lines = grid::blend_lines(layout, parameters, pass.time);
        let levels = grid::level_views(layout, parameters, &lines);
        let lane_rows = rows.div_ceil(LANES).max(1).next_multiple_of(BLOCK);
        let outputs = core.par_chunks_mut(lane_rows * 12).zip(parts(sh, lane_rows * stride, LANES).into_par_iter());
        let memory = tape.features.par_chunks_mut(lane_rows * per_point);
        let memory = memory.zip(parts(&mut tape.activations, lane_rows * kept, LANES).into_par_iter());
        let inputs = tape.points.par_chunks(lane_rows).zip(memory);
        self.lanes.par_iter_mut().zip(inputs).zip(outputs).for_each(|((lane, (points, memory)), (core, sh))| {
            let count = points.len().div_ceil(BLOCK);
            let memory = memory.0.chunks_mut(BLOCK * per_point).zip(parts(memory.1, BLOCK * kept, count));
            let outputs = core.chunks_mut(BLOCK * 12).zip(parts(sh, BLOCK * stride, count));
            for ((points, (features, keep)), (core, sh)) in points.chunks(BLOCK).zip(memory).zip(outputs) {
                for (point, features) in points.iter().zip(features.chunks_exact_mut(per_point)) {
                    with_features!(layout.config.features, gather::<F>(&levels, point, features));
                }
                lane.forward(model, (features, keep), what, core, sh);
            }
        });
    }

    /// Adds the gradients of the parameters for the outputs' gradient `d_out` and returns those of the coordinates.
    pub fn backward(&mut self, layout: &Layout, pass: Pass, tape: &HostTape, d_out: &Rows<'_>) -> Vec<[f32; 3]> {
        let what = pass.what;
        let mut d_points = vec![[0.0; 3]; tape.points.len()];
        let parameters = &self.parameters;
        let model = Model { layout, parameters, transposed: &self.transposed };
        let per_point = layout.point_features();
        let kept = tape.activations.len() / tape.points.len().max(1);
        let per_row = layout.planes.len() * layout.config.features as usize;
        let stride = layout.config.sh_stride as usize;
        let lines = grid::blend_lines(layout, parameters, pass.time);
        let levels = grid::level_views(layout, parameters, &lines);
        self.lanes.par_iter_mut().for_each(|lane| lane.gradient.fill(0.0));
        let round = LANES * LANE_ROWS;
        self.d_planes.resize(tape.points.len().min(round) * per_row, 0.0);
        for (index, d_points) in d_points.chunks_mut(round).enumerate() {
            let points = &tape.points[index * round..][..d_points.len()];
            let d_planes = &mut self.d_planes[..points.len() * per_row];
            let outputs = d_points.par_chunks_mut(LANE_ROWS).zip(d_planes.par_chunks_mut(LANE_ROWS * per_row));
            self.lanes.par_iter_mut().zip(outputs).enumerate().for_each(|(number, (lane, (d_points, d_planes)))| {
                for (block, (d_points, d_planes)) in
                    d_points.chunks_mut(BLOCK).zip(d_planes.chunks_mut(BLOCK * per_row)).enumerate()
                {
                    let first = index * round + number * LANE_ROWS + block * BLOCK;
                    let features = &tape.features[first * per_point..];
                    let sh = if d_out.sh.is_empty() { d_out.sh } else { &d_out.sh[first * stride..] };
                    let d_out = Rows { core: &d_out.core[first * 12..], sh };
                    let kept = &tape.activations[first * kept..][..d_points.len() * kept];
                    lane.backward(model, (features, kept), d_points.len(), what, &d_out);
                    let d_features = lane.d_features.chunks_exact(per_point);
                    let gradients = d_planes.chunks_exact_mut(per_row).zip(d_points).zip(d_features);
                    for (point, ((d_planes, d_point), d_features)) in tape.points[first..].iter().zip(gradients) {
                        *d_point =
                            with_features!(layout.config.features, pull::<F>(&levels, point, d_features, d_planes));
                    }
                }
            });
            scatter(layout, &mut self.gradients, points, d_planes, pass.time);
        }
        let lanes = &self.lanes;
        const CHUNK: usize = 1 << 12;
        self.gradients[layout.grid..].par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, sums)| {
            for lane in lanes {
                let part = &lane.gradient[chunk * CHUNK..][..sums.len()];
                sums.iter_mut().zip(part).for_each(|(sum, d)| *sum += d);
            }
        });
        d_points
    }

    /// Adds the gradients of the regularisers.
    pub fn regularise(&mut self, layout: &Layout, weights: &PlaneWeights) -> PlaneLosses {
        regular::regularise(layout, &self.parameters, &mut self.gradients, weights)
    }

    /// One step of Adam; zeroes the gradients.
    pub fn step(&mut self, layout: &Layout, rates: [f32; 2], config: &AdamConfig, step: u32) {
        let [first, second] = &mut self.moments;
        let (first, second) = (first.split_at_mut(layout.grid), second.split_at_mut(layout.grid));
        let (parameters, gradients) =
            (self.parameters.split_at_mut(layout.grid), self.gradients.split_at_mut(layout.grid));
        adam::step(parameters.0, gradients.0, [first.0, second.0], rates[0], config, step);
        adam::step(parameters.1, gradients.1, [first.1, second.1], rates[1], config, step);
        self.transposed.refresh(layout, &self.parameters);
    }

    /// Takes over parameters and moments; gradients are zero afterwards.
    pub fn replace(&mut self, layout: &Layout, [parameters, first, second]: [Vec<f32>; 3]) {
        self.transposed.refresh(layout, &parameters);
        self.parameters = parameters;
        self.moments = [first, second];
        self.gradients.fill(0.0);
    }
}

/// Cuts `values` into pieces of `length`; an empty slice gives `count` empty pieces.
fn parts(values: &mut [f32], length: usize, count: usize) -> Vec<&mut [f32]> {
    if values.is_empty() {
        (0..count).map(|_| Default::default()).collect()
    } else {
        values.chunks_mut(length).collect()
    }
}

/// Adds the gradient of the planes' values at `points` to the planes, one task a plane.
fn scatter(layout: &Layout, gradients: &mut [f32], points: &[[f32; 3]], d_planes: &[f32], time: (usize, f32)) {
    let features = layout.config.features as usize;
    let mut rest = &mut gradients[..layout.grid];
    let mut tasks = Vec::with_capacity(layout.planes.len());
    for (index, plane) in layout.planes.iter().enumerate() {
        let (gradient, behind) = rest.split_at_mut(plane.rows * plane.cols * features);
        rest = behind;
        tasks.push((index, plane, gradient));
    }
    let count = layout.planes.len();
    tasks.into_par_iter().with_max_len(1).for_each(|(index, plane, gradient)| {
        if !plane.is_time() {
            let shape = (plane.axes, [plane.cols, plane.rows]);
            with_features!(features, scatter_plane::<F>(gradient, (index, count), shape, points, d_planes));
            return;
        }
        let length = plane.cols * features;
        let mut line = vec![0.0; length];
        let shape = (plane.axes[0], plane.cols);
        with_features!(features, scatter_line::<F>(&mut line, (index, count), shape, points, d_planes));
        let (row, weight) = time;
        let (low, high) = gradient[row * length..][..2 * length].split_at_mut(length);
        for ((low, high), d) in low.iter_mut().zip(high).zip(line) {
            *low += (1.0 - weight) * d;
            *high += weight * d;
        }
    });
}
