//! Pictures of what an event camera sees, in which features can be found.
//!
//! COLMAP and its like need intensity. Counts of events over a movement look like edges, and their features match nothing;
//! the logarithm of intensity does match. A camera that stands still sees it where light starts from darkness
//! ([`dark_ramp`]: a shutter that opens, lights that are turned up), or where camera or light moves ([`leaky`]).

use std::ops::Range;

use erfgs_events::{Event, Events};
use erfgs_scene::{image::ImageGrey8, srgb};

use crate::statistics::median;

/// The logarithm of intensity at each pixel, row-major, up to a constant.
#[derive(Clone, Debug, PartialEq)]
pub struct LogIntensity {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Natural logarithm.
    pub values: Vec<f32>,
}

/// How many of a pixel's events tell how bright it is.
pub const FIRST: usize = 8;
/// Shares of the pixels that become black and white.
const CLIPPED: f64 = 0.01;
/// The last share of a ramp's events, in which all pixels see light well above the dark: how many come there tells a pixel's
/// threshold.
const LATE: f64 = 0.35;
/// Fewer late events than this in the median pixel tell no thresholds.
const FEWEST_LATE: f64 = 4.0;
/// How much of the threshold that late events tell is corrected for: they are few, and tell it with an error of their own.
const CORRECTED: f64 = 0.75;

/// Of light that rose from darkness, once or several times, however fast and along whichever curve.
///
/// A bright pixel's first events come early. The clock that they are read on is the number of events of all pixels, which
/// grows as the logarithm of the light does once all of them see it, and slower before. Each pixel's first [`FIRST`] ON events
/// are used and not their number in the end, which says little of the scene: once a pixel is well above the dark, the same
/// growth of the light makes the same change of its logarithm, whatever it looks at. So the late events tell its threshold
/// instead. Thresholds differ from pixel to pixel by some percent to some tens of percent, and a pixel with a high one seems
/// darker; that is corrected for. Noise events are averaged out by repeated ramps.
#[must_use]
pub fn dark_ramp(events: &Events, threshold: f64) -> LogIntensity {
    let mut picture = LogIntensity::new(events.width, events.height);
    let ramps = ramps(events);
    let mut late = vec![0_u32; picture.values.len()];
    for ramp in &ramps {
        let values = one_ramp(events, ramp.clone(), threshold, &mut late);
        // Each ramp has a darkness of its own to start from.
        let middle = median(values.iter().copied().map(f64::from)).unwrap_or(0.0) as f32;
        picture.values.iter_mut().zip(&values).for_each(|(to, value)| *to += (value - middle) / ramps.len() as f32);
    }
    let usual = median(late.iter().copied().map(f64::from)).unwrap_or(0.0);
    if usual >= FEWEST_LATE {
        for (value, count) in picture.values.iter_mut().zip(&late) {
            *value += (CORRECTED * (usual / f64::from((*count).max(1))).ln()) as f32;
        }
    }
    picture
}

/// Minus the clock at a pixel's first events in a ramp, the mean; `late` is increased by its late events.
fn one_ramp(events: &Events, ramp: Range<usize>, threshold: f64, late: &mut [u32]) -> Vec<f32> {
    let (width, height) = (events.width as usize, events.height as usize);
    let pixel = |index: usize| {
        let (x, y) = (usize::from(events.x[index]), usize::from(events.y[index]));
        (events.on[index] && x < width && y < height).then_some(y * width + x)
    };
    let (mut values, mut counts) = (vec![0.0_f32; late.len()], vec![0_usize; late.len()]);
    let per_event = threshold / late.len().max(1) as f64;
    let total = ramp.clone().filter_map(pixel).count() as f64;
    let mut clock = 0.0;
    for at in ramp.filter_map(pixel) {
        clock += per_event;
        if counts[at] < FIRST {
            values[at] -= clock as f32 / FIRST as f32;
            counts[at] += 1;
        }
        late[at] += u32::from(clock > (1.0 - LATE) * total * per_event);
    }
    for (value, count) in values.iter_mut().zip(&counts) {
        // What has not come would have come later than all else.
        *value -= (FIRST - count) as f32 / FIRST as f32 * (clock + threshold) as f32;
    }
    values
}

