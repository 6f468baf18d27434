//! v2e's pixel, as its code computes it (SensorsINI/v2e, `v2ecore/emulator.py` and `emulator_utils.py` at cac6384).
//!
//! What a reader may take for mistakes is v2e's, and kept:
//! - All pixels of an interval share one time grid, of as many steps as the busiest pixel has events. A pixel with one
//!   event fires at the first step, early in the interval, whenever another pixel has many.
//! - Times are `f32` seconds since the first frame: 0.95 µs apart at 10 s, 244 µs at an hour.
//! - The low-pass is a forward Euler step clamped to one: at 30 frames a second a corner at 300 Hz does nothing.
//! - An event dropped in the refractory period does not move the reference; its contrast is tried again.
//! - The refractory period is ignored where it is not longer than a step of the grid.
//! - A pixel makes at most one shot noise event an interval, at its end, refractory or not; the rate falls with
//!   brightness, so that the mean rate is below the one asked for.
//! - The state is `f32` without the low-pass and `f64` with it, while events move the reference by `f32` multiples of
//!   the threshold.

use std::ops::{Add, Mul, Neg, Sub};

use erfgs_events::Events;
use rayon::prelude::*;

use super::{
    CHUNK, Interval, Luma, SimulatorConfig, SimulatorError,
    collect::{self, Raw},
    lin_log::Response,
    noise::{self, Noise, QuickNormal, SHOT_AT_WHITE},
};

/// `f32` or `f64`.
pub(super) trait Real:
    Copy
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
    + Into<f64>
    + From<f32>
{
    /// The nearest number of this type.
    fn of(value: f64) -> Self;
}

impl Real for f32 {
    fn of(value: f64) -> Self {
        value as f32
    }
}

impl Real for f64 {
    fn of(value: f64) -> Self {
        value
    }
}

/// A pixel that crossed its threshold or made shot noise in the interval.
struct Candidate<T> {
    /// Index in the block.
    pixel: u32,
    /// Events by contrast: ON above zero, OFF below.
    signal: i32,
    shot_on: bool,
    shot_off: bool,
    /// The photoreceptor's output at the end of the interval.
    output: T,
}

/// Contrast thresholds: the same everywhere, or one for each pixel.
enum Thresholds<T> {
    Same(T, T),
    Each(Vec<T>, Vec<T>),
}

impl<T: Real> Thresholds<T> {
    fn get(&self, pixel: usize) -> (T, T) {
        match self {
            Self::Same(on, off) => (*on, *off),
            Self::Each(on, off) => (on[pixel], off[pixel]),
        }
    }
}

/// Some rows of the sensor.
struct Block<T> {
    first_row: usize,
    /// Global index of the first pixel.
    first_pixel: u64,
    /// The reference that the pixel compares with.
    base: Vec<T>,
    /// The low-pass; empty where it is off.
    low_passed: Vec<T>,
    thresholds: Thresholds<T>,
    /// Mean fall of the reference by leakage, natural-log intensity a second; empty where there is no leak.
    leak: Vec<f32>,
    /// Nominal over own thresholds, ON and OFF; empty where there is no shot noise.
    shot_ratio: [Vec<f32>; 2],
    /// Time of the last event that the refractory period looked at, `f32` seconds; empty where there is none.
    last_event: Vec<f32>,
    candidates: Vec<Candidate<T>>,
    raws: Vec<Raw>,
}

/// The sensor.
pub(super) struct Parity<T> {
    config: SimulatorConfig,
    width: usize,
    blocks: Vec<Block<T>>,
    noise: Noise,
    quick_normal: QuickNormal,
    response: Response,
    scratch: Vec<u32>,
}

