//! A table of numbers: a line for each measure of each setting.

use std::fmt::Write as _;

use erfgs_base::text::csv_cell;

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
                    let words = [outcome.about.name, &curve.knob, &place.setting].map(csv_cell).join(",");
                    let [least, most] = spent.cpu_range;
                    let _ = writeln!(
                        text,
                        "{words},{},{},{},{error},{},{least},{most},{},{}",
                        place.default,
                        csv_cell(measure.name),
                        csv_cell(measure.unit),
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
