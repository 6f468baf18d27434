//! Matrix products on the device.

use bytemuck::{Pod, Zeroable};
use wgpu::{Buffer, DeviceType};

use crate::gpu::{Commands, Gpu, GpuError, Kernel};

/// A matrix in a buffer of f32: where it starts, and how far apart neighbours along its rows and columns lie.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    pub buffer: &'a Buffer,
    pub offset: usize,
    /// Floats from one row to the next.
    pub row: usize,
    /// Floats from one column to the next.
    pub col: usize,
}

impl<'a> Place<'a> {
    /// A matrix whose rows lie `stride` floats apart.
    pub fn new(buffer: &'a Buffer, offset: usize, stride: usize) -> Self {
        Self { buffer, offset, row: stride, col: 1 }
    }

    fn transposed(self) -> Self {
        Self { row: self.col, col: self.row, ..self }
    }
}

/// A linear layer on the device: its sizes, and where its weights and biases start in the buffers of the MLP.
#[derive(Clone, Copy)]
pub struct Layer {
    pub inputs: usize,
    pub outputs: usize,
    pub weight: usize,
    pub bias: usize,
}

/// What happens to a product before it is stored.
#[derive(Clone, Copy)]
enum Finish<'a> {
    /// A bias, from the buffer of the right operand, and a ReLU if so.
    Bias { offset: usize, relu: bool },
    /// Zeros where the mask is zero.
    Mask(Option<Place<'a>>),
    /// Slabs of this many rows of the inner dimension, `length` floats each: the product, and behind it the sums of the right operand's columns.
    Slabs { rows: usize, length: usize },
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ProductUniform {
    sizes: [u32; 4],
    a: [u32; 4],
    b: [u32; 4],
    c: [u32; 4],
    more: [u32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct ReduceUniform {
    weights: u32,
    biases: u32,
    slabs: u32,
    to_weights: u32,
    to_biases: u32,
    padding: [u32; 3],
}

/// Kernels of one tile shape.
#[derive(Debug)]
struct Tiles {
    m: usize,
    n: usize,
    /// `x W^T + b`, with a ReLU or without.
    layer: Kernel,
    /// `d W`, with a mask or without.
    input: Kernel,
    /// `x^T d`, in slabs, with the sums of the columns of `d` behind each.
    weight: Kernel,
}

/// The kernels of the layers.
#[derive(Debug)]
pub struct Products {
    wide: Tiles,
    /// For products of up to 64 columns.
    half: Tiles,
    /// For products of up to 16.
    tall: Tiles,
    reduce: Kernel,
    /// Slabs of gradients before they are summed.
    slabs: Buffer,
}

/// See `product.wgsl`.
const WRITTEN_OUT: &str = include_str!("product/written_out.wgsl");
const LOOPED: &str = include_str!("product/looped.wgsl");

/// Floats of the buffer for slabs, unless a layer alone has more.
const SLAB_FLOATS: usize = 1 << 22;
/// Rows of a slab at least.
const SLAB_ROWS: usize = 512;

impl Products {
    /// Compiles the kernels; `largest` is the number of weights and biases of the largest layer.
    pub fn new(gpu: &Gpu, largest: usize) -> Result<Self, GpuError> {
        Self::with(gpu, largest, if gpu.info.device_type == DeviceType::Cpu { LOOPED } else { WRITTEN_OUT })
    }

    /// `several`: how what is done several times is put.
    fn with(gpu: &Gpu, largest: usize, several: &str) -> Result<Self, GpuError> {
        let tiles = |n, blocks, threads| Tiles::new(gpu, n, blocks, threads, several);
        Ok(Self {
            wide: tiles(128, [2, 2], 256),
            half: tiles(64, [2, 1], 256),
            tall: tiles(16, [1, 1], 128),
            reduce: gpu.kernel("sum of slabs", &[include_str!("reduce.wgsl")]),
            slabs: gpu.storage("slabs of gradients", Self::bytes(largest))?,
        })
    }

    /// Bytes of their buffers.
    pub fn bytes(largest: usize) -> u64 {
        4 * largest.max(SLAB_FLOATS) as u64
    }

    fn tiles(&self, columns: usize) -> &Tiles {
        match columns {
            0..=16 => &self.tall,
            17..=64 => &self.half,
            _ => &self.wide,
        }
    }

    /// `out = x W^T + b`, then a ReLU if so, for `rows` rows.
    pub fn layer(
        &self,
        commands: &mut Commands<'_>,
        (layer, parameters): (Layer, &Buffer),
        rows: usize,
        x: Place<'_>,
        out: Place<'_>,
        relu: bool,
    ) {
        let tiles = self.tiles(layer.outputs);
        let weights = Place::new(parameters, layer.weight, layer.inputs).transposed();
        let size = [rows, layer.outputs, layer.inputs];
        let finish = Finish::Bias { offset: layer.bias, relu };
        tiles.dispatch(commands, &tiles.layer, size, [x, weights, out], finish);
    }

    /// `d_x = d W`, zero where `mask` is, for `rows` rows.
    pub fn input_gradient(
        &self,
        commands: &mut Commands<'_>,
        (layer, parameters): (Layer, &Buffer),
        rows: usize,
        d: Place<'_>,
        d_x: Place<'_>,
        mask: Option<Place<'_>>,
    ) {
        let tiles = self.tiles(layer.inputs);
        let weights = Place::new(parameters, layer.weight, layer.inputs);
        let size = [rows, layer.inputs, layer.outputs];
        tiles.dispatch(commands, &tiles.input, size, [d, weights, d_x], Finish::Mask(mask));
    }

    /// Adds `d^T x` and the column sums of `d` to the gradients of weights and biases.
    pub fn weight_gradient(
        &self,
        commands: &mut Commands<'_>,
        (layer, gradients): (Layer, &Buffer),
        rows: usize,
        d: Place<'_>,
        x: Place<'_>,
    ) {
        let weights = layer.inputs * layer.outputs;
        let length = weights + layer.outputs;
        let most = (SLAB_FLOATS / length).max(1);
        let slab = rows.div_ceil(most).max(SLAB_ROWS);
        let slabs = rows.div_ceil(slab);
        let tiles = self.tiles(layer.outputs);
        let out = Place::new(&self.slabs, 0, layer.inputs).transposed();
        let size = [layer.inputs, layer.outputs, rows];
        tiles.dispatch(commands, &tiles.weight, size, [x.transposed(), d, out], Finish::Slabs { rows: slab, length });

        let uniform = ReduceUniform {
            weights: weights as u32,
            biases: layer.outputs as u32,
            slabs: slabs as u32,
            to_weights: layer.weight as u32,
            to_biases: layer.bias as u32,
            padding: [0; 3],
        };
        let uniform = commands.gpu().uniform("sum of slabs", &uniform);
        commands.dispatch(&self.reduce, &[&uniform, &self.slabs, gradients], length.div_ceil(64) as u32);
    }
}

impl Tiles {
    /// Tiles of 128 rows and `n` columns; a thread makes `blocks` blocks of 4 x 4, down and across.
    fn new(gpu: &Gpu, n: usize, blocks: [usize; 2], threads: usize, several: &str) -> Self {
        const M: usize = 128;
        debug_assert_eq!(M * n, 16 * blocks[0] * blocks[1] * threads);
        let [down, across] = blocks;
        let kernel = |label: &str, a_along_k: bool, b_along_n: bool, bias: bool, columns: bool| {
            let constants = format!(
                "const TILE_M = {M}u;\nconst TILE_N = {n}u;\nconst DOWN = {down}u;\nconst ACROSS = {across}u;\n\
                 const THREADS = {threads}u;\nconst A_ALONG_K = {a_along_k};\nconst B_ALONG_N = {b_along_n};\n\
                 const BIAS = {bias};\nconst COLUMNS = {columns};"
            );
            gpu.kernel(label, &[&constants, include_str!("product.wgsl"), several])
        };
        Self {
            m: M,
            n,
            layer: kernel("linear layer", true, false, true, false),
            input: kernel("gradient of a layer's input", true, true, false, false),
            weight: kernel("gradient of a layer's weights", false, true, false, true),
        }
    }

    /// `out = a b` for sizes m, n, k.
    fn dispatch(
        &self,
        commands: &mut Commands<'_>,
        kernel: &Kernel,
        [m, n, k]: [usize; 3],
        [a, b, out]: [Place<'_>; 3],
        finish: Finish<'_>,
    ) {
        let (mut slab, mut slab_stride, mut more, mut mask, mut cut) = (k, 0, [0; 4], None, false);
        match finish {
            Finish::Bias { offset, relu } => (more[0], cut) = (offset, relu),
            Finish::Mask(place) => {
                mask = place.map(|place| place.buffer);
                more = place.map_or(more, |place| [0, place.offset, place.row, 0]);
            }
            Finish::Slabs { rows, length } => (slab, slab_stride, more[3]) = (rows, length, m * n),
        }
        let words = |values: [usize; 4]| values.map(|value| value as u32);
        let uniform = ProductUniform {
            sizes: words([m, n, k, slab]),
            a: words([a.offset, a.row, a.col, usize::from(cut) + 2 * usize::from(mask.is_some())]),
            b: words([b.offset, b.row, b.col, 4]),
            c: words([out.offset, out.row, out.col, slab_stride]),
            more: words(more),
        };
        let uniform = commands.gpu().uniform("matrix product", &uniform);
        let bindings = [&uniform, a.buffer, b.buffer, out.buffer, mask.unwrap_or(a.buffer)];
        let tiles = m.div_ceil(self.m) * n.div_ceil(self.n) * k.div_ceil(slab.max(1));
        commands.dispatch(kernel, &bindings, tiles as u32);
    }
}

#[cfg(test)]
mod tests;
