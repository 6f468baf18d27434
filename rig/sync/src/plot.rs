//! A page with the residuals of every stream.

use std::fmt::Write;

use erfgs_page::{
    html::{self, Escaped, number},
    plot::{Plot, Series},
};
use erfgs_session::clock::Residuals;

use super::report::{StreamSync, Synchronisation};

/// The page, as HTML that is one file.
#[must_use]
pub fn page(sync: &Synchronisation) -> String {
    let mut rows = String::new();
    for row in sync.streams.iter().flat_map(StreamSync::rows) {
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
        let _ = writeln!(
            rows,
            "<tr><th>{}</th><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            Escaped(&row.name),
            row.tier.name(),
            html::count(row.samples),
            or_dash(row.outliers.map(|share| format!("{} %", number(100.0 * share, 1)))),
            or_dash(row.rate_ppm.map(|ppm| format!("{ppm:+.2} ppm"))),
            time(row.residuals.p50_ns),
            time(row.residuals.p95_ns),
            time(row.residuals.max_ns),
        );
    }
    let head = "<tr><th>stream</th><th>tier</th><th class=\"n\">samples</th><th class=\"n\">outliers</th>\
                <th class=\"n\">rate error</th><th class=\"n\">p50</th><th class=\"n\">p95</th><th class=\"n\">max</th></tr>";
    let mut body = html::table("streams", head, &rows);
    for stream in &sync.streams {
        let mut about = String::new();
        for note in stream.faults.iter().chain(&stream.notes) {
            let _ = writeln!(about, "<p class=\"caption\">{}</p>", Escaped(note));
        }
        if stream.points.len() > 1 {
            about += &residuals(&stream.points);
        }
        body += &html::section("", &Escaped(&stream.id).to_string(), &stream.id, &about);
    }
    html::page(&format!("Clock residuals of {}", sync.session), "", &body)
}

/// Residuals, nanoseconds, against the session's time, seconds.
fn residuals(points: &[(f64, f64)]) -> String {
    let most = Residuals::of(points.iter().map(|point| point.1.abs()).collect()).p95_ns;
    let (per_unit, unit) = unit(most);
    Plot {
        x_label: "session, s".into(),
        y_label: format!("residual, {unit}"),
        dots: true,
        series: vec![Series {
            name: String::new(),
            run: 0,
            points: points.iter().map(|&(at, ns)| (at, ns / per_unit)).collect(),
        }],
        ..Plot::default()
    }
    .svg()
}

/// The unit that suits a time, and how many nanoseconds it has.
fn unit(ns: f64) -> (f64, &'static str) {
    match ns.abs() {
        small if small < 1e3 => (1.0, "ns"),
        small if small < 1e6 => (1e3, "µs"),
        small if small < 1e9 => (1e6, "ms"),
        _ => (1e9, "s"),
    }
}

/// A time in the unit that suits it, with three digits.
fn time(ns: f64) -> String {
    let (per_unit, unit) = unit(ns);
    let decimals = match unit {
        "ns" => 0,
        "µs" => 1,
        _ => 2,
    };
    format!("{} {unit}", number(ns / per_unit, decimals))
}
