//! The document.

use super::{Made, better, capital, cells, default, figure};
use crate::Outcome;

/// The document, in Markdown: a table for each knob.
#[must_use]
pub fn markdown(outcomes: &[Outcome], made: &Made) -> String {
    let mut text = format!(
        "# Work and precision\n\n\
         Error of numerical components against their processor time, over the settings of each knob. `{}` made this file \
         (version {}, kernels on {}); run it again for the figures of your machine. `precision.html` beside it draws the same as \
         curves, `precision.csv` has the numbers.\n\n\
         One knob is varied at a time. Processor time is that of all threads, without setup and comparison; short work is \
         repeated, and the median counts. \"Cost\" is the ratio of the time to that of the default. A default is beaten if another \
         setting of its knob takes less than 0.8 of its time and is no worse in any measure, or has less than \
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
