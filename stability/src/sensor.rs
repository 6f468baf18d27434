//! The event simulator at its edges.
//!
//! The mode `enhanced` is compared event by event with a pixel in `f64`; what the events of the mode `parity` add up to, with what
//! v2e's rule makes of the signal.

use std::f64::consts::TAU;

use erfgs_events::Events;
use erfgs_replay::{Luma, Mode, Simulator, SimulatorConfig};

use crate::{
    Bound, Case, Expected, Measured, Refusal, Size,
    pixel::{Pixel, log_of},
};

const PART: &str = "event simulator";

/// Its name, and the truth of its cases.
pub(crate) const ABOUT: [&str; 2] = [
    PART,
    "The mode `enhanced` is compared event by event with a pixel in `f64`; what the events of the mode `parity` add up to, with what v2e's rule makes of the signal in `f64`.",
];

const TIMES: &str = "half a microsecond of rounding, and states in f32: 2^-22 of log intensity a frame, over the slope";
const SUM: &str = "less than a threshold is left over at the end";
/// What one frame may round the states of a pixel by, natural-log intensity.
const ROUNDED: f64 = 1.0 / 4_194_304.0;
const MS: i64 = 1_000_000;

/// What the pixels of a sensor see: times, nanoseconds, and grey levels.
type Film = Vec<(i64, Vec<f32>)>;

/// `count` frames every `step_ns`, where pixel `x` of `width` has the grey level `level(k, x)` in frame `k`.
fn film(count: usize, step_ns: i64, width: usize, level: impl Fn(usize, usize) -> f64) -> Film {
    let frame = |k: usize| (0..width).map(|x| level(k, x) as f32).collect();
    (0..count).map(|k| (k as i64 * step_ns, frame(k))).collect()
}

/// What pixel `x` sees: seconds and grey levels.
fn seen(film: &Film, x: usize) -> Vec<(f64, f64)> {
    film.iter().map(|(t_ns, levels)| (*t_ns as f64 * 1e-9, f64::from(levels[x]))).collect()
}

fn width(film: &Film) -> usize {
    film.first().map_or(0, |(_, levels)| levels.len())
}

/// The events of each pixel: microseconds, ON.
fn simulate(config: &SimulatorConfig, film: &Film) -> Result<Vec<Vec<(i64, bool)>>, Refusal> {
    let width = width(film);
    let mut simulator = Simulator::new(width as u32, 1, config, 0)?;
    let mut events = Events::new(width as u32, 1);
    for (t_ns, levels) in film {
        simulator.step(Luma::F32(levels), *t_ns, &mut events)?;
    }
    let mut by_pixel = vec![Vec::new(); width];
    for event in events.iter() {
        by_pixel[usize::from(event.x)].push((event.t_us, event.on));
    }
    Ok(by_pixel)
}

/// The largest error of a time, microseconds; infinite where an event is missing, false, or of the other polarity.
fn times(pixel: &Pixel, film: &Film, mode: Mode) -> Result<Measured, Refusal> {
    let config = SimulatorConfig {
        mode,
        threshold_on: pixel.threshold,
        threshold_off: pixel.threshold,
        cutoff_hz: pixel.cutoff_hz,
        refractory_s: pixel.refractory_s,
        ..SimulatorConfig::default()
    };
    let mut measured = Measured::default();
    for (x, events) in simulate(&config, film)?.into_iter().enumerate() {
        let truth = pixel.events(&seen(film, x));
        let signed = |time: f64, on: bool| if on { time } else { -time };
        let computed = events.iter().map(|&(t_us, on)| signed(t_us as f64, on));
        measured = measured.and(Measured::between(computed, truth.iter().map(|of| signed(1e6 * of.time, of.on))));
    }
    Ok(measured)
}