/// The light rises and falls by this many events in the mean pixel.
const SWING: f64 = 1.0;
/// A ramp starts where this share of its rise has come: what comes before is noise of the dark.
const START: f64 = 0.003;

/// The ranges of events in which the light rises; everything where it never does.
fn ramps(events: &Events) -> Vec<Range<usize>> {
    let swing = (SWING * f64::from(events.width) * f64::from(events.height)).max(1.0) as i64;
    let signs = |range: Range<usize>| events.on[range].iter().map(|on| if *on { 1_i64 } else { -1 });
    // From the lowest place to the highest one after it.
    let (mut level, mut low, mut high) = (0_i64, (0_i64, 0), None);
    let mut found = Vec::new();
    for (index, sign) in signs(0..events.on.len()).enumerate() {
        level += sign;
        match &mut high {
            None if level <= low.0 => low = (level, index + 1),
            None if level - low.0 >= swing => high = Some((level, index + 1)),
            Some((most, end)) if level >= *most => (*most, *end) = (level, index + 1),
            Some((most, end)) if *most - level >= swing => {
                found.push((low.1..*end, *most - low.0));
                (low, high) = ((level, index + 1), None);
            }
            _ => {}
        }
    }
    if let Some((most, end)) = high {
        found.push((low.1..end, most - low.0));
    }
    if found.is_empty() {
        return std::iter::once(0..events.on.len()).collect();
    }
    let trimmed = found.into_iter().map(|(range, rise)| {
        let (mut level, mut start) = (0, range.start);
        for (index, sign) in range.clone().zip(signs(range.clone())) {
            level += sign;
            if level as f64 <= START * rise as f64 {
                start = index + 1;
            }
        }
        start..range.end
    });
    trimmed.collect()
}

/// Of whatever moved: a leaky integral of the events up to `t_us`, that forgets with `cutoff_hz` (0.5 to 1 Hz are usual).
#[must_use]
pub fn leaky(events: &Events, threshold: f64, cutoff_hz: f64, t_us: i64) -> LogIntensity {
    let mut integral = Leaky::new(events.width, events.height, threshold, cutoff_hz);
    events.iter().take_while(|event| event.t_us <= t_us).for_each(|event| integral.push(event));
    integral.at(t_us)
}

/// The leaky integral of a stream, event by event: each pixel's sum of thresholds, which decays between its events.
#[derive(Clone, Debug)]
pub struct Leaky {
    /// As it was at each pixel's last event.
    sums: LogIntensity,
    last_us: Vec<i64>,
    threshold: f32,
    cutoff_hz: f64,
}

impl Leaky {
    /// Nothing seen yet. `threshold` is an event's share of the logarithm of intensity; what is older than
    /// 1 / (2 pi `cutoff_hz`) seconds is forgotten.
    #[must_use]
    pub fn new(width: u32, height: u32, threshold: f64, cutoff_hz: f64) -> Self {
        let sums = LogIntensity::new(width, height);
        let last_us = vec![i64::MIN; sums.values.len()];
        Self { sums, last_us, threshold: threshold as f32, cutoff_hz }
    }

    /// Takes the next event; one outside the sensor counts nowhere.
    pub fn push(&mut self, event: Event) {
        let index = usize::from(event.y) * self.sums.width as usize + usize::from(event.x);
        let (decay, threshold) = (self.decay(self.last_us.get(index).copied(), event.t_us), self.threshold);
        let Some(value) = self.sums.at(event.x, event.y) else { return };
        *value = *value * decay + if event.on { threshold } else { -threshold };
        self.last_us[index] = event.t_us;
    }

