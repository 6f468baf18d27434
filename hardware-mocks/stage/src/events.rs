//! The event sensor: continuous in time, so that an event has the microsecond at which its pixel crossed its threshold.
//!
//! A pixel fires whenever its log intensity has moved by one contrast threshold from where it last fired. Its intensity
//! is the exact function of time that frames integrate ([`StageView`]); an interval is halved until the intensity is
//! nearly straight in it, and each crossing is then found to the microsecond (the first whole microsecond at which it has
//! happened). Only pixels that something moving can reach are evaluated.

use std::ops::Range;

use erfgs_base::random;
use erfgs_events::{Event, Events};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    StageError,
    actors::{Actors, Moment},
    colour::{encode, lin_log, luma, luminance},
    pixel::{Pixel, Signal},
    view::StageView,
};

/// The sensor's parameters. The default is a good sensor in good light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EventOptions {
    /// Contrast threshold of ON events, natural-log intensity.
    pub threshold_on: f64,
    /// Contrast threshold of OFF events, natural-log intensity.
    pub threshold_off: f64,
    /// Standard deviation of the thresholds over the pixels, natural-log intensity. Thresholds stay above 0.01.
    pub threshold_sigma: f64,
    /// After an event a pixel is blind for this long, microseconds; then it starts from the intensity that it finds.
    pub refractory_us: i64,
    /// Rate of the ON events that a pixel's leak makes in constant light, hertz.
    pub leak_hz: f64,
    /// Rate of noise events of either polarity per pixel, hertz (a Poisson process).
    pub shot_hz: f64,
    /// Share of pixels that are hot.
    pub hot_share: f64,
    /// Rate of ON events of a hot pixel, hertz.
    pub hot_hz: f64,
    /// Below this grey level (of 255) the response is linear, above it logarithmic: v2e's "lin-log".
    pub lin_log_threshold: f64,
    /// Whether the logarithm is taken of linearised luma instead of display (sRGB-encoded) luma. Luma itself is of
    /// display values either way, as in the simulator and in the trainer's event loss.
    pub linear_light: bool,
}

impl Default for EventOptions {
    fn default() -> Self {
        Self {
            threshold_on: 0.2,
            threshold_off: 0.2,
            threshold_sigma: 0.02,
            refractory_us: 0,
            leak_hz: 0.05,
            shot_hz: 0.1,
            hot_share: 0.0,
            hot_hz: 50.0,
            lin_log_threshold: 20.0,
            linear_light: false,
        }
    }
}

impl EventOptions {
    /// A sensor without noise, mismatch, leak or refractory period.
    #[must_use]
    pub fn ideal() -> Self {
        Self { threshold_sigma: 0.0, leak_hz: 0.0, shot_hz: 0.0, ..Self::default() }
    }

    fn check(&self) -> Result<(), StageError> {
        let threshold = |value: f64| (0.01..=10.0).contains(&value);
        let rate = |value: f64| (0.0..=1e5).contains(&value);
        let check = StageError::check;
        check("the ON threshold", self.threshold_on, threshold(self.threshold_on), "0.01 to 10")?;
        check("the OFF threshold", self.threshold_off, threshold(self.threshold_off), "0.01 to 10")?;
        check(
            "the spread of the thresholds",
            self.threshold_sigma,
            (0.0..=5.0).contains(&self.threshold_sigma),
            "0 to 5",
        )?;
        let refractory = (0..=1_000_000).contains(&self.refractory_us);
        check("the refractory period, microseconds,", self.refractory_us as f64, refractory, "0 to 1000000")?;
        check("the leak rate, hertz,", self.leak_hz, rate(self.leak_hz), "0 to 100000")?;
        check("the shot noise rate, hertz,", self.shot_hz, rate(self.shot_hz), "0 to 100000")?;
        check("the rate of hot pixels, hertz,", self.hot_hz, rate(self.hot_hz), "0 to 100000")?;
        check("the share of hot pixels", self.hot_share, (0.0..=1.0).contains(&self.hot_share), "0 to 1")?;
        let lin_log = self.lin_log_threshold > 1.0 && self.lin_log_threshold <= 255.0;
        check("the lin-log threshold", self.lin_log_threshold, lin_log, "above 1, to 255")?;
        Ok(())
    }

    /// The sensor's response to linear light: log intensity, from 0 to ln 255.
    #[must_use]
    pub fn response(&self, linear: [f64; 3]) -> f64 {
        let light = match self.linear_light {
            true => luminance(DVec3::from(linear)),
            false => luma(DVec3::from(linear.map(encode))),
        };
        lin_log(255.0 * light, self.lin_log_threshold)
    }
}

/// The time in which the set of reachable pixels is taken as constant, microseconds.
const SLAB_US: i64 = 2000;
/// Slabs that are worked on together: bounds the memory, and each block's events are sorted alone.
const BLOCK_SLABS: usize = 64;
/// Nothing moves farther than this from one sample of the intensity to the next, pixels, before any halving.
const STEP_PX: f64 = 0.7;

/// Samples of the intensity in a period of a lamp that flickers, before any halving.
const STEPS_A_PERIOD: f64 = 8.0;

/// A pixel that something can reach during a slab.
#[derive(Clone, Copy, Debug)]
struct Visit {
    pixel: u32,
    slab: u32,
    steps: u32,
    actors: Actors,
}

