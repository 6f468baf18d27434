//! What the steps came to.

use erfgs_run::Metrics;
use serde::Serialize;

use crate::{About, Cause, Step};

/// The quality of a reconstruction on the held-out cameras, dB.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// Of whole frames.
    pub psnr: f64,
    /// Of what moves; of whole frames where nothing does.
    pub dpsnr: f64,
    /// Of what moves, between the exposures of the training frames.
    pub between: Option<f64>,
    /// Of what stands still.
    pub still: Option<f64>,
}

impl Quality {
    /// The mean of runs; what one of them lacks is not known.
    fn mean(runs: &[Self]) -> Self {
        let mean = |of: &dyn Fn(&Self) -> Option<f64>| {
            let values: Option<Vec<f64>> = runs.iter().map(of).collect();
            values.filter(|values| !values.is_empty()).map(|values| values.iter().sum::<f64>() / values.len() as f64)
        };
        Self {
            psnr: mean(&|quality| Some(quality.psnr)).unwrap_or(f64::NAN),
            dpsnr: mean(&|quality| Some(quality.dpsnr)).unwrap_or(f64::NAN),
            between: mean(&|quality| quality.between),
            still: mean(&|quality| quality.still),
        }
    }
}

impl From<&Metrics> for Quality {
    fn from(metrics: &Metrics) -> Self {
        Self {
            psnr: metrics.psnr,
            dpsnr: metrics.dpsnr.unwrap_or(metrics.psnr),
            between: metrics.between_frames.dpsnr,
            still: metrics.psnr_static,
        }
    }
}

/// What a step came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its size.
    pub size: f64,
    /// How far it moves what cameras see, pixels, where it does.
    pub moved_px: Option<f64>,
    /// The quality with it, for each seed.
    pub runs: Vec<Quality>,
}

impl Row {
    /// The mean over its seeds.
    #[must_use]
    pub fn quality(&self) -> Quality {
        Quality::mean(&self.runs)
    }
}

/// A cause and its steps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Costs {
    /// What there is to know of it.
    #[serde(flatten)]
    pub about: About,
    /// The steps, from the least to the greatest.
    pub rows: Vec<Row>,
}

/// The budget.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Budget {
    /// The base's quality, for each seed.
    pub base: Vec<Quality>,
    /// What each cause costs.
    pub causes: Vec<Costs>,
}

/// Up to where a cause costs no more than a limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tolerated {
    /// Up to this size, between two steps.
    Size(f64),
    /// The least step costs more.
    LessThan(f64),
    /// The greatest step costs less.
    MoreThan(f64),
}

impl Costs {
    /// A cause, with nothing measured yet.
    #[must_use]
    pub fn of(cause: &Cause) -> Self {
        Self { about: cause.about, rows: Vec::new() }
    }

    /// Adds what a step came to.
    pub fn add(&mut self, step: &Step, moved_px: Option<f64>, runs: Vec<Quality>) {
        self.rows.push(Row { size: step.size, moved_px, runs });
    }

    /// Whether its size is an error, which is 0 in the base, and not a choice.
    #[must_use]
    pub fn is_an_error(&self) -> bool {
        self.about.usual == 0.0
    }
}

impl Budget {
    /// The mean of the base over its seeds.
    #[must_use]
    pub fn usual(&self) -> Quality {
        Quality::mean(&self.base)
    }

    fn rows(&self) -> impl Iterator<Item = &Row> {
        self.causes.iter().flat_map(|costs| &costs.rows)
    }

    /// How many seeds the base has, and how many each step has at least.
    #[must_use]
    pub fn seeds(&self) -> [usize; 2] {
        let base = self.base.len();
        [base, self.rows().map(|row| row.runs.len()).min().unwrap_or(base)]
    }

    /// What the cost of a step must exceed to be more than its seeds, dB: twice the standard deviation of the difference of two means,
    /// by how runs of the same dataset differ, over all datasets; none where each was trained once.
    #[must_use]
    pub fn noise_db(&self) -> Option<f64> {
        let groups = std::iter::once(&self.base).chain(self.rows().map(|row| &row.runs));
        let (mut squares, mut free) = (0.0, 0);
        for runs in groups.filter(|runs| runs.len() > 1) {
            let mean = Quality::mean(runs).dpsnr;
            squares += runs.iter().map(|quality| (quality.dpsnr - mean).powi(2)).sum::<f64>();
            free += runs.len() - 1;
        }
        let of_means: f64 = self.seeds().map(|seeds| 1.0 / seeds.max(1) as f64).iter().sum();
        (free > 0).then(|| 2.0 * (squares / free as f64 * of_means).sqrt())
    }

