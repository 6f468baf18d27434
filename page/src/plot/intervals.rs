//! Charts of one quantity of several things: a row each.

use std::fmt::Write as _;

use super::scale::Scale;
use crate::html::Escaped;

const WIDTH: f64 = 560.0;
const LEFT: f64 = 120.0;
const RIGHT: f64 = 20.0;
const ROW: f64 = 22.0;

/// One row.
#[derive(Clone, Debug)]
pub struct Interval {
    /// Written left of the row.
    pub name: String,
    /// Where its dot is; at least zero, as all values here.
    pub value: f64,
    /// The standard deviation of the value.
    pub sigma: f64,
    /// Where a stroke marks the limit of the value.
    pub limit: f64,
    /// Whether the row stands out.
    pub marked: bool,
}

/// A dot for each thing with its standard deviation, and a stroke at its limit. The axis begins at zero.
#[derive(Clone, Debug, Default)]
pub struct Intervals {
    /// Written below the axis, with its unit.
    pub label: String,
    /// The rows, from the top.
    pub rows: Vec<Interval>,
}

impl Intervals {
    /// The figure, or nothing where there are no rows.
    #[must_use]
    pub fn svg(&self) -> String {
        let length = WIDTH - LEFT - RIGHT;
        let far = self.rows.iter().flat_map(|row| [row.value, row.value + row.sigma, row.limit]);
        let most = far.filter(|value| value.is_finite()).fold(0.0, f64::max).max(1e-9);
        let Some(scale) = Scale::linear([0.0, 1.05 * most].into_iter(), length, 6, false) else { return String::new() };
        if self.rows.is_empty() {
            return String::new();
        }
        let x = |value: f64| LEFT + scale.place(value).clamp(0.0, length);
        let height = ROW * self.rows.len() as f64;
        let mut svg = format!(
            "<svg class=\"plot intervals\" viewBox=\"0 0 {WIDTH} {:.0}\" role=\"img\" aria-label=\"{}\">",
            height + 50.0,
            Escaped(&self.label)
        );
        for (value, text) in &scale.ticks {
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{0:.1} 0V{height:.0}\"/><text class=\"tick\" text-anchor=\"middle\" x=\"{0:.1}\" \
                 y=\"{1:.0}\">{text}</text>",
                x(*value),
                height + 18.0
            );
        }
        let _ = write!(
            svg,
            "<text class=\"label\" text-anchor=\"end\" x=\"{:.0}\" y=\"{:.0}\">{}</text>",
            WIDTH - RIGHT,
            height + 40.0,
            Escaped(&self.label)
        );
        for (index, row) in self.rows.iter().enumerate() {
            let y = ROW * (index as f64 + 0.5);
            let _ = write!(
                svg,
                "<text class=\"tick\" text-anchor=\"end\" x=\"{:.0}\" y=\"{:.1}\">{}</text>",
                LEFT - 10.0,
                y + 4.0,
                Escaped(&row.name)
            );
            if row.limit.is_finite() {
                let _ = write!(svg, "<path class=\"limit\" d=\"M{:.1} {:.1}v14\"/>", x(row.limit), y - 7.0);
            }
            // An unknown deviation has no line, an unknown value nothing.
            if row.value.is_finite() {
                let sigma = if row.sigma.is_finite() { row.sigma } else { 0.0 };
                let _ = write!(
                    svg,
                    "<g class=\"{}\"><path d=\"M{:.1} {y:.1}H{:.1}\"/><circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"4\"/></g>",
                    if row.marked { "marked" } else { "unmarked" },
                    x(row.value - sigma),
                    x(row.value + sigma),
                    x(row.value)
                );
            }
        }
        svg + "</svg>\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(value: f64, sigma: f64, limit: f64) -> Interval {
        Interval { name: "<c>".into(), value, sigma, limit, marked: value > limit }
    }

    #[test]
    fn rows_are_drawn_from_zero_on_one_axis() {
        let rows = vec![row(1.0, 0.5, 4.0), row(9.5, 0.5, 4.0)];
        let svg = Intervals { label: "shift, mm".into(), rows }.svg();
        assert_eq!((svg.matches("&lt;c&gt;").count(), svg.matches("class=\"limit\"").count()), (2, 2));
        assert_eq!((svg.matches("\"unmarked\"").count(), svg.matches("\"marked\"").count()), (1, 1));
        // 420 pixels for 10.5 mm.
        assert!(svg.contains("<path d=\"M140.0 11.0H180.0\"/><circle cx=\"160.0\""), "{svg}");
        assert!(svg.contains("<path d=\"M480.0 33.0H520.0\"/><circle cx=\"500.0\""), "{svg}");
        assert!(svg.contains(">0</text>") && svg.contains(">10</text>"), "{svg}");
    }

    #[test]
    fn what_is_not_known_is_not_drawn() {
        assert_eq!(Intervals::default().svg(), "");
        let rows =
            vec![row(0.0, f64::INFINITY, 0.0), row(f64::NAN, f64::NAN, f64::NAN), row(1.0, f64::NAN, f64::INFINITY)];
        let svg = Intervals { label: String::new(), rows }.svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert_eq!((svg.matches("<circle").count(), svg.matches("&lt;c&gt;").count()), (2, 3));
    }
}
