//! The unit of the lengths in other programs' files, which most of them do not say.
//!
//! What a file says is taken, or what the user says. Where nobody does, formats that are meant to be in metres are taken to be, as
//! long as the cameras stand as near to each other as a rig's do: files in millimetres are common, and a rig of 431 m is one of them.

use std::{fmt, path::Path, str::FromStr};

use super::ExchangeError;
use crate::rig_file::RigFile;

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// 1 m
    Metre,
    /// 0.01 m
    Centimetre,
    /// 0.001 m
    Millimetre,
    /// 0.0254 m
    Inch,
}

impl Unit {
    const ALL: [Self; 4] = [Self::Metre, Self::Centimetre, Self::Millimetre, Self::Inch];

    /// How long it is, metres.
    #[must_use]
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
            Self::Inch => 0.0254,
        }
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Inch => "inch",
        })
    }
}

impl FromStr for Unit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text.trim().to_lowercase().as_str() {
            "m" | "metre" | "metres" | "meter" | "meters" => Self::Metre,
            "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => Self::Centimetre,
            "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => Self::Millimetre,
            "in" | "inch" | "inches" => Self::Inch,
            _ => {
                let text: String = text.escape_debug().take(40).collect();
                return Err(format!("the unit '{text}' is not known; m, cm, mm and inch are"));
            }
        })
    }
}

/// A rig as a file has it, its lengths not yet in metres.
pub(super) struct Found {
    pub rig: RigFile,
    /// The unit that the file says.
    pub unit: Option<Unit>,
    /// Whether the format's own documentation says that its lengths are metres.
    pub metres_by_format: bool,
}

impl Found {
    /// A rig of a format that is of no scale, or whose files are in metres.
    pub fn new(rig: RigFile) -> Self {
        Self { rig, unit: None, metres_by_format: false }
    }
}

/// Whether a key of a file says its unit.
pub(super) fn is_key(key: &str) -> bool {
    matches!(
        key.to_ascii_lowercase().as_str(),
        "unit" | "units" | "length_unit" | "length_units" | "translation_unit" | "translation_units"
    )
}

/// The one unit that the words of a file say, if any do.
pub(super) fn stated<'a>(words: impl Iterator<Item = Option<&'a str>>) -> Result<Option<Unit>, String> {
    let mut unit = None;
    for word in words {
        let other: Unit = word.ok_or("its unit is no word; m, cm, mm and inch are")?.parse()?;
        if let Some(unit) = unit.filter(|unit| *unit != other) {
            return Err(format!("it says two units of length, {unit} and {other}; correct one of them"));
        }
        unit = Some(other);
    }
    Ok(unit)
}

/// The farthest that cameras of a rig are believed to be apart where nobody says that the unit is the metre, metres.
const FARTHEST_M: f64 = 20.0;

/// The rig with its lengths in metres, where these are known; `given` is the unit that the user says.
pub(super) fn in_metres(path: &Path, found: Found, given: Option<Unit>) -> Result<RigFile, ExchangeError> {
    let Found { mut rig, unit: file_unit, metres_by_format } = found;
    if let (Some(file_unit), Some(given)) = (file_unit, given)
        && file_unit != given
    {
        let what = format!("it says that its unit is {file_unit}, and the option {given}; leave the option out");
        return Err(ExchangeError::Malformed { path: path.into(), what });
    }
    match given.or(file_unit) {
        Some(unit) => {
            rig.scale(unit.metres());
            rig.metric = true;
        }
        None if rig.metric => {
            let Some(reach) = Reach::of(&rig) else { return Ok(rig) };
            if reach.length > FARTHEST_M {
                return Err(ExchangeError::Unit { path: path.into(), seen: reach.to_string(), likely: reach.likely() });
            }
            if !metres_by_format {
                rig.warnings
                    .push(format!("{reach}, as the file does not say its unit: if it is not the metre, give --units"));
            }
        }
        None => {}
    }
    Ok(rig)
}

/// How far a rig reaches: from one camera to another, or of one camera from the world's origin.
struct Reach {
    cameras: [String; 2],
    length: f64,
}

impl Reach {
    fn of(rig: &RigFile) -> Option<Self> {
        let posed: Vec<_> =
            rig.cameras.iter().filter_map(|camera| Some((camera.name.as_str(), camera.pose?.centre()))).collect();
        let (first, centre) = *posed.first()?;
        if posed.len() == 1 {
            return Some(Self { cameras: [first.into(), "the origin".into()], length: centre.length() });
        }
        // The farthest from any one, and the farthest from that: nearly as far as any two, of any number of cameras.
        let farthest = |from: glam::DVec3| {
            let distance = |&&(_, centre): &&(_, glam::DVec3)| (centre - from).length();
            posed.iter().max_by(|a, b| distance(a).total_cmp(&distance(b)))
        };
        let (one, from) = *farthest(centre)?;
        let (other, to) = *farthest(from)?;
        Some(Self { cameras: [one.into(), other.into()], length: (to - from).length() })
    }

    /// The units in which it would be the size of a rig, with what it would be then.
    fn likely(&self) -> String {
        let fits = |unit: &Unit| self.length * unit.metres() <= FARTHEST_M;
        let likely: Vec<String> = Unit::ALL
            .into_iter()
            .filter(fits)
            .map(|unit| format!("--units {unit} ({:.3} m)", self.length * unit.metres()))
            .collect();
        if likely.is_empty() { "no unit makes a rig of it".into() } else { likely.join(", ") }
    }
}

impl fmt::Display for Reach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [one, other] = self.cameras.each_ref().map(|name| name.escape_debug().take(40).collect::<String>());
        if one == other {
            return write!(f, "all of its cameras are at one place");
        }
        write!(f, "{one} and {other} are {:.3} m apart", self.length)
    }
}