/// The mode `enhanced` against the pixel in `f64`.
fn enhanced(name: String, pixel: Pixel, film: Film) -> Case {
    let slopes = (0..width(&film)).flat_map(|x| pixel.events(&seen(&film, x))).map(|event| event.slope.abs());
    let slowest = slopes.fold(f64::INFINITY, f64::min);
    let most = 0.5 + 1e6 * ROUNDED * film.len() as f64 / slowest;
    let bound = Bound { most, unit: "µs", why: TIMES };
    Case::new(PART, name, Expected::Within(bound), move |_| times(&pixel, &film, Mode::Enhanced))
}

/// The mode `parity`: what the events add up to against v2e's forward Euler low-pass, clamped to one, in `f64`.
fn parity(name: String, pixel: Pixel, film: Film) -> Case {
    let bound = Bound { most: 1.0 + 1e-3, unit: "thresholds", why: SUM };
    Case::new(PART, name, Expected::Within(bound), move |_| {
        let config = SimulatorConfig {
            threshold_on: pixel.threshold,
            threshold_off: pixel.threshold,
            cutoff_hz: pixel.cutoff_hz,
            ..SimulatorConfig::default()
        };
        let mut measured = Measured::default();
        for (x, events) in simulate(&config, &film)?.into_iter().enumerate() {
            let frames = seen(&film, x);
            let first = log_of(frames[0].1);
            let (mut output, mut sums) = (first, Vec::new());
            for pair in frames.windows(2) {
                let [(before, _), (now, level)] = [pair[0], pair[1]];
                let share = ((now - before) * TAU * pixel.cutoff_hz * (level + 20.0) / 275.0).min(1.0);
                output += share * (log_of(level) - output);
                let steps = events.iter().filter(|&&(t_us, _)| t_us as f64 <= 1e6 * now + 0.5);
                let sum = steps.map(|&(_, on)| if on { 1.0 } else { -1.0 }).sum::<f64>();
                sums.push((sum, (output - first) / pixel.threshold));
            }
            measured = measured.and(Measured::between(sums.iter().map(|of| of.0), sums.iter().map(|of| of.1)));
        }
        Ok(measured)
    })
}

fn refusal(name: &str, names: &'static str, config: SimulatorConfig, film: Film) -> Case {
    Case::new(PART, name, Expected::Refusal(names), move |_| {
        simulate(&config, &film)?;
        Ok(Measured::default())
    })
}

