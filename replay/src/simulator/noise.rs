//! What is random at a pixel.

use std::sync::LazyLock;

use erfgs_base::random;

use super::SimulatorConfig;

const THRESHOLD: u64 = random::purpose("simulator threshold");
const LEAK: u64 = random::purpose("simulator leak");
const HOT: u64 = random::purpose("simulator hot");
const FRAME: u64 = random::purpose("simulator frame");

/// Shot noise at full brightness, as a fraction of that in the dark (v2e's `SHOT_NOISE_INTEN_FACTOR`).
pub(super) const SHOT_AT_WHITE: f32 = 0.25;

/// Drawn thresholds are at least this (v2e).
const SMALLEST_DRAWN: f64 = 0.01;

/// The random numbers of one camera.
#[derive(Clone, Copy)]
pub(super) struct Noise {
    key: u64,
}

impl Noise {
    pub(super) fn new(seed: u64, camera_key: u64) -> Self {
        Self { key: random::key(seed, &[camera_key]) }
    }

    /// The contrast thresholds (ON, OFF) of the pixel with this index in the image.
    pub(super) fn thresholds(self, config: &SimulatorConfig, pixel: u64) -> (f32, f32) {
        if config.sigma == 0.0 {
            return (config.threshold_on as f32, config.threshold_off as f32);
        }
        // Both normals of a Box-Muller pair.
        let key = random::key(self.key, &[THRESHOLD, pixel]);
        let radius = (2.0 * random::exponential(key)).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * random::uniform(random::extend(key, 0))).sin_cos();
        let drawn = |nominal: f64, normal: f64| (nominal + config.sigma * normal).max(SMALLEST_DRAWN) as f32;
        (drawn(config.threshold_on, radius * cos), drawn(config.threshold_off, radius * sin))
    }

    /// The pixel's leak rate over the mean one.
    pub(super) fn leak_factor(self, config: &SimulatorConfig, pixel: u64) -> f32 {
        10f64.powf(config.leak_cov_decades * random::normal(random::key(self.key, &[LEAK, pixel]))) as f32
    }

    /// The rate of noise events (both polarities, Hz) that the pixel makes beyond shot noise.
    pub(super) fn hot_hz(self, config: &SimulatorConfig, pixel: u64) -> f32 {
        let hot = random::uniform(random::key(self.key, &[HOT, pixel])) < config.hot_fraction;
        if hot { config.hot_hz as f32 } else { 0.0 }
    }

    /// The key of a frame, for [`bits`].
    pub(super) fn frame(self, frame: u64) -> u64 {
        random::key(self.key, &[FRAME, frame])
    }
}

/// The random bits of some pixels, from the one with the index `first` in the image on, for the interval before the frame
/// with this key: the splitmix64 stream that starts at the key.
pub(super) fn bits(frame_key: u64, first: u64, out: &mut [u64]) {
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let mut state = frame_key.wrapping_add(GOLDEN.wrapping_mul(first));
    for bits in out {
        state = state.wrapping_add(GOLDEN);
        *bits = random::mix(state);
    }
}

/// A pixel's uniform number for an interval, from the upper bits.
#[inline]
pub(super) fn uniform(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// The same from the 24 uppermost bits alone, as many as an `f32` near 1 tells apart.
#[inline]
pub(super) fn uniform24(bits: u64) -> f32 {
    ((bits >> 40) as i32) as f32 * (1.0 / (1 << 24) as f32)
}

const TABLE: usize = 2048;

/// A quick normal number from the lowest 11 bits, which [`uniform`] leaves alone: a draw from 2048 equally likely values
/// of mean 0 and variance 1. Good enough for the jitter of a leak.
#[derive(Clone, Copy)]
pub(super) struct QuickNormal(&'static [f32; TABLE]);

impl QuickNormal {
    pub(super) fn new() -> Self {
        static VALUES: LazyLock<[f32; TABLE]> = LazyLock::new(|| {
            // The Box-Muller radius and angle at the points of a 2D low-discrepancy set (the R2 sequence), made
            // symmetric, then scaled to unit variance.
            const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];
            let mut values: [f64; TABLE] = std::array::from_fn(|index| {
                let point = STEPS.map(|step| ((index / 2) as f64 + 0.5) * step % 1.0);
                let radius = (-2.0 * (1.0 - point[0]).ln()).sqrt();
                let value = radius * (std::f64::consts::TAU * point[1]).cos();
                if index % 2 == 0 { value } else { -value }
            });
            let variance = values.iter().map(|value| value * value).sum::<f64>() / TABLE as f64;
            values.iter_mut().for_each(|value| *value /= variance.sqrt());
            values.map(|value| value as f32)
        });
        Self(&VALUES)
    }

    #[inline]
    pub(super) fn get(self, bits: u64) -> f32 {
        self.0[bits as usize % TABLE]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quick_normals_have_the_moments_of_a_normal() {
        let normal = QuickNormal::new();
        let moment =
            |power| (0..TABLE as u64).map(|bits| f64::from(normal.get(bits)).powi(power)).sum::<f64>() / 2048.0;
        assert!(moment(1).abs() < 1e-6 && (moment(2) - 1.0).abs() < 1e-6);
        assert!((moment(4) - 3.0).abs() < 0.15, "{}", moment(4));
    }

    #[test]
    fn drawn_thresholds_spread_as_told_and_never_come_near_zero() {
        let config = SimulatorConfig { threshold_off: 0.1, sigma: 0.05, ..SimulatorConfig::default() };
        let noise = Noise::new(3, 4);
        let drawn: Vec<_> = (0..20_000).map(|pixel| noise.thresholds(&config, pixel)).collect();
        let mean = drawn.iter().map(|(on, _)| f64::from(*on)).sum::<f64>() / drawn.len() as f64;
        let variance = drawn.iter().map(|(on, _)| (f64::from(*on) - mean).powi(2)).sum::<f64>() / drawn.len() as f64;
        assert!((mean - 0.2).abs() < 0.002 && (variance.sqrt() - 0.05).abs() < 0.002, "{mean} {variance}");
        assert!(drawn.iter().all(|(on, off)| *on >= 0.01 && *off >= 0.01));
        assert!(drawn.iter().any(|(_, off)| *off == 0.01), "some are clamped");
    }
}
