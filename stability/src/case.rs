//! A case, what must come of it, and what came.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
};

use erfgs_base::cpu;
use erfgs_splat::{
    gpu::Gpu,
    raster::{RasterError, Rasteriser},
};
use serde::Serialize;

/// How much of the suite runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Size {
    /// Some cases of every part, in seconds.
    Small,
    /// All cases.
    Full,
}

/// What the cases compute on.
#[derive(Debug)]
pub struct Bench {
    /// The device.
    pub gpu: Gpu,
    /// Its rasteriser.
    pub rasteriser: Rasteriser,
}

impl Bench {
    /// Compiles what the cases need.
    ///
    /// # Errors
    /// Where the device fails.
    pub fn new(gpu: Gpu) -> Result<Self, RasterError> {
        let rasteriser = Rasteriser::new(&gpu)?;
        Ok(Self { gpu, rasteriser })
    }
}

/// A largest error, and why it may be as large as that.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bound {
    /// The largest error.
    pub most: f64,
    /// Its unit.
    pub unit: &'static str,
    /// Where it comes from.
    pub why: &'static str,
}

/// What must come of a case.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Expected {
    /// Finite numbers within a bound.
    Within(Bound),
    /// A refusal whose message names this.
    Refusal(&'static str),
    /// Finite numbers within a bound, or a refusal whose message names this.
    Either(Bound, &'static str),
}

/// What a case came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Measured {
    /// The largest error.
    pub error: f64,
    /// How many of the numbers that were computed are not finite.
    pub not_finite: u64,
}

impl Measured {
    /// The largest distance of two lists of the same length; infinite where they are of different lengths.
    pub fn between(computed: impl IntoIterator<Item = f64>, truth: impl IntoIterator<Item = f64>) -> Self {
        let (mut computed, mut truth) = (computed.into_iter(), truth.into_iter());
        let mut measured = Self::default();
        loop {
            match (computed.next(), truth.next()) {
                (None, None) => return measured,
                (Some(computed), Some(truth)) if computed.is_finite() => {
                    measured.error = measured.error.max((computed - truth).abs());
                }
                (Some(_), Some(_)) => measured.not_finite += 1,
                _ => measured.error = f64::INFINITY,
            }
        }
    }

    /// The worse of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self { error: self.error.max(other.error), not_finite: self.not_finite + other.not_finite }
    }
}

/// Any of the libraries' errors.
pub type Refusal = Box<dyn std::error::Error + Send + Sync>;

type Run = dyn Fn(&Bench) -> Result<Measured, Refusal> + Send + Sync;

/// Something extreme, and what must come of it.
#[derive(Clone)]
pub struct Case {
    /// The part of the program.
    pub part: &'static str,
    /// What is done.
    pub name: String,
    /// What must come of it.
    pub expected: Expected,
    /// About how long it takes, in units of a quick case: what the time left is told by.
    pub weight: f64,
    run: Arc<Run>,
}

impl std::fmt::Debug for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.part, self.name)
    }
}

/// Whether what came of a case is what must.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub enum Verdict {
    /// All numbers are finite, and the error is within its bound.
    Within,
    /// It was refused as it must be, with this message.
    Refused(String),
    /// Neither, and this is why.
    Fail(String),
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Within => f.write_str("finite, within its bound"),
            Self::Refused(message) => write!(f, "typed refusal: {message}"),
            Self::Fail(why) => write!(f, "FAIL: {why}"),
        }
    }
}

/// A case that was run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The part of the program.
    pub part: &'static str,
    /// What was done.
    pub name: String,
    /// What had to come of it.
    pub expected: Expected,
    /// What was measured; absent where there was a refusal.
    pub measured: Option<Measured>,
    /// CPU time of all threads, seconds; absent where the system does not tell.
    pub cpu_seconds: Option<f64>,
    /// Whether that is as it must be.
    pub verdict: Verdict,
}

impl Row {
    /// Whether the case failed.
    #[must_use]
    pub fn failed(&self) -> bool {
        matches!(self.verdict, Verdict::Fail(_))
    }
}

