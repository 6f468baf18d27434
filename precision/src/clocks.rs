//! Fits of clocks: what pulses, jitter, windows and the robust start cost and give.

use erfgs_base::random::{key, normal, purpose, uniform};
use erfgs_session::clock::{Clock, Errors, Evidence, Robust, Sample};
use erfgs_sync::EDGES_WINDOW_NS;

use crate::{Bench, Component, Measure, Result, Size, Stopwatch, Study, component::About};

const ABOUT: About = About {
    name: "clock fit",
    truth: "Edges of a trigger board in the ticks of an event camera, 30 a second over ten minutes, each off by half a tick (1 µs) and \
            by jitter of 1 µs (standard deviation), one in a hundred off by up to 50 ms; the camera's clock is 40 ppm slow and wanders \
            by 2 ppm every five minutes. The truth is that clock, at a thousand instants.",
    work: "the fit",
    measures: &[
        Measure { name: "error of a time, root mean square", unit: "ns", logarithmic: true },
        Measure { name: "largest error of a time", unit: "ns", logarithmic: true },
    ],
};

#[derive(Clone, Copy, Debug, PartialEq)]
struct Setting {
    pulses: u64,
    jitter_ns: f64,
    outliers: f64,
    window_s: f64,
    robust: Robust,
}

const SECONDS: f64 = 600.0;
const PURPOSE: u64 = purpose("precision clock");

/// The session time of a tick, nanoseconds.
fn truth(ticks: f64) -> f64 {
    let seconds = 1e-6 * ticks;
    // A rate of 40 ppm + 2 ppm sin(2 pi t / 300 s), integrated.
    let turn = std::f64::consts::TAU / 300.0;
    1e9 * (seconds + 40e-6 * seconds + 2e-6 / turn * (1.0 - (turn * seconds).cos()))
}

impl Setting {
    fn samples(&self) -> Vec<Sample> {
        let sample = |k: u64| {
            let at = |word: u64| key(9, &[PURPOSE, k, word]);
            let ticks = (1e6 * SECONDS * k as f64 / (self.pulses - 1).max(1) as f64).round();
            let wrong = if uniform(at(1)) < self.outliers { 1e8 * (uniform(at(2)) - 0.5) } else { 0.0 };
            let off = 1000.0 * (uniform(at(3)) - 0.5) + self.jitter_ns * normal(at(4)) + wrong;
            Sample { ticks: ticks as i64, session_ns: (truth(ticks) + off).round() as i64 }
        };
        (0..self.pulses).map(sample).collect()
    }

    fn run(&self, stopwatch: &mut Stopwatch) -> Result<Vec<f64>> {
        let samples = self.samples();
        let window_ns = (1e9 * self.window_s) as i64;
        let fit = || {
            let evidence = Evidence::TriggerEdges;
            Ok(Clock::fit_with(&samples, 1000.0, evidence, Errors::Symmetric, window_ns, &self.robust)?)
        };
        let clock = stopwatch.time(fit)?;
        let errors = (0..=1000).map(|k| {
            let ticks = 1e3 * SECONDS * f64::from(k);
            (clock.session_ns(ticks as i64) as f64 - truth(ticks)).abs()
        });
        let squares: f64 = errors.clone().map(|error| error * error).sum();
        Ok(vec![(squares / 1001.0).sqrt(), errors.fold(0.0, f64::max)])
    }
}

/// The knobs of the fit.
#[must_use]
pub fn component(size: Size) -> Component {
    let robust = Robust::default();
    let window_s = EDGES_WINDOW_NS as f64 / 1e9;
    let default = Setting { pulses: 18_000, jitter_ns: 1000.0, outliers: 0.01, window_s, robust };
    let few = size == Size::Small;
    let study = Study::new(ABOUT, |_: &Bench, stopwatch: &mut Stopwatch, setting: &Setting| setting.run(stopwatch));
    let windows = |of: Setting| {
        let windows = [1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 300.0, 1e6];
        windows.into_iter().filter(move |window| !few || [of.window_s, 1e6].contains(window)).map(move |window_s| {
            let name = if window_s > SECONDS { "one line".into() } else { format!("{window_s} s") };
            (name, Setting { window_s, ..of })
        })
    };
    let study = study.knob("window", &default, windows(default));
    if few {
        return study.component();
    }
    let jitters = [0.0, 100.0, 1000.0, 10_000.0, 100_000.0];
    let noisy = Setting { jitter_ns: 10_000.0, ..default };
    let spoilt = Setting { outliers: 0.3, ..default };
    let starts = |of: Setting| {
        [5, 11, 25, 51, 101, 201, 401].map(|start_samples: usize| {
            (start_samples.to_string(), Setting { robust: Robust { start_samples, ..robust }, ..of })
        })
    };
    let factor = |outlier_factor: f64| {
        let name = if outlier_factor > 1e6 { "least squares of all".into() } else { outlier_factor.to_string() };
        (name, Setting { robust: Robust { outlier_factor, ..robust }, ..default })
    };
    study
        .knob(
            "number of pulses",
            &default,
            [30, 100, 300, 1000, 3000, 18_000, 60_000, 180_000]
                .map(|pulses| (pulses.to_string(), Setting { pulses, ..default })),
        )
        .knob(
            "jitter",
            &default,
            jitters.map(|jitter_ns| (format!("{} µs", 1e-3 * jitter_ns), Setting { jitter_ns, ..default })),
        )
        .knob("window, jitter of 10 µs", &noisy, windows(noisy))
        .knob("samples of the robust start", &default, starts(default))
        .knob("samples of the robust start, three pulses in ten wrong", &spoilt, starts(spoilt))
        .knob("median distances of an outlier", &default, [2.0, 3.0, 5.0, 9.0, 20.0, 100.0, 1e12].map(factor))
        .component()
}
