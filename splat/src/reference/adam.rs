//! Adam in double precision.

use crate::optimiser::AdamConfig;

/// One step of Adam over `parameters` and moments, all of one length; column `i % rates.len()` has its own learning
/// rate; `step` counts from 1. The form of PyTorch: `p -= rate / (1 - b1^t) * m / (sqrt(v) / sqrt(1 - b2^t) + epsilon)`.
pub fn step(
    parameters: &mut [f64],
    gradients: &[f64],
    first_moment: &mut [f64],
    second_moment: &mut [f64],
    rates: &[f64],
    config: &AdamConfig,
    step: u32,
) {
    let [beta1, beta2, epsilon] = [config.beta1, config.beta2, config.epsilon].map(f64::from);
    let left1 = 1.0 - beta1.powf(f64::from(step));
    let left2 = 1.0 - beta2.powf(f64::from(step));
    for (i, gradient) in gradients.iter().enumerate() {
        first_moment[i] = beta1 * first_moment[i] + (1.0 - beta1) * gradient;
        second_moment[i] = beta2 * second_moment[i] + (1.0 - beta2) * gradient * gradient;
        let root = (second_moment[i] / left2).sqrt();
        parameters[i] -= rates[i % rates.len()] * first_moment[i] / left1 / (root + epsilon);
    }
}
