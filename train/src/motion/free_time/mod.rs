//! Gaussians that are free in time (FreeTimeGS, Wang et al. 2025, with quadratic motion): each is at its stored place at
//! an instant of its own, moves with a velocity and an acceleration, and is seen for a while around that instant.
//!
//! Time runs in RGB intervals, T = t01 x `intervals`, so that rates and lives do not depend on how long a recording is. With
//! the row (v, T0 | a, l) of a Gaussian of opacity o:
//!
//! ```text
//! dt = T - T0         s = least + exp(l)        presence = exp(-(dt / s)^2 / 2)
//! mean + v dt + a dt^2 / 2                      opacity o * presence
//! ```
//!
//! A life of at least `least` intervals bridges the gap between two frames: shorter ones make perfect frames and ghosts
//! between them.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use wgpu::Buffer;

use super::{MotionRows, Witness};
use crate::{
    field::{FieldError, Tape},
    gpu::{Gpu, Kernel, Shape},
    raster::Deltas,
};

/// Floats of a row: velocity (3, metres an interval), instant (intervals), acceleration (3, metres an interval squared),
/// logarithm of how much longer than the least a life is (intervals).
pub const ROW: usize = 8;

/// The least change of an opacity's logit: what is fainter is not there.
pub const GONE: f32 = -30.0;

/// How Gaussians that are free in time start and learn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FreeTimeOptions {
    /// The shortest life (standard deviation of the presence), RGB intervals.
    pub least_life: f32,
    /// The life that a Gaussian starts with, RGB intervals; more than the shortest.
    pub first_life: f32,
    /// The opacity that a Gaussian starts with.
    pub opacity: f32,
    /// Faster than this nothing is taken to be at the start, extents of the scene an interval.
    pub fastest: f32,
    /// Learning rate of velocities, as a share of that of positions.
    pub velocity: f32,
    /// Learning rate of accelerations, as a share of that of positions.
    pub acceleration: f32,
    /// Learning rate of instants, intervals.
    pub instant: f32,
    /// Learning rate of the logarithm of lives.
    pub life: f32,
    /// Weight of the mean opacity of what is present (4D regularisation): what no frame asks for fades.
    pub weight_presence: f32,
    /// Weight of the mean squared acceleration, in extents.
    pub weight_acceleration: f32,
    /// Whether events teach trajectories alone, and places, shapes and colours are left to the frames.
    pub events_move_only: bool,
    /// How much of an event's gradient reaches instants and lives: at 0 motion must explain events, not birth and death.
    pub event_opacity: f32,
}

impl Default for FreeTimeOptions {
    fn default() -> Self {
        Self {
            least_life: 1.0,
            first_life: 2.0,
            opacity: 0.2,
            fastest: 0.5,
            velocity: 0.5,
            acceleration: 0.25,
            instant: 0.01,
            life: 3e-3,
            weight_presence: 1e-2,
            weight_acceleration: 1e-3,
            events_move_only: false,
            event_opacity: 0.0,
        }
    }
}

/// The uniform of `row.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Uniform {
    rows: u32,
    time: f32,
    least: f32,
    path: f32,
    presence: f32,
    acceleration: f32,
    padding: [u32; 2],
}

/// The kernels of the motion, and what they are told of the scene.
#[derive(Debug)]
pub struct FreeTime {
    options: FreeTimeOptions,
    intervals: f32,
    extent: f32,
    forward: Kernel,
    backward: Kernel,
    /// Rows that a workgroup takes.
    rows_a_group: u32,
}

impl FreeTime {
    /// Kernels for a recording of so many RGB `intervals` in a scene of this `extent`, metres.
    #[must_use]
    pub fn new(gpu: &Gpu, options: &FreeTimeOptions, intervals: f32, extent: f32) -> Self {
        // A thread of a CPU takes several rows; a group of a GPU has 256 threads.
        let (threads, per_thread) = match gpu.shape {
            Shape::Gpu => (256, 1),
            Shape::Cpu => (8, 32),
        };
        let constants =
            format!("const THREADS = {threads}u;\nconst PER_THREAD = {per_thread}u;\nconst GONE = {GONE:?};");
        let shared = include_str!("row.wgsl");
        Self {
            options: options.clone(),
            intervals,
            extent,
            forward: gpu.kernel("motion forward", &[&constants, shared, include_str!("forward.wgsl")]),
            backward: gpu.kernel("motion backward", &[&constants, shared, include_str!("backward.wgsl")]),
            rows_a_group: threads * per_thread,
        }
    }

    /// Fills `tape.deltas` for the dynamic rows at `t01`.
    pub(super) fn forward(&self, gpu: &Gpu, rows: MotionRows<'_>, t01: f32, tape: &mut Tape) -> Result<(), FieldError> {
        tape.begin_rows(gpu, rows.count, t01)?;
        let uniform = gpu.uniform("motion", &self.uniform(rows.count, t01, 0.0, 0.0));
        let mut commands = gpu.commands();
        commands.dispatch(
            &self.forward,
            &[&uniform, rows.core, rows.values, &tape.deltas.core],
            rows.count.div_ceil(self.rows_a_group),
        );
        commands.submit();
        Ok(())
    }

    /// Adds the gradients of the pass on `tape` to those of the rows and, for opacities, to `d_core`; and those of the
    /// regularisers where the witness is a frame.
    pub(super) fn backward(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        tape: &Tape,
        d_deltas: &Deltas,
        d_core: &Buffer,
        witness: Witness,
    ) -> Result<(), FieldError> {
        let count = tape.deltas.rows;
        if d_deltas.rows != count {
            return Err(FieldError::Mismatch {
                doing: "going backward through the motion".into(),
                reason: format!("{} rows of gradients for {count} of deltas", d_deltas.rows),
            });
        }
        let (path, weight) = match witness {
            Witness::Frame(share) => (1.0, share),
            Witness::Events => (self.options.event_opacity, 0.0),
        };
        let uniform = gpu.uniform("motion", &self.uniform(count, tape.t01, path, weight));
        let mut commands = gpu.commands();
        commands.dispatch(
            &self.backward,
            &[&uniform, rows.core, rows.values, &d_deltas.core, d_core, rows.gradients],
            count.div_ceil(self.rows_a_group),
        );
        commands.submit();
        Ok(())
    }

    fn uniform(&self, rows: u32, t01: f32, path: f32, weight: f32) -> Uniform {
        let share = weight / rows.max(1) as f32;
        Uniform {
            rows,
            time: t01 * self.intervals,
            least: self.options.least_life,
            path,
            presence: share * self.options.weight_presence,
            acceleration: 2.0 * share * self.options.weight_acceleration / (self.extent * self.extent).max(1e-12),
            padding: [0; 2],
        }
    }
}
