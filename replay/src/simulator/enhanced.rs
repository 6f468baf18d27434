//! A finer pixel than v2e's, from the same frames.
//!
//! Between two frames the photoreceptor's output u is a straight line in time. With s from 0 (the frame before) to 1
//! (this frame), `u(s) = v0 + (v1 - v0 + leak) s`: `v1` follows the frame through the exact step response of a first-order
//! low-pass, and the leak of the reference is written as a rise of the output. A signal event lies where
//! `u(s) - base` reaches a threshold (as in ESIM); shot noise and hot pixels are Poisson processes. After any event the
//! pixel is held for the refractory period, and its reference is the output at the end of it (as in ICNS's simulator), so
//! that the contrast of that time is lost, as in the real pixel.

use std::sync::atomic::{AtomicU64, Ordering};

use erfgs_base::random;
use erfgs_events::Events;
use rayon::prelude::*;

use super::{
    CHUNK, Interval, Luma, SimulatorConfig, SimulatorError,
    collect::{self, Raw},
    lin_log::Response,
    noise::{self, Noise, QuickNormal, SHOT_AT_WHITE},
    set,
};

/// Some rows of the sensor.
struct Block {
    first_row: usize,
    /// Global index of the first pixel.
    first_pixel: u64,
    /// The photoreceptor's output at the frame before.
    output: Vec<f32>,
    /// The reference that the pixel compares with.
    base: Vec<f32>,
    /// The pixel's thresholds.
    own: Vec<[f32; 2]>,
    /// The thresholds of the pixel's next event, ON and OFF: its own, or redrawn around them.
    next_on: Vec<f32>,
    next_off: Vec<f32>,
    /// Mean fall of the reference by leakage, natural-log intensity a second; empty where there is no leak.
    leak: Vec<f32>,
    /// Nominal over own thresholds, ON plus OFF; empty where there is no shot noise.
    shot_ratio: Vec<f32>,
    /// Rate of noise events beyond shot noise, Hz; empty where no pixel is hot.
    hot: Vec<f32>,
    /// When the refractory period ends, nanoseconds since the first frame; empty where there is none.
    ready_ns: Vec<f64>,
    raws: Vec<Raw>,
}

/// The sensor.
pub(super) struct Enhanced {
    config: SimulatorConfig,
    width: usize,
    blocks: Vec<Block>,
    noise: Noise,
    quick_normal: QuickNormal,
    response: Response,
    scratch: Vec<u32>,
}

