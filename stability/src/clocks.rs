//! Fits of clocks on hours, milliseconds, drifts, late arrivals and broken samples, against the clock that the samples were drawn
//! from.

use erfgs_base::random::{key, normal, uniform};
use erfgs_session::clock::{Clock, Errors, Evidence, Sample};

use crate::{Bound, Case, Expected, Measured, Refusal, Size};

const PART: &str = "clock fits";
const TICK: Bound =
    Bound { most: 1000.0, unit: "ns", why: "a tick, 1 µs: what one edge may be off, which many edges average away" };
const DRIFT: Bound = Bound {
    most: 2000.0,
    unit: "ns",
    why: "a tick, and what a line over 10 s leaves of a drift of 1 ppm a minute, with the half windows at both ends",
};
const LATE: Bound = Bound {
    most: 95_000.0,
    unit: "ns",
    why: "80 µs that nothing arrives sooner, and what a minute's luckiest arrival is later than that (15 µs)",
};

/// A clock that counts microseconds and is off.
#[derive(Clone, Copy)]
struct Crystal {
    /// Session time at tick 0, nanoseconds.
    offset_ns: f64,
    /// First tick.
    first: i64,
    ppm: f64,
    /// Parts per million more for each minute.
    drift: f64,
}

impl Crystal {
    /// The session time of a tick, nanoseconds.
    fn truth(&self, ticks: i64) -> f64 {
        let seconds = (ticks - self.first) as f64 * 1e-6;
        self.offset_ns + 1e9 * (seconds * (1.0 + self.ppm * 1e-6) + 0.5 * self.drift * 1e-6 / 60.0 * seconds * seconds)
    }

    /// `count` samples over `seconds`, each of which comes so much later as `late` says, nanoseconds.
    fn samples(&self, seconds: f64, count: u64, late: impl Fn(u64) -> f64) -> Vec<Sample> {
        let sample = |k: u64| {
            let ticks = self.first + (1e6 * seconds * k as f64 / count.max(2).saturating_sub(1) as f64).round() as i64;
            Sample { ticks, session_ns: (self.truth(ticks) + late(k)).round() as i64 }
        };
        (0..count).map(sample).collect()
    }

    /// The largest error over the ticks of the samples and between them, nanoseconds.
    fn against(&self, clock: &Clock, samples: &[Sample]) -> Measured {
        let [Some(first), Some(last)] = [samples.first(), samples.last()] else { return Measured::default() };
        let ticks = |k: i64| first.ticks + ((last.ticks - first.ticks) as f64 * k as f64 / 1000.0) as i64;
        let ticks: Vec<i64> = (0..=1000).map(ticks).collect();
        // Distances, so that an hour in nanoseconds does not round the difference.
        Measured::between(
            ticks.iter().map(|&at| clock.session_ns(at) as f64 - self.truth(at)),
            std::iter::repeat_n(0.0, ticks.len()),
        )
    }
}

fn exponential(k: u64) -> f64 {
    -(1.0 - uniform(key(5, &[k, 1]))).ln()
}

/// An edge is told in whole ticks.
fn in_ticks(k: u64) -> f64 {
    1000.0 * uniform(key(5, &[k, 2])) - 500.0
}

fn case(name: &str, bound: Bound, crystal: Crystal, errors: Errors, samples: Vec<Sample>) -> Case {
    Case::new(PART, name, Expected::Within(bound), move |_| {
        let (evidence, window_ns) = match errors {
            Errors::Symmetric => (Evidence::TriggerEdges, 10_000_000_000),
            Errors::Late => (Evidence::Arrival, 60_000_000_000),
        };
        let clock = Clock::fit(&samples, 1000.0, evidence, errors, window_ns)?;
        Ok(crystal.against(&clock, &samples))
    })
}

/// The cases of clocks.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    let steady = Crystal { offset_ns: 3.3e9, first: 17, ppm: 100.0, drift: 0.0 };
    let drifting = Crystal { drift: 1.0, ..steady };
    let hour = 3600.0;
    let edges = |of: Crystal, seconds: f64, count| of.samples(seconds, count, in_ticks);
    let broken = |k: u64| if k % 10 == 3 { 1e9 * normal(key(5, &[k, 3])) } else { in_ticks(k) };
    let late = |k: u64| 80e3 + 200e3 * exponential(k);
    let early = Crystal { first: i64::MAX / 4, offset_ns: 0.0, ..steady };
    let mut cases = vec![
        case("an hour of edges, 100 ppm", TICK, steady, Errors::Symmetric, edges(steady, hour, 108_000)),
        case("a millisecond of edges", TICK, steady, Errors::Symmetric, edges(steady, 1e-3, 30)),
        case("one edge", TICK, steady, Errors::Symmetric, edges(steady, 1.0, 1)),
        case("two edges", TICK, steady, Errors::Symmetric, edges(steady, 1.0, 2)),
        case(
            "an hour of edges, a tenth of them off by a second",
            TICK,
            steady,
            Errors::Symmetric,
            steady.samples(hour, 108_000, broken),
        ),
        case("ticks that began 73,000 years ago", TICK, early, Errors::Symmetric, edges(early, 600.0, 18_000)),
        case("an hour of late arrivals, 100 ppm", LATE, steady, Errors::Late, steady.samples(hour, 360_000, late)),
        Case::new(PART, "nothing to fit", Expected::Refusal("no samples"), |_| -> Result<Measured, Refusal> {
            Clock::fit(&[], 1000.0, Evidence::TriggerEdges, Errors::Symmetric, 1)?;
            Ok(Measured::default())
        }),
    ];
    let minutes = if size == Size::Full { 60.0 } else { 10.0 };
    let name = format!("{minutes} min of edges whose rate drifts by 1 ppm a minute");
    let count = (1800.0 * minutes) as u64;
    cases.push(case(&name, DRIFT, drifting, Errors::Symmetric, edges(drifting, 60.0 * minutes, count)));
    cases
}
