//! Axes: which values they span, and where their ticks are.

use crate::html::number;

/// A range of values along an axis, and its ticks.
pub(super) struct Scale {
    low: f64,
    high: f64,
    length: f64,
    logarithmic: bool,
    /// Where ticks are, and what is written there.
    pub ticks: Vec<(f64, String)>,
}

impl Scale {
    /// Around `values`, about `count` ticks. `widen`: the range ends at ticks, so that no line touches the border.
    pub fn linear(values: impl Iterator<Item = f64>, length: f64, count: usize, widen: bool) -> Option<Self> {
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
    pub fn logarithmic(values: impl Iterator<Item = f64>, length: f64) -> Option<Self> {
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

    /// How far from the beginning of the axis `value` lies.
    pub fn place(&self, value: f64) -> f64 {
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
}
