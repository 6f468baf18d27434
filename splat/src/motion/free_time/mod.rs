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
//! Where `knots` are asked for, a path is no parabola: the row holds where the Gaussian is at so many times before and after its
//! instant, `spacing` intervals apart, and a cubic leads from each to the next (`knots.wgsl`).
//!
//! A life of at least `least` intervals bridges the gap between two frames: shorter ones make perfect frames and ghosts
//! between them.

#[cfg(test)]
mod tests;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use wgpu::Buffer;

use super::{ClockRow, MotionRows, Supervision, track};
use crate::{
    field::{FieldError, Tape},
    gpu::{Gpu, GpuError, Kernel, Shape},
    raster::Deltas,
};

/// Floats of a row whose path is a parabola: velocity (3, metres an interval), instant (intervals), acceleration (3, metres an
/// interval squared), logarithm of how much longer than the least a life is (intervals).
pub const ROW: usize = 8;

/// The least change of an opacity's logit: what is fainter is not there.
pub const GONE: f32 = -30.0;

/// Most knots on either side of an instant.
pub const MOST_KNOTS: u32 = 16;
/// Most births between two instants.
pub const MOST_BETWEEN: u32 = 16;

/// What paths are fitted to between the middles of two exposures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Guide {
    /// The frames where exposures leave little unseen of how things move (less than a hundredth of the picture's width from frame to
    /// frame, where the fastest are), or where ways are straight (the velocity of a point changes by less than 1.1 of its speed from
    /// frame to frame, in the median; by less than 0.9 beside events, which tell of what bends) and the fastest go less than a sixth of
    /// the width; else the events, as where a setting that this would decide was chosen by hand.
    Auto,
    /// The frames: paths are parabolas, and lives reach the frames before and after, unless either was chosen by hand.
    Frames,
    /// The events: paths and lives are as the other settings have them.
    #[default]
    Events,
}

/// How Gaussians that are free in time start and learn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FreeTimeOptions {
    /// The shortest life (standard deviation of the presence), RGB intervals; half the first where that is left to the data.
    pub least_life: f32,
    /// The life that a Gaussian starts with, RGB intervals; more than the shortest. 0 leaves it to the data: half an interval, and a
    /// quarter where events teach and the fastest things go farther than a sixth of the picture's width from frame to frame.
    pub first_life: f32,
    /// How many times Gaussians are born between two instants of the points, on their paths through knots: what is seen by events alone has
    /// its own. Once at least where the first life is left to the data and things go as far as that says.
    pub between: u32,
    /// The opacity that a Gaussian starts with.
    pub opacity: f32,
    /// Faster than this nothing is taken to be at the start, extents of the scene an interval.
    pub fastest: f32,
    /// What paths are fitted to between the middles of two exposures.
    pub guide: Guide,
    /// Knots of a path on either side of its instant, 2 or more; 0: a path is a parabola.
    pub knots: u32,
    /// RGB intervals from a knot to the next.
    pub spacing: f32,
    /// Learning rate of velocities and of knots, as a share of that of positions.
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
            least_life: 0.25,
            first_life: 0.0,
            between: 0,
            opacity: 0.2,
            fastest: 0.5,
            guide: Guide::Events,
            knots: 0,
            spacing: 1.0,
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

/// Rows cannot have a path.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} = {value} is out of range: {reason}")]
pub struct PathError {
    /// The option, as configurations name it.
    pub key: &'static str,
    /// Its value.
    pub value: String,
    /// What is allowed.
    pub reason: &'static str,
}

/// Where things go farther than this share of the picture's width from frame to frame, no path that can be learned leads from one to the
/// next, and Gaussians live half as long.
pub const FAR: f64 = 1.0 / 6.0;
/// The life that a Gaussian starts with where things go less far, RGB intervals.
const FIRST_LIFE: f32 = 0.5;

impl FreeTimeOptions {
    /// Decides on lives and on births between frames where the fastest things go by `displacement` (a share of the picture's width) from
    /// frame to frame, if that is known and events tell what is between.
    pub fn live(&mut self, displacement: Option<f64>) {
        let far = displacement.is_some_and(|displacement| displacement > FAR);
        self.first_life = if far { 0.5 } else { 1.0 } * FIRST_LIFE;
        self.least_life = 0.5 * self.first_life;
        // So short that half way between two frames there would be little.
        self.between = self.between.max(u32::from(far));
    }

