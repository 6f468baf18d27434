//! A table of numbers: a line for each run.

use std::fmt::Write as _;

use crate::{Budget, Quality};

/// The header, a line for each seed of the base, and one for each seed of each step, with what the mean of its seeds costs. What is not
/// known is empty.
#[must_use]
pub fn csv(budget: &Budget) -> String {
    let mut text = String::from("cause,unit,size,moved_px,dpsnr_db,psnr_db,between_dpsnr_db,static_psnr_db,cost_db\n");
    let known = |value: Option<f64>| value.map_or(String::new(), |value| round(value).to_string());
    let mut line = |[cause, unit, size]: [&str; 3], moved: Option<f64>, quality: &Quality, cost: f64| {
        let Quality { psnr, dpsnr, between, still } = *quality;
        let cells = [moved, Some(dpsnr), Some(psnr), between, still, Some(cost)].map(known).join(",");
        let _ = writeln!(text, "{cause},{unit},{size},{cells}");
    };
    for quality in &budget.base {
        line(["nothing", "", ""], None, quality, budget.usual().dpsnr - quality.dpsnr);
    }
    for costs in &budget.causes {
        for row in &costs.rows {
            for quality in &row.runs {
                let names = [costs.about.name, costs.about.unit, &row.size.to_string()];
                line(names, row.moved_px, quality, budget.cost_db(row));
            }
        }
    }
    text
}

/// A tenth of a thousandth of a decibel is noise.
fn round(value: f64) -> f64 {
    (1e4 * value).round() / 1e4
}
