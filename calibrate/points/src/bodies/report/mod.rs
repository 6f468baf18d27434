//! A page that shows what was found as bodies, so that a person sees what was missed and why, and can correct it.

mod pictures;

use std::collections::BTreeMap;

use erfgs_dataset::Body;
use erfgs_page::{
    html::{self, Escaped, count, number},
    plot::{Plot, Series, legend, swatch},
};
use serde_json::Value;

use super::{curve::Curve, film::Film, spin::noted_rate, things::Things};

/// All that a page shows.
pub struct Shown<'a> {
    pub film: &'a Film,
    pub things: &'a Things,
    pub bodies: &'a [Body],
    /// By the names of bodies.
    pub curves: &'a BTreeMap<&'a str, Curve>,
}

/// The page, one HTML file.
pub fn page(dataset: &str, shown: &Shown<'_>) -> String {
    let [points, nobodys] = shown.things.points();
    let share = 100.0 * nobodys as f64 / points.max(1) as f64;
    let head = format!(
        "<p>{} bodies at {} instants of {}. {} of {} points of what moves belong to none of them ({} %).</p>\n",
        shown.bodies.len(),
        shown.film.moments.len(),
        Escaped(dataset),
        count(nobodys as u64),
        count(points as u64),
        number(share, 1)
    );
    let mut text = html::section("", "bodies", "Bodies", &(table(shown) + &unshaped(shown)));
    text += &html::section("", "tracks", "Tracks", &tracks(shown));
    text += &html::section("", "points", "What belongs to what", &pictures::owners(shown));
    for (index, body) in shown.bodies.iter().enumerate() {
        let part = pictures::strip(shown, body) + &curve(shown, body) + &facts(body);
        text += &html::section("body-", &index.to_string(), &body.name, &part);
    }
    text += &html::section("", "correct", "Correct it", &corrections(shown));
    html::page("Bodies", &head, &text)
}

fn fact(body: &Body, name: &str, decimals: usize) -> String {
    body.found_by.get(name).and_then(Value::as_f64).map_or("–".into(), |value| number(value, decimals))
}

fn words<'a>(body: &'a Body, name: &str) -> &'a str {
    body.found_by.get(name).and_then(Value::as_str).unwrap_or("–")
}

fn table(shown: &Shown<'_>) -> String {
    let row = |(index, body): (usize, &Body)| {
        let span = body.span_ns.map(|t_ns| number(1e-9 * t_ns.saturating_sub(shown.film.span_ns[0]) as f64, 3));
        let cells = [
            format!("{} – {}", span[0], span[1]),
            format!("{} <small>({} sure)</small>", fact(body, "instants", 0), fact(body, "sure_instants", 0)),
            count(body.points.len() as u64),
            fact(body, "radius_m", 3),
            noted_rate(body).map_or("–".into(), |rate| number(rate.length(), 1)),
            fact(body, "contrast_without_turn", 3),
            fact(body, "contrast_gained_by_looks", 3),
        ];
        let cells: String = cells.iter().map(|cell| format!("<td class=\"n\">{cell}</td>")).collect();
        format!(
            "<tr><th>{}<a href=\"#body-{index}\">{}</a></th>{cells}<td class=\"words\">{}</td></tr>\n",
            swatch(Some(index)),
            Escaped(&body.name),
            Escaped(words(body, "rotation"))
        )
    };
    let heading = [
        "In view <small>s</small>",
        "Instants",
        "Points",
        "Radius <small>m</small>",
        "Turns <small>rad/s</small>",
        "Contrast without a turn",
        "Contrast gained by its looks",
    ];
    let head: String = heading.iter().map(|cell| format!("<th class=\"n\">{cell}</th>")).collect();
    let rows: String = shown.bodies.iter().enumerate().map(row).collect();
    html::table("runs", &format!("<tr><th>Body</th>{head}<th>How its rotation was found</th></tr>"), &rows)
        + "<p class=\"caption\">Contrast without a turn: how sharp a body's events are if it does not turn, of the sharpest; near 1, events \
           hardly tell how it turns. Contrast gained by its looks: how much sharper they are if it is followed by its colours from instant \
           to instant than if it turns at the rates that were found.</p>\n"
}

/// Tracks of which no shape is left.
fn unshaped(shown: &Shown<'_>) -> String {
    let lost = |name: &str| shown.bodies.iter().all(|body| body.name != name);
    let lost: Vec<String> = shown
        .things
        .all
        .iter()
        .filter(|thing| lost(&thing.name))
        .map(|thing| format!("{} (seen at {} instants)", Escaped(&thing.name), thing.shapes.len()))
        .collect();
    if lost.is_empty() {
        return String::new();
    }
    format!(
        "<p>Followed, but too little is left where the silhouettes of all instants agree, so that they are no bodies: {}.</p>\n",
        lost.join(", ")
    )
}

