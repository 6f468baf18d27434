//! Light that flickers: how often, and when it is brightest. What an event camera sees of it is no motion, and is the same at each peak,
//! so that events counted from peak to peak tell of everything else alone.
//!
//! A pixel is brightest between ON events and the OFF events after them. Where that comes back at steady intervals, at many pixels and at
//! all of them at once, a lamp flickers; what turns or swings comes to one pixel after another.

use std::f64::consts::TAU;

use erfgs_dataset::{Camera, Dataset, DatasetError, Split};
use erfgs_events::Events;
use rayon::prelude::*;

use super::median;

/// What flickers more slowly is taken for motion, and what flickers faster than this has no peaks that a pixel could follow, hertz.
const SLOWEST_HZ: f64 = 40.0;
const FASTEST_HZ: f64 = 4000.0;
/// Frequencies are told apart in steps of this share.
const STEP: f64 = 0.03;
/// An interval is as the ones before if it differs by no more than this share of them...
const STEADY: f64 = 0.2;
/// ...and so many in a row are no chance.
const ROW: u16 = 5;
/// Periods over which the light's phase is told.
const WINDOW: f64 = 8.0;
/// A window of fewer peaks tells nothing.
const FEWEST_PEAKS: f64 = 4.0;
/// The share of all pixels, and their number, that must see it.
const LEAST_SHARE: f64 = 0.002;
const FEWEST_PIXELS: u64 = 30;
/// Peaks of all pixels within a window must be so much at once: the square of the length of their mean, where a period is a turn.
const AT_ONCE: f64 = 0.5;

/// Light that flickers.
#[derive(Clone, Debug)]
pub struct Flicker {
    /// How often, hertz, in the mean.
    pub hz: f64,
    /// The share of the event cameras' pixels that see it.
    pub share: f64,
    /// The frequency that phases are told beside, hertz.
    nominal_hz: f64,
    /// How many turns of that the peaks are behind, by time (microseconds), ascending.
    behind: Vec<(f64, f64)>,
    /// The same a microsecond, in the median.
    slope: f64,
}

impl Flicker {
    /// What the event cameras of the training set see flicker; nothing where the light is steady, or flickers less than their thresholds.
    ///
    /// # Errors
    /// [`DatasetError`] where events cannot be read.
    pub(super) fn find(dataset: &Dataset) -> Result<Option<Self>, DatasetError> {
        let cameras: Vec<&Camera> = dataset.cameras(Split::Train).filter(|camera| camera.events.is_some()).collect();
        let look = |camera: &Camera| -> Result<FlickerFinder, DatasetError> {
            let mut finder = FlickerFinder::new(camera.intrinsics.width, camera.intrinsics.height);
            dataset.read_event_pieces(camera, |events| -> Result<(), DatasetError> {
                finder.add(events);
                Ok(())
            })?;
            Ok(finder)
        };
        let found = cameras.into_par_iter().map(|camera| look(camera).map(FlickerFinder::finish));
        let found = found.collect::<Result<Vec<_>, _>>()?;
        Ok(found.into_iter().reduce(Evidence::with).and_then(Evidence::tell))
    }

    /// How many turns of the nominal frequency the peaks are behind at a time, microseconds.
    fn behind(&self, t_us: f64) -> f64 {
        let after = self.behind.partition_point(|&(t, _)| t <= t_us);
        match (after.checked_sub(1).map(|at| self.behind[at]), self.behind.get(after)) {
            (Some((from, a)), Some(&(to, b))) => a + (b - a) * (t_us - from) / (to - from),
            (Some((t, turns)), None) | (None, Some(&(t, turns))) => turns + self.slope * (t_us - t),
            (None, None) => 0.0,
        }
    }

    /// The peak number `number`, microseconds.
    fn peak(&self, number: f64) -> f64 {
        let period = 1e6 / self.nominal_hz;
        let mut t_us = number * period;
        // The phase changes by little in a period, so that a few rounds settle it.
        for _ in 0..20 {
            t_us = (number + self.behind(t_us)) * period;
        }
        t_us
    }

    /// Peaks within `[from, to]` microseconds, every so many that they are about `width` apart.
    pub(super) fn peaks(&self, [from, to]: [i64; 2], width: f64) -> Vec<i64> {
        let each = (width * 1e-6 * self.hz).round().max(1.0);
        let turns = |t: i64| t as f64 * 1e-6 * self.nominal_hz - self.behind(t as f64);
        let (first, last) = (turns(from).ceil(), turns(to).floor());
        let count = ((last - first) / each).floor();
        let numbers = (0..=count.clamp(-1.0, 1e6) as i64).map(|k| first + each * k as f64);
        numbers.map(|number| self.peak(number).round() as i64).filter(|t| (from..=to).contains(t)).collect()
    }
}

