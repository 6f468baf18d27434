//! Fits against clocks whose truth is known.

use proptest::prelude::*;

use super::{
    line::{fit_line, fit_lower_envelope},
    *,
};
use erfgs_base::random;

/// A device clock: session time of a tick, for ticks of 1 µs. `ppm` at the start, `drift` ppm more for each minute.
fn truth(ticks: f64, ppm: f64, drift: f64) -> f64 {
    let seconds = ticks * 1e-6;
    12_345_678.0 + ticks * 1000.0 * (1.0 + ppm * 1e-6) + 0.5 * drift / 60.0 * 1e-6 * seconds * seconds * 1e9
}

fn uniform(n: u64, purpose: u64) -> f64 {
    random::range(random::key(5, &[n, purpose]), 0.0, 1.0)
}

/// Edges at 30 Hz over so many seconds, seen with a resolution of 1 µs.
fn edges(seconds: f64, ppm: f64, drift: f64) -> Vec<Sample> {
    (0..(seconds * 30.0) as i64)
        .map(|n| {
            let exact = n as f64 * 1e6 / 30.0 + 77.7;
            Sample { ticks: exact.floor() as i64, session_ns: truth(exact, ppm, drift).round() as i64 }
        })
        .collect()
}

/// Arrivals every millisecond, late by 150 µs and an exponential delay of 300 µs, one in 200 by up to 20 ms.
fn arrivals(seconds: f64, ppm: f64, drift: f64) -> Vec<Sample> {
    (0..(seconds * 1000.0) as u64)
        .map(|n| {
            let uniform = |purpose: u64| uniform(n, purpose);
            let delay = 150e3 - 300e3 * uniform(0).ln() + if uniform(1) < 0.005 { 20e6 * uniform(2) } else { 0.0 };
            let ticks = n as f64 * 1000.0;
            Sample { ticks: ticks as i64, session_ns: (truth(ticks, ppm, drift) + delay) as i64 }
        })
        .collect()
}

fn errors_ns(clock: &Clock, samples: &[Sample], ppm: f64, drift: f64) -> Residuals {
    Residuals::of(
        samples
            .iter()
            .map(|sample| (clock.session_ns(sample.ticks) as f64 - truth(sample.ticks as f64, ppm, drift)).abs())
            .collect(),
    )
}

const US: f64 = 1000.0;

#[test]
fn edges_of_a_drifting_clock_are_followed_to_2_us() {
    for (ppm, drift, seconds) in [(100.0, 1.0, 600.0), (-100.0, -1.0, 120.0), (100.0, 1.0, 15.0), (-500.0, 0.0, 60.0)] {
        let samples = edges(seconds, ppm, drift);
        let clock = Clock::fit(&samples, 1000.0, Evidence::TriggerEdges, Errors::Symmetric, 10_000_000_000).unwrap();
        let error = errors_ns(&clock, &samples, ppm, drift);
        // Half a microsecond of it is the tick that was cut off.
        assert!(error.p95_ns < 2.0 * US && error.max_ns < 2.0 * US, "{ppm} {drift} {seconds}: {error:?}");
        assert!(clock.residuals.p95_ns < 1.5 * US, "{:?}", clock.residuals);
        assert!((clock.rate_error_ppm() - ppm).abs() < drift.abs() * seconds / 60.0 + 0.1);
    }
}

#[test]
fn a_steady_clock_stays_one_line_and_a_drifting_one_does_not() {
    let fit = |drift| {
        let samples = edges(120.0, 40.0, drift);
        Clock::fit(&samples, 1000.0, Evidence::TriggerEdges, Errors::Symmetric, 10_000_000_000).unwrap().pieces.len()
    };
    assert_eq!(fit(0.0), 1);
    assert!(fit(1.0) > 5);
}

#[test]
fn late_arrivals_give_the_clock_to_200_us_but_for_the_least_delay() {
    for (ppm, drift, seconds) in [(100.0, 1.0, 60.0), (-100.0, -1.0, 300.0), (100.0, 0.0, 2.0)] {
        let samples = arrivals(seconds, ppm, drift);
        let clock = Clock::fit(&samples, 1000.0, Evidence::Arrival, Errors::Late, 60_000_000_000).unwrap();
        let error = errors_ns(&clock, &samples, ppm, drift);
        assert!(error.p95_ns < 200.0 * US, "{ppm} {drift} {seconds}: {error:?}");
        assert_eq!(clock.evidence(), Some(Evidence::Arrival));
    }
}

