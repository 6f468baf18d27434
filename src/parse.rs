//! Values of options that clap has no type for.

use std::{fmt, str::FromStr};

use erfgs_base::plausible::{Brief, INSTANT};
use erfgs_events::SensorSize;

/// Iterations of the coarse and the fine stage: `3000+14000`. One number alone means that many fine iterations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Iterations {
    /// Of the coarse stage; `None` leaves the preset's.
    pub coarse: Option<u32>,
    /// Of the fine stage.
    pub fine: u32,
}

impl fmt::Display for Iterations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.coarse {
            Some(coarse) => write!(f, "{coarse}+{}", self.fine),
            None => write!(f, "{}", self.fine),
        }
    }
}

impl FromStr for Iterations {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| {
            part.trim()
                .parse::<u32>()
                .map_err(|_| format!("'{text}' is not COARSE+FINE iterations; write for example 3000+14000"))
        };
        match text.split_once('+') {
            Some((coarse, fine)) => Ok(Self { coarse: Some(number(coarse)?), fine: number(fine)? }),
            None => Ok(Self { coarse: None, fine: number(text)? }),
        }
    }
}

/// A number of seconds, 0 or more.
pub fn seconds(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "a number of seconds".to_owned())?;
    if value >= 0.0 { Ok(INSTANT.check(value)?) } else { Err("a number of seconds, 0 or more".into()) }
}

/// Reads a number from `least` to `most`, both included.
pub fn within(least: f64, most: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let value = text.parse::<f64>().ok().filter(|value| (least..=most).contains(value));
        value.ok_or_else(|| format!("write a number from {} to {}", Brief(least), Brief(most)))
    }
}

/// The size of a sensor: `1280x720`.
pub fn sensor_size(text: &str) -> Result<SensorSize, String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let size = sides.map(|(width, height)| SensorSize { width, height });
    let size = size
        .filter(|size| size.width > 0 && size.height > 0)
        .ok_or_else(|| format!("'{text}' is no sensor size; write for example 1280x720"))?;
    Ok(size.checked()?)
}

/// An inclusive range of frame indices: `40..84` are 45 frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    /// First frame.
    pub first: u64,
    /// Last frame, included.
    pub last: u64,
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' is not a range of frames; write for example 40..84 (both included)");
        let (first, last) = text.split_once("..").ok_or_else(wrong)?;
        let bound = |part: &str| part.strip_prefix('=').unwrap_or(part).parse::<u64>().map_err(|_| wrong());
        let range = Self { first: bound(first)?, last: bound(last)? };
        if range.first > range.last {
            return Err(format!("'{text}' ends before it starts; write the lower frame first"));
        }
        Ok(range)
    }
}

/// Two contrast thresholds, ON and OFF; one alone stands for both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds(pub [f64; 2]);

impl FromStr for Thresholds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' are no thresholds; write ON,OFF between 0.01 and 2, for example 0.22,0.25");
        let one = |part: &str| part.trim().parse().ok().filter(|c| (0.01..=2.0).contains(c)).ok_or_else(wrong);
        let (on, off) = text.split_once(',').unwrap_or((text, text));
        Ok(Self([one(on)?, one(off)?]))
    }
}

/// Cameras by number (a count that is spread evenly) or by name, separated by commas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraChoice {
    /// So many.
    Count(u32),
    /// These.
    Names(Vec<String>),
}

impl FromStr for CameraChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(count) = text.parse() {
            return Ok(Self::Count(count));
        }
        let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
        if names.iter().any(String::is_empty) {
            return Err(format!("'{text}' is neither a count nor a list of camera names such as 03,07,12"));
        }
        Ok(Self::Names(names))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iterations_are_coarse_plus_fine() {
        assert_eq!("3000+14000".parse(), Ok(Iterations { coarse: Some(3000), fine: 14_000 }));
        assert_eq!("500".parse(), Ok(Iterations { coarse: None, fine: 500 }));
        for wrong in ["", "+", "3000+", "-1+5", "a+b"] {
            assert!(wrong.parse::<Iterations>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn numbers_of_options_are_held_within_their_range() {
        assert_eq!(within(0.0, 100.0)("20"), Ok(20.0));
        for wrong in ["-1", "100.1", "nan", "inf", "1e308", "x", ""] {
            assert!(within(0.0, 100.0)(wrong).is_err_and(|message| message.contains("0 to 100")), "{wrong}");
        }
        assert_eq!(seconds("7200"), Ok(7200.0));
        for wrong in ["-1", "nan", "inf", "1e300", "1e10"] {
            assert!(seconds(wrong).is_err(), "{wrong}");
        }
        assert!(sensor_size("1280x720").is_ok());
        for wrong in ["65535x65535", "0x3", "1280", "70000x2"] {
            assert!(sensor_size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn frame_ranges_include_both_ends() {
        assert_eq!("40..84".parse(), Ok(FrameRange { first: 40, last: 84 }));
        assert_eq!("40..=84".parse(), Ok(FrameRange { first: 40, last: 84 }));
        for wrong in ["", "40", "40..", "84..40", "a..b", "1..2..3"] {
            assert!(wrong.parse::<FrameRange>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn cameras_are_a_count_or_names() {
        assert_eq!("4".parse(), Ok(CameraChoice::Count(4)));
        assert_eq!("03, cam7".parse(), Ok(CameraChoice::Names(vec!["03".into(), "cam7".into()])));
        assert!("a,,b".parse::<CameraChoice>().is_err());
    }
}
