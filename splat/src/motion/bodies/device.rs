//! Bodies on the device.

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

use super::{
    BodiesOptions, NEIGHBOURS, Start,
    carry_on::{Paths, gate_within},
    index::Index,
};
use crate::{
    field::{FieldError, FieldState, NamedVector, Tape},
    gpu::{Gpu, GpuError, Kernel, Shape},
    motion::{
        ClockRow, FreeTime, MotionRows, Witness,
        free_time::{FreeTimeOptions, GONE},
    },
    optimiser::{Adam, AdamBuffers, AdamConfig, decayed},
    raster::Deltas,
};

/// How softly a body appears and vanishes, seconds.
pub const SOFTNESS: f32 = 0.012;
/// How much faster bodies learn while they are followed.
const FASTER: f32 = 2.0;
/// Adam's memory of squared gradients: each control point is asked for now and then alone.
const BETA2: f32 = 0.99;

/// The uniform `Moment` of `shared.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Moment {
    rows: u32,
    bodies: u32,
    nodes: u32,
    knots: u32,
    stretch: f32,
    seconds: f32,
    softness: f32,
    path: f32,
    rigid: f32,
    away: f32,
    alike: f32,
    padding: u32,
}

/// Parameters with their gradients and moments.
#[derive(Debug)]
struct Learned {
    values: Buffer,
    gradients: Buffer,
    moments: [Buffer; 2],
    floats: usize,
}

impl Learned {
    fn new(gpu: &Gpu, label: &str, values: &[f32]) -> Result<Self, GpuError> {
        let bytes = size_of_val(values) as u64;
        Ok(Self {
            values: gpu.storage_from(label, values)?,
            gradients: gpu.storage("gradients of bodies", bytes)?,
            moments: [gpu.storage("first moment of bodies", bytes)?, gpu.storage("second moment of bodies", bytes)?],
            floats: values.len(),
        })
    }

    fn all(&self) -> [&Buffer; 3] {
        let [first, second] = &self.moments;
        [&self.values, first, second]
    }
}

/// Which rows hang on which body and node, on the device.
#[derive(Debug)]
struct Hung {
    items: Buffer,
    chunks: Buffer,
    chunk_count: u32,
    runs: Buffer,
    partial: Buffer,
    shares: Buffer,
    some_are_free: bool,
}

#[derive(Debug)]
struct Kernels {
    poses: Kernel,
    carry: Kernel,
    carry_backward: Kernel,
    chunks: Kernel,
    settle: Kernel,
    smooth: Kernel,
    unit: Kernel,
    clock: Kernel,
}

/// Bodies, their nodes and their paths.
#[derive(Debug)]
pub struct Bodies {
    /// Of the Gaussians that no body carries.
    free: FreeTime,
    options: BodiesOptions,
    names: Vec<String>,
    /// When each is in view, in [0, 1].
    spans: Vec<[f64; 2]>,
    /// Whether how each turns at the start is a guess.
    guessed: Vec<bool>,
    /// Their gates at the start.
    gates: Vec<[f32; 4]>,
    /// The control points at the start.
    started: Vec<f32>,
    counts: [u32; 3],
    /// Stretches of splines, seconds and RGB intervals in the recording.
    stretches: f64,
    seconds: f64,
    intervals: f32,
    /// The scene's extent, metres.
    extent: f32,
    control: Learned,
    other: Learned,
    neighbours: Buffer,
    poses: Buffer,
    d_poses: Buffer,
    hung: Hung,
    kernels: Kernels,
    adam: Adam,
    steps: u32,
    threads: u32,
    rows_a_group: u32,
    row: [usize; 2],
}

