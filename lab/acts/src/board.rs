//! What the trainings came to.

use std::path::PathBuf;

use erfgs_run::Metrics;
use serde::Serialize;

use crate::{BASELINE, CEILING};

/// The quality of a reconstruction on the held-out cameras, dB, and what it took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Of whole frames.
    pub psnr: f64,
    /// Of what stands still.
    pub still: Option<f64>,
    /// Of what moves.
    pub dpsnr: Option<f64>,
    /// Of what moves, between the exposures of the training frames.
    pub between: Option<f64>,
    /// Of the tenth of it that changes most.
    pub fast: Option<f64>,
    /// Processor time of the training, seconds over all threads.
    pub cpu_seconds: Option<f64>,
}

impl From<&Metrics> for Quality {
    fn from(metrics: &Metrics) -> Self {
        Self {
            psnr: metrics.psnr,
            still: metrics.psnr_static,
            dpsnr: metrics.dpsnr,
            between: metrics.between_frames.dpsnr,
            fast: metrics.psnr_fast,
            cpu_seconds: metrics.train_cpu_seconds,
        }
    }
}

impl Quality {
    /// The figures that tables show, in their order; none where it is not known.
    #[must_use]
    pub fn figures(&self) -> [Option<f64>; 6] {
        [Some(self.psnr), self.still, self.dpsnr, self.between, self.fast, self.cpu_seconds]
    }
}

/// One training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The act or acts.
    pub act: String,
    /// The seed of the take.
    pub seed: u64,
    /// The name of the method.
    pub method: &'static str,
    /// What it came to.
    pub quality: Quality,
    /// A picture of it between frames, cropped to what moves.
    pub picture: Option<PathBuf>,
}

/// The scoreboard.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Board {
    /// The trainings, by act, seed and method.
    pub rows: Vec<Row>,
    /// What is true, by act and seed, as the pictures show it.
    pub truths: Vec<(String, u64, PathBuf)>,
}

/// A gap of less is noise, dB.
const LEAST_GAP: f64 = 0.2;

/// The share of the gap between `baseline` and `ceiling` that `value` closes, all in dB; none where there is hardly a gap.
#[must_use]
pub fn closed(baseline: f64, value: f64, ceiling: f64) -> Option<f64> {
    let gap = ceiling - baseline;
    (gap >= LEAST_GAP).then(|| (value - baseline) / gap)
}

impl Board {
    fn dpsnr(&self, act: &str, seed: u64, method: &str) -> Option<f64> {
        let row = self.rows.iter().find(|row| row.act == act && row.seed == seed && row.method == method)?;
        row.quality.dpsnr
    }

    /// The share of its take's gap that a training closes.
    #[must_use]
    pub fn share(&self, row: &Row) -> Option<f64> {
        let of = |method| self.dpsnr(&row.act, row.seed, method);
        closed(of(BASELINE)?, row.quality.dpsnr?, of(CEILING)?)
    }

    /// The acts, in the order of the trainings.
    #[must_use]
    pub fn acts(&self) -> Vec<&str> {
        distinct(self.rows.iter().map(|row| row.act.as_str()))
    }

    /// The methods, in the order of the trainings.
    #[must_use]
    pub fn methods(&self) -> Vec<&'static str> {
        distinct(self.rows.iter().map(|row| row.method))
    }

    /// The seeds of an act.
    #[must_use]
    pub fn seeds(&self, act: &str) -> Vec<u64> {
        distinct(self.rows.iter().filter(|row| row.act == act).map(|row| row.seed))
    }

    /// The means over the seeds of an act (over everything without one): the figures of [`Quality::figures`] and the share closed.
    /// What one of the trainings lacks is left out of the mean.
    #[must_use]
    pub fn mean(&self, act: Option<&str>, method: &str) -> [Option<f64>; 7] {
        let rows = || {
            let of_act = move |row: &&Row| act.is_none_or(|act| row.act == act) && row.method == method;
            self.rows.iter().filter(of_act)
        };
        let mean = |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        std::array::from_fn(|figure| {
            let of = |row: &Row| row.quality.figures().get(figure).copied().unwrap_or_else(|| self.share(row));
            mean(rows().filter_map(of).collect())
        })
    }
}

fn distinct<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    let mut known = Vec::new();
    for item in all {
        if !known.contains(&item) {
            known.push(item);
        }
    }
    known
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn board() -> Board {
        let row = |act: &str, seed, method, dpsnr: f64| Row {
            act: act.into(),
            seed,
            method,
            quality: Quality {
                psnr: 25.0,
                still: Some(30.0),
                dpsnr: Some(dpsnr),
                between: Some(dpsnr - 1.0),
                fast: None,
                cpu_seconds: Some(60.0),
            },
            picture: None,
        };
        let rows = vec![
            row("throw", 1, BASELINE, 16.0),
            row("throw", 1, "erf-gs", 18.0),
            row("throw", 1, CEILING, 24.0),
            row("throw", 2, BASELINE, 15.0),
            row("throw", 2, "erf-gs", 20.0),
            row("throw", 2, CEILING, 25.0),
            row("fan", 1, BASELINE, 20.0),
            row("fan", 1, "erf-gs", 20.5),
            row("fan", 1, CEILING, 20.1),
        ];
        Board { rows, truths: Vec::new() }
    }

    #[test]
    fn the_share_closed_is_of_each_take_and_its_mean_is_over_takes() {
        let board = board();
        let shares: Vec<Option<f64>> = board.rows.iter().map(|row| board.share(row)).collect();
        assert_eq!(shares[..3], [Some(0.0), Some(0.25), Some(1.0)]);
        assert_eq!(shares[7], None, "there is hardly a gap");
        assert_eq!(board.mean(Some("throw"), "erf-gs")[6], Some(0.375));
        assert_eq!(board.mean(Some("throw"), "erf-gs")[2], Some(19.0));
        assert_eq!(board.mean(None, "erf-gs")[2], Some(19.5));
        assert_eq!(board.mean(None, "erf-gs")[4], None);
        assert_eq!(board.mean(None, "bodies"), [None; 7]);
        assert_eq!((board.acts(), board.seeds("throw")), (vec!["throw", "fan"], vec![1, 2]));
    }
}
