//! The document.

use std::fmt::Write as _;

use super::{LIMITS, Made, base, cells, sized, tolerated};
use crate::{Budget, Kind};

/// The document, in Markdown: up to where errors are cheap, and a table for each cause.
#[must_use]
pub fn markdown(budget: &Budget, made: &Made) -> String {
    let mut text = format!(
        "# Error budget\n\n\
         What each error of a rig costs in the quality of its reconstructions. `{}` made this file (version {}, trained on {}); run it \
         again for the figures of your scene. `budget.html` beside it draws the same as curves, `budget.csv` has the numbers.\n\n\
         {} Each error is put into the training cameras alone; quality is measured on the held-out cameras, which are not changed. \
         {}\n\n\
         A cost is the loss of DPSNR, the PSNR of moving pixels. \"Moved\" is the image shift by the error, root mean square over \
         the initial points.\n\n\
         ## Tolerances\n\n\
         Largest size of each error that costs no more than the stated loss; interpolated between steps over the logarithm of the \
         size.\n\n\
         | error | {} |\n|---|{}\n",
        made.command,
        made.version,
        made.adapter.replace('|', "/"),
        made.what,
        base(budget),
        LIMITS.map(|limit| format!("{limit} dB")).join(" | "),
        "---|".repeat(LIMITS.len())
    );
    for costs in budget.causes.iter().filter(|costs| costs.is_an_error()) {
        let sizes = LIMITS.map(|limit| tolerated(costs, budget.tolerated(costs, limit)));
        let _ = writeln!(text, "| {} | {} |", costs.about.name, sizes.join(" | "));
    }
    for kind in Kind::ALL {
        let of_kind: Vec<_> = budget.causes.iter().filter(|costs| costs.about.kind == kind).collect();
        if of_kind.is_empty() {
            continue;
        }
        let _ = write!(text, "\n## {}\n", kind.name());
        for costs in of_kind {
            let usual = if costs.is_an_error() {
                String::new()
            } else {
                format!("; {} where nothing else is said", sized(costs, costs.about.usual))
            };
            let _ = write!(
                text,
                "\n**{}**: {}{usual}.\n\n\
                 | size | moved, px | cost, dB | between frames | where nothing moves | DPSNR, dB | PSNR, dB |\n\
                 |---|---|---|---|---|---|---|\n",
                costs.about.name, costs.about.meaning
            );
            for row in &costs.rows {
                let _ = writeln!(text, "| {} | {} |", sized(costs, row.size), cells(budget, row).join(" | "));
            }
        }
    }
    text
}
