//! The budget as numbers, as a document and as a page.

mod csv;
mod markdown;
mod page;

pub use csv::csv;
pub use markdown::markdown;
pub use page::page;

use erfgs_stability::report::figure;

use crate::{Budget, Costs, Row, Tolerated};

/// How the budget was made.
#[derive(Clone, Debug)]
pub struct Made {
    /// The command.
    pub command: String,
    /// The program's version.
    pub version: String,
    /// The adapter that trained.
    pub adapter: String,
    /// What was trained: the base and the iterations, in words.
    pub what: String,
}

/// Costs that the summary tells sizes of, dB: what is less than the first is hardly more than the seed.
pub const LIMITS: [f64; 2] = [0.5, 1.0];

/// A size with its unit.
#[must_use]
pub fn sized(costs: &Costs, size: f64) -> String {
    let whole = size >= 1e3 && size.fract() == 0.0;
    let figure = if whole { size.to_string() } else { figure(size) };
    format!("{figure} {}", costs.about.unit).trim_end().to_owned()
}

/// Up to where a cause is cheap, in words.
#[must_use]
pub fn tolerated(costs: &Costs, tolerated: Option<Tolerated>) -> String {
    match tolerated {
        None => "-".into(),
        // Two digits: the steps are a factor of three apart.
        Some(Tolerated::Size(size)) => {
            let scale = 10_f64.powf(size.log10().floor() - 1.0);
            sized(costs, (size / scale).round() * scale)
        }
        Some(Tolerated::LessThan(size)) => format!("less than {}", sized(costs, size)),
        Some(Tolerated::MoreThan(size)) => format!("more than {}", sized(costs, size)),
    }
}

/// What was compared with, in a sentence or two.
fn base(budget: &Budget) -> String {
    let usual = budget.usual();
    let mean = |count: usize, one: &str| match count {
        1 => one.to_owned(),
        count => format!("the mean of {count} seeds"),
    };
    let [base, step] = budget.seeds();
    let (base, step) = (mean(base, "one seed"), mean(step, "one run"));
    let noise = budget.noise_db().map_or(String::new(), |noise| {
        let noise = figure(noise);
        format!(
            " Each step is {step}: a cost below {noise} dB may be the seeds', and the part of it that is the base's is the same in all costs."
        )
    });
    format!("With nothing wrong: DPSNR {:.2} dB, PSNR {:.2} dB ({base}).{noise}", usual.dpsnr, usual.psnr)
}

/// The cells of a step, without its size: what it moves, what it costs, what it comes to.
fn cells(budget: &Budget, row: &Row) -> Vec<String> {
    let mut cells = vec![row.moved_px.map_or("-".into(), figure)];
    cells.extend(budget.costs_db(row).map(|cost| cost.map_or("-".into(), |cost| format!("{cost:+.2}"))));
    let quality = row.quality();
    cells.extend([quality.dpsnr, quality.psnr].map(|decibels| format!("{decibels:.2}")));
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outcome::tests::budget;

    fn made() -> Made {
        Made {
            command: "erfgs bench budget --out <folder>".into(),
            version: "1".into(),
            adapter: "a | card".into(),
            what: "the stage".into(),
        }
    }

    #[test]
    fn all_three_forms_tell_the_same() {
        let budget = budget(&[0.0, 0.2, 2.0]);
        let table = csv(&budget);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines.len(), 1 + 3 + 3 * 2, "{table}");
        assert!(lines[0].starts_with("cause,unit,size,moved_px,"));
        assert!(lines.contains(&"place,mm,100,10,18.1,26.1,17.1,,2"), "{table}");
        assert!(lines.contains(&"place,mm,100,10,17.9,25.9,16.9,,2"), "{table}");
        let document = markdown(&budget, &made());
        assert!(document.contains("| 100 mm | 10 | +2.00 | +2.00 | - | 18.00 | 26.00 |"), "{document}");
        assert!(document.contains("| place | 15 mm | 28 mm |"), "{document}");
        let page = page(&budget, &made());
        assert!(page.contains("&lt;folder&gt;") && !page.contains("<folder>") && page.contains("<svg"), "{page}");
    }
}
