//! The parameters of the event simulator.

use erfgs_base::{
    plausible::{REFRACTORY, THRESHOLD},
    random,
};
use serde::{Deserialize, Serialize};

use super::SimulatorError;

/// Which pixel model runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// What v2e's code does, its peculiarities included: one global time grid for each frame interval, times in `f32`
    /// seconds, a forward Euler low-pass clamped to one, at most one shot noise event a pixel and frame, all of them
    /// stamped with the frame's time.
    #[default]
    Parity,
    /// The same pixel with what frames allow to do better: an exact exponential low-pass, the time at which each pixel's
    /// linearly interpolated signal crosses its threshold, thresholds redrawn for each event, a reset at the end of the
    /// refractory period, noise as a Poisson process with uniform times, hot pixels.
    Enhanced,
}

/// The parameters of the event simulator. The names of the presets are v2e's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SimulatorConfig {
    /// Which pixel model runs.
    pub mode: Mode,
    /// Nominal contrast threshold of ON events, natural-log intensity.
    pub threshold_on: f64,
    /// Nominal contrast threshold of OFF events, natural-log intensity.
    pub threshold_off: f64,
    /// Standard deviation of the thresholds from pixel to pixel, drawn once, natural-log intensity. Drawn thresholds are
    /// at least 0.01.
    pub sigma: f64,
    /// Corner frequency of the photoreceptor at full brightness, Hz (v2e: bandwidth proportional to intensity, a darkest
    /// pixel 13.75 times slower); 0 switches the low-pass off.
    pub cutoff_hz: f64,
    /// Mean rate of ON events that the leak of the reset switch makes at each pixel, Hz.
    pub leak_hz: f64,
    /// Standard deviation of the leak from interval to interval, as a fraction.
    pub leak_jitter: f64,
    /// Standard deviation of the leak from pixel to pixel, decades (log-normal, drawn once).
    pub leak_cov_decades: f64,
    /// Rate of shot noise events of both polarities at a black pixel, Hz; it falls to a quarter at a white one.
    pub shot_hz: f64,
    /// Time after an event in which a pixel makes no other, seconds.
    pub refractory_s: f64,
    /// Standard deviation of the threshold from event to event, natural-log intensity. `enhanced` alone.
    pub event_sigma: f64,
    /// Fraction of pixels that are hot. `enhanced` alone.
    pub hot_fraction: f64,
    /// Rate of noise events of both polarities at a hot pixel, Hz. `enhanced` alone.
    pub hot_hz: f64,
    /// Whether the input is linearised (sRGB to linear light) before the logarithm. `enhanced` alone.
    pub linear_light: bool,
    /// The seed of everything random.
    pub seed: u64,
}

impl Default for SimulatorConfig {
    /// Parity, thresholds 0.2, nothing random.
    fn default() -> Self {
        Self {
            mode: Mode::Parity,
            threshold_on: 0.2,
            threshold_off: 0.2,
            sigma: 0.0,
            cutoff_hz: 0.0,
            leak_hz: 0.0,
            leak_jitter: 0.0,
            leak_cov_decades: 0.0,
            shot_hz: 0.0,
            refractory_s: 0.0,
            event_sigma: 0.0,
            hot_fraction: 0.0,
            hot_hz: 0.0,
            linear_light: false,
            seed: 0,
        }
    }
}

impl SimulatorConfig {
    /// Below this grey level (of 255) the logarithm is replaced by a line through the origin: v2e's `lin_log`.
    pub const LIN_LOG_THRESHOLD: f64 = 20.0;

    /// The smallest contrast threshold accepted.
    pub const SMALLEST_THRESHOLD: f64 = 0.001;

    /// The names that [`Self::preset`] knows.
    pub const PRESETS: [&str; 3] = ["noiseless", "clean", "noisy"];

    /// The preset called `name`: `noiseless` (the default), v2e's `clean` (thresholds vary) or v2e's `noisy` (low-pass at
    /// 30 Hz, leak and shot noise).
    #[must_use]
    pub fn preset(name: &str) -> Option<Self> {
        let noiseless = Self::default();
        match name {
            "noiseless" => Some(noiseless),
            "clean" => Some(Self { sigma: 0.02, ..noiseless }),
            "noisy" => Some(Self {
                sigma: 0.05,
                cutoff_hz: 30.0,
                leak_hz: 0.1,
                leak_jitter: 0.1,
                leak_cov_decades: 0.1,
                shot_hz: 5.0,
                ..noiseless
            }),
            _ => None,
        }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is not finite, out of its range, or unknown to the mode.
    pub fn validate(&self) -> Result<(), SimulatorError> {
        let range = |name, value: f64, from: f64, to: f64| {
            let inside = (from..=to).contains(&value);
            if inside { Ok(()) } else { Err(SimulatorError::OutOfRange { name, value, from, to }) }
        };
        range("threshold_on", self.threshold_on, Self::SMALLEST_THRESHOLD, THRESHOLD.most)?;
        range("threshold_off", self.threshold_off, Self::SMALLEST_THRESHOLD, THRESHOLD.most)?;
        range("sigma", self.sigma, 0.0, 100.0)?;
        range("cutoff_hz", self.cutoff_hz, 0.0, 1e12)?;
        range("leak_hz", self.leak_hz, 0.0, 1e4)?;
        range("leak_jitter", self.leak_jitter, 0.0, 10.0)?;
        range("leak_cov_decades", self.leak_cov_decades, 0.0, 1.0)?;
        range("shot_hz", self.shot_hz, 0.0, 1e4)?;
        range("refractory_s", self.refractory_s, REFRACTORY.least, REFRACTORY.most)?;
        range("event_sigma", self.event_sigma, 0.0, 100.0)?;
        range("hot_fraction", self.hot_fraction, 0.0, 1.0)?;
        range("hot_hz", self.hot_hz, 0.0, 1e4)?;
        if self.mode == Mode::Parity {
            let only_enhanced = [
                ("event_sigma", self.event_sigma != 0.0),
                ("hot_fraction", self.hot_fraction != 0.0),
                ("hot_hz", self.hot_hz != 0.0),
                ("linear_light", self.linear_light),
            ];
            if let Some((name, _)) = only_enhanced.into_iter().find(|(_, given)| *given) {
                return Err(SimulatorError::OnlyEnhanced { name });
            }
        }
        Ok(())
    }
}

/// The key of the camera called `name`, for [`super::Simulator::new`]: two cameras never share random numbers, and a
/// camera keeps its own when others are added.
#[must_use]
pub const fn camera_key(name: &str) -> u64 {
    random::purpose(name)
}
