//! The page: the curves.

use std::fmt::Write as _;

use erfgs_page::{
    html::{self, Escaped},
    plot::{COLOURS, Setting, Tradeoff, legend},
};

use super::{Made, better, capital, places};
use crate::{Outcome, Spent};

/// The page, one HTML file.
#[must_use]
pub fn page(outcomes: &[Outcome], made: &Made) -> String {
    let head = format!(
        "<p>The error of numerical components against the processor time that it takes, over its own knobs; what the program has \
         by default is ringed. Down and to the left is better. Made by <code>{}</code>, kernels on {}.</p>\n",
        Escaped(&made.command),
        Escaped(&made.adapter)
    );
    let body: String = outcomes.iter().map(section).collect();
    html::page("Work and precision", &head, &body)
}

fn section(outcome: &Outcome) -> String {
    let about = &outcome.about;
    let mut body = format!(
        "<p>{} Processor time is that of {}.</p>\n",
        Escaped(&about.truth.replace('`', "")),
        Escaped(about.work)
    );
    body.push_str(&legend(outcome.curves.iter().enumerate().map(|(index, curve)| (index, curve.knob.as_str()))));
    body.push_str("<div class=\"plots\">\n");
    for (index, measure) in about.measures.iter().enumerate() {
        let _ = writeln!(body, "<figure>{}</figure>", plot(outcome, index, measure.logarithmic));
    }
    body.push_str("</div>\n");
    let mut notes = String::new();
    for curve in &outcome.curves {
        if let Some(place) = better(curve) {
            let _ = write!(
                notes,
                "<li>{}: the default is beaten by {}.</li>",
                Escaped(&curve.knob),
                Escaped(&place.setting)
            );
        }
    }
    for [knob, setting, why] in outcome.refused() {
        let _ = write!(notes, "<li>{} {}: {}</li>", Escaped(knob), Escaped(setting), Escaped(why));
    }
    if !notes.is_empty() {
        let _ = writeln!(body, "<ul>{notes}</ul>");
    }
    let id = about.name.replace(' ', "-");
    html::section("", &id, &capital(about.name), &body)
}

fn plot(outcome: &Outcome, index: usize, logarithmic: bool) -> String {
    let measure = &outcome.about.measures[index];
    let setting = |place: &crate::Place<Result<Spent, String>>, spent: &Spent| Setting {
        name: place.setting.clone(),
        cost: spent.cpu_seconds,
        error: spent.errors.get(index).copied().unwrap_or(f64::NAN),
        marked: place.default,
    };
    let curves = outcome.curves.iter().enumerate();
    let plot = Tradeoff {
        error_label: format!("{}, {}", measure.name, measure.unit),
        cost_label: "processor time, s".into(),
        logarithmic,
        curves: curves
            .map(|(colour, curve)| {
                let settings = places(curve).map(|(place, spent)| setting(place, spent)).collect();
                (curve.knob.clone(), colour % (4 * COLOURS), settings)
            })
            .collect(),
    };
    plot.svg()
}
