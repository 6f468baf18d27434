//! A rig that tests itself: each device is opened, recorded alone and with all others, and what came is judged.
//!
//! ```text
//! RIG.toml ─► open ─► record each alone ─► record all together ─► observe (what a session holds) ─► verdicts ─► report
//! ```
//!
//! Recording and opening are those of `erfgs-recorder`, clocks and pulses those of `erfgs-sync`. What is new here are the
//! verdicts: pure functions from what was observed to [`Check`]s, so that a recording of another machine can be judged, too.
//! What a rig gives no chance to test is `not-tested`, with the reason, and never `ok`.

mod bus;
mod check;
mod error;
mod histogram;
mod holes;
mod observe;
mod rate;
mod record;
mod report;
mod run;
mod shared;
mod verdict;

pub use check::{Check, CheckName, Verdict, worst};
pub use error::SelftestError;
pub use histogram::{Bin, Intervals};
pub use holes::Holes;
pub use observe::{Observed, ObservedBoard, ObservedEvents, Recording, observe};
pub use rate::{Rate, RateFit};
pub use report::{ClockReport, DeviceReport, RecordedReport, Report};
pub use run::{Options, Step, run};
pub use verdict::{Alone, DeviceFindings, Findings, Together, judge};