impl Enhanced {
    pub(super) fn new(width: usize, height: usize, config: &SimulatorConfig, noise: Noise) -> Self {
        let blocks = super::blocks(width, height)
            .map(|rows| {
                let pixels = rows.start * width..rows.end * width;
                let indices = || pixels.clone().map(|pixel| pixel as u64);
                let some = |wanted: bool| if wanted { pixels.len() } else { 0 };
                let own: Vec<[f32; 2]> = indices().map(|pixel| noise.thresholds(config, pixel).into()).collect();
                Block {
                    first_row: rows.start,
                    first_pixel: pixels.start as u64,
                    output: vec![0.0; pixels.len()],
                    base: vec![0.0; pixels.len()],
                    next_on: own.iter().map(|own| own[0]).collect(),
                    next_off: own.iter().map(|own| own[1]).collect(),
                    leak: own
                        .iter()
                        .zip(indices())
                        .take(some(config.leak_hz > 0.0))
                        .map(|(own, pixel)| config.leak_hz as f32 * noise.leak_factor(config, pixel) * own[0])
                        .collect(),
                    shot_ratio: own
                        .iter()
                        .take(some(config.shot_hz > 0.0))
                        .map(|own| config.threshold_on as f32 / own[0] + config.threshold_off as f32 / own[1])
                        .collect(),
                    own,
                    hot: indices()
                        .take(some(config.hot_fraction > 0.0 && config.hot_hz > 0.0))
                        .map(|pixel| noise.hot_hz(config, pixel))
                        .collect(),
                    ready_ns: vec![f64::MIN; some(config.refractory_s > 0.0)],
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
            response: Response::new(config.linear_light),
            scratch: Vec::new(),
        }
    }

    pub(super) fn first(&mut self, luma: Luma<'_>) {
        let response = &self.response;
        self.blocks.par_iter_mut().for_each(|block| {
            response.log(luma, block.first_pixel as usize, &mut block.output);
            block.base.copy_from_slice(&block.output);
        });
    }

    pub(super) fn step(&mut self, luma: Luma<'_>, interval: &Interval, out: &mut Events) -> Result<(), SimulatorError> {
        let Self { config, width, blocks, noise, quick_normal, response, scratch } = self;
        let mut pass = Pass {
            config,
            width: *width,
            response,
            quick_normal: *quick_normal,
            frame_key: noise.frame(interval.frame),
            delta_s: interval.delta_s(),
            delta_ns: (interval.now_ns - interval.previous_ns) as f64,
            previous_ns: (interval.previous_ns - interval.first_ns) as f64,
            rest_ns: interval.previous_ns.rem_euclid(1000) as f64,
            expected: AtomicU64::new(0),
            gains: [0.0; 256],
        };
        pass.gains = response.tabulate(|intensity| pass.gain(intensity));
        blocks.par_iter_mut().for_each(|block| pass.block(block, luma));
        interval.check_count(pass.expected.load(Ordering::Relaxed))?;
        let previous_us = interval.previous_ns.div_euclid(1000);
        let raws = blocks.iter().map(|block| block.raws.as_slice());
        collect::append(raws, |key| previous_us + i64::from(key), out, scratch);
        Ok(())
    }
}

/// What all pixels of an interval share.
struct Pass<'a> {
    config: &'a SimulatorConfig,
    width: usize,
    response: &'a Response,
    quick_normal: QuickNormal,
    frame_key: u64,
    delta_s: f64,
    delta_ns: f64,
    /// The frame before, nanoseconds since the first frame.
    previous_ns: f64,
    /// The frame before, nanoseconds since the last whole microsecond of the session clock.
    rest_ns: f64,
    /// Events that all blocks expect so far, so that what memory cannot hold is given up before it is made.
    expected: AtomicU64,
    /// [`Self::gain`] of each whole grey level.
    gains: [f32; 256],
}

/// A pixel's line through an interval.
struct Line {
    /// Output at the frame before.
    start: f64,
    /// Rise of output and leak over the interval.
    rise: f64,
}

impl Line {
    fn at(&self, s: f64) -> f64 {
        self.start + self.rise * s
    }
}

/// A pixel's noise events in an interval.
struct Arrivals {
    /// The next one; infinite where there is none.
    next: f64,
    /// Mean number of events in the interval.
    mean: f64,
    /// Share of ON events.
    share_on: f64,
    /// Names the next draw.
    key: u64,
}

impl Arrivals {
    fn advance(&mut self) {
        self.key = random::extend(self.key, 0);
        self.next += random::exponential(self.key) / self.mean;
    }
}

/// Shot noise at an intensity over that in the dark.
fn shot_factor(intensity: f32) -> f32 {
    (1.0 + (SHOT_AT_WHITE - 1.0) * intensity).max(0.0)
}

impl Pass<'_> {
    fn block(&self, block: &mut Block, luma: Luma<'_>) {
        let config = self.config;
        let (low_pass, leaky, shot) = (config.cutoff_hz > 0.0, !block.leak.is_empty(), !block.shot_ratio.is_empty());
        let noisy = shot || !block.hot.is_empty();
        let (mut log, mut intensity, mut bits) = ([0.0_f32; CHUNK], [0.0; CHUNK], [0; CHUNK]);
        let (mut gain, mut leak, mut mean) = ([0.0_f32; CHUNK], [0.0_f32; CHUNK], [0.0_f32; CHUNK]);
        let mut flags = [false; CHUNK];
        block.raws.clear();
        for start in (0..block.base.len()).step_by(CHUNK) {
            let len = CHUNK.min(block.base.len() - start);
            let range = start..start + len;
            let first = block.first_pixel as usize + start;
            self.response.log(luma, first, &mut log[..len]);
            if low_pass || shot {
                self.response.intensity(luma, first, &mut intensity[..len]);
            }
            if leaky || noisy || config.event_sigma > 0.0 {
                noise::bits(self.frame_key, first as u64, &mut bits[..len]);
            }
            if low_pass {
                match luma {
                    Luma::U8(levels) => {
                        gain.iter_mut().zip(&levels[first..]).for_each(|(gain, &x)| *gain = self.gains[usize::from(x)]);
                    }
                    Luma::F32(_) => {
                        gain[..len].iter_mut().zip(&intensity).for_each(|(gain, &x)| *gain = self.gain(x));
                    }
                }
                for ((log, &output), &gain) in log.iter_mut().zip(&block.output[range.clone()]).zip(&gain) {
                    *log = output + (*log - output) * gain;
                }
            }
            if leaky {
                let (delta_s, jitter) = (self.delta_s as f32, config.leak_jitter as f32);
                for ((leak, &rate), &bits) in leak.iter_mut().zip(&block.leak[range.clone()]).zip(&bits) {
                    *leak = delta_s * rate * (1.0 - jitter * self.quick_normal.get(bits));
                }
            }
            // Between two events the line is inside both thresholds if its end is: its start is, since the last interval.
            let pixels =
                block.base[range.clone()].iter().zip(&block.next_on[range.clone()]).zip(&block.next_off[range.clone()]);
            for (index, ((&base, &on), &off)) in pixels.enumerate() {
                let difference = log[index] + leak[index] - base;
                flags[index] = (difference >= on) | (-difference >= off);
            }
            if shot {
                let half = (config.shot_hz / 2.0 * self.delta_s) as f32;
                for ((mean, &ratio), &intensity) in
                    mean.iter_mut().zip(&block.shot_ratio[range.clone()]).zip(&intensity)
                {
                    *mean = half * shot_factor(intensity as f32) * ratio;
                }
            }
            if noisy {
                for (mean, &hot_hz) in mean.iter_mut().zip(block.hot.iter().skip(start)).take(len) {
                    *mean = if shot { *mean } else { 0.0 } + hot_hz * self.delta_s as f32;
                }
                // 1 - exp(-mean) is the probability of any event, and below the mean.
                for ((flag, &bits), &mean) in flags[..len].iter_mut().zip(&bits).zip(&mean) {
                    *flag |= noise::uniform(bits) < f64::from(mean);
                }
            }
            for (flag, &ready_ns) in flags.iter_mut().zip(block.ready_ns.iter().skip(start)).take(len) {
                *flag |= ready_ns > self.previous_ns;
            }
            let mut expected = 0;
            for index in set(&flags[..len]) {
                let line = Line {
                    start: f64::from(block.output[start + index]),
                    rise: f64::from(log[index]) - f64::from(block.output[start + index]) + f64::from(leak[index]),
                };
                let arrivals = if noisy {
                    self.arrivals(block, start + index, mean[index], intensity[index], bits[index])
                } else {
                    Arrivals { next: f64::INFINITY, mean: 0.0, share_on: 0.5, key: bits[index] }
                };
                expected += self.expect(block, start + index, &line, arrivals.mean);
                if expected + self.expected.load(Ordering::Relaxed) > Interval::MOST_EVENTS {
                    self.expected.fetch_add(expected, Ordering::Relaxed);
                    return;
                }
                self.pixel(block, start + index, &line, arrivals);
            }
            self.expected.fetch_add(expected, Ordering::Relaxed);
            for (base, &leak) in block.base[range.clone()].iter_mut().zip(&leak) {
                *base -= leak;
            }
            block.output[range].copy_from_slice(&log[..len]);
        }
    }