    /// What a step costs where things move, dB; below zero where it is better than the base.
    #[must_use]
    pub fn cost_db(&self, row: &Row) -> f64 {
        self.usual().dpsnr - row.quality().dpsnr
    }

    /// What a step costs where things move, where they do between frames, and where nothing moves, dB.
    #[must_use]
    pub fn costs_db(&self, row: &Row) -> [Option<f64>; 3] {
        let (usual, here) = (self.usual(), row.quality());
        let lost = |usual: Option<f64>, here: Option<f64>| Some(usual? - here?);
        [Some(self.cost_db(row)), lost(usual.between, here.between), lost(usual.still, here.still)]
    }

    /// Up to where an error costs at most `limit` dB at every step from there down; between two steps by a straight line over the
    /// logarithm of the size. None without steps.
    #[must_use]
    pub fn tolerated(&self, costs: &Costs, limit: f64) -> Option<Tolerated> {
        let cheap = |row: &&Row| self.cost_db(row) <= limit;
        let count = costs.rows.iter().take_while(cheap).count();
        let last = costs.rows.last()?;
        let Some(dear) = costs.rows.get(count) else { return Some(Tolerated::MoreThan(last.size)) };
        let Some(below) = count.checked_sub(1).and_then(|at| costs.rows.get(at)) else {
            return Some(Tolerated::LessThan(dear.size));
        };
        let [from, to] = [below, dear].map(|row| self.cost_db(row));
        let share = ((limit - from) / (to - from)).clamp(0.0, 1.0);
        Some(Tolerated::Size((below.size.ln() + share * (dear.size / below.size).ln()).exp()))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn quality(dpsnr: f64) -> Quality {
        Quality { psnr: dpsnr + 8.0, dpsnr, between: Some(dpsnr - 1.0), still: None }
    }

    pub(crate) fn budget(costs: &[f64]) -> Budget {
        let rows = [1.0, 10.0, 100.0].iter().zip(costs);
        let runs = |cost: f64| vec![quality(20.1 - cost), quality(19.9 - cost)];
        let row = |(size, cost): (&f64, &f64)| Row { size: *size, moved_px: Some(0.1 * size), runs: runs(*cost) };
        let about = About {
            name: "place",
            unit: "mm",
            meaning: "how far a camera stands off",
            kind: crate::Kind::Calibration,
            usual: 0.0,
        };
        let place = Costs { about, rows: rows.map(row).collect() };
        Budget { base: [19.9, 20.0, 20.1].map(quality).into(), causes: vec![place] }
    }

    #[test]
    fn the_base_is_a_mean_and_its_seeds_say_what_is_noise() {
        let budget = budget(&[]);
        assert!((budget.usual().dpsnr - 20.0).abs() < 1e-12 && (budget.usual().between.unwrap() - 19.0).abs() < 1e-12);
        assert_eq!(budget.usual().still, None);
        // A standard deviation of 0.1, of which both means have their share.
        assert!((budget.noise_db().unwrap() - 2.0 * (0.01_f64 * 2.0 / 3.0).sqrt()).abs() < 1e-12);
        // Pairs that lie 0.2 apart, too: variances of 0.02 with one degree of freedom each, beside 0.01 with two.
        let pairs = self::budget(&[0.0, 0.5]).noise_db().unwrap();
        assert!((pairs - 2.0 * (0.06_f64 / 4.0 * (1.0 / 2.0 + 1.0 / 3.0)).sqrt()).abs() < 1e-12, "{pairs}");
        assert_eq!(Budget { base: vec![quality(20.0)], causes: Vec::new() }.noise_db(), None);
    }

    #[test]
    fn what_is_tolerated_lies_between_the_last_cheap_step_and_the_next() {
        let of = |costs: &[f64], limit: f64| {
            let budget = budget(costs);
            budget.tolerated(&budget.causes[0], limit)
        };
        let Some(Tolerated::Size(size)) = of(&[0.0, 0.2, 2.0], 0.1) else { panic!("a size") };
        assert!((size - 10_f64.sqrt()).abs() < 1e-9, "half of the way in logarithms: {size}");
        assert_eq!(of(&[0.3, 0.2, 2.0], 0.1), Some(Tolerated::LessThan(1.0)));
        assert_eq!(of(&[0.0, -0.2, 0.05], 0.1), Some(Tolerated::MoreThan(100.0)));
        // A step that happens to be cheap beyond a dear one does not count.
        assert!(matches!(of(&[0.0, 0.5, 0.0], 0.1), Some(Tolerated::Size(size)) if size < 10.0));
        assert_eq!(of(&[], 0.1), None);
    }
}
