//! What numbers of files and settings are believed: the one place that knows what is plausible for each quantity.
//!
//! The bounds keep out what no camera, clock or sensor has, and what would overflow on the way through the program. They are generous:
//! microscopes and drones, time lapse and high-speed cameras, recordings that last for days lie within. `docs/reference/event-formats.md` lists them.
//!
//! ```
//! use erfgs_base::plausible::{EXPOSURE, POSITION};
//!
//! assert_eq!(EXPOSURE.check(20e-6), Ok(20e-6));
//! let error = POSITION.check(9e18).unwrap_err();
//! assert_eq!(
//!     error.to_string(),
//!     "a coordinate of a position is 9e18 m, and -1e8 to 1e8 m is plausible; check its unit, and calibrate or import it again"
//! );
//! ```

mod lens;
mod picture;

pub use lens::{Lens, check_lens, focal};
pub use picture::{check_sensor, check_size};

use std::fmt;

/// A quantity, and which values of it are believed: those from `least` to `most`, both included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// What it is, with its article.
    pub name: &'static str,
    /// Its unit; empty where it has none.
    pub unit: &'static str,
    /// The least value that is believed.
    pub least: f64,
    /// The greatest.
    pub most: f64,
    /// What to do about another value.
    pub remedy: &'static str,
}

/// A number that no camera, clock or sensor has.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{} is {}{}, and {} to {}{} is plausible; {}",
    quantity.name, Brief(*value), Unit(quantity.unit), Brief(quantity.least), Brief(quantity.most), Unit(quantity.unit), quantity.remedy
)]
pub struct Implausible {
    /// The quantity, with the bounds that were asked of it.
    pub quantity: Quantity,
    /// The value.
    pub value: f64,
}

/// For readers whose errors hold a reason in words.
impl From<Implausible> for String {
    fn from(error: Implausible) -> Self {
        error.to_string()
    }
}

const CALIBRATE: &str = "calibrate or import it again";
const UNIT: &str = "check its unit, and calibrate or import it again";
const CLOCK: &str = "check the unit and the clock that it is of";

/// Pixels along a side of a picture or sensor.
pub const SIDE: Quantity = Quantity::new(
    "a side of the picture",
    "px",
    1.0,
    65_535.0,
    "give the width and height of the images in whole pixels",
);
/// Pixels of a whole picture or sensor.
pub const PIXELS: Quantity = Quantity::new(
    "the number of pixels of the picture",
    "px",
    1.0,
    5e8,
    "give the width and height of the images in pixels",
);
/// Pixels of an event sensor, of each of which a reader keeps something.
pub const SENSOR: Quantity = Quantity::new(
    "the number of pixels of the event sensor",
    "px",
    1.0,
    1.5e8,
    "give the sensor's width and height in pixels",
);
/// Coordinates of cameras and of what they are told by, metres or a unit of the file's.
pub const POSITION: Quantity = Quantity::new("a coordinate of a position", "m", -1e8, 1e8, UNIT);
/// Coordinates of points: those of rays that hardly cross are far beyond all cameras.
pub const POINT: Quantity =
    Quantity::new("a coordinate of a point", "m", -1e12, 1e12, "check its unit, and make the point cloud again");
/// The length of a rotation's quaternion.
pub const QUATERNION: Quantity =
    Quantity::new("the length of the rotation's quaternion", "", 1.0 - 1e-6, 1.0 + 1e-6, CALIBRATE);
/// An instant on the clock of a session: clocks may count from 1970.
pub const INSTANT: Quantity = Quantity::new("a time", "s", -4e9, 4e9, CLOCK);
/// The length of a recording.
pub const SPAN: Quantity = Quantity::new("the length of the recording", "s", 0.0, 31.0 * 86_400.0, CLOCK);
/// How long a shutter is open.
pub const EXPOSURE: Quantity = Quantity::new("an exposure", "s", 0.0, 600.0, CLOCK);
/// How far an exposure reaches out of the recording.
pub const OVERHANG: Quantity = Quantity::new(
    "what an exposure reaches out of the recording's span",
    "s",
    0.0,
    60.0,
    "correct `exposure_ns`, or `span_ns` if the recording is longer",
);
/// How long the exposures of two consecutive frames of one camera overlap, in times between the two frames. A sensor ends one exposure
/// before it begins the next; rounded stamps and fitted clocks make a little of it.
pub const OVERLAP: Quantity = Quantity::new(
    "the overlap with the exposure before it",
    "frame intervals",
    0.0,
    0.1,
    "correct `exposure_ns`; blur that was simulated from more frames is told by a step `blur` in `variant`",
);
/// What the times of a camera are off by.
pub const OFFSET: Quantity = Quantity::new("a time offset", "s", -86_400.0, 86_400.0, CLOCK);
/// Frames, pulses or events of a periodic kind a second.
pub const RATE: Quantity = Quantity::new("a rate", "Hz", 1e-5, 1e7, "give it per second");
/// The length of a tick of a device's clock.
pub const TICK: Quantity = Quantity::new("a tick of a device's clock", "ns", 1e-3, 1e9, CLOCK);
/// The change of the logarithm of light that makes an event.
pub const THRESHOLD: Quantity =
    Quantity::new("a contrast threshold", "", 1e-6, 100.0, "give it as a change of the natural logarithm of intensity");