    /// The fraction of a step of log intensity that has passed the low-pass at the end of the interval: the exact step
    /// response of first order.
    fn gain(&self, intensity: f64) -> f32 {
        -(-intensity * self.delta_s * std::f64::consts::TAU * self.config.cutoff_hz).exp_m1() as f32
    }

    /// The noise events of a pixel that makes `mean` of them in the interval.
    fn arrivals(&self, block: &Block, pixel: usize, mean: f32, intensity: f64, bits: u64) -> Arrivals {
        let config = self.config;
        let mean = f64::from(mean);
        // A pixel with a lower threshold makes more noise (v2e); a hot one makes both polarities alike.
        let half = config.shot_hz / 2.0 * self.delta_s * f64::from(shot_factor(intensity as f32));
        let hot = block.hot.get(pixel).map_or(0.0, |&hot_hz| f64::from(hot_hz) / 2.0 * self.delta_s);
        let on = half * config.threshold_on / f64::from(block.own[pixel][0]) + hot;
        // The first gap of the Poisson process comes from the draw that raised the flag.
        let next = if mean > 0.0 { -(-noise::uniform(bits)).ln_1p() / mean } else { f64::INFINITY };
        Arrivals { next, mean, share_on: on / mean, key: bits }
    }

    /// About how many events a pixel makes in the interval.
    fn expect(&self, block: &Block, pixel: usize, line: &Line, noise: f64) -> u64 {
        let [on, off] = block.own[pixel].map(f64::from);
        let contrast = line.rise.abs() + (line.start - f64::from(block.base[pixel])).abs();
        (contrast / on.min(off) + noise) as u64
    }

