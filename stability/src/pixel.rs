//! A pixel of an event sensor in `f64`, from its definition: what the simulator's mode `enhanced` is measured against.
//!
//! Its output is the low-passed logarithm of intensity, straight between frames; where it is a threshold away from its
//! reference there is an event, and the reference follows. After an event the pixel is held for the refractory period, and
//! its reference is the output at the end of that.

use std::f64::consts::TAU;

/// What the pixel is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Contrast threshold, both ways, natural-log intensity.
    pub threshold: f64,
    /// Corner frequency at full brightness, Hz; 0: no low-pass.
    pub cutoff_hz: f64,
    /// Refractory period, seconds.
    pub refractory_s: f64,
}

/// An event of the pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// When, seconds.
    pub time: f64,
    /// Whether it is ON.
    pub on: bool,
    /// How fast the output changes then, natural-log intensity a second.
    pub slope: f64,
}

/// v2e's logarithm of a grey level.
#[must_use]
pub fn log_of(level: f64) -> f64 {
    if level <= 20.0 { level / 20.0 * 20_f64.ln() } else { level.ln() }
}

impl Pixel {
    /// The output at the frames' times, seconds: the exact step response of the first-order low-pass, whose bandwidth is
    /// proportional to v2e's intensity of the later frame.
    #[must_use]
    pub fn output(&self, frames: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let mut output: Vec<(f64, f64)> = Vec::with_capacity(frames.len());
        for &(time, level) in frames {
            let log = log_of(level);
            let value = match output.last() {
                Some(&(before, value)) if self.cutoff_hz > 0.0 => {
                    let passed = (time - before) * TAU * self.cutoff_hz * (level + 20.0) / 275.0;
                    log + (value - log) * (-passed).exp()
                }
                _ => log,
            };
            output.push((time, value));
        }
        output
    }

    /// The events of a pixel that sees these frames (seconds, grey level).
    #[must_use]
    pub fn events(&self, frames: &[(f64, f64)]) -> Vec<Event> {
        let output = self.output(frames);
        let Some(&(start, first)) = output.first() else { return Vec::new() };
        let (mut reference, mut ready) = (first, start);
        let mut waiting = false;
        let mut events = Vec::new();
        for pair in output.windows(2) {
            let [(from, low), (to, high)] = [pair[0], pair[1]];
            let slope = (high - low) / (to - from);
            let at = |time: f64| low + slope * (time - from);
            loop {
                if waiting {
                    if ready > to {
                        break;
                    }
                    (reference, waiting) = (at(ready), false);
                }
                let rises = slope > 0.0;
                let next = if rises { reference + self.threshold } else { reference - self.threshold };
                let time = if slope == 0.0 { f64::INFINITY } else { from + (next - low) / slope };
                if time > to {
                    break;
                }
                events.push(Event { time: time.max(ready), on: rises, slope });
                if self.refractory_s > 0.0 {
                    (ready, waiting) = (time.max(ready) + self.refractory_s, true);
                } else {
                    (reference, ready) = (next, time);
                }
            }
        }
        events
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_rise_crosses_at_equal_steps_and_is_held_after_each() {
        let frames = [(0.0, 4_f64.exp()), (0.01, 5_f64.exp())];
        let pixel = Pixel { threshold: 0.3, cutoff_hz: 0.0, refractory_s: 0.0 };
        let are_at = |events: &[Event], times: &[f64]| {
            let near = |(event, time): (&Event, &f64)| event.on && (event.time - time).abs() < 1e-12;
            events.len() == times.len() && std::iter::zip(events, times).all(near)
        };
        assert!(are_at(&pixel.events(&frames), &[0.003, 0.006, 0.009]));
        // Held from 3 to 5 ms, it needs 3 ms more.
        assert!(are_at(&Pixel { refractory_s: 0.002, ..pixel }.events(&frames), &[0.003, 0.008]));
    }

    #[test]
    fn the_low_pass_is_the_same_in_one_step_and_in_many() {
        let pixel = Pixel { threshold: 1.0, cutoff_hz: 20.0, refractory_s: 0.0 };
        let once = pixel.output(&[(0.0, 0.0), (0.02, 255.0)]);
        let often: Vec<(f64, f64)> =
            (0..=200).map(|k| (1e-4 * f64::from(k), if k == 0 { 0.0 } else { 255.0 })).collect();
        assert!((once[1].1 - pixel.output(&often)[200].1).abs() < 1e-12);
    }
}