    /// Lets frames alone tell of paths: they leave so little unseen that a parabola through three of them is better known than any
    /// path between two.
    pub fn follow_frames(&mut self) {
        (self.knots, self.first_life, self.least_life) = (0, 1.0, 0.5);
    }

    /// Whether rows can have such a path.
    ///
    /// # Errors
    /// [`PathError`].
    pub fn check_path(&self) -> Result<(), PathError> {
        let refuse = |key, value, reason| Err(PathError { key, value, reason });
        if self.knots == 1 || self.knots > MOST_KNOTS {
            return refuse("free_time.knots", self.knots.to_string(), "0 (a parabola), or 2 to 16 on either side");
        }
        if self.between > MOST_BETWEEN {
            return refuse("free_time.between", self.between.to_string(), "0 to 16");
        }
        // What is shorter than that has no square in single precision.
        if !(self.spacing >= 1e-3 && self.spacing.is_finite()) {
            return refuse("free_time.spacing", self.spacing.to_string(), "0.001 RGB intervals or more");
        }
        Ok(())
    }

    /// Floats of a row.
    #[must_use]
    pub fn floats(&self) -> usize {
        match self.knots {
            0 => ROW,
            side => 8 * side as usize,
        }
    }

    /// How far a Gaussian with this row is from its place `dt` intervals after its instant, metres.
    #[must_use]
    pub fn moved(&self, row: &[f32], dt: f32) -> [f32; 3] {
        if self.knots == 0 {
            return std::array::from_fn(|axis| dt * (row[axis] + 0.5 * dt * row[4 + axis]));
        }
        let (before, after) = row[..self.floats()].as_chunks::<4>().0.split_at(self.knots as usize);
        let knot = |[x, y, z, _]: &[f32; 4]| [*x, *y, *z];
        let places = before.iter().map(knot).chain([[0.0; 3]]).chain(after.iter().map(knot));
        let time = |index: usize| (index as f32 - self.knots as f32) * self.spacing;
        let track: track::Track = places.enumerate().map(|(index, place)| (time(index), place)).collect();
        track::along(&track, dt)
    }

    /// What the kernels of the path are told as they are made.
    fn constants(&self) -> String {
        match self.knots {
            0 => String::new(),
            side => format!("const SIDE = {side}u;\nconst SPACING = {:?};\n", self.spacing),
        }
    }

    /// Learning rates of the numbers of a row, where positions learn at `position`.
    #[must_use]
    pub fn rates(&self, position: f32) -> Vec<f32> {
        let (velocity, acceleration) = (self.velocity * position, self.acceleration * position);
        let mut rates = match self.knots {
            0 => vec![velocity, velocity, velocity, 0.0, acceleration, acceleration, acceleration, 0.0],
            side => [velocity, velocity, velocity, 0.0].repeat(2 * side as usize),
        };
        (rates[3], rates[7]) = (self.instant, self.life);
        rates
    }

    /// What a row stores of the life that a Gaussian starts with.
    fn log_life(&self) -> f32 {
        let first = if self.first_life == 0.0 { FIRST_LIFE } else { self.first_life };
        (first - self.least_life).max(1e-3).ln()
    }

    /// The row of a Gaussian that is born at `instant` with a velocity, metres an interval.
    #[must_use]
    pub fn born(&self, instant: f32, velocity: [f32; 3]) -> Vec<f32> {
        let [x, y, z] = velocity;
        match self.knots {
            0 => vec![x, y, z, instant, 0.0, 0.0, 0.0, self.log_life()],
            _ => self.bent(instant, |dt| velocity.map(|v| v * dt)),
        }
    }

