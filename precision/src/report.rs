//! The curves as numbers, as a document and as a page.

mod csv;
mod markdown;
mod page;

pub use csv::csv;
pub use erfgs_stability::report::Made;
pub use markdown::markdown;
pub use page::page;

use erfgs_stability::report::figure;

use crate::{Curve, Outcome, Place, Spent};

/// From here on something is cheaper, or better, than something else, and not only by the noise of a measurement.
const CLEARLY: f64 = 0.8;
/// Up to here something is as cheap, or as good.
const ALIKE: f64 = 1.05;

/// The places of a curve at which something came.
fn places(curve: &Curve<Result<Spent, String>>) -> impl Iterator<Item = (&Place<Result<Spent, String>>, &Spent)> {
    curve.places.iter().filter_map(|place| Some((place, place.came.as_ref().ok()?)))
}

/// The default of a curve, where there is one.
fn default(curve: &Curve<Result<Spent, String>>) -> Option<&Spent> {
    places(curve).find(|(place, _)| place.default).map(|(_, spent)| spent)
}

/// The setting of a curve that beats its default: clearly cheaper and no worse in any measure, or clearly better by the first one and
/// worse in none, at no more cost.
#[must_use]
pub fn better(curve: &Curve<Result<Spent, String>>) -> Option<&Place<Result<Spent, String>>> {
    let here = default(curve)?;
    let no_worse = |there: &Spent| there.errors.iter().zip(&here.errors).all(|(there, here)| *there <= ALIKE * here);
    let beats = |there: &Spent| {
        let cost = there.cpu_seconds / here.cpu_seconds;
        let gain = there.errors.first().zip(here.errors.first()).is_some_and(|(there, here)| *there < CLEARLY * here);
        no_worse(there) && (cost < CLEARLY || (cost <= ALIKE && gain))
    };
    let beating = places(curve).filter(|(place, spent)| !place.default && beats(spent));
    beating.min_by(|(_, a), (_, b)| a.cpu_seconds.total_cmp(&b.cpu_seconds)).map(|(place, _)| place)
}

/// A row for each setting of a curve: its name, its errors, its time; or why it could not be run.
#[must_use]
pub fn cells(outcome: &Outcome, curve: &Curve<Result<Spent, String>>) -> Vec<Vec<String>> {
    let row = |place: &Place<Result<Spent, String>>| {
        let setting = if place.default { format!("{} (default)", place.setting) } else { place.setting.clone() };
        let [mut errors, mut time] = [vec![String::new(); outcome.about.measures.len()], vec![String::new()]];
        match &place.came {
            Ok(spent) => {
                errors = spent.errors.iter().copied().map(figure).collect();
                time[0] = seconds(spent.cpu_seconds);
            }
            Err(why) => errors[0] = why.replace('\n', " "),
        }
        [vec![setting], errors, time].concat()
    };
    curve.places.iter().map(row).collect()
}

/// A time in the unit that fits.
fn seconds(value: f64) -> String {
    match value {
        ..1e-3 => format!("{} µs", figure(1e6 * value)),
        ..1.0 => format!("{} ms", figure(1e3 * value)),
        _ => format!("{} s", figure(value)),
    }
}

/// A name as a title: its first letter large.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Measure, component::About};

    const ABOUT: About = About {
        name: "a component",
        truth: "A formula.",
        work: "a sum",
        measures: &[
            Measure { name: "error", unit: "px", logarithmic: true },
            Measure { name: "missed", unit: "%", logarithmic: false },
        ],
    };

    fn place(setting: &str, default: bool, cpu_seconds: f64, errors: [f64; 2]) -> Place<Result<Spent, String>> {
        let spent =
            Spent { errors: errors.to_vec(), cpu_seconds, cpu_range: [cpu_seconds; 2], wall_seconds: 0.5, runs: 3 };
        Place { setting: setting.into(), default, came: Ok(spent) }
    }

    fn curve(places: Vec<Place<Result<Spent, String>>>) -> Curve<Result<Spent, String>> {
        Curve { knob: "a | knob".into(), places }
    }

    #[test]
    fn a_default_is_beaten_by_what_is_better_and_no_dearer_or_cheaper_and_no_worse() {
        let beaten = |cpu: f64, errors: [f64; 2]| {
            let curve = curve(vec![place("here", true, 1.0, [1.0, 10.0]), place("there", false, cpu, errors)]);
            better(&curve).map(|place| place.setting.clone())
        };
        let there = Some("there".to_owned());
        assert_eq!(beaten(0.7, [1.0, 10.0]), there);
        assert_eq!(beaten(1.0, [0.5, 10.0]), there);
        for (cpu, errors) in [(0.7, [1.2, 10.0]), (0.7, [1.0, 11.0]), (1.2, [0.1, 1.0]), (0.95, [0.95, 10.0])] {
            assert_eq!(beaten(cpu, errors), None, "{cpu} {errors:?}");
        }
    }

    #[test]
    fn all_three_forms_tell_the_same() {
        let mut places = vec![place("fast, \"1\"", false, 0.001, [2.0, 3.0]), place("usual", true, 0.02, [0.5, 0.0])];
        places.push(Place { setting: "wrong".into(), default: false, came: Err("it cannot".into()) });
        let outcomes = [Outcome { about: ABOUT, curves: vec![curve(places)] }];
        let made = Made { command: "erfgs bench precision".into(), version: "1".into(), adapter: "<card>".into() };
        let table = csv(&outcomes);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines.len(), 5, "{table}");
        assert_eq!(lines[1], "a component,a | knob,\"fast, \"\"1\"\"\",false,error,px,2,0.001,0.001,0.001,0.5,3");
        assert_eq!(lines[4], "a component,a | knob,usual,true,missed,%,0,0.02,0.02,0.02,0.5,3");
        let text = markdown(&outcomes, &made);
        assert!(text.contains("| **usual (default)** | **0.5** | **0** | **20 ms** |  |"), "{text}");
        assert!(text.contains("| wrong | it cannot |  |  |  |"), "{text}");
        let html = page(&outcomes, &made);
        assert_eq!(
            (html.matches("<svg class=\"plot tradeoff\"").count(), html.matches("class=\"ring\"").count()),
            (2, 2)
        );
        assert!(html.contains("&lt;card&gt;") && html.contains("it cannot"), "{html}");
    }
}