impl<T: Real> Parity<T> {
    pub(super) fn new(width: usize, height: usize, config: &SimulatorConfig, noise: Noise) -> Self {
        let blocks = super::blocks(width, height)
            .map(|rows| {
                let pixels = rows.start * width..rows.end * width;
                let indices = || pixels.clone().map(|pixel| pixel as u64);
                let thresholds = if config.sigma == 0.0 {
                    Thresholds::Same(T::of(config.threshold_on), T::of(config.threshold_off))
                } else {
                    let (on, off) = indices()
                        .map(|pixel| noise.thresholds(config, pixel))
                        .map(|(on, off)| (T::from(on), T::from(off)))
                        .unzip();
                    Thresholds::Each(on, off)
                };
                let some = |wanted: bool| if wanted { pixels.len() } else { 0 };
                let own = |pixel: usize| {
                    let (on, off) = thresholds.get(pixel);
                    [on, off].map(|threshold| threshold.into() as f32)
                };
                let leak = indices()
                    .take(some(config.leak_hz > 0.0))
                    .enumerate()
                    .map(|(index, pixel)| config.leak_hz as f32 * noise.leak_factor(config, pixel) * own(index)[0])
                    .collect();
                let nominal = [config.threshold_on as f32, config.threshold_off as f32];
                let shot_ratio = [0, 1].map(|polarity| {
                    (0..some(config.shot_hz > 0.0)).map(|pixel| nominal[polarity] / own(pixel)[polarity]).collect()
                });
                Block {
                    first_row: rows.start,
                    first_pixel: pixels.start as u64,
                    base: vec![T::default(); pixels.len()],
                    low_passed: vec![T::default(); some(config.cutoff_hz > 0.0)],
                    thresholds,
                    leak,
                    shot_ratio,
                    last_event: vec![-config.refractory_s as f32; some(config.refractory_s > 0.0)],
                    candidates: Vec::new(),
                    raws: Vec::new(),
                }
            })
            .collect();
        Self {
            config: config.clone(),
            width,
            blocks,
            noise,
            quick_normal: QuickNormal::new(),
            response: Response::new(false),
            scratch: Vec::new(),
        }
    }

    pub(super) fn first(&mut self, luma: Luma<'_>) {
        let response = &self.response;
        self.blocks.par_iter_mut().for_each(|block| {
            let mut log = vec![0.0; block.base.len()];
            response.log(luma, block.first_pixel as usize, &mut log);
            block.base.iter_mut().zip(&log).for_each(|(base, &log)| *base = T::from(log));
            if !block.low_passed.is_empty() {
                block.low_passed.copy_from_slice(&block.base);
            }
        });
    }

    pub(super) fn step(&mut self, luma: Luma<'_>, interval: &Interval, out: &mut Events) -> Result<(), SimulatorError> {
        let Self { config, width, blocks, noise, quick_normal, response, scratch } = self;
        let scan = Scan {
            config,
            response,
            quick_normal: *quick_normal,
            frame_key: noise.frame(interval.frame),
            delta_s: interval.delta_s(),
        };
        let (most, total) = blocks
            .par_iter_mut()
            .map(|block| scan.block(block, luma))
            .reduce(|| (0, 0), |a: (u32, u64), b| (a.0.max(b.0), a.1 + b.1));
        interval.check_count(total)?;

        let times = TimeGrid::new(interval, most.max(1));
        let refractory = config.refractory_s > times.step_s;
        blocks.par_iter_mut().for_each(|block| block.emit(*width, &times, refractory, config.refractory_s as f32));
        collect::append(
            blocks.iter().map(|block| block.raws.as_slice()),
            |key| times.distinct_us[key as usize],
            out,
            scratch,
        );
        Ok(())
    }
}

/// The times at which events of an interval may lie.
struct TimeGrid {
    /// The step, seconds.
    step_s: f64,
    /// Step k (from 0): `f32` seconds since the first frame.
    seconds: Vec<f32>,
    /// Step k: index into `distinct_us`.
    keys: Vec<u32>,
    /// Microseconds on the session clock, increasing.
    distinct_us: Vec<i64>,
}

impl TimeGrid {
    /// `torch.linspace(previous + step, now, steps, dtype=float32)`.
    fn new(interval: &Interval, steps: u32) -> Self {
        let step_s = interval.delta_s() / f64::from(steps);
        let seconds = linspace((interval.previous_s() + step_s) as f32, interval.now_s() as f32, steps);
        let (mut keys, mut distinct_us) = (Vec::with_capacity(seconds.len()), Vec::<i64>::new());
        for &t in &seconds {
            let t_us = interval.us_of_seconds(f64::from(t));
            if distinct_us.last().is_none_or(|&last| t_us > last) {
                distinct_us.push(t_us);
            }
            keys.push(distinct_us.len() as u32 - 1);
        }
        Self { step_s, seconds, keys, distinct_us }
    }
}

