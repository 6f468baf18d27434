//! A page with the residuals of every stream: one SVG each, nothing that is loaded from elsewhere.

use std::fmt::Write;

use super::report::{StreamSync, Synchronisation};

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 200.0;
const LEFT: f64 = 70.0;
const BOTTOM: f64 = 24.0;

/// The page, as HTML.
#[must_use]
pub fn page(sync: &Synchronisation) -> String {
    let mut html = String::from(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Clock residuals</title>\n<style>\
         body{font:14px system-ui,sans-serif;max-width:960px;margin:2em auto;color:#222}\
         td,th{padding:.2em .8em;text-align:right}td:first-child,th:first-child,td:nth-child(2){text-align:left}\
         svg{background:#fafafa;border:1px solid #ddd}.note{color:#a50}</style></head><body>\n",
    );
    let _ = write!(
        html,
        "<h1>Clock residuals of {}</h1>\n<table><tr><th>stream<th>tier<th>samples<th>outliers<th>rate error<th>p50<th>p95<th>max</tr>\n",
        escape(&sync.session)
    );
    for row in sync.streams.iter().flat_map(StreamSync::rows) {
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
        let _ = writeln!(
            html,
            "<tr><td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}<td>{}</tr>",
            escape(&row.name),
            row.tier.name(),
            row.samples,
            or_dash(row.outliers.map(|share| format!("{:.1} %", 100.0 * share))),
            or_dash(row.rate_ppm.map(|ppm| format!("{ppm:+.2} ppm"))),
            time(row.residuals.p50_ns),
            time(row.residuals.p95_ns),
            time(row.residuals.max_ns),
        );
    }
    html.push_str("</table>\n");
    for stream in &sync.streams {
        let _ = writeln!(html, "<h2>{}</h2>", escape(&stream.id));
        for note in &stream.notes {
            let _ = writeln!(html, "<p class=\"note\">{}</p>", escape(note));
        }
        if stream.points.len() > 1 {
            plot(&mut html, &stream.points);
        }
    }
    html.push_str("</body></html>\n");
    html
}

/// A time in the unit that suits it.
#[must_use]
fn time(ns: f64) -> String {
    match ns.abs() {
        small if small < 1e3 => format!("{ns:.0} ns"),
        small if small < 1e6 => format!("{:.1} µs", ns / 1e3),
        small if small < 1e9 => format!("{:.2} ms", ns / 1e6),
        _ => format!("{:.2} s", ns / 1e9),
    }
}

fn plot(html: &mut String, points: &[(f64, f64)]) {
    let bounds = |pick: fn(&(f64, f64)) -> f64| {
        let (low, high) = points
            .iter()
            .map(pick)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if high > low { (low, high) } else { (low - 1.0, high + 1.0) }
    };
    let (from, to) = bounds(|point| point.0);
    let (_, high) = bounds(|point| point.1);
    let (low, _) = bounds(|point| point.1);
    // The outermost points would flatten all others.
    let mut sorted: Vec<f64> = points.iter().map(|point| point.1).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |q: f64| sorted[((sorted.len() - 1) as f64 * q).round() as usize];
    let spread = (at(0.99) - at(0.01)).max(1.0);
    let (low, high) = (low.max(at(0.01) - spread / 2.0), high.min(at(0.99) + spread / 2.0));
    let (low, high) = if high > low { (low, high) } else { (low - 1.0, high + 1.0) };
    let x = |value: f64| LEFT + (value - from) / (to - from) * (WIDTH - LEFT - 10.0);
    let y = |value: f64| 10.0 + (high - value.clamp(low, high)) / (high - low) * (HEIGHT - BOTTOM - 10.0);
    let _ = write!(
        html,
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" role=\"img\"><g fill=\"#26c\" fill-opacity=\".5\">"
    );
    for point in points {
        let _ = write!(html, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.5\"/>", x(point.0), y(point.1));
    }
    html.push_str("</g><g font-size=\"11\" fill=\"#444\">");
    if low < 0.0 && high > 0.0 {
        let _ = write!(html, "<path d=\"M{LEFT} {0:.1}H{WIDTH}\" stroke=\"#999\" stroke-width=\".5\"/>", y(0.0));
    }
    for value in [low, f64::midpoint(low, high), high] {
        let _ = write!(
            html,
            "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            y(value) + 4.0,
            time(value)
        );
    }
    for value in [from, f64::midpoint(from, to), to] {
        let _ = write!(
            html,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{value:.1} s</text>",
            x(value).clamp(LEFT + 20.0, WIDTH - 30.0),
            HEIGHT - 8.0
        );
    }
    html.push_str("</g></svg>\n");
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
