//! A table of numbers: a line for each measure of each setting.

use std::fmt::Write as _;

use super::places;
use crate::Outcome;

/// The header and a line for each measure of each setting that could be run.
#[must_use]
pub fn csv(outcomes: &[Outcome]) -> String {
    let mut text = String::from(
        "component,knob,setting,default,measure,unit,error,cpu_seconds,cpu_seconds_least,cpu_seconds_most,wall_seconds,runs\n",
    );
    for outcome in outcomes {
        for curve in &outcome.curves {
            for (place, spent) in places(curve) {
                for (measure, error) in outcome.about.measures.iter().zip(&spent.errors) {
                    let words = [outcome.about.name, &curve.knob, &place.setting].map(quoted).join(",");
                    let [least, most] = spent.cpu_range;
                    let _ = writeln!(
                        text,
                        "{words},{},{},{},{error},{},{least},{most},{},{}",
                        place.default,
                        quoted(measure.name),
                        quoted(measure.unit),
                        spent.cpu_seconds,
                        spent.wall_seconds,
                        spent.runs
                    );
                }
            }
        }
    }
    text
}

/// A cell, in quotes where it needs them (RFC 4180).
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}