/// `torch.linspace(start, end, steps, dtype=float32)` to the last bit: torch counts from the start in the first half and
/// from the end in the second, in whole pairs of eight-lane vectors it adds multiples of the step to the first lane, and
/// every product is fused with its sum.
fn linspace(start: f32, end: f32, steps: u32) -> Vec<f32> {
    const LANES: u32 = 8;
    if steps == 1 {
        return vec![start];
    }
    let step = (end - start) / (steps - 1) as f32;
    let vectorised = steps - steps % (2 * LANES);
    (0..steps)
        .map(|k| {
            let lane = if k < vectorised { k % LANES } else { 0 };
            let first = k - lane;
            let base = if first < steps / 2 {
                step.mul_add(first as f32, start)
            } else {
                (-step).mul_add((steps - first - 1) as f32, end)
            };
            step.mul_add(lane as f32, base)
        })
        .collect()
}

/// The first pass: every pixel's signal, and the pixels that make events.
struct Scan<'a> {
    config: &'a SimulatorConfig,
    response: &'a Response,
    quick_normal: QuickNormal,
    frame_key: u64,
    delta_s: f64,
}

impl Scan<'_> {
    /// The events of the busiest pixel by contrast, and an upper bound of the number of events.
    fn block<T: Real>(&self, block: &mut Block<T>, luma: Luma<'_>) -> (u32, u64) {
        let config = self.config;
        let (low_pass, leaky, shot) = (config.cutoff_hz > 0.0, config.leak_hz > 0.0, config.shot_hz > 0.0);
        let bandwidth = self.delta_s * std::f64::consts::TAU * config.cutoff_hz;
        let (mut log, mut intensity, mut bits, mut drawn) = ([0.0; CHUNK], [0.0; CHUNK], [0; CHUNK], [0.0; CHUNK]);
        let mut output = [T::default(); CHUNK];
        let (mut flags, mut shot_on, mut shot_off) = ([false; CHUNK], [false; CHUNK], [false; CHUNK]);
        let (mut most, mut total) = (0, 0);
        block.candidates.clear();
        for start in (0..block.base.len()).step_by(CHUNK) {
            let len = CHUNK.min(block.base.len() - start);
            let range = start..start + len;
            let first = block.first_pixel as usize + start;
            self.response.log(luma, first, &mut log[..len]);
            if low_pass || shot {
                self.response.intensity(luma, first, &mut intensity[..len]);
            }
            if leaky || shot {
                noise::bits(self.frame_key, first as u64, &mut bits[..len]);
            }
            if low_pass {
                for ((state, out), (&log, &intensity)) in
                    block.low_passed[range.clone()].iter_mut().zip(&mut output).zip(log.iter().zip(&intensity))
                {
                    let eps = (intensity * bandwidth).min(1.0);
                    *state = T::of(1.0 - eps) * *state + T::of(eps) * T::from(log);
                    *out = *state;
                }
            } else {
                output.iter_mut().zip(&log).for_each(|(output, &log)| *output = T::from(log));
            }
            if leaky {
                let (delta_s, jitter) = (self.delta_s as f32, config.leak_jitter as f32);
                // Looking numbers up is not what vector units do: apart from the rest, which is.
                drawn.iter_mut().zip(&bits[..len]).for_each(|(drawn, &bits)| *drawn = self.quick_normal.get(bits));
                for ((base, &leak), &normal) in
                    block.base[range.clone()].iter_mut().zip(&block.leak[range.clone()]).zip(&drawn)
                {
                    *base = *base - T::from(delta_s * leak * (1.0 - jitter * normal));
                }
            }
            let base = &block.base[range.clone()];
            match &block.thresholds {
                Thresholds::Same(on, off) => crosses(&output, base, |_| *on, |_| *off, &mut flags),
                Thresholds::Each(on, off) => {
                    let (on, off) = (&on[range.clone()], &off[range.clone()]);
                    crosses(&output, base, |index| on[index], |index| off[index], &mut flags);
                }
            }
            if shot {
                let half = (config.shot_hz / 2.0 * self.delta_s) as f32;
                drawn.iter_mut().zip(&bits[..len]).for_each(|(drawn, &bits)| *drawn = noise::uniform24(bits));
                let [on, off] = block.shot_ratio.each_ref().map(|ratio| &ratio[range.clone()]);
                let made = shot_on.iter_mut().zip(&mut shot_off).zip(&mut flags);
                for (((made, intensity), draw), (on, off)) in made.zip(&intensity).zip(&drawn).zip(on.iter().zip(off)) {
                    let half = half * ((SHOT_AT_WHITE - 1.0) * *intensity as f32 + 1.0);
                    let ((shot_on, shot_off), flag) = made;
                    *shot_on = *draw > 1.0 - half * on;
                    *shot_off = *draw < half * off;
                    *flag |= *shot_on | *shot_off;
                }
            }
            for index in super::set(&flags[..len]) {
                let difference = output[index] - base[index];
                let (on, off) = block.thresholds.get(start + index);
                let signal = if difference >= on {
                    floor_quotient(difference.into(), on.into()) as i32
                } else if -difference >= off {
                    -(floor_quotient((-difference).into(), off.into()) as i32)
                } else {
                    0
                };
                let (shot_on, shot_off) = (shot_on[index], shot_off[index]);
                most = most.max(signal.unsigned_abs());
                total += u64::from(signal.unsigned_abs()) + u64::from(shot_on) + u64::from(shot_off);
                let pixel = (start + index) as u32;
                block.candidates.push(Candidate { pixel, signal, shot_on, shot_off, output: output[index] });
            }
        }
        (most, total)
    }
}

