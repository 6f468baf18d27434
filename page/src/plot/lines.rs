//! Plots of lines or dots over two axes.

use std::fmt::Write as _;

use super::scale::Scale;
use crate::html::{Escaped, number};

/// Colours in the style sheet (`--run-0` ...); with more runs they come again with another dash.
pub const COLOURS: usize = 8;
const DASHES: [&str; 4] = ["", "7 3", "2 3", "9 3 2 3"];

pub(super) const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 290.0;
pub(super) const LEFT: f64 = 70.0;
const RIGHT: f64 = 20.0;
pub(super) const TOP: f64 = 34.0;
pub(super) const BOTTOM: f64 = 44.0;

/// One line.
#[derive(Clone, Debug)]
pub struct Series {
    /// What it is called in the legend and on hovering.
    pub name: String,
    /// Index of the run: decides colour and dash.
    pub run: usize,
    /// x and y.
    pub points: Vec<(f64, f64)>,
}

/// A plot of one quantity of all runs.
#[derive(Clone, Debug, Default)]
pub struct Plot {
    /// Written above the y axis, with its unit.
    pub y_label: String,
    /// Written below the x axis, with its unit.
    pub x_label: String,
    /// Whether the x axis begins at zero.
    pub from_zero: bool,
    /// Whether the y axis is logarithmic.
    pub log_y: bool,
    /// Dots instead of lines, for what scatters: the outermost hundredth at either end does not stretch the y axis, and what
    /// lies beyond it is drawn at its end.
    pub dots: bool,
    /// The lines.
    pub series: Vec<Series>,
    /// Vertical lines: position and what it is.
    pub marks: Vec<(f64, String)>,
    /// Shaded ranges of x.
    pub bands: Vec<[f64; 2]>,
}

/// The style of a run's line.
pub(super) fn stroke(run: usize) -> String {
    let dash = DASHES[(run / COLOURS + run) % DASHES.len()];
    format!("stroke=\"var(--run-{})\" stroke-dasharray=\"{dash}\"", run % COLOURS)
}

/// A piece of a run's line, to stand before its name; nothing for what is no run.
#[must_use]
pub fn swatch(run: Option<usize>) -> String {
    run.map_or(String::new(), |run| {
        format!(
            "<svg class=\"swatch\" viewBox=\"0 0 30 8\" aria-hidden=\"true\"><path d=\"M1 4H29\" class=\"line\" {}/></svg>",
            stroke(run)
        )
    })
}

/// The legend: a line and a name for each run.
#[must_use]
pub fn legend<'a>(runs: impl Iterator<Item = (usize, &'a str)>) -> String {
    let mut html = String::from("<p class=\"legend\">");
    for (run, name) in runs {
        let _ = write!(html, "<span>{}{}</span>", swatch(Some(run)), Escaped(name));
    }
    html + "</p>\n"
}

/// A picture of a plot begins, with what its axes are of.
pub(super) fn opened(class: &str, height: f64, y_label: &str, x_label: &str) -> String {
    format!(
        "<svg class=\"{class}\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{0} against {1}\">\
         <text class=\"label\" x=\"{LEFT}\" y=\"16\">{0}</text>",
        Escaped(y_label),
        Escaped(x_label)
    )
}

/// The lines and figures of the y axis.
pub(super) fn rows(svg: &mut String, y: &Scale, right: f64, bottom: f64) {
    for (value, text) in &y.ticks {
        let at = bottom - y.place(*value);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{right}\"/>\
             <text class=\"tick\" text-anchor=\"end\" x=\"{:.1}\" y=\"{:.1}\">{text}</text>",
            LEFT - 7.0,
            at + 4.0
        );
    }
}

impl Plot {
    /// The figure, or nothing where there is nothing to draw.
    #[must_use]
    pub fn svg(&self) -> String {
        let drawable: Vec<(&Series, Vec<(f64, f64)>)> = self
            .series
            .iter()
            .map(|series| (series, series.points.iter().copied().filter(|point| self.drawable(*point)).collect()))
            .filter(|(_, points): &(_, Vec<_>)| !points.is_empty())
            .collect();
        let zero = self.from_zero.then_some(0.0);
        let xs = drawable.iter().flat_map(|(_, points)| points.iter().map(|point| point.0)).chain(zero);
        let mut ys: Vec<f64> = drawable.iter().flat_map(|(_, points)| points.iter().map(|point| point.1)).collect();
        if self.dots {
            without_far_ends(&mut ys);
        }
        let ys = ys.into_iter();
        let Some(x) = Scale::linear(xs, WIDTH - LEFT - RIGHT, 6, false) else { return String::new() };
        let height = HEIGHT - TOP - BOTTOM;
        let y = if self.log_y { Scale::logarithmic(ys, height) } else { Scale::linear(ys, height, 5, true) };
        let Some(y) = y else { return String::new() };

        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        let mut svg = opened("plot", HEIGHT, &self.y_label, &self.x_label);
        for band in &self.bands {
            let [from, to] = band.map(|at| (LEFT + x.place(at)).clamp(LEFT, right));
            if to > from {
                let _ = write!(
                    svg,
                    "<rect class=\"band\" x=\"{from:.1}\" y=\"{TOP}\" width=\"{:.1}\" height=\"{height}\"/>",
                    to - from
                );
            }
        }
        rows(&mut svg, &y, right, bottom);
        for (value, text) in &x.ticks {
            let at = LEFT + x.place(*value);
            if self.marks.len() <= 1 && at > LEFT + 1.0 {
                let _ = write!(svg, "<path class=\"grid\" d=\"M{at:.1} {TOP}V{bottom}\"/>");
            }
            let _ = write!(
                svg,
                "<path class=\"axis\" d=\"M{at:.1} {bottom}v5\"/>\
                 <text class=\"tick\" text-anchor=\"middle\" x=\"{at:.1}\" y=\"{:.1}\">{text}</text>",
                bottom + 18.0
            );
        }
        for (at, what) in &self.marks {
            let place = LEFT + x.place(*at);
            if (LEFT..=right).contains(&place) {
                let _ = write!(
                    svg,
                    "<path class=\"mark\" d=\"M{place:.1} {TOP}V{bottom}\"><title>{}</title></path>",
                    Escaped(what)
                );
            }
        }
        let _ = write!(
            svg,
            "<path class=\"axis\" d=\"M{LEFT} {bottom}H{right}\"/>\
             <text class=\"label\" text-anchor=\"middle\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            (LEFT + right) / 2.0,
            HEIGHT - 6.0,
            Escaped(&self.x_label)
        );
        for (series, points) in &drawable {
            let place = |(px, py): (f64, f64)| (LEFT + x.place(px), bottom - y.place(py).clamp(0.0, height));
            if self.dots { dots(&mut svg, series, points, place) } else { line(&mut svg, series, points, place) }
        }
        svg + "</svg>\n"
    }

