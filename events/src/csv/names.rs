//! Names of columns: which one is what, and in which unit times are.

use std::{fmt, str::FromStr};

/// In which unit times are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeUnit {
    /// Seconds.
    Seconds,
    /// Thousandths of them.
    Milliseconds,
    /// Millionths of them.
    Microseconds,
    /// Thousandths of these.
    Nanoseconds,
}

impl TimeUnit {
    /// Microseconds in one of them.
    pub(super) fn microseconds(self) -> f64 {
        match self {
            Self::Seconds => 1e6,
            Self::Milliseconds => 1e3,
            Self::Microseconds => 1.0,
            Self::Nanoseconds => 1e-3,
        }
    }

    fn of(word: &str) -> Option<Self> {
        match word {
            "s" | "sec" | "secs" | "second" | "seconds" => Some(Self::Seconds),
            "ms" | "msec" | "msecs" | "millis" | "millisecond" | "milliseconds" => Some(Self::Milliseconds),
            "us" | "µs" | "μs" | "usec" | "usecs" | "micros" | "microsecond" | "microseconds" => {
                Some(Self::Microseconds)
            }
            "ns" | "nsec" | "nsecs" | "nanos" | "nanosecond" | "nanoseconds" => Some(Self::Nanoseconds),
            _ => None,
        }
    }

    /// What a cell of a line of units says, as `ms` or `[ms]`.
    pub(super) fn of_cell(cell: &str) -> Option<Self> {
        Self::of(cell.to_lowercase().trim_matches(|letter: char| !letter.is_alphanumeric()))
    }

    /// The one unit that a comment tells of times in, as "timestamps are in ms".
    pub(super) fn in_prose(comment: &str) -> Option<Self> {
        let comment = comment.to_lowercase();
        let words = || comment.split(|letter: char| !letter.is_alphanumeric());
        let tells = words().any(|word| matches!(word, "t" | "ts" | "time" | "times" | "timestamp" | "timestamps"));
        let mut units = words().filter_map(Self::of);
        let unit = units.next().filter(|_| tells)?;
        units.all(|other| other == unit).then_some(unit)
    }
}

impl fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Seconds => "seconds",
            Self::Milliseconds => "milliseconds",
            Self::Microseconds => "microseconds",
            Self::Nanoseconds => "nanoseconds",
        })
    }
}

/// Which columns of a text are what, and in which unit its times are: what a line of names says, or the user where a text has none
/// that is understood, as `x,y,p,t_us`. A `-` stands for a column that is none of an event's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextColumns {
    /// Which column is the time, the column of the pixel, its row and the polarity.
    pub(super) order: [usize; 4],
    /// Number of columns.
    pub(super) count: usize,
    /// The unit of the time, where its name tells it.
    pub(super) unit: Option<TimeUnit>,
}

/// Columns in one line at most.
const MOST: usize = 16;

/// What one name stands for.
enum Column {
    Time(Option<TimeUnit>),
    X,
    Y,
    Polarity,
    /// The number of the line, as pandas writes it, or `-`.
    Index,
}

impl Column {
    fn of(name: &str) -> Option<Self> {
        let name = name.to_lowercase();
        let mut words = name.split(|letter: char| !letter.is_alphanumeric()).filter(|word| !word.is_empty());
        let (first, second) = (words.next().unwrap_or_default(), words.next());
        let column = match (first, second) {
            ("t" | "ts" | "time" | "times" | "timestamp" | "timestamps", None) => Self::Time(None),
            ("t" | "ts" | "time" | "times" | "timestamp" | "timestamps", Some(unit)) => {
                Self::Time(Some(TimeUnit::of(unit)?))
            }
            ("x" | "column" | "col", None) => Self::X,
            ("y" | "row", None) => Self::Y,
            ("p" | "on" | "pol" | "polarity" | "polarities", None) => Self::Polarity,
            ("" | "index", None) => Self::Index,
            (unit, None) => Self::Time(Some(TimeUnit::of(unit)?)),
            _ => return None,
        };
        words.next().is_none().then_some(column)
    }
}

/// How many of these are names of columns that are known.
pub(super) fn known(fields: &[&str]) -> usize {
    fields.iter().filter(|name| !name.is_empty() && Column::of(name).is_some()).count()
}

impl TextColumns {
    /// What these names say.
    ///
    /// # Errors
    /// Which name is not known or which column is missing.
    pub(super) fn of(fields: &[&str]) -> Result<Self, String> {
        if fields.len() > MOST {
            return Err(format!("there are names of {} columns; at most {MOST} are read", fields.len()));
        }
        let mut found = [None; 4];
        let mut unit = None;
        for (at, name) in fields.iter().enumerate() {
            let column = Column::of(name).ok_or_else(|| {
                format!(
                    "column {} is called `{}`, which is not known; names are t (or t_s, t_ms, t_us, t_ns), x, y and p",
                    at + 1,
                    name.escape_debug()
                )
            })?;
            let place = match column {
                Column::Time(of_name) => {
                    unit = of_name;
                    0
                }
                Column::X => 1,
                Column::Y => 2,
                Column::Polarity => 3,
                Column::Index => continue,
            };
            if found[place].replace(at).is_some() {
                return Err(format!("two columns are called {}", ["t", "x", "y", "p"][place]));
            }
        }
        let [Some(t), Some(x), Some(y), Some(p)] = found else {
            let missing: Vec<&str> = ["t", "x", "y", "p"]
                .into_iter()
                .zip(found)
                .filter(|(_, at)| at.is_none())
                .map(|(name, _)| name)
                .collect();
            return Err(format!("it lacks {} of t, x, y and p", missing.join(", ")));
        };
        Ok(Self { order: [t, x, y, p], count: fields.len(), unit })
    }
}

impl FromStr for TextColumns {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names: Vec<&str> = text.split(',').map(str::trim).collect();
        Self::of(&names).map_err(|what| {
            format!("{what}; write what each column is, as x,y,p,t_us, with - for a column that is none of these")
        })
    }
}
