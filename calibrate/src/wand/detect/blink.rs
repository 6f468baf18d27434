//! Blinking lights in a stream of events.

use std::collections::BTreeMap;

use erfgs_base::memory;

use super::{
    Lights,
    spot::{Sample, spots},
};

/// So many periods in a row make a pixel one of a LED's.
const STREAK: u8 = 2;
/// Events of a pixel that may wait for its streak.
const MOST_EARLY: usize = 64;
/// The lights of a frequency that are kept.
const KEPT: usize = 8;

/// What is looked for in the events.
#[derive(Clone, Debug, PartialEq)]
pub struct BlinkOptions {
    /// The LEDs' frequencies in the order of the wand's gaps, or one that all share, hertz.
    pub led_hz: Vec<f64>,
    /// How far a period may be off, as a share of it. Frequencies must differ by more than twice this.
    pub tolerance: f64,
    /// Over how long events are gathered into one place, microseconds.
    pub window_us: i64,
    /// A light of fewer events in a window is none.
    pub least_events: f64,
    /// A light of fewer pixels is none: a defect pixel may blink.
    pub least_pixels: usize,
}

impl Default for BlinkOptions {
    fn default() -> Self {
        Self { led_hz: vec![500.0], tolerance: 0.1, window_us: 10_000, least_events: 12.0, least_pixels: 3 }
    }
}

impl BlinkOptions {
    /// Checks the numbers; the error says what is wrong.
    ///
    /// # Errors
    /// If no frequency, two, or more than three are given, one is not positive, or they cannot be told apart.
    pub fn check(&self) -> Result<(), String> {
        if self.led_hz.len() != 1 && self.led_hz.len() != 3 {
            return Err(format!("{} LED frequencies are given; give one that all share, or three", self.led_hz.len()));
        }
        if !self.led_hz.iter().all(|hz| (10.0..=10_000.0).contains(hz)) {
            return Err("the LEDs' frequencies must lie between 10 and 10000 Hz".into());
        }
        for (index, a) in self.led_hz.iter().enumerate() {
            if self.led_hz[..index].iter().any(|b| (a / b).ln().abs() <= 2.0 * self.tolerance) {
                return Err(format!(
                    "LED frequencies nearer than {:.0} % cannot be told apart",
                    200.0 * self.tolerance
                ));
            }
        }
        if self.window_us < 1 {
            return Err("the window that events are gathered over must be positive".into());
        }
        Ok(())
    }
}

#[derive(Clone, Default)]
struct Pixel {
    /// When the light last rose, microseconds; 0 before the first time.
    rose_us: i64,
    on: bool,
    /// The frequency that the last periods have, counted from 1; 0 for none.
    frequency: u8,
    streak: u8,
    /// Its events since the first rise of the streak, microseconds, until the streak is long enough.
    early: Vec<i64>,
}

/// Finds blinking lights in the events of one camera, window by window.
pub struct BlinkDetector {
    options: BlinkOptions,
    width: u16,
    pixels: Vec<Pixel>,
    /// Events of lit pixels by window, and in it by frequency.
    windows: BTreeMap<i64, Vec<Vec<Sample>>>,
    /// How long a window may still get events after its end, microseconds: a pixel's first ones count once its streak is long
    /// enough. Without them a light that moves would be seen where it was.
    hold_us: i64,
    found: Vec<Lights>,
}

impl BlinkDetector {
    /// A detector for a sensor of `width` x `height` pixels.
    ///
    /// # Errors
    /// As [`BlinkOptions::check`]; also where memory has no room for so many pixels.
    pub fn new(width: u16, height: u16, options: BlinkOptions) -> Result<Self, String> {
        options.check()?;
        let count = usize::from(width) * usize::from(height);
        memory::afford((count * size_of::<Pixel>()) as u64).map_err(|shortage| {
            format!("a sensor of {width} x {height} pixels is too large for this machine: {shortage}")
        })?;
        let pixels = vec![Pixel::default(); count];
        let slowest_hz = options.led_hz.iter().copied().fold(f64::INFINITY, f64::min);
        let hold_us = (1.2e6 * f64::from(STREAK) / slowest_hz) as i64;
        Ok(Self { options, width, pixels, windows: BTreeMap::new(), hold_us, found: Vec::new() })
    }

    /// Takes the next event; times never decrease. Pixels outside of the sensor are passed over.
    pub fn event(&mut self, t_us: i64, x: u16, y: u16, on: bool) {
        while let Some((window, samples)) = self.complete(t_us) {
            self.close(window, samples);
        }
        let index = usize::from(y) * usize::from(self.width) + usize::from(x);
        let Some(pixel) = self.pixels.get_mut(index).filter(|_| x < self.width) else { return };
        if on && !pixel.on {
            let period_us = (t_us - pixel.rose_us) as f64;
            let is = |hz: &f64| (period_us * hz * 1e-6).ln().abs() <= self.options.tolerance;
            let frequency = self.options.led_hz.iter().position(is).map_or(0, |index| index as u8 + 1);
            pixel.streak = if frequency == 0 {
                0
            } else if frequency == pixel.frequency {
                pixel.streak.saturating_add(1)
            } else {
                1
            };
            if pixel.streak == 0 {
                pixel.early.clear();
            }
            pixel.frequency = frequency;
            pixel.rose_us = t_us;
        }
        pixel.on = on;
        if pixel.streak < STREAK {
            if pixel.early.len() < MOST_EARLY {
                pixel.early.push(t_us);
            }
            return;
        }
        let which = usize::from(pixel.frequency) - 1;
        let period_us = 1e6 / self.options.led_hz[which];
        let rose_us = pixel.rose_us;
        let mut times = std::mem::take(&mut pixel.early);
        times.extend(((t_us - rose_us) as f64 <= 1.2 * period_us).then_some(t_us));
        for t_us in times {
            let window = t_us.div_euclid(self.options.window_us);
            let middle = (window as f64 + 0.5) * self.options.window_us as f64;
            let frequencies = self.options.led_hz.len();
            let samples = self.windows.entry(window).or_insert_with(|| vec![Vec::new(); frequencies]);
            samples[which].push(Sample { x, y, weight: 1.0, t: t_us as f64 - middle });
        }
    }

    /// The windows that are complete and hold lights, in order of time; a window's time is its middle.
    pub fn take(&mut self) -> Vec<Lights> {
        std::mem::take(&mut self.found)
    }

    /// The same, with the window that was begun.
    #[must_use]
    pub fn finish(mut self) -> Vec<Lights> {
        while let Some((window, samples)) = self.windows.pop_first() {
            self.close(window, samples);
        }
        self.found
    }

    /// The first window that will get no more events.
    fn complete(&mut self, t_us: i64) -> Option<(i64, Vec<Vec<Sample>>)> {
        let first = self.windows.first_entry()?;
        let end_us = (first.key() + 1) * self.options.window_us;
        (end_us + self.hold_us <= t_us).then(|| first.remove_entry())
    }

    fn close(&mut self, window: i64, samples: Vec<Vec<Sample>>) {
        let lights_of = |samples: Vec<Sample>| {
            let mut lights = spots(&samples, 2, self.options.least_pixels);
            lights.retain(|light| light.weight >= self.options.least_events);
            lights.truncate(KEPT);
            lights
        };
        let by_frequency: Vec<_> = samples.into_iter().map(lights_of).collect();
        if by_frequency.iter().any(|lights| !lights.is_empty()) {
            let t = window * self.options.window_us + self.options.window_us / 2;
            self.found.push(Lights { t, by_frequency });
        }
    }
}