    /// A row that is at its place at `instant` and where `path` says so many intervals later.
    pub fn bent(&self, instant: f32, path: impl Fn(f32) -> [f32; 3]) -> Vec<f32> {
        let side = self.knots as i32;
        let knots = (-side..=side).filter(|knot| *knot != 0).map(|knot| path(knot as f32 * self.spacing));
        let mut row: Vec<f32> = knots.flat_map(|[x, y, z]| [x, y, z, 0.0]).collect();
        (row[3], row[7]) = (instant, self.log_life());
        row
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

/// Threads that sum what rows say of a time.
const CLOCK_THREADS: u32 = 256;

/// The kernels of the motion, and what they are told of the scene.
#[derive(Debug)]
pub struct FreeTime {
    options: FreeTimeOptions,
    intervals: f32,
    extent: f32,
    forward: Kernel,
    backward: Kernel,
    clock_partial: Kernel,
    clock_sum: Kernel,
    /// What each thread of the clock summed.
    partial: Buffer,
    /// Threads of a workgroup.
    threads: u32,
    /// Rows that a workgroup takes.
    rows_a_group: u32,
}

impl FreeTime {
    /// Kernels for a recording of so many RGB `intervals` in a scene of this `extent`, metres.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no room.
    pub fn new(gpu: &Gpu, options: &FreeTimeOptions, intervals: f32, extent: f32) -> Result<Self, GpuError> {
        Self::with_rows(gpu, options, 0, intervals, extent)
    }

    /// The same where so many floats (a multiple of 4) of something else follow in each row.
    ///
    /// # Errors
    /// As [`FreeTime::new`].
    pub(super) fn with_rows(
        gpu: &Gpu,
        options: &FreeTimeOptions,
        extra_floats: usize,
        intervals: f32,
        extent: f32,
    ) -> Result<Self, GpuError> {
        // A thread of a CPU takes several rows; a group of a GPU has 256 threads.
        let (threads, per_thread) = match gpu.shape {
            Shape::Gpu => (256, 1),
            Shape::Cpu => (8, 32),
        };
        let constants = format!(
            "const THREADS = {threads}u;\nconst PER_THREAD = {per_thread}u;\nconst GONE = {GONE:?};\nconst VECTORS = {}u;\n{}",
            (options.floats() + extra_floats) / 4,
            options.constants()
        );
        let shared = include_str!("row.wgsl");
        let [path, path_backward] = match options.knots {
            0 => [include_str!("parabola.wgsl"), include_str!("parabola_backward.wgsl")],
            _ => [include_str!("knots.wgsl"), include_str!("knots_backward.wgsl")],
        };
        let stage = |label: &str, own: &[&str]| gpu.kernel(label, &[&[&constants, path, shared], own].concat());
        Ok(Self {
            options: options.clone(),
            intervals,
            extent,
            forward: stage("motion forward", &[include_str!("forward.wgsl")]),
            backward: stage("motion backward", &[path_backward, include_str!("backward.wgsl")]),
            clock_partial: stage("clock", &[include_str!("clock_partial.wgsl")]),
            clock_sum: gpu.kernel("clock of a camera", &[include_str!("clock_sum.wgsl")]),
            partial: gpu.storage("clock", Self::BYTES)?,
            threads,
            rows_a_group: threads * per_thread,
        })
    }

    /// Bytes of the device's memory that it takes itself.
    pub const BYTES: u64 = CLOCK_THREADS as u64 * 4;

    /// Fills `tape.deltas` for the dynamic rows at `t01`.
    pub(in crate::motion) fn forward(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        t01: f32,
        tape: &mut Tape,
    ) -> Result<(), FieldError> {
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
    /// regularisers where the supervision is a frame.
    pub(super) fn backward(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        tape: &Tape,
        d_deltas: &Deltas,
        d_core: &Buffer,
        supervision: Supervision,
    ) -> Result<(), FieldError> {
        let count = tape.deltas.rows;
        if d_deltas.rows != count {
            return Err(FieldError::Mismatch {
                doing: "going backward through the motion".into(),
                reason: format!("{} rows of gradients for {count} of deltas", d_deltas.rows),
            });
        }
        let (path, weight) = match supervision {
            Supervision::Frame(share) => (1.0, share),
            Supervision::Events => (self.options.event_opacity, 0.0),
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

    /// Adds to a camera's row the gradient of the time of the pass on `tape`, intervals, from those of its deltas.
    pub(super) fn clock(&self, gpu: &Gpu, rows: MotionRows<'_>, tape: &Tape, d_deltas: &Deltas, to: ClockRow<'_>) {
        let uniform = gpu.uniform("motion", &self.uniform(tape.deltas.rows, tape.t01, 0.0, 0.0));
        let row = gpu.uniform("row of a camera", &[to.row, CLOCK_THREADS, 0, 0]);
        let mut commands = gpu.commands();
        let partial = [&uniform, rows.core, rows.values, &d_deltas.core, &self.partial];
        commands.dispatch(&self.clock_partial, &partial, CLOCK_THREADS / self.threads);
        commands.dispatch(&self.clock_sum, &[&row, &self.partial, to.sums], 1);
        commands.submit();
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