    /// The picture at a time not before the last event.
    #[must_use]
    pub fn at(&self, t_us: i64) -> LogIntensity {
        let mut picture = self.sums.clone();
        for (value, &last) in picture.values.iter_mut().zip(&self.last_us) {
            *value *= self.decay(Some(last), t_us);
        }
        picture
    }

    /// What is left at a later time of what was there after a pixel's last event.
    fn decay(&self, last_us: Option<i64>, t_us: i64) -> f32 {
        let seconds = 1e-6 * last_us.map_or(0, |last| t_us.saturating_sub(last)) as f64;
        (-std::f64::consts::TAU * self.cutoff_hz * seconds).exp() as f32
    }
}

impl LogIntensity {
    fn new(width: u32, height: u32) -> Self {
        Self { width, height, values: vec![0.0; width as usize * height as usize] }
    }

    fn at(&mut self, x: u16, y: u16) -> Option<&mut f32> {
        let (x, y) = (u32::from(x), u32::from(y));
        if x >= self.width || y >= self.height {
            return None;
        }
        self.values.get_mut(y as usize * self.width as usize + x as usize)
    }

    /// Of an ordinary image, so that its features look like an event camera's.
    #[must_use]
    pub fn of_image(image: &ImageGrey8) -> Self {
        let light = |level: u8| srgb::decode(f32::from(level) / 255.0);
        let values = image.data.iter().map(|&level| (light(level) + 0.005).ln()).collect();
        Self { width: image.width, height: image.height, values }
    }

    /// An image of 8 bits: what varies more slowly than `radius_px` is taken out, single wild pixels are replaced by the median
    /// of their neighbours, and the rest is stretched.
    #[must_use]
    pub fn picture(&self, radius_px: u32) -> ImageGrey8 {
        let (width, height) = (self.width as usize, self.height as usize);
        let mut image = ImageGrey8::new(self.width, self.height);
        if self.values.is_empty() {
            return image;
        }
        let calm = without_wild_pixels(&self.values, width, height);
        let mut slow = calm.clone();
        // Three box filters are nearly a Gaussian.
        for _ in 0..3 {
            slow = box_filter(&slow, width, height, radius_px as usize);
        }
        let high: Vec<f32> = calm.iter().zip(&slow).map(|(value, slow)| value - slow).collect();
        let mut sorted = high.clone();
        sorted.sort_by(f32::total_cmp);
        let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
        let (low, top) = (at(CLIPPED), at(1.0 - CLIPPED));
        let range = if top > low { top - low } else { 1.0 };
        for (to, value) in image.data.iter_mut().zip(&high) {
            *to = (255.0 * ((value - low) / range).clamp(0.0, 1.0) + 0.5) as u8;
        }
        image
    }
}

/// Replaces what lies outside the range of its eight neighbours by the nearest end of that range.
fn without_wild_pixels(values: &[f32], width: usize, height: usize) -> Vec<f32> {
    let mut out = values.to_vec();
    for y in 0..height {
        for x in 0..width {
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for ny in y.saturating_sub(1)..(y + 2).min(height) {
                for nx in x.saturating_sub(1)..(x + 2).min(width) {
                    if (nx, ny) != (x, y) {
                        low = low.min(values[ny * width + nx]);
                        high = high.max(values[ny * width + nx]);
                    }
                }
            }
            if low <= high {
                out[y * width + x] = values[y * width + x].clamp(low, high);
            }
        }
    }
    out
}

/// The mean over a square of side 2 `radius` + 1, cut off at the edges.
fn box_filter(values: &[f32], width: usize, height: usize, radius: usize) -> Vec<f32> {
    let mut rows = vec![0.0; values.len()];
    let mut out = vec![0.0; values.len()];
    line_means(values, &mut rows, height, width, width, 1, radius);
    line_means(&rows, &mut out, width, height, 1, width, radius);
    out
}

