//! Fits of clocks on hours, milliseconds, drifts, late arrivals and broken samples, against the clock that the samples were drawn
//! from.

use erfgs_base::random::{exponential, key, normal, uniform};
use erfgs_session::clock::{Clock, Epoch, Epochs, Errors, Evidence, Sample};
use erfgs_sync::{Arrived, even};

use crate::{Bench, Bound, Case, Expected, Measured, Refusal, Size};

const PART: &str = "clock fits";

/// Its name, and the truth of its cases.
pub(crate) const ABOUT: [&str; 2] = [PART, "The clock that the samples were drawn from, at a thousand instants."];

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

const FRAMES: Bound = Bound {
    most: 40_000.0,
    unit: "ns",
    why: "a line through 300 stamps that are off by 58 µs (rms) is off by 7 µs (rms) at its ends; 108,000 frames see six times that",
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

/// A device that starts again at tick 0 in the middle, half an hour in, and says so.
fn restarted(_: &Bench) -> Result<Measured, Refusal> {
    let first = Crystal { offset_ns: 2e9, first: 0, ppm: 60.0, drift: 0.0 };
    let second = Crystal { offset_ns: 1_805e9, ppm: -60.0, ..first };
    let mut epochs = Vec::new();
    let mut samples = Vec::new();
    for (packet, crystal) in [(0, first), (1000, second)] {
        let of_it = crystal.samples(1800.0, 54_000, in_ticks);
        let clock = Clock::fit(&of_it, 1000.0, Evidence::TriggerEdges, Errors::Symmetric, 10_000_000_000)?;
        epochs.push(Epoch { first_sequence: packet, first_break: 0, arrived_ns: 0, clock: Some(clock) });
        samples.push((packet, crystal));
    }
    let epochs = Epochs::from(epochs);
    let mut cursor = epochs.follow();
    let mut errors = Vec::new();
    for (packet, crystal) in samples {
        cursor.packet(packet + 3);
        let ticks = (0..=1000).map(|k: i64| k * 1_800_000);
        errors.extend(ticks.map(|at| match cursor.session_ns(at.unsigned_abs()) {
            Some(session_ns) => session_ns as f64 - crystal.truth(at),
            None => f64::NAN,
        }));
    }
    let none = vec![0.0; errors.len()];
    Ok(Measured::between(errors, none))
}

/// An hour of a camera at 30 frames a second whose stamps jitter, and whose phase jumps by 10 ms in the middle.
fn frames(_: &Bench) -> Result<Measured, Refusal> {
    let truth = |k: u64| 33_334_100.0 * k as f64 + if k >= 54_000 { 10e6 } else { 0.0 };
    let stamp = |k: u64| truth(k) + 200e3 * (uniform(key(5, &[k, 4])) - 0.5);
    let arrived = |k: u64| Arrived { sequence: k, stamp_ns: stamp(k).round() as i64 };
    let stamps: Vec<Arrived> = (0..108_000).map(arrived).collect();
    let counts: Vec<u64> = (0..108_000).collect();
    let even = even(&stamps, &counts);
    Ok(Measured::between(even.at_ns.iter().map(|&at| at as f64), (0..108_000).map(truth)))
}

/// The cases of clocks.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    let steady = Crystal { offset_ns: 3.3e9, first: 17, ppm: 100.0, drift: 0.0 };
    let drifting = Crystal { drift: 1.0, ..steady };
    let hour = 3600.0;
    let edges = |of: Crystal, seconds: f64, count| of.samples(seconds, count, in_ticks);
    let broken = |k: u64| if k % 10 == 3 { 1e9 * normal(key(5, &[k, 3])) } else { in_ticks(k) };
    let late = |k: u64| 80e3 + 200e3 * exponential(key(5, &[k, 1]));
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
    cases.push(Case::new(PART, "a device that restarts in the middle of an hour", Expected::Within(TICK), restarted));
    let name_of_frames = "an hour of frames whose stamps jitter by 100 µs, with a jump of phase";
    cases.push(Case::new(PART, name_of_frames, Expected::Within(FRAMES), frames));
    cases.push(case(&name, DRIFT, drifting, Errors::Symmetric, edges(drifting, 60.0 * minutes, count)));
    cases
}