/// What a pixel has seen.
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    /// Its last two events, the later one first, and its last peak, microseconds.
    last: [i64; 2],
    peak: i64,
    /// The mean interval of those that were alike, microseconds, and how many these are.
    interval: f32,
    row: u16,
    /// ON events since the last OFF event, up to two.
    rises: u8,
    /// Events since the last peak, those in rows of steady intervals, and all.
    since: u32,
    steady: u32,
    all: u32,
}

impl Pixel {
    fn flickers(&self) -> bool {
        2 * u64::from(self.steady) > u64::from(self.all)
    }
}

/// Peaks of a frequency within a window: their sum where a period is a turn, that of their times (microseconds), and their number.
#[derive(Clone, Copy, Debug)]
struct Window {
    index: i64,
    sum: [f64; 2],
    time: f64,
    count: f64,
}

impl Window {
    fn add(&mut self, other: &Self) {
        self.sum = [0, 1].map(|axis| self.sum[axis] + other.sum[axis]);
        self.time += other.time;
        self.count += other.count;
    }

    /// The same beside another frequency, `more` hertz higher, to which it belongs at `hz`.
    fn beside(&self, hz: f64, more: f64) -> Self {
        let t = self.time / self.count * 1e-6;
        let (sin, cos) = (TAU * (more * t).fract()).sin_cos();
        let [x, y] = self.sum;
        let index = (t * hz / WINDOW).floor() as i64;
        Self { index, sum: [x * cos - y * sin, x * sin + y * cos], ..*self }
    }

    /// How many turns its peaks are behind.
    fn turns(&self) -> f64 {
        self.sum[1].atan2(self.sum[0]) / TAU
    }
}

/// Follows a camera's pixels from event to event.
pub(super) struct FlickerFinder {
    width: usize,
    pixels: Vec<Pixel>,
    windows: Vec<Vec<Window>>,
}

/// What cameras have seen.
struct Evidence {
    pixels: u64,
    /// Of each frequency the pixels that flicker so, and the windows.
    steady: Vec<u64>,
    windows: Vec<Vec<Window>>,
}

fn frequencies() -> usize {
    ((FASTEST_HZ / SLOWEST_HZ).ln() / STEP).ceil() as usize
}

/// Which frequency an interval (microseconds) is nearest to, if it is one of them.
fn frequency_of(interval: f64) -> Option<usize> {
    let at = ((1e6 / interval / SLOWEST_HZ).ln() / STEP).floor();
    (at >= 0.0 && at < frequencies() as f64).then_some(at as usize)
}

fn hz_of(frequency: usize) -> f64 {
    SLOWEST_HZ * (STEP * (frequency as f64 + 0.5)).exp()
}

impl FlickerFinder {
    pub fn new(width: u32, height: u32) -> Self {
        let [width, height] = [width, height].map(|side| side as usize);
        Self { width, pixels: vec![Pixel::default(); width * height], windows: vec![Vec::new(); frequencies()] }
    }

    /// Events that come after those before.
    pub fn add(&mut self, events: &Events) {
        for event in events.iter() {
            let pixel = &mut self.pixels[usize::from(event.y) * self.width + usize::from(event.x)];
            pixel.all = pixel.all.saturating_add(1);
            pixel.since = pixel.since.saturating_add(1);
            let rises = pixel.rises;
            // The light that the first OFF event tells of was passed at the last ON event but one.
            let before = pixel.last[usize::from(rises > 1)];
            let peak = before + (event.t_us - before) / 2;
            pixel.last = [event.t_us, pixel.last[0]];
            pixel.rises = if event.on { 2.min(rises + 1) } else { 0 };
            if event.on || rises == 0 {
                continue;
            }
            let interval = (peak - pixel.peak) as f64;
            let mean = f64::from(pixel.interval);
            if pixel.row > 0 && (interval - mean).abs() <= STEADY * mean {
                pixel.row = pixel.row.saturating_add(1);
                pixel.interval += ((interval - mean) / f64::from(pixel.row.min(16))) as f32;
            } else {
                (pixel.row, pixel.interval) = (1, interval as f32);
            }
            pixel.peak = peak;
            let since = std::mem::take(&mut pixel.since);
            if pixel.row < ROW {
                continue;
            }
            let Some(frequency) = frequency_of(pixel.interval.into()) else { continue };
            pixel.steady = pixel.steady.saturating_add(since);
            let turns = peak as f64 * 1e-6 * hz_of(frequency);
            let (sin, cos) = (TAU * turns.fract()).sin_cos();
            let (index, windows) = ((turns / WINDOW).floor() as i64, &mut self.windows[frequency]);
            // Peaks are told as they end, so that one may come late for its window.
            let one = Window { index, sum: [cos, sin], time: peak as f64, count: 1.0 };
            match windows.last_mut().filter(|window| window.index >= index) {
                Some(window) => window.add(&one),
                None => windows.push(one),
            }
        }
    }

