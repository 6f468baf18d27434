//! The wand itself: three LEDs on a straight stick.

use std::{fmt, str::FromStr};

use crate::board::not_metres;

/// Nobody waves a longer one, metres.
const LONGEST_M: f64 = 10.0;

/// Three LEDs on a line, at known gaps.
///
/// Gaps that differ tell the two ends apart; with equal gaps the LEDs must come labelled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stick {
    gaps_m: [f64; 2],
}

impl Stick {
    /// A wand by its two gaps, metres; `None` unless both are positive and finite.
    #[must_use]
    pub fn new(gaps_m: [f64; 2]) -> Option<Self> {
        gaps_m.iter().all(|gap| *gap > 0.0 && gap.is_finite()).then_some(Self { gaps_m })
    }

    /// The gaps between neighbouring LEDs, metres.
    #[must_use]
    pub fn gaps_m(&self) -> [f64; 2] {
        self.gaps_m
    }

    /// The distance of the outer LEDs, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.gaps_m[0] + self.gaps_m[1]
    }

    /// Where the LEDs are along the stick, metres from its middle.
    #[must_use]
    pub fn offsets_m(&self) -> [f64; 3] {
        let half = self.length_m() / 2.0;
        [-half, self.gaps_m[0] - half, half]
    }

    /// Where the middle LED is between the outer ones: 0 at the first, 1 at the last.
    pub(super) fn share(&self) -> f64 {
        self.gaps_m[0] / self.length_m()
    }
}

impl FromStr for Stick {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' is no wand; write the two gaps between its LEDs in metres, such as 0.13+0.26");
        let (first, second) = text.split_once('+').ok_or_else(wrong)?;
        let gap = |part: &str| part.trim().parse::<f64>().map_err(|_| wrong());
        let gaps = [gap(first)?, gap(second)?];
        let stick = Self::new(gaps).ok_or_else(wrong)?;
        match gaps.into_iter().max_by(f64::total_cmp).and_then(|most| not_metres(most, LONGEST_M)) {
            Some(meant) => Err(format!("a wand of {} m cannot be; {meant}", stick.length_m())),
            None => Ok(stick),
        }
    }
}

impl fmt::Display for Stick {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}+{}", self.gaps_m[0], self.gaps_m[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wand_is_written_as_its_gaps() {
        let stick: Stick = "0.13+0.26".parse().unwrap();
        let expected = [-0.195, -0.065, 0.195];
        assert!(stick.offsets_m().iter().zip(expected).all(|(found, known)| (found - known).abs() < 1e-15));
        assert_eq!(stick.to_string(), "0.13+0.26");
        let message = "130+260".parse::<Stick>().unwrap_err();
        assert!(message.contains("390 m cannot be; if it is millimetres, write 0.26"), "{message}");
        for wrong in ["", "0.13", "0.13+", "0.13+-1", "nan+1", "0+1", "1+2+3"] {
            assert!(wrong.parse::<Stick>().is_err(), "{wrong}");
        }
    }
}
