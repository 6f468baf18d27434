//! The page: the curves.

use erfgs_page::{
    html::{self, Escaped},
    plot::{Setting, Tradeoff, legend},
};

use super::{LIMITS, Made, base, sized, tolerated};
use crate::{Budget, Costs, Kind, Row};

/// The page, one HTML file.
#[must_use]
pub fn page(budget: &Budget, made: &Made) -> String {
    let head = format!(
        "<p>What each error of a rig costs in the quality of its reconstructions, each put in alone. {} {} Made by <code>{}</code>, \
         trained on {}.</p>\n",
        Escaped(&made.what),
        Escaped(&base(budget)),
        Escaped(&made.command),
        Escaped(&made.adapter)
    );
    let mut body = summary(budget);
    body.push_str(&of_pixels(budget));
    for kind in Kind::ALL {
        let of_kind: Vec<&Costs> = budget.causes.iter().filter(|costs| costs.about.kind == kind).collect();
        if !of_kind.is_empty() {
            body.push_str(&section(budget, kind, &of_kind));
        }
    }
    html::page("Error budget", &head, &body)
}

fn summary(budget: &Budget) -> String {
    let mut rows = format!("<tr><th>error</th>{}</tr>\n", LIMITS.map(|limit| format!("<th>{limit} dB</th>")).join(""));
    for costs in budget.causes.iter().filter(|costs| costs.is_an_error()) {
        let cells =
            LIMITS.map(|limit| format!("<td>{}</td>", Escaped(&tolerated(costs, budget.tolerated(costs, limit)))));
        rows.push_str(&format!("<tr><th>{}</th>{}</tr>\n", Escaped(costs.about.name), cells.join("")));
    }
    let body = format!(
        "<p>Up to this size an error costs no more than so much where things move.</p>\n<table>\n{rows}</table>\n"
    );
    html::section("", "summary", "Tolerances", &body)
}

/// All errors of cameras over one axis: how far they move what is seen.
fn of_pixels(budget: &Budget) -> String {
    let moved: Vec<&Costs> =
        budget.causes.iter().filter(|costs| costs.rows.iter().any(|row| row.moved_px.is_some())).collect();
    if moved.is_empty() {
        return String::new();
    }
    let curve = |(colour, costs): (usize, &&Costs)| {
        let at = |row: &Row| Some(setting(sized(costs, row.size), row.moved_px?, budget.cost_db(row), false));
        (costs.about.name.to_owned(), colour, costs.rows.iter().filter_map(at).collect())
    };
    let plot = Tradeoff {
        error_label: "lost DPSNR, dB".into(),
        cost_label: "what is seen is moved by, px".into(),
        logarithmic: false,
        curves: moved.iter().enumerate().map(curve).collect(),
    };
    let names = legend(moved.iter().enumerate().map(|(colour, costs)| (colour, costs.about.name)));
    let body = format!(
        "<p>Errors of the cameras by how far they move what is seen. What costs nothing is drawn at zero.</p>\n{names}<div \
         class=\"plots\"><figure>{}</figure></div>\n",
        plot.svg()
    );
    html::section("", "pixels", "In pixels", &body)
}

fn section(budget: &Budget, kind: Kind, all: &[&Costs]) -> String {
    let measures = ["where things move", "moving, between frames", "where nothing moves"];
    let mut body = legend(measures.iter().enumerate().map(|(colour, name)| (colour, *name)));
    body.push_str("<div class=\"plots\">\n");
    for costs in all {
        let curves = measures.iter().enumerate().map(|(colour, name)| {
            let label = |row: &Row| if colour == 0 { sized(costs, row.size) } else { String::new() };
            let mut settings: Vec<Setting> = costs
                .rows
                .iter()
                .filter(|row| row.size > 0.0)
                .filter_map(|row| Some(setting(label(row), row.size, budget.costs_db(row)[colour]?, false)))
                .collect();
            if !costs.is_an_error() {
                let name = if colour == 0 { sized(costs, costs.about.usual) } else { String::new() };
                settings.push(setting(name, costs.about.usual, 0.0, true));
                settings.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            }
            ((*name).to_owned(), colour, settings)
        });
        let plot = Tradeoff {
            error_label: "lost, dB".into(),
            cost_label: format!("{}, {}", costs.about.name, costs.about.unit).trim_end_matches(", ").to_owned(),
            logarithmic: false,
            curves: curves.collect(),
        };
        body.push_str(&format!(
            "<figure>{}<figcaption>{}</figcaption></figure>\n",
            plot.svg(),
            Escaped(costs.about.meaning)
        ));
    }
    body.push_str("</div>\n");
    html::section("", &kind.name().to_lowercase(), kind.name(), &body)
}

/// What is better than the base is drawn at zero.
fn setting(name: String, size: f64, cost: f64, marked: bool) -> Setting {
    Setting { name, cost: size, error: cost.max(0.0), marked }
}