    /// Which pixels saw little else than light that flickers; none where there is no such light.
    pub fn flickering(self) -> Vec<bool> {
        let pixels = self.pixels.iter().map(Pixel::flickers).collect();
        if self.finish().tell().is_some() { pixels } else { Vec::new() }
    }

    fn finish(self) -> Evidence {
        let mut steady = vec![0; frequencies()];
        for pixel in self.pixels.iter().filter(|pixel| pixel.flickers()) {
            frequency_of(pixel.interval.into()).into_iter().for_each(|frequency| steady[frequency] += 1);
        }
        Evidence { pixels: self.pixels.len() as u64, steady, windows: self.windows }
    }
}

impl Evidence {
    /// Together with what others saw of the same light.
    fn with(mut self, other: Self) -> Self {
        self.pixels += other.pixels;
        for (own, more) in self.steady.iter_mut().zip(other.steady) {
            *own += more;
        }
        for (own, more) in self.windows.iter_mut().zip(other.windows) {
            own.extend(more);
            merge(own);
        }
        self
    }

    fn tell(self) -> Option<Flicker> {
        let peaks = |frequency: usize| self.windows[frequency].iter().map(|window| window.count).sum::<f64>();
        let most = (0..frequencies()).max_by(|&a, &b| peaks(a).total_cmp(&peaks(b)))?;
        // Pixels' own intervals scatter about the light's.
        let beside = most.saturating_sub(1)..(most + 2).min(frequencies());
        let steady: u64 = self.steady[beside.clone()].iter().sum();
        let share = steady as f64 / self.pixels.max(1) as f64;
        let nominal_hz = hz_of(most);
        let shifted = beside.flat_map(|other| {
            let more = nominal_hz - hz_of(other);
            self.windows[other].iter().map(move |window| window.beside(nominal_hz, more))
        });
        let mut windows: Vec<Window> = shifted.collect();
        merge(&mut windows);
        windows.retain(|window| window.count >= FEWEST_PEAKS);
        let (at_once, all) = windows.iter().fold((0.0, 0.0), |(at_once, all), Window { sum: [x, y], count, .. }| {
            (at_once + x * x + y * y - count, all + count * count - count)
        });
        if steady < FEWEST_PIXELS || share < LEAST_SHARE || windows.len() < 2 || at_once < AT_ONCE * all {
            return None;
        }
        let near = |turns: f64| turns - turns.round();
        // How the phase goes on from a window to the next; where some are missing it is taken as going on so.
        let steps: Vec<f64> = (windows.array_windows().filter(|[a, b]| b.index == a.index + 1))
            .map(|[a, b]| near(b.turns() - a.turns()))
            .collect();
        let step = median(steps)?;
        let mut behind: Vec<(f64, f64)> = Vec::with_capacity(windows.len());
        let mut last: Option<(i64, f64)> = None;
        for window in &windows {
            let found = window.turns();
            let turns = last.map_or(found, |(index, turns)| {
                let expected = turns + step * (window.index - index) as f64;
                expected + near(found - expected)
            });
            last = Some((window.index, turns));
            behind.push((window.time / window.count, turns));
        }
        let slope = step * nominal_hz * 1e-6 / WINDOW;
        let (first, last) = (behind[0], behind[behind.len() - 1]);
        let hz = nominal_hz - 1e6 * (last.1 - first.1) / (last.0 - first.0);
        Some(Flicker { hz, share, nominal_hz, behind, slope })
    }
}