/// The cases of the event simulator.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    let full = size == Size::Full;
    let mut cases = Vec::new();
    let plain = Pixel { threshold: 0.2, cutoff_hz: 0.0, refractory_s: 0.0 };

    // Between two levels, eight frames of 10 ms each. They grow a little: a signal that comes back to where it began has a contrast
    // of a whole number of thresholds there, and rounding decides whether that is an event.
    let flips = film(48, 10 * MS, 24, |k, x| {
        let level = if k / 8 % 2 == 0 { 3.0 + 2.0 * x as f64 } else { 90.0 + 7.0 * x as f64 };
        level * (1.0 + 0.003 * (k / 8) as f64)
    });
    for decade in (-3..=6).filter(|decade| full || [-3, 0, 6].contains(decade)) {
        let pixel = Pixel { threshold: 0.021, cutoff_hz: 100.0 * 10_f64.powi(decade), refractory_s: 0.0 };
        let name = |mode| format!("{mode}: photoreceptor cut-off times step 1e{decade}");
        cases.push(enhanced(name("enhanced"), pixel, flips.clone()));
        cases.push(parity(name("parity"), pixel, flips.clone()));
    }
    // A swing of log intensity by 1.5 and back.
    let swing = film(100, 10 * MS, 24, |k, x| {
        (3.5 + 0.75 * (1.0 - (0.13 * k as f64 + 0.05 * x as f64).cos()) + 0.01 * x as f64).exp()
    });
    for threshold in [0.01, 0.03, 0.1, 0.3, 1.0].into_iter().filter(|of| full || [0.01, 1.0].contains(of)) {
        cases.push(enhanced(format!("enhanced: threshold {threshold}"), Pixel { threshold, ..plain }, swing.clone()));
    }
    // From black to a million times the unit and back, in leaps.
    let leaps = [0.0, 1e6, 1.0, 3e4, 1e-3, 255.0, 1e6, 0.5];
    let leaping =
        film(16, 10 * MS, 8, |k, x| leaps[(k / 2 + x) % 8] * (1.0 - 0.01 * x as f64 + 0.003 * (k / 2) as f64));
    cases.push(enhanced("enhanced: intensities 0 to 1e6".into(), plain, leaping.clone()));
    let filtered = Pixel { cutoff_hz: 300.0, ..plain };
    cases.push(enhanced(
        "enhanced: intensities 0 to 1e6 through a low-pass of 300 Hz".into(),
        filtered,
        leaping.clone(),
    ));
    cases.push(parity("parity: intensities 0 to 1e6 through a low-pass of 300 Hz".into(), filtered, leaping));

    // Light that flickers at 10 kHz, a little less than ten frames a period.
    let flicker = |step_ns: i64, count| {
        film(count, step_ns, 8, move |k, x| {
            let phase = TAU * (1e4 * 1e-9 * (k as i64 * step_ns) as f64) + 0.3 * x as f64;
            100.0 * (1.0 + (0.5 + 0.01 * x as f64) * phase.sin())
        })
    };
    cases.push(enhanced("enhanced: 10 kHz flicker of 50 %".into(), plain, flicker(10_310, 200)));
    let slow = Pixel { cutoff_hz: 200.0, ..plain };
    cases.push(enhanced("enhanced: 10 kHz flicker behind a low-pass of 200 Hz".into(), slow, flicker(10_310, 2000)));
    cases.push(enhanced(
        "enhanced: 10 kHz flicker in frames of 1 kHz, all alike".into(),
        plain,
        flicker(1_000_000, 50),
    ));
    // Frames every millisecond.
    let quick = film(200, MS, 16, |k, x| (4.0 + (0.05 * k as f64 + 0.2 * x as f64).sin()).exp());
    for refractory_s in [0.0137, 10.0] {
        let pixel = Pixel { refractory_s, ..plain };
        let name = format!("enhanced: refractory period of {:.0} steps", refractory_s * 1e3);
        cases.push(enhanced(name, pixel, quick.clone()));
    }
    for (name, step_ns, count) in [("1 ms", 10_000, 101), ("1 h", 10_000_000_000, 361)] {
        let wave = film(count, step_ns, 8, |k, x| (4.0 + (0.7 * k as f64 + 0.4 * x as f64).sin()).exp());
        cases.push(enhanced(format!("enhanced: a recording of {name}"), plain, wave.clone()));
        cases.push(parity(format!("parity: a recording of {name}"), Pixel { cutoff_hz: 1e9, ..plain }, wave));
    }
    for (name, level) in [("all black", 0.0), ("saturated", 255.0)] {
        cases.push(enhanced(format!("enhanced: {name}, not one event"), filtered, film(20, 10 * MS, 16, |_, _| level)));
    }
    let config = SimulatorConfig { mode: Mode::Enhanced, ..SimulatorConfig::default() };
    let two = |level: f32| vec![(0, vec![1.0]), (MS, vec![level])];
    let fine = SimulatorConfig { threshold_on: 1e-4, ..config.clone() };
    cases.push(refusal("threshold 1e-4", "threshold_on", fine, two(2.0)));
    let quickest = SimulatorConfig { cutoff_hz: 1e13, ..config.clone() };
    cases.push(refusal("cut-off at 1e13 Hz", "cutoff_hz", quickest, two(2.0)));
    cases.push(refusal("an intensity that is no number", "luma NaN", config.clone(), two(f32::NAN)));
    cases.push(refusal("a negative intensity", "luma -1", config.clone(), two(-1.0)));
    let apart = vec![(0, vec![1.0]), (33_000_000 * MS, vec![2.0])];
    cases.push(refusal("cut-off 30 Hz, times step 1e6: nine hours a step", "more than an hour", config, apart));
    cases
}