#[test]
fn a_resonator_is_believed_in_where_its_rate_is_clear() {
    for ppm in [4900.0, -3100.0, 9000.0] {
        let fit = fit_line(&edges(2.0, ppm, 0.0), 1000.0, Evidence::TriggerEdges, &Robust::default()).unwrap();
        assert!((fit.rate_error_ppm(1000.0) - ppm).abs() < 1.0, "{ppm}: {}", fit.rate_error_ppm(1000.0));
        let fit = fit_lower_envelope(&arrivals(2.0, ppm, 0.0), 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
        assert!((fit.rate_error_ppm(1000.0) - ppm).abs() < 100.0, "{ppm}: {}", fit.rate_error_ppm(1000.0));
    }
    // A crystal of which a busy host took a few packets, several at one time: no rate that is found of it is far off.
    for seed in 0..2000 {
        let random = |n: u64, purpose: u64| uniform(1000 * seed + n, purpose);
        let (count, apart_us) = (8 + (40.0 * random(0, 1)) as u64, 500.0 + 8000.0 * random(0, 2));
        let mut late_ns = 0.0;
        let sample = |n: u64| {
            let ticks = n as f64 * apart_us;
            if random(n, 3) < 0.3 {
                late_ns = 20e6 * random(n, 4);
            }
            // Those that wait are taken together.
            late_ns = f64::max(late_ns - apart_us * 1000.0, 200_000.0 * random(n, 5));
            Sample { ticks: ticks as i64, session_ns: (truth(ticks, 30.0, 0.0) + late_ns) as i64 }
        };
        let samples: Vec<Sample> = (0..count).map(sample).collect();
        for fit in [fit_line, fit_lower_envelope] {
            let found = fit(&samples, 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
            assert!(found.rate_error_ppm(1000.0).abs() <= 1000.1, "{seed}: {}", found.rate_error_ppm(1000.0));
        }
    }
}

#[test]
fn a_chain_of_lines_is_continuous() {
    let samples = edges(120.0, 40.0, 3.0);
    let clock = Clock::fit(&samples, 1000.0, Evidence::TriggerEdges, Errors::Symmetric, 10_000_000_000).unwrap();
    let steps: Vec<i64> =
        (0..120_000).map(|ms| clock.session_ns((ms + 1) * 1000) - clock.session_ns(ms * 1000)).collect();
    assert!(steps.iter().all(|&step| (step - 1_000_040).abs() < 200), "{:?}", steps.iter().max());
}

#[test]
fn three_outliers_in_ten_change_nothing() {
    let mut samples = edges(60.0, 100.0, 0.0);
    for (n, sample) in samples.iter_mut().enumerate() {
        if uniform(n as u64, 0) < 0.3 {
            sample.session_ns += (uniform(n as u64, 1) * 400e6) as i64 - 100_000_000;
        }
    }
    let fit = fit_line(&samples, 1000.0, Evidence::TriggerEdges, &Robust::default()).unwrap();
    assert!((fit.rate_error_ppm(1000.0) - 100.0).abs() < 0.05, "{}", fit.rate_error_ppm(1000.0));
    assert!((480..=600).contains(&fit.outliers), "{}", fit.outliers);
    let error = errors_ns(&Clock::line(fit, 1000.0), &edges(60.0, 100.0, 0.0), 100.0, 0.0);
    assert!(error.max_ns < 2.0 * US, "{error:?}");
}

#[test]
fn device_times_damaged_upwards_do_not_pull_the_envelope_down() {
    let mut samples = arrivals(20.0, 30.0, 0.0);
    for n in (100..samples.len()).step_by(1000) {
        samples[n].ticks += 4_000_000;
    }
    let fit = fit_lower_envelope(&samples, 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
    assert!(fit.outliers >= 19, "{}", fit.outliers);
    let error = errors_ns(&Clock::line(fit, 1000.0), &arrivals(20.0, 30.0, 0.0), 30.0, 0.0);
    assert!(error.max_ns < 200.0 * US, "{error:?}");
}

#[test]
fn no_sample_is_an_error_and_one_gives_the_nominal_rate() {
    for fit in [fit_line, fit_lower_envelope] {
        assert_eq!(fit(&[], 1000.0, Evidence::Arrival, &Robust::default()), Err(FitError::NoSamples));
        let one = Sample { ticks: 5_000_000_000_000, session_ns: -3 };
        let single = fit(&[one], 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
        assert_eq!((single.session_ns(one.ticks), single.ns_per_tick), (-3, 1000.0));
        assert_eq!(single.session_ns(one.ticks + 2), 1997);
        assert_eq!(single.ticks(1997), one.ticks + 2);
        let same = fit(&[one; 7], 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
        assert_eq!((same.session_ns(one.ticks), same.ns_per_tick, same.samples), (-3, 1000.0, 7));
    }
}

#[test]
fn two_samples_give_their_line_unless_no_crystal_can_be_that_far_off() {
    let at = |ticks, session_ns| Sample { ticks, session_ns };
    for fit in [fit_line, fit_lower_envelope] {
        let line =
            fit(&[at(0, 10), at(1_000_000, 1_000_100_010)], 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
        assert!((line.ns_per_tick - 1000.1).abs() < 1e-9);
        assert_eq!(line.residuals.max_ns.round(), 0.0);
        let jitter = fit(&[at(0, 0), at(1000, 3_000_000)], 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
        assert_eq!(jitter.ns_per_tick, 1000.0);
    }
}

#[test]
fn ten_hours_at_500_ppm_are_exact_to_the_tick() {
    let samples: Vec<Sample> = (0..36_000_i64)
        .map(|second| {
            let ticks = (1 << 50) + second * 1_000_000;
            Sample { ticks, session_ns: 7 + second * 1_000_500_000 }
        })
        .collect();
    for fit in [fit_line, fit_lower_envelope] {
        let line = fit(&samples, 1000.0, Evidence::Arrival, &Robust::default()).unwrap();
        for sample in &samples {
            assert!((line.session_ns(sample.ticks) - sample.session_ns).abs() <= 1);
        }
    }
}

proptest! {
    #[test]
    fn no_samples_whatsoever_make_a_fit_panic(
        samples in prop::collection::vec((any::<i64>(), any::<i64>()), 0..80),
        probe in any::<i64>(),
    ) {
        let samples: Vec<Sample> =
            samples.into_iter().map(|(ticks, session_ns)| Sample { ticks, session_ns }).collect();
        for errors in [Errors::Symmetric, Errors::Late] {
            let fit = Clock::fit(&samples, 62.5, Evidence::Arrival, errors, 1_000_000);
            prop_assert_eq!(fit.is_err(), samples.is_empty());
            if let Ok(clock) = fit {
                let _ = (clock.session_ns(probe), clock.rate_error_ppm());
                prop_assert!(clock.pieces.iter().all(|piece| piece.ns_per_tick.is_finite()));
            }
        }
    }
}