/// Flags the pixels whose difference from their reference reaches a threshold.
#[inline]
fn crosses<T: Real>(
    output: &[T; CHUNK],
    base: &[T],
    on: impl Fn(usize) -> T,
    off: impl Fn(usize) -> T,
    flags: &mut [bool; CHUNK],
) {
    for (index, ((&output, &base), flag)) in output.iter().zip(base).zip(flags).enumerate() {
        let difference = output - base;
        *flag = (difference >= on(index)) | (-difference >= off(index));
    }
}

/// The largest integer not above the exact quotient of `a` and `b`, both positive.
fn floor_quotient(a: f64, b: f64) -> f64 {
    let quotient = a / b;
    let floor = quotient.floor();
    if (1e-9..1.0 - 1e-9).contains(&(quotient - floor)) {
        return floor;
    }
    // The division may have been rounded up to an integer. The remainder of `%` is exact.
    ((a - a % b) / b).round()
}

impl<T: Real> Block<T> {
    /// The second pass: the events of the candidates, and their new references.
    fn emit(&mut self, width: usize, times: &TimeGrid, refractory: bool, period_s: f32) {
        self.raws.clear();
        let last_key = times.keys.last().copied().unwrap_or(0);
        for candidate in &self.candidates {
            let pixel = candidate.pixel as usize;
            let (row, column) = (self.first_row + pixel / width, pixel % width);
            let mut push = |key, on| self.raws.push(Raw { key, y: row as u16, x: column as u16, on });
            let on = candidate.signal > 0;
            let mut fired = 0;
            for (&key, &t) in times.keys.iter().zip(&times.seconds).take(candidate.signal.unsigned_abs() as usize) {
                if refractory {
                    let last = &mut self.last_event[pixel];
                    if t - *last <= period_s {
                        continue;
                    }
                    *last = t;
                }
                fired += 1;
                push(key, on);
            }
            if candidate.shot_on {
                push(last_key, true);
            }
            if candidate.shot_off {
                push(last_key, false);
            }
            let (threshold_on, threshold_off) = self.thresholds.get(pixel);
            let moved = |threshold: T| {
                let threshold: f64 = threshold.into();
                T::from(fired as f32 * threshold as f32)
            };
            let base = &mut self.base[pixel];
            *base = if on { *base + moved(threshold_on) } else { *base - moved(threshold_off) };
            if candidate.shot_on || candidate.shot_off {
                *base = candidate.output;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floor_quotients_are_exact_next_to_integers() {
        let theta = f64::from(0.2_f32);
        for n in 1..200 {
            let product = f64::from(n) * theta;
            assert_eq!(floor_quotient(product, theta), f64::from(n));
            assert_eq!(floor_quotient(product.next_down(), theta), f64::from(n - 1));
            assert_eq!(floor_quotient(product.next_up(), theta), f64::from(n));
        }
        // 0.6 / 0.2 rounds to 3 in f64, but 3 times the double 0.2 is above the double 0.6.
        assert_eq!(floor_quotient(0.6, 0.2), 2.0);
    }
}
