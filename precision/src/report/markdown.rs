//! The document.

use super::{Made, better, capital, cells, default, figure};
use crate::Outcome;

/// The document, in Markdown: a table for each knob.
#[must_use]
pub fn markdown(outcomes: &[Outcome], made: &Made) -> String {
    let mut text = format!(
        "# Work and precision\n\n\
         The error of numerical components against the processor time that it takes, over its own knobs. `{}` made this file \
         (version {}, kernels on {}); run it again for the figures of your machine. `precision.html` beside it draws the same as \
         curves, `precision.csv` has the numbers.\n\n\
         A knob is turned while the others stay where they are. Processor time is that of all threads, without what is set up before \
         and judged after; short work is repeated, and the median counts. \"Cost\" is the time over that of the default. A default is \
         beaten where another setting of its knob takes less than 0.8 of its time and is no worse in any measure, or has less than \
         0.8 of its first error, is worse in none and takes no longer.\n",
        made.command, made.version, made.adapter
    );
    for outcome in outcomes {
        text.push_str(&format!(
            "\n## {}\n\n{} Processor time is that of {}.\n",
            capital(outcome.about.name),
            outcome.about.truth,
            outcome.about.work
        ));
        for curve in &outcome.curves {
            let measures: Vec<String> =
                outcome.about.measures.iter().map(|measure| format!("{}, {}", measure.name, measure.unit)).collect();
            let columns = "---|".repeat(measures.len());
            text.push_str(&format!(
                "\n| {} | {} | CPU time | cost |\n|---|{columns}---|---|\n",
                escaped(&curve.knob),
                measures.join(" | ")
            ));
            let usual = default(curve).map(|spent| spent.cpu_seconds);
            for (place, cells) in curve.places.iter().zip(cells(outcome, curve)) {
                let bold = |text: String| if place.default && !text.is_empty() { format!("**{text}**") } else { text };
                let line: Vec<String> = cells.iter().map(|text| bold(escaped(text))).collect();
                let cost = usual.zip(place.came.as_ref().ok()).filter(|_| !place.default);
                let cost = cost.map_or(String::new(), |(usual, spent)| figure(spent.cpu_seconds / usual));
                text.push_str(&format!("| {} | {cost} |\n", line.join(" | ")));
            }
            if let Some(place) = better(curve) {
                text.push_str(&format!("\nThe default is beaten by {}.\n", place.setting));
            }
        }
    }
    text
}

fn escaped(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}
