//! Bodies on the device.

mod learned;
mod passes;

use wgpu::Buffer;

pub use self::passes::SOFTNESS;

use self::learned::Learned;
use super::{
    BodiesOptions, CODES, LOOSE, NEIGHBOURS, Start,
    carry_on::{Paths, gate_within},
    index::Index,
};
use crate::{
    gpu::{Gpu, GpuError, Kernel, Shape, stored},
    motion::{
        FreeTime,
        free_time::{FreeTimeOptions, GONE},
    },
    optimiser::Adam,
};

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
    /// Whether each is followed.
    followed: Vec<bool>,
    /// The instant that each of those that bend is followed from, in [0, 1].
    bends: Vec<Option<f64>>,
    /// Of each node whether its body bends.
    loose: Vec<bool>,
    /// The body of each node.
    node_bodies: Vec<usize>,
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
                "const THREADS = {threads}u;\nconst PER_THREAD = {per_thread}u;\nconst NEIGHBOURS = {NEIGHBOURS}u;\nconst CODES = {CODES}u;\nconst LOOSE = {LOOSE}u;\nconst GONE = {GONE:?};\nconst VECTORS = {}u;\nconst BODY = {}u;\n",
                row[0] / 4,
                row[1] / 4
            )
        };
        let shared = include_str!("../shared.wgsl");
        let of_rows = |label: &str, own: &str| {
            gpu.kernel(label, &[&constants(threads), shared, include_str!("../row.wgsl"), own])
        };
        let of_each = |label: &str, own: &str| gpu.kernel(label, &[&constants(few), shared, own]);
        let kernels = Kernels {
            poses: of_each("poses of bodies", include_str!("../poses.wgsl")),
            carry: of_rows("motion forward", include_str!("../carry.wgsl")),
            carry_backward: of_rows("motion backward", include_str!("../carry_backward.wgsl")),
            chunks: gpu.kernel("shares of bodies", &[&constants(few), include_str!("../chunks.wgsl")]),
            settle: of_each("gradients of bodies", include_str!("../settle.wgsl")),
            smooth: gpu.kernel("smooth paths", &[&constants(few), include_str!("../smooth.wgsl")]),
            unit: gpu.kernel("turns of length 1", &[&constants(few), include_str!("../unit.wgsl")]),
            clock: of_each("clock of a camera", include_str!("../clock.wgsl")),
        };
        let poses = Self::size_of_poses(start.bodies + start.nodes);
        let in_view = |at_s: f32| f64::from(at_s) / seconds;
        let free = FreeTime::with_rows(gpu, free, extra, intervals as f32, extent)?;
        Ok(Self {
            free,
            options: options.clone(),
            names: start.names.clone(),
            spans: start.other.chunks_exact(4).take(start.bodies).map(|gate| [gate[0], gate[1]].map(in_view)).collect(),
            followed: start.followed.clone(),
            bends: start.bends.clone(),
            node_bodies: start.node_bodies.clone(),
            loose: start.loose(),
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
            poses: gpu.storage("poses of bodies", poses)?,
            d_poses: gpu.storage("gradients of poses", poses)?,
            hung: Hung::new(gpu, &Index::new(&[], row[0], row[1], start.bodies, start.nodes), 0)?,
            kernels,
            adam: Adam::new(gpu),
            steps: 0,
            threads: few,
            rows_a_group: threads * per_thread,
            row,
        })
    }

    /// Bytes of the device's memory that bodies take which start so and carry `rows` rows at most: parameters with their gradients and
    /// moments, poses, and which row hangs on what.
    #[must_use]
    pub fn bytes(start: &Start, rows: u32) -> u64 {
        let learned: u64 =
            [&start.control, &start.other].map(|values| 4 * stored(size_of_val(&values[..]) as u64)).iter().sum();
        let entities = start.bodies + start.nodes;
        let poses = 2 * stored(Self::size_of_poses(entities));
        let neighbours = stored(size_of_val(&start.neighbours[..]) as u64);
        learned + poses + neighbours + Hung::bytes(entities, rows) + FreeTime::BYTES
    }

    fn size_of_poses(entities: usize) -> u64 {
        entities as u64 * 32
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

    /// Whether each is followed.
    #[must_use]
    pub fn followed(&self) -> &[bool] {
        &self.followed
    }

    /// The instant that each of those that bend is followed from, in [0, 1].
    #[must_use]
    pub fn bends(&self) -> &[Option<f64>] {
        &self.bends
    }

    /// Shows the bodies that are followed each in its part of the recording (in [0, 1]) alone, or again whenever they are in view.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn show_followed(&mut self, gpu: &Gpu, parts: Option<&[[f64; 2]]>) -> Result<(), GpuError> {
        let mut other: Vec<f32> = gpu.download(&self.other.values, self.other.floats)?;
        let gates = std::iter::zip(other.as_chunks_mut().0, &self.gates);
        for (body, (gate, started)) in gates.enumerate().filter(|(body, _)| self.followed[*body]) {
            let part = parts.map(|parts| parts[body].map(|at| (at * self.seconds) as f32));
            *gate = part.map_or(*started, |part| gate_within(*started, part));
        }
        gpu.upload(&self.other.values, 0, &other);
        Ok(())
    }

    /// Lays the paths of bodies that are followed anew, each beyond its part of the recording (in [0, 1]), from what was learned in it.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn carry_on(&mut self, gpu: &Gpu, parts: &[[f64; 2]]) -> Result<(), GpuError> {
        let knots = self.counts[2] as usize;
        let paths = Paths {
            started: &self.started,
            followed: &self.followed,
            loose: &self.loose,
            of: &self.node_bodies,
            knots,
        };
        let mut control = gpu.download(&self.control.values, self.control.floats)?;
        let known: Vec<_> = parts.iter().map(|part| part.map(|at| at * self.stretches)).collect();
        paths.carry_on(&mut control, &known);
        gpu.upload(&self.control.values, 0, &control);
        Ok(())
    }

    fn entities(&self) -> u32 {
        self.counts[0] + self.counts[1]
    }
}

impl Hung {
    /// Bytes of the sums of so many chunks, and of the shares of so many rows.
    fn sizes(chunks: usize, rows: usize) -> [u64; 2] {
        [chunks as u64 * 32, rows as u64 * 160]
    }

    /// Bytes at most where each row hangs on a body and as many nodes as it can.
    fn bytes(entities: usize, rows: u32) -> u64 {
        let [items, chunks] = Index::most(entities, rows as usize);
        let [partial, shares] = Self::sizes(chunks, rows as usize);
        let [each, pair] = [size_of::<u32>() as u64, size_of::<[u32; 2]>() as u64];
        let lists = [items as u64 * each, chunks as u64 * pair, entities as u64 * pair, partial, shares];
        lists.into_iter().map(stored).sum()
    }

    fn new(gpu: &Gpu, index: &Index, rows: usize) -> Result<Self, GpuError> {
        let chunks = index.chunks.len();
        let [partial, shares] = Self::sizes(chunks, rows);
        Ok(Self {
            items: gpu.storage_from("shares of each body", &index.items)?,
            chunks: gpu.storage_from("chunks of shares", &index.chunks)?,
            chunk_count: chunks as u32,
            runs: gpu.storage_from("runs of chunks", &index.runs)?,
            partial: gpu.storage("sums of chunks", partial)?,
            shares: gpu.storage("shares of rows", shares)?,
            some_are_free: index.some_are_free,
        })
    }
}
