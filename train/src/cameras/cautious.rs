//! Adam on the host for the few numbers of a camera, of which a mean gradient may be chance.

use erfgs_splat::optimiser::AdamConfig;

/// A camera takes some hundred steps.
const ADAM: AdamConfig = AdamConfig { beta1: 0.9, beta2: 0.99, epsilon: 1e-15 };
/// A mean gradient of less than so many of its root mean squares may be chance.
const CHANCE: f64 = 0.3;

/// By how many learning rates a number falls in step `step` (the first is 1), given its gradient; `moments` are those of its gradients, and
/// take this one in.
pub(super) fn cautious_step(step: u32, moments: [&mut f32; 2], gradient: f64) -> f64 {
    let corrections = ADAM.bias_corrections(step);
    let (first, second) = (f64::from(corrections.0), f64::from(corrections.1));
    let (beta1, beta2) = (f64::from(ADAM.beta1), f64::from(ADAM.beta2));
    let [kept_m, kept_v] = moments;
    let m = beta1 * f64::from(*kept_m) + (1.0 - beta1) * gradient;
    let v = beta2 * f64::from(*kept_v) + (1.0 - beta2) * gradient * gradient;
    (*kept_m, *kept_v) = (m as f32, v as f32);
    let sure = first * m / (v.sqrt() * second + f64::from(ADAM.epsilon));
    sure.signum() * (sure.abs() - CHANCE).max(0.0)
}
