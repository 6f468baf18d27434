//! Line plots as inline SVG.

use std::fmt::Write as _;

use super::html::{Escaped, number};

/// Colours in the style sheet (`--run-0` ...); with more runs they come again with another dash.
pub const COLOURS: usize = 8;
const DASHES: [&str; 4] = ["", "7 3", "2 3", "9 3 2 3"];

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 290.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 44.0;

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
    /// The lines.
    pub series: Vec<Series>,
    /// Vertical lines: position and what it is.
    pub marks: Vec<(f64, String)>,
    /// Shaded ranges of x.
    pub bands: Vec<[f64; 2]>,
}

/// The style of a run's line.
fn stroke(run: usize) -> String {
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
        let ys = drawable.iter().flat_map(|(_, points)| points.iter().map(|point| point.1));
        let Some(x) = Scale::linear(xs, WIDTH - LEFT - RIGHT, 6, false) else { return String::new() };
        let height = HEIGHT - TOP - BOTTOM;
        let y = if self.log_y { Scale::logarithmic(ys, height) } else { Scale::linear(ys, height, 5, true) };
        let Some(y) = y else { return String::new() };

        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        let mut svg = format!(
            "<svg class=\"plot\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0} against {1}\">\
             <text class=\"label\" x=\"{LEFT}\" y=\"16\">{0}</text>",
            Escaped(&self.y_label),
            Escaped(&self.x_label)
        );
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
            self.line(&mut svg, series, points, |(px, py)| (LEFT + x.place(px), bottom - y.place(py)));
        }
        svg + "</svg>\n"
    }

    fn drawable(&self, (x, y): (f64, f64)) -> bool {
        x.is_finite() && y.is_finite() && (!self.log_y || y > 0.0)
    }

    fn line(&self, svg: &mut String, series: &Series, points: &[(f64, f64)], place: impl Fn((f64, f64)) -> (f64, f64)) {
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
}

/// Four significant digits, for the text that appears at a point.
fn significant(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let decimals = (3.0 - value.abs().log10().floor()).clamp(0.0, 12.0);
    number(value, decimals as usize)
}

/// A range of values along an axis, and its ticks.
struct Scale {
    low: f64,
    high: f64,
    length: f64,
    logarithmic: bool,
    ticks: Vec<(f64, String)>,
}

impl Scale {
    /// Around `values`, about `count` ticks. `widen`: the range ends at ticks, so that no line touches the border.
    fn linear(values: impl Iterator<Item = f64>, length: f64, count: usize, widen: bool) -> Option<Self> {
        let (mut low, mut high) = range(values)?;
        let size = high.abs().max(low.abs());
        if high - low <= 1e-9 * size || size < 1e-200 {
            let margin = if size < 1e-200 { 1.0 } else { size * 0.05 };
            (low, high) = (low - margin, high + margin);
        }
        let step = nice_step((high - low) / count as f64);
        if widen {
            let margin = 0.04 * (high - low);
            // What cannot be negative keeps an axis that is not.
            let floor = if low >= 0.0 { 0.0 } else { f64::NEG_INFINITY };
            low = (((low - margin) / step).floor() * step).max(floor);
            high = ((high + margin) / step).ceil() * step;
        }
        Some(Self { low, high, length, logarithmic: false, ticks: multiples(low, high, step) })
    }

    /// Around positive `values`, ticks at powers of ten, with those at 2 and 5 times them where the range is short, or at
    /// equal steps where it is shorter still.
    fn logarithmic(values: impl Iterator<Item = f64>, length: f64) -> Option<Self> {
        let (low, high) = range(values.map(f64::log10))?;
        let margin = 0.04 * (high - low).max(0.5);
        let (low, high) = (low - margin, high + margin);
        let factors: &[f64] = if high - low > 3.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let stride = (((high - low) / 7.0).ceil() as usize).max(1);
        let mut ticks = Vec::new();
        for exponent in (low.floor() as i32..=high.ceil() as i32).step_by(stride) {
            for factor in factors {
                let value = factor * 10f64.powi(exponent);
                if (low..=high).contains(&value.log10()) {
                    ticks.push((value, scientific(*factor, exponent)));
                }
            }
        }
        if ticks.len() < 3 {
            let (from, to) = (10f64.powf(low), 10f64.powf(high));
            ticks = multiples(from, to, nice_step((to - from) / 4.0));
        }
        Some(Self { low, high, length, logarithmic: true, ticks })
    }

