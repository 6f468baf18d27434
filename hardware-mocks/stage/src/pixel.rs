//! One pixel of the event sensor: it follows a signal and fires.

use std::ops::Range;

use erfgs_base::random;

use super::events::EventOptions;

const ON: u64 = 0;
const OFF: u64 = 1;
const LEAK: u64 = 2;
const LEAK_PHASE: u64 = 3;
const HOT: u64 = 4;
const NOISE: u64 = 5;

/// The log intensity of a pixel as a function of time.
pub(crate) struct Signal<F: Fn(i64) -> Option<f64>> {
    /// Its value while nothing touches the pixel.
    pub still: f64,
    /// Its value at a microsecond; none while nothing touches the pixel.
    pub at: F,
}

/// The state of one pixel.
#[derive(Clone, Debug)]
pub(crate) struct Pixel {
    key: u64,
    threshold: [f64; 2],
    refractory: i64,
    /// The leak adds this to the level per microsecond.
    leak: f64,
    /// Rate of noise events per microsecond, and whether they are all ON.
    noise_rate: f64,
    hot: bool,
    still: f64,
    start: i64,
    /// The time that the pixel has been followed to.
    time: i64,
    /// The level then: log intensity plus leak.
    level: f64,
    /// The level at which the pixel last fired.
    reference: f64,
    blind_until: i64,
    next_noise: i64,
    noise_count: u64,
}

impl Pixel {
    /// A pixel that sees `level` at `start` (microseconds) and `still` whenever nothing touches it.
    pub(crate) fn new(options: &EventOptions, key: u64, start: i64, still: f64, level: f64) -> Self {
        let draw = |word| random::extend(key, word);
        let threshold = |nominal: f64, word| (nominal + options.threshold_sigma * random::normal(draw(word))).max(0.01);
        let threshold = [threshold(options.threshold_on, ON), threshold(options.threshold_off, OFF)];
        let hot = random::uniform(draw(HOT)) < options.hot_share;
        // v2e's spread of leak rates: a tenth of a decade.
        let leak_hz = options.leak_hz * 10.0_f64.powf(0.1 * random::normal(draw(LEAK)));
        // Without a random phase all pixels would leak their first event together.
        let phase = if options.leak_hz > 0.0 { random::uniform(draw(LEAK_PHASE)) } else { 0.0 };
        let mut pixel = Self {
            key: draw(NOISE),
            threshold,
            refractory: options.refractory_us,
            leak: leak_hz * threshold[0] * 1e-6,
            noise_rate: 1e-6 * if hot { options.hot_hz } else { options.shot_hz },
            hot,
            still,
            start,
            time: start,
            level,
            reference: level - phase * threshold[0],
            blind_until: i64::MIN,
            next_noise: start,
            noise_count: 0,
        };
        pixel.draw_noise();
        pixel
    }

    /// The log intensity while nothing touches the pixel.
    pub(crate) fn still(&self) -> f64 {
        self.still
    }

    /// Follows the pixel to `to` while nothing touches it.
    pub(crate) fn stay(&mut self, to: i64, fired: &mut Vec<(i64, bool)>) {
        if to > self.time {
            let still = Signal { still: self.still, at: |_| None };
            let level = self.leaked(self.still, to);
            self.cross(to, level, &still, fired);
        }
    }

    /// Follows the pixel through `[slab.start, slab.end]`, looking at the signal at `steps` equal steps and wherever it
    /// bends in between. The pixel must have been followed to the slab's start.
    pub(crate) fn follow<F: Fn(i64) -> Option<f64>>(
        &mut self,
        slab: Range<i64>,
        steps: u32,
        signal: &Signal<F>,
        fired: &mut Vec<(i64, bool)>,
    ) {
        let length = slab.end - slab.start;
        let mut from = (slab.start, (signal.at)(slab.start));
        for step in 1..=i64::from(steps) {
            let t = slab.start + length * step / i64::from(steps);
            if t > from.0 {
                let to = (t, (signal.at)(t));
                self.bend(from, to, signal, fired);
                from = to;
            }
        }
    }

