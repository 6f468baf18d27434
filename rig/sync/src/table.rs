//! The rows of the table: a stream each, or an epoch each where a stream has several.

use erfgs_session::clock::{Clock, Residuals};

use super::report::{StreamSync, Tier};

/// A row of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The stream; of several epochs, also when this one begins.
    pub name: String,
    /// How it is tied to the session clock.
    pub tier: Tier,
    /// What it rests on.
    pub samples: u64,
    /// The share of samples that did not fit, 0 to 1; `None` where nothing is set aside.
    pub outliers: Option<f64>,
    /// By how much the device's clock is slow, parts per million; `None` without a clock of its own.
    pub rate_ppm: Option<f64>,
    /// Distances of the samples.
    pub residuals: Residuals,
}

impl StreamSync {
    /// What the table says of the stream.
    #[must_use]
    pub fn rows(&self) -> Vec<Row> {
        let of_clock = |name: String, tier: Tier, clock: &Clock| Row {
            name,
            tier,
            samples: clock.samples,
            outliers: Some(clock.outlier_share()),
            rate_ppm: Some(clock.rate_error_ppm()),
            residuals: clock.residuals,
        };
        let without = |name: String, samples: u64, residuals: Residuals| Row {
            name,
            tier: self.tier,
            samples,
            outliers: None,
            rate_ppm: None,
            residuals,
        };
        match (self.epochs.as_slice(), &self.exposures) {
            ([], Some(exposures)) => {
                vec![without(self.id.clone(), exposures.sequence.len() as u64, exposures.residuals)]
            }
            ([], None) => vec![without(self.id.clone(), 0, Residuals::default())],
            ([epoch], _) => vec![match &epoch.clock {
                Some(clock) => of_clock(self.id.clone(), self.tier, clock),
                None => without(self.id.clone(), 0, Residuals::default()),
            }],
            (epochs, _) => epochs
                .iter()
                .map(|epoch| {
                    let name = format!("{} from {:.3} s", self.id, epoch.arrived_ns as f64 * 1e-9);
                    match &epoch.clock {
                        Some(clock) => of_clock(name, Tier::of(clock), clock),
                        None => without(name, 0, Residuals::default()),
                    }
                })
                .collect(),
        }
    }
}