/// Windows in order, those of the same time as one.
fn merge(windows: &mut Vec<Window>) {
    windows.sort_by_key(|window| window.index);
    windows.dedup_by(|next, kept| {
        let same = next.index == kept.index;
        if same {
            kept.add(next);
        }
        same
    });
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;
    use erfgs_events::Event;

    use super::*;

    const SIZE: [u32; 2] = [40, 30];

    /// Events of pixels whose log intensity is told by (pixel, seconds), with a threshold of 0.2, in steps of 100 us.
    fn events(us: i64, level: impl Fn([u32; 2], f64) -> f64) -> Events {
        let mut all: Vec<Event> = Vec::new();
        for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
            let drawn = random::uniform(random::key(7, &[x.into(), y.into()]));
            let mut reference = level([x, y], 0.0) + 0.2 * (drawn - 0.5);
            for t_us in (0..us).step_by(100) {
                let now = level([x, y], t_us as f64 * 1e-6);
                while (now - reference).abs() >= 0.2 {
                    let on = now > reference;
                    reference += if on { 0.2 } else { -0.2 };
                    all.push(Event { t_us, x: x as u16, y: y as u16, on });
                }
            }
        }
        all.sort_by_key(|event| event.t_us);
        let mut events = Events::new(SIZE[0], SIZE[1]);
        all.into_iter().for_each(|event| events.push(event));
        events
    }

    fn seen(events: &Events) -> Evidence {
        let mut finder = FlickerFinder::new(SIZE[0], SIZE[1]);
        finder.add(events);
        finder.finish()
    }

    /// A lamp on mains that drift, by share of its mean; cycles at a time.
    fn turns(hz: f64, drift: f64, t: f64) -> f64 {
        hz * t + drift * t * t
    }

    #[test]
    fn a_lamp_s_peaks_are_found_however_its_mains_drift() {
        for (hz, drift, depth) in [(100.0, 0.0, 0.3), (120.3, 0.4, 0.15), (61.0, -0.3, 0.8), (1003.0, 0.0, 0.5)] {
            let lamp = |[x, _]: [u32; 2], t: f64| match x < 12 {
                true => (1.0 + depth * (TAU * turns(hz, drift, t)).sin()).ln(),
                false => 0.0,
            };
            // Steps of events are a tenth of the shortest period.
            let found = seen(&events(1_500_000, lamp)).tell().expect("a lamp");
            assert!((found.hz / (hz + 1.5 * drift) - 1.0).abs() < 2e-3, "{} of {hz}", found.hz);
            // Of a range of one threshold and a half, half of the pixels happen to see nothing.
            assert!((0.15..0.31).contains(&found.share), "{}", found.share);
            let peaks = found.peaks([100_000, 1_400_000], 20_000.0);
            assert!((55..80).contains(&peaks.len()), "{}", peaks.len());
            for t_us in peaks {
                let late = turns(hz, drift, t_us as f64 * 1e-6) - 0.25;
                let late = late - late.round();
                // Events tell of light that was there before: where they are one threshold apart, by half of the time for that.
                let expected = if depth < 0.2 { 0.12 } else { 0.0 };
                assert!((late - expected).abs() < 0.06, "{late} turns at {t_us} us of {hz} Hz");
            }
        }
    }

    #[test]
    fn lamps_that_shine_in_pulses_are_found_in_the_middle_of_a_pulse() {
        let lamp = |_: [u32; 2], t: f64| if (200.0 * t).fract() < 0.2 { 0.0 } else { -1.0 };
        let found = seen(&events(400_000, lamp)).tell().expect("a lamp");
        for t_us in found.peaks([0, 400_000], 1.0) {
            let phase = (200.0 * t_us as f64 * 1e-6).rem_euclid(1.0);
            assert!((phase - 0.1).abs() < 0.05, "{phase}");
        }
    }

    #[test]
    fn cameras_that_see_little_of_it_tell_together() {
        let lamp = |hz: f64| {
            move |[x, y]: [u32; 2], t: f64| {
                if x < 10 && y < 2 { 0.4 * (TAU * hz * t).sin() } else { 0.0 }
            }
        };
        let alone = || seen(&events(500_000, lamp(100.0)));
        assert!(alone().tell().is_none(), "twenty pixels");
        let found = alone().with(alone()).tell().expect("forty");
        assert!((found.hz - 100.0).abs() < 0.2 && (found.share - 1.0 / 60.0).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn what_turns_swings_or_passes_is_no_lamp() {
        let middle = |[x, y]: [u32; 2]| [f64::from(x) - 19.5, f64::from(y) - 14.5];
        // A fan of three blades that turns 33 times a second.
        let fan = |at: [u32; 2], t: f64| {
            let [x, y] = middle(at);
            0.5 * (3.0 * y.atan2(x) - TAU * 100.0 * t).sin()
        };
        assert!(seen(&events(500_000, fan)).tell().is_none());
        // A light stripe that swings to and fro 60 times a second.
        let string = |at: [u32; 2], t: f64| {
            let away = middle(at)[0] - 6.0 * (TAU * 60.0 * t).sin();
            1.5 * (-away * away / 4.0).exp()
        };
        assert!(seen(&events(500_000, string)).tell().is_none());
        // A grating that passes.
        let grating = |[x, _]: [u32; 2], t: f64| (TAU * (f64::from(x) / 9.0 - 100.0 * t)).sin();
        assert!(seen(&events(500_000, grating)).tell().is_none());
        let nothing = |_: [u32; 2], _: f64| 0.0;
        assert!(seen(&events(500_000, nothing)).tell().is_none());
        // Noise.
        let mut noise = Events::new(SIZE[0], SIZE[1]);
        for index in 0..100_000_u64 {
            let draw = |word, limit| random::below(random::key(5, &[index, word]), limit) as u16;
            let (x, y) = (draw(0, 40), draw(1, 30));
            noise.push(Event { t_us: 10 * index as i64, x, y, on: draw(2, 2) == 1 });
        }
        assert!(seen(&noise).tell().is_none());
    }
}
