//! The planes on the device: features, gradients and regularisers.

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

use super::DeviceTape;
use crate::{
    field::{
        Layout, PlaneLosses, PlaneWeights, SpatialSmoothness,
        backend::{Domain, Pass},
    },
    gpu::{Commands, Gpu, GpuError, Kernel, stored},
};

/// The spatial planes xy, xz, yz and the time planes xt, yt, zt among the six of a level.
const SPATIAL: [usize; 3] = [0, 1, 3];
const TEMPORAL: [usize; 3] = [2, 4, 5];

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Level {
    cells: [u32; 4],
    planes: [u32; 4],
    times: [u32; 4],
    lines: [u32; 4],
    sums: [u32; 4],
    line_sums: [u32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FrameUniform {
    origin: [f32; 4],
    scale: [f32; 4],
    rows: [u32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct LinesUniform {
    row: u32,
    weight: f32,
    groups: u32,
    padding: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct PullUniform {
    rows: u32,
    first: u32,
    limit: f32,
    padding: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct MeansUniform {
    scale: [f32; 4],
    rows: u32,
    first: u32,
    padding: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FlushUniform {
    sums: u32,
    to: u32,
    length: u32,
    stride: u32,
    weight: f32,
    padding: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct RegularUniform {
    offset: u32,
    length: u32,
    step: u32,
    cells: u32,
    taps: [f32; 4],
    reach: u32,
    scale: f32,
    first_sum: u32,
    padding: u32,
}

/// Kernels and scratch of the planes.
#[derive(Debug)]
pub struct Planes {
    levels: Vec<Level>,
    level_buffer: Buffer,
    lines: Buffer,
    /// Low and high words of the fixed-point sums.
    words: [Buffer; 2],
    /// Gradient of the coordinates by row and group of features, for the rows of a chunk.
    d_points: Option<Buffer>,
    blend: Kernel,
    gather: Kernel,
    pull: Kernel,
    means: Kernel,
    flush: Kernel,
    regular: Kernel,
}

impl Planes {
    /// Compiles the kernels.
    pub fn new(gpu: &Gpu, layout: &Layout) -> Result<Self, GpuError> {
        let features = layout.config.features as usize;
        let (levels, [lines, words]) = levels(layout);
        let constants = format!("const LEVELS = {}u;\nconst F4 = {}u;", levels.len(), features / 4);
        let kernel = |label, source| gpu.kernel(label, &[&constants, include_str!("planes.wgsl"), source]);
        Ok(Self {
            level_buffer: gpu.storage_from("levels of the field", &levels)?,
            lines: gpu.storage("blended time planes", lines)?,
            words: [gpu.storage("low words of the sums", words)?, gpu.storage("high words of the sums", words)?],
            d_points: None,
            blend: kernel("blend time planes", include_str!("lines.wgsl")),
            gather: kernel("gather features", include_str!("gather.wgsl")),
            pull: kernel("gradient of the planes", include_str!("pull.wgsl")),
            means: kernel("gradient of the means", include_str!("means.wgsl")),
            flush: gpu.kernel("sums to gradients", &[include_str!("flush.wgsl")]),
            regular: gpu.kernel("regularise a plane", &[include_str!("regular.wgsl")]),
            levels,
        })
    }

    /// Bytes of all buffers where chunks have `rows` rows.
    pub fn bytes(layout: &Layout, rows: usize) -> u64 {
        let (levels, [lines, words]) = levels(layout);
        let of_levels = size_of_val(&levels[..]) as u64;
        stored(of_levels) + stored(lines) + 2 * stored(words) + stored(size_of_coordinates(layout, rows))
    }

    /// Blends the time planes for a pass.
    pub fn blend_lines(&self, commands: &mut Commands<'_>, pass: Pass, parameters: &Buffer) {
        let groups = (self.lines.size() / 16) as u32;
        let time = LinesUniform { row: pass.time.0 as u32, weight: pass.time.1, groups, padding: 0 };
        let time = commands.gpu().uniform("time of a pass", &time);
        let bindings = [&time, &self.level_buffer, parameters, &self.lines];
        commands.dispatch(&self.blend, &bindings, groups.div_ceil(256));
    }

    /// Coordinates and features of the rows of a pass.
    pub fn gather(
        &self,
        commands: &mut Commands<'_>,
        domain: &Domain,
        pass: Pass,
        parameters: &Buffer,
        core: &Buffer,
        tape: &DeviceTape,
    ) {
        self.blend_lines(commands, pass, parameters);
        let four = |values: [f32; 3]| [values[0], values[1], values[2], 0.0];
        let frame = FrameUniform { origin: four(domain.origin), scale: four(domain.scale), rows: [tape.rows, 0, 0, 0] };
        let frame = commands.gpu().uniform("frame of a pass", &frame);
        let inputs = [&self.level_buffer, parameters, &self.lines, core];
        let bindings = [&frame, inputs[0], inputs[1], inputs[2], inputs[3], &tape.points, &tape.features];
        let groups = tape.rows as usize * domain.layout.point_features() / 4;
        commands.dispatch(&self.gather, &bindings, groups.div_ceil(256) as u32);
    }

    /// Adds the gradient of the features of rows `first..first + rows` to the sums, and that of their means to `d_core`.
    #[expect(clippy::too_many_arguments, reason = "one kernel's bindings")]
    pub fn pull(
        &mut self,
        commands: &mut Commands<'_>,
        domain: &Domain,
        parameters: &Buffer,
        tape: &DeviceTape,
        [first, rows]: [usize; 2],
        d_features: &Buffer,
        left_out: &Buffer,
        d_core: &Buffer,
    ) -> Result<(), GpuError> {
        let gpu = commands.gpu();
        let groups = rows * domain.layout.point_features() / 4;
        let bytes = size_of_coordinates(&domain.layout, rows);
        let d_points = match self.d_points.take() {
            Some(buffer) if buffer.size() >= bytes => buffer,
            _ => gpu.storage("gradient of the coordinates", bytes)?,
        };
        let d_points = self.d_points.insert(d_points);
        // No cell gets more than one contribution of a point through one tap, so that the sums stay below 2^22.
        let limit = (1_u32 << 22) as f32 / tape.rows.max(1) as f32;
        let uniform = PullUniform { rows: rows as u32, first: first as u32, limit, padding: 0 };
        let uniform = gpu.uniform("rows of a chunk", &uniform);
        let [low, high] = &self.words;
        let inputs = [&self.level_buffer, parameters, &self.lines, &tape.points, d_features];
        let bindings =
            [&uniform, inputs[0], inputs[1], inputs[2], inputs[3], inputs[4], low, high, &*d_points, left_out];
        commands.dispatch(&self.pull, &bindings, groups.div_ceil(256) as u32);

        let [x, y, z] = domain.scale;
        let uniform = MeansUniform { scale: [x, y, z, 0.0], rows: rows as u32, first: first as u32, padding: [0; 2] };
        let uniform = gpu.uniform("rows of a chunk", &uniform);
        commands.dispatch(&self.means, &[&uniform, &*d_points, d_core], rows.div_ceil(256) as u32);
        Ok(())
    }

    /// Turns the sums of a pass into gradients of the planes.
    pub fn flush(&self, commands: &mut Commands<'_>, layout: &Layout, pass: Pass, gradients: &Buffer) {
        let features = layout.config.features as usize;
        for (level, planes) in self.levels.iter().zip(layout.planes.chunks_exact(6)) {
            for which in 0..3 {
                let (spatial, temporal) = (&planes[SPATIAL[which]], &planes[TEMPORAL[which]]);
                let stride = (temporal.cols * features) as u32;
                let jobs = [
                    FlushUniform {
                        sums: level.sums[which],
                        to: spatial.offset as u32,
                        length: (spatial.rows * spatial.cols * features) as u32,
                        stride: 0,
                        weight: 0.0,
                        padding: [0; 3],
                    },
                    FlushUniform {
                        sums: level.line_sums[which],
                        to: temporal.offset as u32 + pass.time.0 as u32 * stride,
                        length: stride,
                        stride,
                        weight: pass.time.1,
                        padding: [0; 3],
                    },
                ];
                for job in jobs {
                    let uniform = commands.gpu().uniform("sums to gradients", &job);
                    let bindings = [&uniform, &self.words[0], &self.words[1], gradients];
                    commands.dispatch(&self.flush, &bindings, job.length.div_ceil(256));
                }
            }
        }
    }

    /// Adds the gradients of the regularisers and returns their values.
    pub fn regularise(
        &self,
        gpu: &Gpu,
        layout: &Layout,
        [parameters, gradients]: [&Buffer; 2],
        weights: &PlaneWeights,
    ) -> Result<PlaneLosses, GpuError> {
        let jobs = regular_jobs(layout, weights);
        let total = jobs.iter().map(|job| job.groups()).sum::<u32>();
        let sums = gpu.storage("losses of the planes", u64::from(total) * 4)?;
        let mut commands = gpu.commands();
        let mut first_sum = 0;
        for job in &jobs {
            let uniform = gpu.uniform("regularise a plane", &RegularUniform { first_sum, ..job.uniform });
            commands.dispatch(&self.regular, &[&uniform, parameters, gradients, &sums], job.groups());
            first_sum += job.groups();
        }
        commands.submit();
        let sums = gpu.download::<f32>(&sums, total as usize)?;
        let (mut losses, mut rest) = (PlaneLosses::default(), sums.as_slice());
        for job in &jobs {
            let (own, behind) = rest.split_at(job.groups() as usize);
            rest = behind;
            let mean = own.iter().map(|sum| f64::from(*sum)).sum::<f64>() / job.count;
            match job.kind {
                Kind::Space => losses.space += mean,
                Kind::Time => losses.time += mean,
                Kind::TimeL1 => losses.time_l1 += mean,
            }
        }
        Ok(losses)
    }
}

/// Bytes of the gradient of the coordinates of so many rows, by row and group of features.
fn size_of_coordinates(layout: &Layout, rows: usize) -> u64 {
    (rows * layout.point_features() / 4) as u64 * 16
}

/// Where the parts of each level lie, and the bytes of the lines and of the words of the sums of all.
fn levels(layout: &Layout) -> (Vec<Level>, [u64; 2]) {
    let features = layout.config.features as usize;
    let mut lines = 0;
    let mut sums = 0;
    let mut levels: Vec<Level> = Vec::new();
    for planes in layout.planes.chunks_exact(6) {
        let four = |values: [usize; 3]| [values[0] as u32, values[1] as u32, values[2] as u32, 0];
        let take = |from: &mut usize, length: usize| {
            *from += length;
            *from - length
        };
        levels.push(Level {
            cells: four(TEMPORAL.map(|plane| planes[plane].cols)),
            planes: four(SPATIAL.map(|plane| planes[plane].offset / 4)),
            times: four(TEMPORAL.map(|plane| planes[plane].offset / 4)),
            lines: four(TEMPORAL.map(|plane| take(&mut lines, planes[plane].cols * features / 4))),
            sums: four(SPATIAL.map(|plane| take(&mut sums, planes[plane].cols * planes[plane].rows * features))),
            line_sums: [0; 4],
        });
    }
    for level in &mut levels {
        level.line_sums = level.lines.map(|line| sums as u32 + 4 * line);
    }
    (levels, [lines as u64 * 16, (sums + 4 * lines) as u64 * 4])
}

/// Which loss a job belongs to.
#[derive(Clone, Copy)]
enum Kind {
    Space,
    Time,
    TimeL1,
}

/// One regulariser of one plane.
struct RegularJob {
    kind: Kind,
    uniform: RegularUniform,
    /// Terms of the mean.
    count: f64,
}

impl RegularJob {
    /// Workgroups, each of which leaves one sum.
    fn groups(&self) -> u32 {
        self.uniform.length.div_ceil(256 * 8)
    }
}

fn regular_jobs(layout: &Layout, weights: &PlaneWeights) -> Vec<RegularJob> {
    let features = layout.config.features as usize;
    let mut jobs = Vec::new();
    for plane in &layout.planes {
        let length = plane.rows * plane.cols * features;
        // Taps along an axis of `cells` cells that lie `step` floats apart; no taps for the distance from 1.
        let mut job = |kind: Kind, taps: &[f32], (cells, step): (usize, usize), weight: f32| {
            let reach = taps.len().saturating_sub(1);
            if cells <= reach {
                return;
            }
            let count = (length / cells * (cells - reach)) as f32;
            let mut all = [0.0; 4];
            all[..taps.len()].copy_from_slice(taps);
            let uniform = RegularUniform {
                offset: plane.offset as u32,
                length: length as u32,
                step: step as u32,
                cells: cells as u32,
                taps: all,
                reach: reach as u32,
                scale: weight * if taps.is_empty() { 1.0 } else { 2.0 } / count,
                first_sum: 0,
                padding: 0,
            };
            jobs.push(RegularJob { kind, uniform, count: f64::from(count) });
        };
        let (along_rows, along_cols) = ((plane.rows, plane.cols * features), (plane.cols, features));
        const FIRST: &[f32] = &[-1.0, 1.0];
        const SECOND: &[f32] = &[1.0, -2.0, 1.0];
        if plane.is_time() {
            job(Kind::Time, SECOND, along_rows, weights.time);
            job(Kind::TimeL1, &[], along_rows, weights.time_l1);
        } else if weights.form == SpatialSmoothness::SecondDifference {
            job(Kind::Space, SECOND, along_rows, weights.space);
        } else {
            job(Kind::Space, FIRST, along_rows, weights.space);
            job(Kind::Space, FIRST, along_cols, weights.space);
        }
    }
    jobs
}