/// The grey level below which an event sensor is linear. At or below 1 the straight line through zero, whose slope is its logarithm, is
/// flat or falls.
pub const LIN_LOG: Quantity =
    Quantity::new("the lin-log threshold", "grey levels of 255", 1.000_001, 255.0, "v2e takes 20");
/// How long a pixel is blind after an event.
pub const REFRACTORY: Quantity =
    Quantity::new("a refractory time", "s", 0.0, 10.0, "give it in the unit that is asked for");
/// A standard deviation of a place.
pub const SIGMA_PLACE: Quantity = Quantity::new("a standard deviation of a place", "m", 0.0, 1e8, SIGMA);
/// A standard deviation of a turn; of one that is hardly determined it is many times a circle.
pub const SIGMA_TURN: Quantity = Quantity::new("a standard deviation of a turn", "degrees", 0.0, 1e8, SIGMA);
/// A standard deviation of a time.
pub const SIGMA_TIME: Quantity = Quantity::new("a standard deviation of a time", "s", 0.0, 86_400.0, SIGMA);

const SIGMA: &str = "calibrate again, or leave out what is not known";

impl Quantity {
    /// A quantity with its bounds.
    #[must_use]
    pub const fn new(name: &'static str, unit: &'static str, least: f64, most: f64, remedy: &'static str) -> Self {
        Self { name, unit, least, most, remedy }
    }

    /// The same by another name.
    #[must_use]
    pub const fn called(self, name: &'static str) -> Self {
        Self { name, ..self }
    }

    /// The same with another remedy.
    #[must_use]
    pub const fn or(self, remedy: &'static str) -> Self {
        Self { remedy, ..self }
    }

    /// Whether a value is believed; NaN never is.
    #[must_use]
    pub fn holds(&self, value: f64) -> bool {
        value.is_finite() && (self.least..=self.most).contains(&value)
    }

    /// A value that is believed.
    ///
    /// # Errors
    /// [`Implausible`] with the quantity, the value and the bounds.
    pub fn check(&self, value: f64) -> Result<f64, Implausible> {
        if self.holds(value) { Ok(value) } else { Err(Implausible { quantity: *self, value }) }
    }

    /// Values that are all believed.
    ///
    /// # Errors
    /// As [`Quantity::check`], of the first that is not.
    pub fn check_all(&self, values: impl IntoIterator<Item = f64>) -> Result<(), Implausible> {
        values.into_iter().try_for_each(|value| self.check(value).map(drop))
    }

    /// A time in nanoseconds, of a quantity in seconds.
    ///
    /// # Errors
    /// As [`Quantity::check`].
    pub fn check_ns(&self, ns: i64) -> Result<i64, Implausible> {
        self.check(ns as f64 * 1e-9).map(|_| ns)
    }

    /// Times in nanoseconds that are all believed.
    ///
    /// # Errors
    /// As [`Quantity::check`], of the first that is not.
    pub fn check_all_ns(&self, times_ns: impl IntoIterator<Item = i64>) -> Result<(), Implausible> {
        times_ns.into_iter().try_for_each(|ns| self.check_ns(ns).map(drop))
    }

    /// The time between two instants in nanoseconds, which may be as far apart as the type allows.
    ///
    /// # Errors
    /// As [`Quantity::check`].
    pub fn check_between_ns(&self, [from, to]: [i64; 2]) -> Result<(), Implausible> {
        self.check((i128::from(to) - i128::from(from)) as f64 * 1e-9).map(drop)
    }
}

/// A number in few digits: 1e308 and not 309 of them.
#[derive(Clone, Copy, Debug)]
pub struct Brief(pub f64);

impl fmt::Display for Brief {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value) = self;
        if *value == 0.0 || !value.is_finite() || (1e-4..1e7).contains(&value.abs()) {
            write!(f, "{value}")
        } else {
            write!(f, "{value:e}")
        }
    }
}

/// A unit with the blank before it; nothing where there is none.
struct Unit(&'static str);

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() { Ok(()) } else { write!(f, " {}", self.0) }
    }
}

#[cfg(test)]
mod tests;