impl Bodies {
    /// Bodies that start as `start` has them, in a recording of so many seconds and RGB `intervals` and a scene of this `extent`, metres.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no room.
    pub fn new(
        gpu: &Gpu,
        start: &Start,
        options: &BodiesOptions,
        free: &FreeTimeOptions,
        [seconds, intervals]: [f64; 2],
        extent: f32,
    ) -> Result<Self, GpuError> {
        let (threads, per_thread) = match gpu.shape {
            Shape::Gpu => (256, 1),
            Shape::Cpu => (8, 32),
        };
        let extra = super::EXTRA_FLOATS;
        let row = [free.floats() + extra, free.floats()];
        // A body or node is work for a thread by itself.
        let few = match gpu.shape {
            Shape::Gpu => 64,
            Shape::Cpu => 8,
        };
        let constants = |threads: u32| {
            format!(
                "const THREADS = {threads}u;\nconst PER_THREAD = {per_thread}u;\nconst NEIGHBOURS = {NEIGHBOURS}u;\nconst GONE = {GONE:?};\nconst VECTORS = {}u;\nconst BODY = {}u;\n",
                row[0] / 4,
                row[1] / 4
            )
        };
        let shared = include_str!("shared.wgsl");
        let of_rows =
            |label: &str, own: &str| gpu.kernel(label, &[&constants(threads), shared, include_str!("row.wgsl"), own]);
        let of_each = |label: &str, own: &str| gpu.kernel(label, &[&constants(few), shared, own]);
        let kernels = Kernels {
            poses: of_each("poses of bodies", include_str!("poses.wgsl")),
            carry: of_rows("motion forward", include_str!("carry.wgsl")),
            carry_backward: of_rows("motion backward", include_str!("carry_backward.wgsl")),
            chunks: gpu.kernel("shares of bodies", &[&constants(few), include_str!("chunks.wgsl")]),
            settle: of_each("gradients of bodies", include_str!("settle.wgsl")),
            smooth: gpu.kernel("smooth paths", &[&constants(few), include_str!("smooth.wgsl")]),
            unit: gpu.kernel("turns of length 1", &[&constants(few), include_str!("unit.wgsl")]),
            clock: of_each("clock of a camera", include_str!("clock.wgsl")),
        };
        let entities = (start.bodies + start.nodes) as u64;
        let in_view = |at_s: f32| f64::from(at_s) / seconds;
        let free = FreeTime::with_rows(gpu, free, extra, intervals as f32, extent)?;
        Ok(Self {
            free,
            options: options.clone(),
            names: start.names.clone(),
            spans: start.other.chunks_exact(4).take(start.bodies).map(|gate| [gate[0], gate[1]].map(in_view)).collect(),
            guessed: start.guessed.clone(),
            gates: start.other.as_chunks().0.iter().take(start.bodies).copied().collect(),
            started: start.control.clone(),
            counts: [start.bodies, start.nodes, start.knots].map(|count| count as u32),
            stretches: (start.knots - 3) as f64,
            seconds,
            intervals: intervals as f32,
            extent,
            control: Learned::new(gpu, "paths of bodies", &start.control)?,
            other: Learned::new(gpu, "gates and nodes", &start.other)?,
            neighbours: gpu.storage_from("neighbours of nodes", &start.neighbours)?,
            poses: gpu.storage("poses of bodies", entities * 32)?,
            d_poses: gpu.storage("gradients of poses", entities * 32)?,
            hung: Hung::new(gpu, &Index::new(&[], row[0], row[1], start.bodies, start.nodes), 0)?,
            kernels,
            adam: Adam::new(gpu),
            steps: 0,
            threads: few,
            rows_a_group: threads * per_thread,
            row,
        })
    }

    /// Says which rows there are now.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no room.
    pub fn hang(&mut self, gpu: &Gpu, rows: &[f32]) -> Result<(), GpuError> {
        let [bodies, nodes, _] = self.counts.map(|count| count as usize);
        let index = Index::new(rows, self.row[0], self.row[1], bodies, nodes);
        self.hung = Hung::new(gpu, &index, rows.len() / self.row[0])?;
        Ok(())
    }

    /// Bodies, nodes, and control points of each.
    #[must_use]
    pub fn counts(&self) -> [u32; 3] {
        self.counts
    }

    /// What the bodies are called.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// When each was found to be in view, in [0, 1].
    #[must_use]
    pub fn spans(&self) -> &[[f64; 2]] {
        &self.spans
    }

    /// Whether how any of them turns at the start is a guess.
    #[must_use]
    pub fn some_are_guessed(&self) -> bool {
        self.guessed.contains(&true)
    }

