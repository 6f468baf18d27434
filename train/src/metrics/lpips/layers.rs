//! The layers of AlexNet and VGG16 up to their last rectifier: convolution by matrix product, and max-pooling.
//!
//! Feature maps are row-major with channels last, so that a band of output rows is one contiguous block that one
//! thread fills.

use rayon::prelude::*;

use erfgs_splat::matrix::{Matrix, multiply};

/// A feature map: `height` x `width` x `channels`.
#[derive(Clone, Debug)]
pub(super) struct Map {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    pub values: Vec<f32>,
}

/// How a window slides over a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    pub size: usize,
    pub stride: usize,
    pub padding: usize,
}

impl Window {
    /// How many positions the window has along a side of `length`; 0 where it does not fit.
    pub fn positions(self, length: usize) -> usize {
        (length + 2 * self.padding).checked_sub(self.size).map_or(0, |rest| rest / self.stride + 1)
    }
}

/// A convolution followed by max(0, x).
#[derive(Debug)]
pub(super) struct Convolution {
    window: Window,
    inputs: usize,
    outputs: usize,
    /// Rows (y, x, input channel) of the window, columns output channels.
    weights: Vec<f32>,
    bias: Vec<f32>,
}

/// Pixels that a thread works on at a time. Each block packs the weights anew, which costs nothing beside this many rows;
/// its unrolled input (at most 4608 values a pixel) still fits a cache.
const BLOCK_PIXELS: usize = 512;

impl Convolution {
    /// `weights` as PyTorch keeps them: output channel, input channel, y, x.
    pub fn new(window: Window, inputs: usize, outputs: usize, weights: &[f32], bias: Vec<f32>) -> Self {
        let area = window.size * window.size;
        let mut rows = vec![0.0; weights.len()];
        for (index, &weight) in weights.iter().enumerate() {
            let (output, input, at) = (index / (inputs * area), index / area % inputs, index % area);
            rows[(at * inputs + input) * outputs + output] = weight;
        }
        Self { window, inputs, outputs, weights: rows, bias }
    }

    pub fn apply(&self, input: &Map) -> Map {
        let (height, width) = (self.window.positions(input.height), self.window.positions(input.width));
        let depth = self.window.size * self.window.size * self.inputs;
        let mut values = vec![0.0f32; height * width * self.outputs];
        let rows_a_block = BLOCK_PIXELS.div_ceil(width.max(1));
        let block = (rows_a_block * width * self.outputs).max(1);
        values.par_chunks_mut(block).enumerate().for_each_init(Vec::new, |unrolled, (index, out)| {
            let pixels = out.len() / self.outputs;
            let first = index * rows_a_block;
            self.unroll(input, first..first + pixels / width, width, unrolled);
            for pixel in out.chunks_exact_mut(self.outputs) {
                pixel.copy_from_slice(&self.bias);
            }
            let unrolled = Matrix::new(unrolled, pixels, depth, depth);
            let weights = Matrix::new(&self.weights, depth, self.outputs, self.outputs);
            multiply(out, self.outputs, unrolled, weights, true);
            for value in out {
                *value = value.max(0.0);
            }
        });
        Map { height, width, channels: self.outputs, values }
    }

    /// One row of `unrolled` a pixel: everything that its window sees, zeros outside the map.
    fn unroll(&self, input: &Map, rows: std::ops::Range<usize>, width: usize, unrolled: &mut Vec<f32>) {
        let Window { size, stride, padding } = self.window;
        let channels = self.inputs;
        unrolled.clear();
        for y in rows {
            for x in 0..width {
                // Columns of the window that lie inside the map; they are the same for all its rows.
                let left = (x * stride) as isize - padding as isize;
                let skip = (-left).clamp(0, size as isize) as usize;
                let end = (input.width as isize - left).clamp(skip as isize, size as isize) as usize;
                for dy in 0..size {
                    let source = (y * stride + dy).wrapping_sub(padding);
                    if source >= input.height {
                        unrolled.resize(unrolled.len() + size * channels, 0.0);
                        continue;
                    }
                    unrolled.resize(unrolled.len() + skip * channels, 0.0);
                    let start = (source * input.width).wrapping_add_signed(left + skip as isize) * channels;
                    unrolled.extend_from_slice(&input.values[start..start + (end - skip) * channels]);
                    unrolled.resize(unrolled.len() + (size - end) * channels, 0.0);
                }
            }
        }
    }
}