/// Moving means along `lines` lines of `length` values; a line starts `between` after the one before, its values are `step`
/// apart.
fn line_means(from: &[f32], to: &mut [f32], lines: usize, length: usize, between: usize, step: usize, radius: usize) {
    let mut sums = vec![0.0_f64; length + 1];
    for line in 0..lines {
        let start = line * between;
        for index in 0..length {
            sums[index + 1] = sums[index] + f64::from(from[start + index * step]);
        }
        for index in 0..length {
            let (first, last) = (index.saturating_sub(radius), (index + radius + 1).min(length));
            to[start + index * step] = ((sums[last] - sums[first]) / (last - first) as f64) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    fn events(list: &[(i64, u16, u16, bool)]) -> Events {
        let mut events = Events::new(4, 3);
        list.iter().for_each(|&(t_us, x, y, on)| events.push(Event { t_us, x, y, on }));
        events
    }

    #[test]
    fn a_ramp_shows_what_is_brighter_by_how_much_whatever_its_speed() {
        // Intensities a factor e^0.6 apart; thresholds of 0.2, one of them 10 % high; light that grows steadily, and ever faster.
        let logs = [0.0, 0.6, 1.2, 1.8, 0.0, 0.6, 1.2, 1.8, 0.0, 0.6, 1.2, 1.8];
        let threshold = |pixel: usize| if pixel == 6 { 0.22 } else { 0.2 };
        for curve in [|light: f64| light, |light: f64| light.exp()] {
            let mut list = Vec::new();
            for (pixel, log) in logs.iter().enumerate() {
                for k in 1..=40 {
                    let light = f64::from(k) * threshold(pixel) - log;
                    if light < 5.0 {
                        list.push(((1e5 * curve(light + 3.0)) as i64, (pixel % 4) as u16, (pixel / 4) as u16, true));
                    }
                }
            }
            list.sort();
            let seen = dark_ramp(&events(&list), 0.2);
            // The clock is slow while few pixels see the light: the brightest steps come out smaller.
            for (pixel, log) in logs.iter().enumerate() {
                let brighter = f64::from(seen.values[pixel] - seen.values[pixel / 4 * 4]);
                assert!(brighter >= 0.5 * log && brighter < log + 0.2, "{pixel}: {brighter} {log}");
            }
            assert!((seen.values[6] - seen.values[2]).abs() < 0.15, "{} {}", seen.values[6], seen.values[2]);
            assert!(
                seen.values[3] > seen.values[2] && seen.values[2] > seen.values[1] && seen.values[1] > seen.values[0]
            );
        }
    }

    /// Events of light that rises from black at `start_us` within 0.2 s and goes off again, onto a sensor that is linear in the
    /// dark: pixels of these intensities and thresholds, with noise events at times of their own.
    fn rise(start_us: i64, intensities: &[f64], thresholds: &[f64], noise: u64) -> Vec<(i64, usize, bool)> {
        let mut list = Vec::new();
        for (pixel, (intensity, threshold)) in intensities.iter().zip(thresholds).enumerate() {
            let mut level = 0.0;
            for step in 0..2000 {
                let light = intensity * (10.0 * f64::from(step) / 2000.0 - 7.0).exp();
                while (1.0 + 10.0 * light).ln() > level + threshold {
                    level += threshold;
                    list.push((start_us + 100 * i64::from(step), pixel, true));
                }
            }
            let count = (level / threshold).round() as i64;
            list.extend((0..count).map(|off| (start_us + 200_000 + 50 * off, pixel, false)));
            for draw in 0..6 {
                let key = random::key(noise, &[pixel as u64, draw]);
                let t_us = start_us + (2e5 * random::uniform(key)) as i64;
                list.push((t_us, pixel, draw % 2 == 0));
            }
        }
        list.sort_unstable();
        list
    }

    /// Correlation of a ramp's picture with the intensities' logarithms.
    fn correlation(seen: &LogIntensity, intensities: &[f64]) -> f64 {
        let count = intensities.len() as f64;
        let centred = |values: Vec<f64>| -> Vec<f64> {
            let mean = values.iter().sum::<f64>() / count;
            values.into_iter().map(|value| value - mean).collect()
        };
        let a = centred(seen.values.iter().copied().map(f64::from).collect());
        let b = centred(intensities.iter().map(|value| value.ln()).collect());
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt()
    }

    #[test]
    fn repeated_ramps_are_told_apart_and_take_noise_out() {
        let (width, height) = (24, 18);
        let key = |purpose: u64, pixel: u32| random::key(purpose, &[u64::from(pixel)]);
        let varied = |purpose: u64, by: f64| -> Vec<f64> {
            (0..width * height).map(|pixel| (by * random::normal(key(purpose, pixel))).clamp(-1.0, 1.0).exp()).collect()
        };
        let intensities = varied(1, 0.4);
        let (even, uneven) =
            (vec![0.1; intensities.len()], varied(2, 0.2).iter().map(|by| 0.1 * by).collect::<Vec<_>>());
        let seen = |thresholds: &[f64], count: u64| {
            let mut events = Events::new(width, height);
            for ramp in 0..count {
                for (t_us, pixel, on) in rise(500_000 * ramp as i64, &intensities, thresholds, 7 + ramp) {
                    let (x, y) = ((pixel as u32 % width) as u16, (pixel as u32 / width) as u16);
                    events.push(Event { t_us, x, y, on });
                }
            }
            assert_eq!(ramps(&events).len(), count as usize);
            correlation(&dark_ramp(&events, 0.1), &intensities)
        };
        let mut best = Vec::new();
        for thresholds in [even, uneven] {
            let (once, often) = (seen(&thresholds, 1), seen(&thresholds, 4));
            assert!(often > once + 0.05, "{once} {often}");
            best.push(often);
        }
        // Thresholds that differ cost something, which late events give back in part.
        assert!(best[0] > 0.9 && best[1] > 0.75, "{best:?}");
    }

    #[test]
    fn the_leaky_integral_forgets_and_events_outside_the_sensor_count_nowhere() {
        let seen = events(&[
            (0, 1, 1, true),
            (10, 1, 1, true),
            (20, 2, 0, false),
            (500_000, 1, 1, true),
            (900_000, 9, 9, true),
        ]);
        // With a time constant of a second, half of it later.
        let cutoff = 1.0 / std::f64::consts::TAU;
        let half = leaky(&seen, 0.2, cutoff, 500_000);
        assert!((half.values[5] - (0.4 * (-0.5_f32).exp() + 0.2)).abs() < 1e-4, "{}", half.values[5]);
        assert_eq!(leaky(&seen, 0.2, cutoff, 5).values[5], 0.2 * (-5e-6_f32).exp());
        assert_eq!(leaky(&seen, 0.2, cutoff, 900_000).values.iter().filter(|value| **value != 0.0).count(), 2);
    }

    #[test]
    fn a_picture_keeps_edges_drops_gradients_and_wild_pixels() {
        let mut seen = LogIntensity::new(64, 32);
        for (index, value) in seen.values.iter_mut().enumerate() {
            let x = index % 64;
            *value = 0.05 * x as f32 + if (x / 4) % 2 == 0 { 0.0 } else { 0.3 };
        }
        seen.values[10 * 64 + 30] = 50.0;
        let picture = seen.picture(6);
        let row = |x: usize| i32::from(picture.data[16 * 64 + x]);
        assert!(row(22) - row(18) > 80 && row(22) - row(26) > 80, "stripes stay");
        assert!((row(18) - row(42)).abs() < 40, "the slope goes");
        let wild = i32::from(picture.data[10 * 64 + 30]);
        assert!((wild - row(30)).abs() < 60, "{wild} {}", row(30));
        assert_eq!(LogIntensity::new(3, 3).picture(2).data.len(), 9);
    }
}