    /// Shows the bodies that are followed in a part of the recording (in [0, 1]) alone, or again whenever they are in view.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn show_followed(&mut self, gpu: &Gpu, part: Option<[f64; 2]>) -> Result<(), GpuError> {
        let mut other: Vec<f32> = gpu.download(&self.other.values, self.other.floats)?;
        let part = part.map(|part| part.map(|at| (at * self.seconds) as f32));
        let gates = std::iter::zip(other.as_chunks_mut().0, std::iter::zip(&self.gates, &self.guessed));
        for (gate, (started, _)) in gates.filter(|(_, (_, guessed))| **guessed) {
            *gate = part.map_or(*started, |part| gate_within(*started, part));
        }
        gpu.upload(&self.other.values, 0, &other);
        Ok(())
    }

    /// Lays the paths of bodies that are followed anew beyond a part of the recording (in [0, 1]), from what was learned in it.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn carry_on(&mut self, gpu: &Gpu, part: [f64; 2]) -> Result<(), GpuError> {
        let [entities, knots] = [self.entities(), self.counts[2]].map(|count| count as usize);
        let paths = Paths { started: &self.started, guessed: &self.guessed, entities, knots };
        let mut control = gpu.download(&self.control.values, self.control.floats)?;
        paths.carry_on(&mut control, part.map(|at| at * self.stretches));
        gpu.upload(&self.control.values, 0, &control);
        Ok(())
    }

    fn entities(&self) -> u32 {
        self.counts[0] + self.counts[1]
    }

    fn moment(&self, rows: u32, t01: f32, path: f32, share: f32) -> Moment {
        let [bodies, nodes, knots] = self.counts;
        let each = share / nodes.max(1) as f32;
        let squared = each / (self.extent * self.extent).max(1e-12);
        Moment {
            rows,
            bodies,
            nodes,
            knots,
            stretch: (f64::from(t01) * self.stretches) as f32,
            seconds: (f64::from(t01) * self.seconds) as f32,
            softness: SOFTNESS,
            path,
            rigid: squared * self.options.rigid,
            away: squared * self.options.away,
            alike: each * self.options.alike,
            padding: 0,
        }
    }

    /// Fills `tape.deltas` for the dynamic rows at `t01`.
    pub(in crate::motion) fn forward(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        t01: f32,
        tape: &mut Tape,
    ) -> Result<(), FieldError> {
        if self.hung.some_are_free {
            self.free.forward(gpu, rows, t01, tape)?;
        } else {
            tape.begin_rows(gpu, rows.count, t01)?;
        }
        let moment = gpu.uniform("motion", &self.moment(rows.count, t01, 0.0, 0.0));
        let mut commands = gpu.commands();
        commands.dispatch(
            &self.kernels.poses,
            &[&moment, &self.control.values, &self.other.values, &self.poses],
            self.entities().div_ceil(self.threads),
        );
        commands.dispatch(
            &self.kernels.carry,
            &[&moment, rows.core, rows.values, &self.poses, &self.other.values, &tape.deltas.core],
            rows.count.div_ceil(self.rows_a_group),
        );
        commands.submit();
        Ok(())
    }

    /// Adds the gradients of the pass on `tape` to those of paths and rows, and to `d_core`; and those of what holds nodes together where
    /// the witness is a frame.
    pub(in crate::motion) fn backward(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        tape: &Tape,
        d_deltas: &Deltas,
        d_core: &Buffer,
        witness: Witness,
    ) -> Result<(), FieldError> {
        if self.hung.some_are_free {
            self.free.backward(gpu, rows, tape, d_deltas, d_core, witness)?;
        }
        let (path, share) = match witness {
            Witness::Frame(share) => (1.0, share),
            Witness::Events => (0.0, 0.0),
        };
        let moment = gpu.uniform("motion", &self.moment(tape.deltas.rows, tape.t01, path, share));
        let counts = gpu.uniform("chunks", &[self.hung.chunk_count, 0, 0, 0]);
        let (control, other, hung) = (&self.control, &self.other, &self.hung);
        let mut commands = gpu.commands();
        // Another pass may have been since.
        commands.dispatch(
            &self.kernels.poses,
            &[&moment, &control.values, &other.values, &self.poses],
            self.entities().div_ceil(self.threads),
        );
        commands.dispatch(
            &self.kernels.carry_backward,
            &[&moment, rows.core, rows.values, &self.poses, &other.values, &d_deltas.core, d_core, &hung.shares],
            rows.count.div_ceil(self.rows_a_group),
        );
        commands.dispatch(
            &self.kernels.chunks,
            &[&counts, &hung.chunks, &hung.items, &hung.shares, &hung.partial],
            hung.chunk_count.div_ceil(self.threads),
        );
        commands.dispatch(
            &self.kernels.settle,
            &[
                &moment,
                &hung.runs,
                &hung.partial,
                &self.poses,
                &other.values,
                &self.neighbours,
                &control.values,
                &control.gradients,
                &other.gradients,
                &self.d_poses,
            ],
            self.entities().div_ceil(self.threads),
        );
        commands.submit();
        Ok(())
    }

    /// Adds to a camera's row the gradient of the time, RGB intervals, of the pass on `tape`, which was the last to be gone back through.
    pub(in crate::motion) fn clock(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        tape: &Tape,
        d_deltas: &Deltas,
        to: ClockRow<'_>,
    ) {
        if self.hung.some_are_free {
            self.free.clock(gpu, rows, tape, d_deltas, to);
        }
        let moment = gpu.uniform("motion", &self.moment(0, tape.t01, 0.0, 0.0));
        let interval = (self.stretches / f64::from(self.intervals)) as f32;
        // Where some rows are free, their clock has counted it.
        let renderings = if self.hung.some_are_free { 0.0_f32 } else { 1.0 };
        let row = gpu.uniform("row of a camera", &[to.row, interval.to_bits(), renderings.to_bits(), 0]);
        let mut commands = gpu.commands();
        let bindings = [&moment, &row, &self.control.values, &self.d_poses, to.sums];
        commands.dispatch(&self.kernels.clock, &bindings, 1);
        commands.submit();
    }

    /// Sets the gradients of an iteration to zero.
    pub fn clear_gradients(&self, gpu: &Gpu) {
        let mut commands = gpu.commands();
        commands.clear(&self.control.gradients);
        commands.clear(&self.other.gradients);
        commands.submit();
    }

    /// One step of Adam, where `progress` is the share of the fine stage that is done; bodies learn faster while they are followed.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn step(&mut self, gpu: &Gpu, progress: f64, follows: bool, epsilon: f32) -> Result<(), FieldError> {
        self.steps += 1;
        let [bodies, nodes, knots] = self.counts;
        let options = &self.options;
        // Appearance first, then bodies, then nodes.
        let early = (0.02 + progress / 0.05).min(1.0) as f32;
        let from = f64::from(options.nodes_from);
        let late = if progress < from { 0.0 } else { ((progress - from) / 0.05).clamp(0.02, 1.0) as f32 };
        let rate = |rates: [f32; 2], scale: f32| scale * decayed(rates, progress);
        let pose = |path: f32, turn: f32| [path, path, path, 0.0, turn, turn, turn, turn];
        let speed = if follows { early * FASTER } else { early };
        let of_body = pose(rate(options.path, speed * self.extent), rate(options.turn, speed));
        let of_node = pose(rate(options.node_path, late * self.extent), rate(options.node_turn, late));
        let control_rates = [of_body.repeat(bodies as usize), of_node.repeat(nodes as usize)].concat();
        let [gate, reach] = [early * options.gate, late * options.reach];
        let other_rates =
            [[gate, gate, 0.0, 0.0].repeat(bodies as usize), [0.0, 0.0, 0.0, reach].repeat(nodes as usize)].concat();
        let squared = self.extent * self.extent;
        let weight = |weight: f32, of: u32, scale: f32| weight * scale / (of.max(1) * (knots - 3).max(1)) as f32;
        let weights = [
            weight(options.smooth_path[0], bodies, 1.0 / squared),
            weight(options.smooth_turn[0], bodies, 1.0),
            weight(options.smooth_path[1], nodes, 1.0 / squared),
            weight(options.smooth_turn[1], nodes, 1.0),
        ];
        let bits = weights.map(f32::to_bits);
        let smooth = gpu.uniform("smooth", &[[bodies, nodes, knots, 0], bits]);
        let points = knots * self.entities();
        let counts = gpu.uniform("control points", &[points, 0, 0, 0]);
        let groups = points.div_ceil(self.threads);
        let config = AdamConfig { beta2: BETA2, epsilon, ..AdamConfig::default() };
        let mut commands = gpu.commands();
        let (control, other) = (&self.control, &self.other);
        commands.dispatch(&self.kernels.smooth, &[&smooth, &control.values, &control.gradients], groups);
        for (learned, rows, rates) in [(control, knots, &control_rates), (other, 1, &other_rates)] {
            let [first_moment, second_moment] = &learned.moments;
            let buffers = AdamBuffers {
                parameters: &learned.values,
                gradients: &learned.gradients,
                first_moment,
                second_moment,
                rows,
                stride: rates.len() as u32,
                mask: None,
            };
            if !rates.is_empty() {
                self.adam.step(&mut commands, &buffers, rates, &config, self.steps)?;
            }
        }
        commands.dispatch(&self.kernels.unit, &[&counts, &control.values], groups);
        commands.submit();
        Ok(())
    }

    /// Everything that resuming needs.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn state(&self, gpu: &Gpu) -> Result<FieldState, FieldError> {
        let mut vectors = Vec::new();
        for (name, learned) in self.learned() {
            for (part, buffer) in PARTS.iter().zip(learned.all()) {
                vectors
                    .push(NamedVector { name: format!("{name}{part}"), values: gpu.download(buffer, learned.floats)? });
            }
        }
        Ok(FieldState { step: self.steps, vectors })
    }

    /// Goes on from what [`Bodies::state`] gave.
    ///
    /// # Errors
    /// [`FieldError::State`] where that is of other bodies.
    pub fn restore(&mut self, gpu: &Gpu, state: &FieldState) -> Result<(), FieldError> {
        let learned = self.learned();
        let expected =
            learned.iter().flat_map(|(name, learned)| PARTS.map(|part| (format!("{name}{part}"), learned.floats)));
        let fits = expected.eq(state.vectors.iter().map(|vector| (vector.name.clone(), vector.values.len())));
        if !fits {
            let reason =
                "it was saved with other bodies; train anew, or with the dataset that it was trained on".into();
            return Err(FieldError::State { reason });
        }
        let buffers = learned.iter().flat_map(|(_, learned)| learned.all());
        for (vector, buffer) in state.vectors.iter().zip(buffers) {
            gpu.upload(buffer, 0, &vector.values);
        }
        self.steps = state.step;
        Ok(())
    }

    fn learned(&self) -> [(&'static str, &Learned); 2] {
        [("bodies.control", &self.control), ("bodies.other", &self.other)]
    }

    /// Numbers that paths, gates and nodes consist of, and the buffers that they lie in.
    #[must_use]
    pub fn values(&self) -> [(&Buffer, u32); 2] {
        self.learned().map(|(_, learned)| (&learned.values, learned.floats as u32))
    }

    /// The gradients of paths, and of gates and nodes, copied to the host.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gradients(&self, gpu: &Gpu) -> Result<[Vec<f32>; 2], GpuError> {
        let [control, other] = self.learned().map(|(_, learned)| gpu.download(&learned.gradients, learned.floats));
        Ok([control?, other?])
    }
}

/// Parts of what is learned, as [`Learned::all`] has them.
const PARTS: [&str; 3] = ["", ".m", ".v"];

impl Hung {
    fn new(gpu: &Gpu, index: &Index, rows: usize) -> Result<Self, GpuError> {
        let chunks = index.chunks.len();
        Ok(Self {
            items: gpu.storage_from("shares of each body", &index.items)?,
            chunks: gpu.storage_from("chunks of shares", &index.chunks)?,
            chunk_count: chunks as u32,
            runs: gpu.storage_from("runs of chunks", &index.runs)?,
            partial: gpu.storage("sums of chunks", chunks as u64 * 32)?,
            shares: gpu.storage("shares of rows", rows as u64 * 160)?,
            some_are_free: index.some_are_free,
        })
    }
}