impl Case {
    /// A case of `part` that does what `name` says by `run`.
    pub fn new(
        part: &'static str,
        name: impl Into<String>,
        expected: Expected,
        run: impl Fn(&Bench) -> Result<Measured, Refusal> + Send + Sync + 'static,
    ) -> Self {
        Self { part, name: name.into(), expected, weight: 1.0, run: Arc::new(run) }
    }

    /// A case that takes as long as so many quick ones.
    #[must_use]
    pub fn weighing(self, weight: f64) -> Self {
        Self { weight, ..self }
    }

    /// Runs it and judges what came. A panic is a failure like any other, so that the cases after it still run.
    #[must_use]
    pub fn run(&self, bench: &Bench) -> Row {
        let before = cpu::process_seconds();
        let came = catch_unwind(AssertUnwindSafe(|| (self.run)(bench)));
        let cpu_seconds = cpu::process_seconds().zip(before).map(|(after, before)| after - before);
        let (measured, verdict) = match came {
            Ok(Ok(measured)) => (Some(measured), self.expected.judge(&measured)),
            Ok(Err(refusal)) => (None, self.expected.judge_refusal(refusal.to_string())),
            Err(_) => (None, Verdict::Fail("it panicked".into())),
        };
        Row { part: self.part, name: self.name.clone(), expected: self.expected, measured, cpu_seconds, verdict }
    }
}

impl Expected {
    fn judge(&self, measured: &Measured) -> Verdict {
        let (Self::Within(bound) | Self::Either(bound, _)) = self else {
            return Verdict::Fail("it was not refused".into());
        };
        if measured.not_finite > 0 {
            return Verdict::Fail(format!("{} numbers are not finite", measured.not_finite));
        }
        // An error that is no number is above every bound.
        if measured.error <= bound.most {
            return Verdict::Within;
        }
        Verdict::Fail(format!("the error is {:.3e} {}, above {:.3e}", measured.error, bound.unit, bound.most))
    }

    fn judge_refusal(&self, message: String) -> Verdict {
        match self {
            Self::Refusal(names) | Self::Either(_, names) if message.contains(names) => Verdict::Refused(message),
            Self::Refusal(names) | Self::Either(_, names) => {
                Verdict::Fail(format!("the refusal does not name {names}: {message}"))
            }
            Self::Within(_) => Verdict::Fail(format!("it was refused: {message}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUND: Bound = Bound { most: 1.0, unit: "px", why: "a test" };

    #[test]
    fn only_what_is_finite_and_within_its_bound_passes() {
        let judge = |error, not_finite| Expected::Within(BOUND).judge(&Measured { error, not_finite });
        assert_eq!(judge(1.0, 0), Verdict::Within);
        for (error, not_finite) in [(1.1, 0), (0.0, 1), (f64::NAN, 0), (f64::INFINITY, 0)] {
            assert!(matches!(judge(error, not_finite), Verdict::Fail(_)), "{error} {not_finite}");
        }
        let not_refused = Expected::Refusal("threshold").judge(&Measured::default());
        assert!(matches!(not_refused, Verdict::Fail(_)));
    }

    #[test]
    fn a_refusal_passes_where_it_must_come_and_names_what_it_must() {
        let message = || "the threshold is 0".to_owned();
        assert!(matches!(Expected::Refusal("threshold").judge_refusal(message()), Verdict::Refused(_)));
        assert!(matches!(Expected::Either(BOUND, "threshold").judge_refusal(message()), Verdict::Refused(_)));
        assert!(matches!(Expected::Refusal("cutoff").judge_refusal(message()), Verdict::Fail(_)));
        assert!(matches!(Expected::Within(BOUND).judge_refusal(message()), Verdict::Fail(_)));
    }

    #[test]
    fn lists_of_different_lengths_are_infinitely_far_apart() {
        assert_eq!(Measured::between([1.0, 2.0], [1.0, 2.5]), Measured { error: 0.5, not_finite: 0 });
        assert_eq!(Measured::between([1.0, f64::NAN], [1.0, 2.5]).not_finite, 1);
        assert_eq!(Measured::between([1.0], [1.0, 2.5]).error, f64::INFINITY);
    }
}