    /// All events of one pixel in the interval.
    fn pixel(&self, block: &mut Block, pixel: usize, line: &Line, mut arrivals: Arrivals) {
        let period = self.config.refractory_s * 1e9 / self.delta_ns;
        let mut base = f64::from(block.base[pixel]);
        let mut s = 0.0;
        if let Some(&ready_ns) = block.ready_ns.get(pixel)
            && ready_ns > self.previous_ns
        {
            s = (ready_ns - self.previous_ns) / self.delta_ns;
            base = line.at(s);
        }
        let (mut on, mut off) = (f64::from(block.next_on[pixel]), f64::from(block.next_off[pixel]));
        let mut count = 0;
        loop {
            while arrivals.next < s {
                arrivals.advance();
            }
            let (crossing, rises) = match line.rise {
                rise if rise > 0.0 => ((base + on - line.start) / rise, true),
                rise if rise < 0.0 => ((base - off - line.start) / rise, false),
                _ => (f64::INFINITY, true),
            };
            let signal = crossing <= arrivals.next;
            let at = if signal { crossing.max(s) } else { arrivals.next };
            if at > 1.0 || s > 1.0 {
                break;
            }
            let key = random::extend(random::extend(arrivals.key, 1), count);
            let polarity = if signal { rises } else { random::uniform(key) < arrivals.share_on };
            self.push(block, pixel, at, polarity);
            base = match (signal && period == 0.0, rises) {
                (true, true) => base + on,
                (true, false) => base - off,
                (false, _) => line.at(at + period),
            };
            s = at + period;
            if !signal {
                arrivals.advance();
            }
            if self.config.event_sigma > 0.0 {
                let own = block.own[pixel].map(f64::from);
                let draw = |own: f64, polarity| {
                    let drawn = own + self.config.event_sigma * random::normal(random::extend(key, polarity));
                    drawn.max(self.smallest_threshold())
                };
                (on, off) = (draw(own[0], 1), draw(own[1], 2));
            }
            count += 1;
        }
        block.base[pixel] = base as f32;
        (block.next_on[pixel], block.next_off[pixel]) = (on as f32, off as f32);
        if let Some(ready_ns) = block.ready_ns.get_mut(pixel) {
            *ready_ns = self.previous_ns + s * self.delta_ns;
        }
    }

    /// What a threshold redrawn for an event is at least.
    fn smallest_threshold(&self) -> f64 {
        self.config.threshold_on.min(self.config.threshold_off).min(0.01)
    }

    fn push(&self, block: &mut Block, pixel: usize, at: f64, on: bool) {
        let (row, column) = (block.first_row + pixel / self.width, pixel % self.width);
        let key = ((self.rest_ns + at * self.delta_ns) * 1e-3).round() as u32;
        block.raws.push(Raw { key, y: row as u16, x: column as u16, on });
    }
}
