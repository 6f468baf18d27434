//! Adam on the host, dense, with the gradients zeroed on the way.

use rayon::prelude::*;

use crate::optimiser::AdamConfig;

/// Values a task handles.
const CHUNK: usize = 1 << 14;

/// Number of values that are NaN or infinite.
pub fn not_finite(values: &[f32]) -> u64 {
    values
        .par_chunks(CHUNK)
        .map(|chunk| chunk.iter().map(|value| u32::from(value.to_bits() & 0x7f80_0000 == 0x7f80_0000)).sum::<u32>())
        .map(u64::from)
        .sum()
}

/// One step over slices of one length; `step` counts from 1.
pub fn step(
    parameters: &mut [f32],
    gradients: &mut [f32],
    [first, second]: [&mut [f32]; 2],
    rate: f32,
    config: &AdamConfig,
    step: u32,
) {
    let (rate_scale, root_scale) = config.bias_corrections(step);
    let AdamConfig { beta1, beta2, epsilon } = *config;
    let (left1, left2, rate) = (1.0 - beta1, 1.0 - beta2, rate * rate_scale);
    parameters
        .par_chunks_mut(CHUNK)
        .zip(gradients.par_chunks_mut(CHUNK))
        .zip(first.par_chunks_mut(CHUNK).zip(second.par_chunks_mut(CHUNK)))
        .for_each(|((parameters, gradients), (first, second))| {
            let values = parameters.iter_mut().zip(gradients).zip(first.iter_mut().zip(second));
            for ((parameter, gradient), (first, second)) in values {
                let m = beta1 * *first + left1 * *gradient;
                let v = beta2 * *second + left2 * *gradient * *gradient;
                *first = m;
                *second = v;
                *gradient = 0.0;
                *parameter -= rate * m / (v.sqrt() * root_scale + epsilon);
            }
        });
}