fn tracks(shown: &Shown<'_>) -> String {
    let names = shown.bodies.iter().enumerate().map(|(index, body)| (index, body.name.as_str()));
    let plot = |axis: usize| {
        let series = |(index, body): (usize, &Body)| {
            let inside = |t_ns: &i64| (body.span_ns[0]..=body.span_ns[1]).contains(t_ns);
            let poses = body.poses.iter().filter(|pose| inside(&pose.t_ns));
            let at = |t_ns: i64| 1e-9 * t_ns.saturating_sub(shown.film.span_ns[0]) as f64;
            let points = poses.map(|pose| (at(pose.t_ns), pose.translation_m[axis])).collect();
            Series { name: body.name.clone(), run: index, points }
        };
        let plot = Plot {
            y_label: format!("{} / m", ["x", "y", "z"][axis]),
            x_label: "time / s".into(),
            series: shown.bodies.iter().enumerate().map(series).collect(),
            ..Plot::default()
        };
        plot.svg()
    };
    let plots: String = (0..3).map(plot).collect();
    format!(
        "{}<div class=\"plots small\">\n{plots}</div>\n<p class=\"caption\">Where bodies are in the world.</p>\n",
        legend(names)
    )
}

/// Contrast and colours against the rate.
fn curve(shown: &Shown<'_>, body: &Body) -> String {
    let Some(curve) = shown.curves.get(body.name.as_str()) else {
        return "<p>There are neither events nor colours that could tell how it turns.</p>\n".into();
    };
    let series = [("contrast of events", &curve.contrast), ("colours apart", &curve.apart)];
    let drawn = series.iter().enumerate().filter(|(_, (_, values))| !values.is_empty());
    let series: Vec<Series> = drawn
        .map(|(run, (name, values))| {
            let points = std::iter::zip(curve.rates.iter().copied(), values.iter().copied()).collect();
            Series { name: (*name).into(), run, points }
        })
        .collect();
    let names: Vec<(usize, String)> = series.iter().map(|series| (series.run, series.name.clone())).collect();
    // Rates are written with two decimals where there are many of them.
    let found = noted_rate(body).map(|rate| (rate.dot(curve.axis), "found".to_owned()));
    let axis = curve.axis.to_array().map(|part| number(part, 2)).join(", ");
    let plot = Plot {
        y_label: "share of the greatest".into(),
        x_label: format!("rate about ({axis}) / rad/s"),
        series,
        marks: found.into_iter().collect(),
        ..Plot::default()
    };
    format!(
        "{}<div class=\"plots small\">\n{}</div>\n<p class=\"caption\">Where it turns, its events are sharpest and its colours fit best. A curve \
         that is flat tells nothing; one with several peaks leaves a doubt.</p>\n",
        legend(names.iter().map(|(run, name)| (*run, name.as_str()))),
        plot.svg()
    )
}

fn facts(body: &Body) -> String {
    let row = |(name, value): (&String, &Value)| {
        let value = value.to_string();
        format!("<tr><th>{}</th><td>{}</td></tr>\n", Escaped(&name.replace('_', " ")), Escaped(value.trim_matches('"')))
    };
    let rows: String = body.found_by.iter().map(row).collect();
    format!("<details><summary>All that was noted of it</summary>\n{}</details>\n", html::table("dense", "", &rows))
}

fn corrections(shown: &Shown<'_>) -> String {
    let name = |index: usize| shown.bodies.get(index).map_or("body0", |body| body.name.as_str());
    let (first, second) = (name(0), name(1.min(shown.bodies.len().saturating_sub(1))));
    let example = format!(
        "forget = [\"{first}\"]                # it is no body\nmerge = [[\"{first}\", \"{second}\"]]     # they are one thing\n\n\
         [[split]]                         # it is several things:\nbody = \"{first}\"\nparts = 2                         # beside \
         each other; or at_s = 0.3: before and after\n\n[[turn]]                          # how it turns: axis in the world times \
         rate\nbody = \"{second}\"\nrate_rad_s = [0.0, 0.0, 15.0]     # zeros: not at all\n"
    );
    format!(
        "<p>Write what is wrong into a file, for example <code>edits.toml</code>, with those of these lines that apply, and find bodies \
         again with <code>erfgs dataset bodies DATASET --edit edits.toml --report bodies.html</code>. Names are those of a finding without \
         corrections.</p>\n<pre><code>{}</code></pre>\n",
        Escaped(&example)
    )
}