/// The largest value of each channel in each window, without padding.
pub(super) fn max_pool(input: &Map, window: Window) -> Map {
    let (height, width, channels) = (window.positions(input.height), window.positions(input.width), input.channels);
    let mut values = vec![f32::NEG_INFINITY; height * width * channels];
    let row = (width * channels).max(1);
    values.par_chunks_mut(row).enumerate().for_each(|(y, out)| {
        for (x, out) in out.chunks_exact_mut(channels).enumerate() {
            for dy in 0..window.size {
                for dx in 0..window.size {
                    let source = (y * window.stride + dy) * input.width + x * window.stride + dx;
                    for (out, &value) in out.iter_mut().zip(&input.values[source * channels..][..channels]) {
                        *out = out.max(value);
                    }
                }
            }
        }
    });
    Map { height, width, channels, values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::testing::noise;

    /// The definition of a convolution, in f64.
    fn plain(input: &Map, window: Window, weights: &[f32], bias: &[f32]) -> Vec<f64> {
        let (height, width) = (window.positions(input.height), window.positions(input.width));
        let mut values = Vec::new();
        for y in 0..height {
            for x in 0..width {
                for (output, &bias) in bias.iter().enumerate() {
                    let mut sum = f64::from(bias);
                    for c in 0..input.channels {
                        for dy in 0..window.size {
                            for dx in 0..window.size {
                                let (sy, sx) = (y * window.stride + dy, x * window.stride + dx);
                                if sy < window.padding || sx < window.padding {
                                    continue;
                                }
                                let (sy, sx) = (sy - window.padding, sx - window.padding);
                                if sy < input.height && sx < input.width {
                                    let w = ((output * input.channels + c) * window.size + dy) * window.size + dx;
                                    let v = (sy * input.width + sx) * input.channels + c;
                                    sum += f64::from(weights[w]) * f64::from(input.values[v]);
                                }
                            }
                        }
                    }
                    values.push(sum.max(0.0));
                }
            }
        }
        values
    }

    #[test]
    fn convolution_is_its_definition_for_every_window_of_the_networks() {
        let windows =
            [(11, 4, 2), (5, 1, 2), (3, 1, 1)].map(|(size, stride, padding)| Window { size, stride, padding });
        for window in windows {
            for (height, width) in [(7, 9), (23, 40), (9, 7)] {
                let (channels, outputs) = (3, 5);
                let input = Map { height, width, channels, values: noise(1, height * width * channels) };
                let weights = noise(2, outputs * channels * window.size * window.size)
                    .iter()
                    .map(|w| w - 0.5)
                    .collect::<Vec<_>>();
                let bias = noise(3, outputs);
                let expected = plain(&input, window, &weights, &bias);
                let got = Convolution::new(window, channels, outputs, &weights, bias).apply(&input);
                assert_eq!(got.values.len(), expected.len());
                for (got, expected) in got.values.iter().zip(&expected) {
                    assert!((f64::from(*got) - expected).abs() < 1e-4, "{window:?} {got} {expected}");
                }
            }
        }
    }

    #[test]
    fn bands_do_not_change_a_convolution() {
        // Wide enough for several blocks.
        let window = Window { size: 3, stride: 1, padding: 1 };
        let input = Map { height: 40, width: 300, channels: 16, values: noise(1, 40 * 300 * 16) };
        let weights = noise(2, 4 * 16 * 9);
        let expected = plain(&input, window, &weights, &[0.0; 4]);
        let got = Convolution::new(window, 16, 4, &weights, vec![0.0; 4]).apply(&input);
        for (got, expected) in got.values.iter().zip(&expected) {
            assert!((f64::from(*got) - expected).abs() < 1e-3, "{got} {expected}");
        }
    }

    #[test]
    fn pooling_takes_the_largest_and_drops_what_no_full_window_covers() {
        let values = (0..5 * 4).map(|value| value as f32).collect();
        let input = Map { height: 4, width: 5, channels: 1, values };
        let pooled = max_pool(&input, Window { size: 2, stride: 2, padding: 0 });
        assert_eq!((pooled.height, pooled.width, pooled.values), (2, 2, vec![6.0, 8.0, 16.0, 18.0]));
    }
}