    fn place(&self, value: f64) -> f64 {
        let value = if self.logarithmic { value.log10() } else { value };
        (value - self.low) / (self.high - self.low) * self.length
    }
}

fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |range, value| match range {
        None => Some((value, value)),
        Some((low, high)) => Some((value.min(low), value.max(high))),
    })
}

/// The least of 1, 2, 5 times a power of ten that is at least `raw`.
fn nice_step(raw: f64) -> f64 {
    let magnitude = 10f64.powf(raw.log10().floor());
    let nice = [1.0, 2.0, 5.0].into_iter().map(|multiple| multiple * magnitude);
    nice.into_iter().find(|step| *step >= raw * (1.0 - 1e-9)).unwrap_or(10.0 * magnitude)
}

/// The multiples of `step` from `low` to `high`, with their texts.
fn multiples(low: f64, high: f64, step: f64) -> Vec<(f64, String)> {
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    let exponent = high.abs().max(low.abs()).log10().floor() as i32;
    // Small and huge numbers share a power of ten, so that their digits stay few.
    let shared = if (-3..7).contains(&exponent) { 0 } else { exponent };
    let unit = 10f64.powi(shared);
    let decimals = (-(step / unit).log10().floor()).clamp(0.0, 12.0) as usize;
    let text = |value: f64| match shared {
        _ if value == 0.0 => "0".into(),
        0 => number(value, decimals),
        _ => format!("{}·{}", number(value / unit, decimals), power_of_ten(shared)),
    };
    (first..=last.min(first.saturating_add(100)))
        .map(|tick| tick as f64 * step)
        .map(|value| (value, text(value)))
        .collect()
}

fn scientific(factor: f64, exponent: i32) -> String {
    if (-2..4).contains(&exponent) {
        return number(factor * 10f64.powi(exponent), (-exponent).max(0) as usize);
    }
    if factor == 1.0 { power_of_ten(exponent) } else { format!("{factor}·{}", power_of_ten(exponent)) }
}

fn power_of_ten(exponent: i32) -> String {
    format!("10{}", exponent.to_string().chars().map(superscript).collect::<String>())
}

fn superscript(character: char) -> char {
    match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => digit.to_digit(10).and_then(|digit| char::from_u32(0x2070 + digit)).unwrap_or(digit),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plot(points: Vec<(f64, f64)>, log_y: bool) -> Plot {
        Plot { log_y, series: vec![Series { name: "a<b".into(), run: 0, points }], ..Plot::default() }
    }

    #[test]
    fn ticks_fall_on_round_numbers() {
        let scale = Scale::linear([21.3, 26.9].into_iter(), 100.0, 5, true).unwrap();
        let texts: Vec<&str> = scale.ticks.iter().map(|(_, text)| text.as_str()).collect();
        assert_eq!(texts, ["20", "22", "24", "26", "28"]);
        let scale = Scale::logarithmic([2e-4, 0.3].into_iter(), 100.0).unwrap();
        let texts: Vec<&str> = scale.ticks.iter().map(|(_, text)| text.as_str()).collect();
        assert_eq!(texts, ["10⁻³", "0.01", "0.1"]);
        let scale = Scale::logarithmic([3.6e-4, 4.3e-4].into_iter(), 100.0).unwrap();
        let texts: Vec<&str> = scale.ticks.iter().map(|(_, text)| text.as_str()).collect();
        assert_eq!(texts, ["3.5·10⁻⁴", "4.0·10⁻⁴", "4.5·10⁻⁴"]);
        let scale = Scale::linear([0.0, 13_000.0].into_iter(), 100.0, 5, true).unwrap();
        assert_eq!(scale.low, 0.0, "a number of things is not negative");
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

    proptest! {
        #[test]
        fn whatever_is_plotted_lands_inside_the_picture(
            points in proptest::collection::vec((any::<f64>(), any::<f64>()), 1..20),
            log_y in any::<bool>(),
        ) {
            // Larger spans overflow the difference of two numbers.
            let points: Vec<_> = points.into_iter().map(|(x, y)| (x.clamp(-1e300, 1e300), y.clamp(-1e300, 1e300))).collect();
            let svg = plot(points, log_y).svg();
            prop_assert!(!svg.contains("NaN") && !svg.contains("inf"), "{}", svg);
            for circle in svg.split("<circle cx=\"").skip(1) {
                let x: f64 = circle.split('"').next().unwrap().parse().unwrap();
                prop_assert!((LEFT - 0.1..=WIDTH - RIGHT + 0.1).contains(&x), "{x}");
            }
        }
    }
}
