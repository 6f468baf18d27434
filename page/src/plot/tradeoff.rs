//! Charts of error against cost: a line for each knob, a word at each of its settings.

use std::fmt::Write as _;

use super::{
    COLOURS,
    lines::{BOTTOM, LEFT, TOP, WIDTH, opened, rows, stroke},
    scale::Scale,
};
use crate::html::Escaped;

const HEIGHT: f64 = 340.0;
const RIGHT: f64 = 60.0;

/// A setting.
#[derive(Clone, Debug)]
pub struct Setting {
    /// What is written beside it.
    pub name: String,
    /// What it costs, above zero.
    pub cost: f64,
    /// Its error.
    pub error: f64,
    /// Whether it is ringed.
    pub marked: bool,
}

/// Errors over a logarithmic axis of costs.
#[derive(Clone, Debug, Default)]
pub struct Tradeoff {
    /// Written above the axis of errors, with its unit.
    pub error_label: String,
    /// Written below the axis of costs, with its unit.
    pub cost_label: String,
    /// Whether the axis of errors is logarithmic; what is not above zero is left out then.
    pub logarithmic: bool,
    /// What each line is called on hovering, the number of its colour, and its settings from one end to the other.
    pub curves: Vec<(String, usize, Vec<Setting>)>,
}

impl Tradeoff {
    /// The figure, or nothing where there is nothing to draw.
    #[must_use]
    pub fn svg(&self) -> String {
        let drawable = |setting: &&Setting| {
            let ranges = [setting.cost, setting.error].iter().all(|value| value.is_finite() && value.abs() < 1e300);
            ranges && setting.cost > 1e-300 && (setting.error > 1e-300 || (!self.logarithmic && setting.error >= 0.0))
        };
        let all = || self.curves.iter().flat_map(|(.., settings)| settings.iter().filter(drawable));
        let (width, height) = (WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM);
        let errors = all().map(|setting| setting.error);
        let y = match self.logarithmic {
            true => Scale::logarithmic(errors, height),
            false => Scale::linear(errors, height, 5, true),
        };
        let Some((x, y)) = Scale::logarithmic(all().map(|setting| setting.cost), width).zip(y) else {
            return String::new();
        };
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        let mut svg = opened("plot tradeoff", HEIGHT, &self.error_label, &self.cost_label);
        rows(&mut svg, &y, right, bottom);
        for (value, text) in &x.ticks {
            let at = LEFT + x.place(*value);
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom}\"/>\
                 <text class=\"tick\" text-anchor=\"middle\" x=\"{at:.1}\" y=\"{:.1}\">{text}</text>",
                bottom + 18.0
            );
        }
        let _ = write!(
            svg,
            "<path class=\"axis\" d=\"M{LEFT} {bottom}H{right}\"/>\
             <text class=\"label\" text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            (LEFT + right) / 2.0,
            HEIGHT - 6.0,
            Escaped(&self.cost_label)
        );
        let mut written: Vec<(f64, f64, f64)> = Vec::new();
        for (name, colour, settings) in &self.curves {
            let places: Vec<(f64, f64, &Setting)> = settings
                .iter()
                .filter(drawable)
                .map(|of| (LEFT + x.place(of.cost), bottom - y.place(of.error).clamp(0.0, height), of))
                .collect();
            let path: Vec<String> = places.iter().map(|(x, y, _)| format!("{x:.1} {y:.1}")).collect();
            let _ = write!(svg, "<path class=\"line\" {} d=\"M{}\"/>", stroke(*colour), path.join("L"));
            for (x, y, setting) in places {
                let fill = format!("var(--run-{})", colour % COLOURS);
                if setting.marked {
                    let _ = write!(svg, "<circle class=\"ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\"/>");
                }
                let _ = write!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{fill}\"><title>{}: {}</title></circle>",
                    Escaped(name),
                    Escaped(&setting.name)
                );
                // A word that would lie on another is left to hovering.
                let width = 5.8 * setting.name.chars().count() as f64;
                let free = written
                    .iter()
                    .all(|(left, end, line)| x + 6.0 > *end || x + 6.0 + width < *left || (y - line).abs() > 11.0);
                if free && x + 6.0 + width < WIDTH {
                    written.push((x + 6.0, x + 6.0 + width, y));
                    let _ = write!(
                        svg,
                        "<text class=\"setting\" fill=\"{fill}\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                        x + 6.0,
                        y - 4.0,
                        Escaped(&setting.name)
                    );
                }
            }
        }
        svg + "</svg>\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setting(name: &str, cost: f64, error: f64, marked: bool) -> Setting {
        Setting { name: name.into(), cost, error, marked }
    }

    #[test]
    fn each_setting_has_its_place_and_the_marked_one_a_ring() {
        let settings =
            vec![setting("<1>", 1.0, 10.0, false), setting("2", 10.0, 1.0, true), setting("3", 100.0, 0.1, false)];
        let plot = Tradeoff {
            error_label: "error, px".into(),
            cost_label: "s".into(),
            logarithmic: true,
            curves: vec![("knob".into(), 0, settings)],
        };
        let svg = plot.svg();
        assert_eq!((svg.matches("class=\"ring\"").count(), svg.matches("<title>knob: ").count()), (1, 3));
        assert!(svg.contains("&lt;1&gt;") && !svg.contains("<1>"));
        let heights: Vec<f64> =
            svg.split("cy=\"").skip(1).map(|rest| rest.split('"').next().unwrap().parse().unwrap()).collect();
        assert!(heights[0] < heights[1] && heights[1] < heights[3], "less error lies lower: {heights:?}");
        assert!((heights[3] + heights[0] - 2.0 * heights[1]).abs() < 0.2, "decades are alike: {heights:?}");
    }

    #[test]
    fn what_has_no_place_is_not_drawn() {
        let wrong = [(0.0, 1.0), (-1.0, 1.0), (1.0, f64::NAN), (f64::INFINITY, 1.0), (1.0, -1.0), (1.0, 1e301)];
        for logarithmic in [false, true] {
            let settings = wrong.map(|(cost, error)| setting("a", cost, error, true)).to_vec();
            let mut plot = Tradeoff { logarithmic, curves: vec![("knob".into(), 3, settings)], ..Tradeoff::default() };
            assert_eq!(plot.svg(), "");
            plot.curves[0].2.extend([setting("b", 1.0, 0.0, false), setting("c", 2.0, 5.0, false)]);
            let svg = plot.svg();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            assert_eq!(svg.matches("<title>").count(), if logarithmic { 1 } else { 2 });
        }
    }
}