/// The events of a camera over `[start, end]` nanoseconds, ordered by time, then row, then column. `stream` tells the
/// sensors of one recording apart (their noise and mismatch); results do not depend on the number of threads.
/// `progress` is told the share of the time that is done, in [0, 1].
///
/// # Errors
/// If an option is out of its range, or the interval is empty.
pub fn record(
    view: &StageView<'_>,
    [start_ns, end_ns]: [i64; 2],
    options: &EventOptions,
    seed: u64,
    stream: u64,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Events, StageError> {
    options.check()?;
    // The whole microseconds inside the interval.
    let start = start_ns.div_euclid(1000) + i64::from(start_ns.rem_euclid(1000) > 0);
    let end = end_ns.div_euclid(1000);
    let seconds = (end_ns as f64 - start_ns as f64) * 1e-9;
    let valid = end > start && seconds <= 3600.0;
    StageError::check("the time to record events for, seconds,", seconds, valid, "a whole microsecond to an hour")?;
    let root = random::key(seed, &[random::purpose("stage events"), stream]);
    let mut pixels: Vec<Pixel> = (0..view.pixels())
        .into_par_iter()
        .with_min_len(256)
        .map(|pixel| {
            let lit = |lamp: f64| options.response(view.still_colour(pixel, lamp).to_array());
            let still = lit(1.0);
            let level = view.pixel_at(pixel, micro(start));
            let level =
                level.map_or_else(|| lit(view.stage.lamp(micro(start))), |colour| options.response(colour.to_array()));
            Pixel::new(options, random::extend(root, pixel as u64), start, still, level)
        })
        .collect();
    let mut events = Events::new(view.intrinsics.width, view.intrinsics.height);
    let width = view.intrinsics.width as usize;
    let mut from = start;
    while from < end {
        let to = end.min(from.saturating_add(SLAB_US * BLOCK_SLABS as i64));
        let mut block: Vec<Event> = record_block(view, options, from..to, &mut pixels)
            .into_par_iter()
            .enumerate()
            .flat_map_iter(|(pixel, fired)| {
                fired.into_iter().map(move |(t_us, on)| Event {
                    t_us,
                    y: (pixel / width) as u16,
                    x: (pixel % width) as u16,
                    on,
                })
            })
            .collect();
        block.par_sort_by_key(|event| (event.t_us, event.y, event.x));
        block.into_iter().for_each(|event| events.push(event));
        from = to;
        progress((to - start) as f64 / (end - start) as f64);
    }
    Ok(events)
}

/// The events of every pixel during a block of time, as (microsecond, polarity) in order of time.
fn record_block(
    view: &StageView<'_>,
    options: &EventOptions,
    block: Range<i64>,
    pixels: &mut [Pixel],
) -> Vec<Vec<(i64, bool)>> {
    let slabs: Vec<Range<i64>> =
        (block.start..block.end).step_by(SLAB_US as usize).map(|from| from..block.end.min(from + SLAB_US)).collect();
    let mut visits: Vec<Visit> =
        slabs.par_iter().enumerate().flat_map_iter(|(index, slab)| slab_visits(view, index, slab)).collect();
    visits.par_sort_by_key(|visit| (visit.pixel, visit.slab));
    let mut ranges = vec![0..0; pixels.len()];
    let mut first = 0;
    for group in visits.chunk_by(|a, b| a.pixel == b.pixel) {
        ranges[group[0].pixel as usize] = first..first + group.len();
        first += group.len();
    }
    pixels
        .par_iter_mut()
        .zip(ranges)
        .enumerate()
        .with_min_len(16)
        .map(|(index, (pixel, range))| {
            let mut fired = Vec::new();
            let looker = view.looker(index);
            for visit in &visits[range] {
                let slab = &slabs[visit.slab as usize];
                pixel.stay(slab.start, &mut fired);
                let signal = Signal {
                    still: pixel.still(),
                    at: |t_us: i64| {
                        let moment = Moment::at(view.stage, micro(t_us), visit.actors);
                        let flickers = || (moment.lamp != 1.0).then(|| view.still_colour(index, moment.lamp));
                        let colour = looker.colour(&moment, visit.actors).or_else(flickers);
                        colour.map(|colour| options.response(colour.to_array()))
                    },
                };
                pixel.follow(slab.clone(), visit.steps, &signal, &mut fired);
            }
            pixel.stay(block.end, &mut fired);
            fired
        })
        .collect()
}

fn slab_visits(view: &StageView<'_>, index: usize, slab: &Range<i64>) -> Vec<Visit> {
    let (from, to) = (micro(slab.start), micro(slab.end));
    let speeds = view.pixel_speeds(0.5 * (from + to), 0.5 * (to - from));
    let flicker = view.stage.options.flicker.map_or(0.0, |flicker| STEPS_A_PERIOD * flicker.hz * (to - from));
    let mut reached = view.reached(from, to);
    if flicker > 0.0 {
        // The lamp's light reaches all.
        let mut all: Vec<(usize, Actors)> = (0..view.pixels()).map(|pixel| (pixel, Actors::NONE)).collect();
        reached.into_iter().for_each(|(pixel, actors)| all[pixel].1 = actors);
        reached = all;
    }
    reached
        .into_iter()
        .map(|(pixel, actors)| {
            let speed =
                speeds.iter().filter(|(actor, _)| actors.has(*actor)).map(|(_, speed)| *speed).fold(0.0, f64::max);
            let steps = (speed * (to - from) / STEP_PX).max(flicker).ceil().clamp(1.0, (slab.end - slab.start) as f64);
            Visit { pixel: pixel as u32, slab: index as u32, steps: steps as u32, actors }
        })
        .collect()
}

/// Seconds of a time in microseconds.
fn micro(t_us: i64) -> f64 {
    t_us as f64 * 1e-6
}