    /// Follows the signal from one look to the next, halving while it is far from straight.
    fn bend<F: Fn(i64) -> Option<f64>>(
        &mut self,
        from: (i64, Option<f64>),
        to: (i64, Option<f64>),
        signal: &Signal<F>,
        fired: &mut Vec<(i64, bool)>,
    ) {
        let values = [from.1, to.1].map(|value| value.unwrap_or(signal.still));
        let untouched = from.1.is_none() && to.1.is_none();
        if !untouched && to.0 - from.0 > 8 {
            let t = from.0 + (to.0 - from.0) / 2;
            let middle = (t, (signal.at)(t));
            let sag = (middle.1.unwrap_or(signal.still) - 0.5 * (values[0] + values[1])).abs();
            let fine = 0.1 * self.threshold[0].min(self.threshold[1]) + 0.1 * (values[1] - values[0]).abs();
            if sag > fine {
                self.bend(from, middle, signal, fired);
                self.bend(middle, to, signal, fired);
                return;
            }
            self.cross(t, self.leaked(middle.1.unwrap_or(signal.still), t), signal, fired);
        }
        self.cross(to.0, self.leaked(values[1], to.0), signal, fired);
    }

    /// Follows the signal to `to`, where its level is `level`, taking it as monotone on the way, and fires.
    fn cross<F: Fn(i64) -> Option<f64>>(
        &mut self,
        to: i64,
        level: f64,
        signal: &Signal<F>,
        fired: &mut Vec<(i64, bool)>,
    ) {
        loop {
            if self.blind_until > self.time {
                if self.blind_until > to {
                    (self.time, self.level) = (to, level);
                    return;
                }
                self.time = self.blind_until;
                self.level = self.look(self.time, signal);
                self.reference = self.level;
            }
            while self.next_noise <= self.time {
                self.draw_noise();
            }
            let noise = self.next_noise <= to;
            let (end, end_level) =
                if noise { (self.next_noise, self.look(self.next_noise, signal)) } else { (to, level) };
            if let Some(on) = self.beyond(self.level).or_else(|| self.beyond(end_level)) {
                let target = self.reference + if on { self.threshold[0] } else { -self.threshold[1] };
                (self.time, self.level) = self.first_beyond(target, on, (end, end_level), signal);
                self.reference = target;
                self.fire(on, fired);
            } else if noise {
                (self.time, self.level) = (end, end_level);
                self.reference = end_level;
                let on = self.hot || random::extend(self.key, self.noise_count) & 1 == 0;
                self.fire(on, fired);
            } else {
                (self.time, self.level) = (to, level);
                return;
            }
        }
    }

    fn fire(&mut self, on: bool, fired: &mut Vec<(i64, bool)>) {
        fired.push((self.time, on));
        self.blind_until = self.time + self.refractory;
    }

    /// The polarity of the event that `level` makes, if it makes one.
    fn beyond(&self, level: f64) -> Option<bool> {
        let change = level - self.reference;
        if change >= self.threshold[0] {
            Some(true)
        } else if change <= -self.threshold[1] {
            Some(false)
        } else {
            None
        }
    }

    /// The first microsecond from the present to `end` at which the level is at or beyond `target`, and the level then.
    fn first_beyond<F: Fn(i64) -> Option<f64>>(
        &self,
        target: f64,
        on: bool,
        end: (i64, f64),
        signal: &Signal<F>,
    ) -> (i64, f64) {
        let reached = |level: f64| if on { level >= target } else { level <= target };
        if reached(self.level) {
            return (self.time, self.level);
        }
        let (mut before, mut after) = ((self.time, self.level), end);
        let mut round = 0;
        while after.0 - before.0 > 1 {
            // The secant's guess; every third time the middle, which bounds the number of rounds.
            let share = if round % 3 == 2 { 0.5 } else { (target - before.1) / (after.1 - before.1) };
            let guess = before.0 + ((after.0 - before.0) as f64 * share).ceil() as i64;
            let t = guess.clamp(before.0 + 1, after.0 - 1);
            let level = self.look(t, signal);
            if reached(level) {
                after = (t, level);
            } else {
                before = (t, level);
            }
            round += 1;
        }
        after
    }

    fn look<F: Fn(i64) -> Option<f64>>(&self, t: i64, signal: &Signal<F>) -> f64 {
        self.leaked((signal.at)(t).unwrap_or(signal.still), t)
    }

    fn leaked(&self, value: f64, t: i64) -> f64 {
        value + self.leak * (t - self.start) as f64
    }

    fn draw_noise(&mut self) {
        if self.noise_rate <= 0.0 {
            self.next_noise = i64::MAX;
            return;
        }
        self.noise_count += 1;
        let wait = random::exponential(random::extend(self.key, !self.noise_count)) / self.noise_rate;
        // At least a microsecond on, so that the loop over noise events ends.
        self.next_noise = self.next_noise.saturating_add((wait.ceil() as i64).max(1));
    }
}
