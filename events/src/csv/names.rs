//! A line of names: which column is what, and in which unit times are.

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
}

/// What a line of names says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Names {
    /// Which column is the time, the column of the pixel, its row and the polarity.
    pub order: [usize; 4],
    /// Number of columns.
    pub count: usize,
    /// The unit of the time, where its name tells it.
    pub unit: Option<TimeUnit>,
}

/// Columns in one line at most.
const MOST: usize = 16;

/// What one name stands for.
enum Column {
    Time(Option<TimeUnit>),
    X,
    Y,
    Polarity,
    /// The number of the line, as pandas writes it.
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

impl Names {
    /// What a line of names says.
    ///
    /// # Errors
    /// Which name is not known or which column is missing.
    pub fn of(fields: &[&str]) -> Result<Self, String> {
        if fields.len() > MOST {
            return Err(format!("its line of names has {} columns; at most {MOST} are read", fields.len()));
        }
        let mut found = [None; 4];
        let mut unit = None;
        for (at, name) in fields.iter().enumerate() {
            let column = Column::of(name).ok_or_else(|| {
                format!(
                    "column {} is called `{}`, which is not known; names are t (or t_s, t_ms, t_us, t_ns), x, y and p: \
                     rename or remove the column",
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
                return Err(format!("two columns are called {}; remove one", ["t", "x", "y", "p"][place]));
            }
        }
        let [Some(t), Some(x), Some(y), Some(p)] = found else {
            let missing: Vec<&str> = ["t", "x", "y", "p"]
                .into_iter()
                .zip(found)
                .filter(|(_, at)| at.is_none())
                .map(|(name, _)| name)
                .collect();
            return Err(format!("its line of names lacks {}; name the columns t, x, y and p", missing.join(", ")));
        };
        Ok(Self { order: [t, x, y, p], count: fields.len(), unit })
    }
}