    fn drawable(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && y.is_finite() && (!self.log_y || y > 0.0)
    }
}

fn line(svg: &mut String, series: &Series, points: &[(f64, f64)], place: impl Fn((f64, f64)) -> (f64, f64)) {
    let mut path = String::new();
    for (at, &point) in points.iter().enumerate() {
        let (x, y) = place(point);
        let _ = write!(path, "{}{x:.1} {y:.1}", if at == 0 { 'M' } else { 'L' });
    }
    let _ = write!(svg, "<path class=\"line\" {} d=\"{path}\"/>", stroke(series.run));
    if points.len() > 64 {
        return;
    }
    for &point in points {
        let (x, y) = place(point);
        let _ = write!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\" fill=\"var(--run-{})\"><title>{}: {} at {}</title></circle>",
            series.run % COLOURS,
            Escaped(&series.name),
            significant(point.1),
            significant(point.0)
        );
    }
}

fn dots(svg: &mut String, series: &Series, points: &[(f64, f64)], place: impl Fn((f64, f64)) -> (f64, f64)) {
    let _ = write!(svg, "<g class=\"dots\" fill=\"var(--run-{})\">", series.run % COLOURS);
    for &point in points {
        let (x, y) = place(point);
        let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.5\"/>");
    }
    svg.push_str("</g>");
}

/// Moves what lies far outside the bulk of the values to its border.
fn without_far_ends(values: &mut [f64]) {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else { return };
    let [low, high] = [0.01, 0.99].map(|share| sorted[(last as f64 * share).round() as usize]);
    let margin = (high - low) / 2.0;
    for value in values {
        *value = value.clamp(low - margin, high + margin);
    }
}

/// Four significant digits, for the text that appears at a point.
fn significant(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let decimals = (3.0 - value.abs().log10().floor()).clamp(0.0, 12.0);
    number(value, decimals as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plot(points: Vec<(f64, f64)>, log_y: bool) -> Plot {
        Plot { log_y, series: vec![Series { name: "a<b".into(), run: 0, points }], ..Plot::default() }
    }

    #[test]
    fn a_plot_of_nothing_is_nothing() {
        assert_eq!(plot(vec![], false).svg(), "");
        assert_eq!(plot(vec![(1.0, f64::NAN)], false).svg(), "");
        assert_eq!(plot(vec![(1.0, -1.0)], true).svg(), "");
    }

    #[test]
    fn names_are_escaped() {
        let svg = plot(vec![(0.0, 1.0), (1.0, 2.0)], false).svg();
        assert!(svg.contains("a&lt;b") && !svg.contains("a<b"));
    }

    #[test]
    fn the_outermost_of_many_dots_do_not_flatten_the_others() {
        let mut points: Vec<(f64, f64)> = (0..200).map(|at| (f64::from(at), f64::from(at % 5))).collect();
        points[100].1 = 1e6;
        let svg = Plot { dots: true, ..plot(points, false) }.svg();
        let heights = svg.split("cy=\"").skip(1).map(|rest| rest.split('"').next().unwrap().parse().unwrap());
        let heights: Vec<f64> = heights.collect();
        assert_eq!(heights.len(), 200);
        assert!(heights[0] - heights[4] > 0.4 * (HEIGHT - TOP - BOTTOM), "{} {}", heights[0], heights[4]);
        assert!(
            heights.iter().all(|height| (TOP..=HEIGHT - BOTTOM).contains(height)) && heights[100] < heights[4] - 10.0
        );
        assert!(!svg.contains("class=\"line\""), "no line between them");
    }

    proptest! {
        #[test]
        fn whatever_is_plotted_lands_inside_the_picture(
            points in proptest::collection::vec((any::<f64>(), any::<f64>()), 1..20),
            log_y in any::<bool>(),
            dots in any::<bool>(),
        ) {
            // Larger spans overflow the difference of two numbers.
            let points: Vec<_> = points.into_iter().map(|(x, y)| (x.clamp(-1e300, 1e300), y.clamp(-1e300, 1e300))).collect();
            let svg = Plot { dots, ..plot(points, log_y) }.svg();
            prop_assert!(!svg.contains("NaN") && !svg.contains("inf"), "{}", svg);
            for circle in svg.split("<circle cx=\"").skip(1) {
                let x: f64 = circle.split('"').next().unwrap().parse().unwrap();
                prop_assert!((LEFT - 0.1..=WIDTH - RIGHT + 0.1).contains(&x), "{x}");
            }
        }
    }
}
