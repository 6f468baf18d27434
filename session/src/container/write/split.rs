//! When a recording goes on in another file.

use std::str::FromStr;

use erfgs_base::plausible::Brief;

/// The smallest size of a part, bytes.
const LEAST_BYTES: f64 = 10e6;
/// The largest: 1 EB.
const MOST_BYTES: f64 = 1e18;
/// The shortest part, seconds.
const LEAST_S: f64 = 1.0;
/// The longest: a year.
const MOST_S: f64 = 366.0 * 86400.0;

/// When a recording goes on in another file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Before a file is longer than so many bytes. A packet that is longer by itself lies in a file of its own.
    Bytes(u64),
    /// After so many nanoseconds.
    Time(i64),
}

/// Why a text is no [`Split`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SplitError {
    /// It is neither a size nor a time.
    #[error(
        "'{0}' is neither a size nor a time; write a number and kB, MB, GB, TB, MiB, GiB, TiB, s, min or h: 10GB, 500MB, 5min, 90s"
    )]
    Neither(String),
    /// It is too small or too large.
    #[error("'{text}': write a {what} from {least} to {most}")]
    Range {
        /// What was written.
        text: String,
        /// What it is.
        what: &'static str,
        /// The least.
        least: String,
        /// The most.
        most: String,
    },
}

impl FromStr for Split {
    type Err = SplitError;

    fn from_str(text: &str) -> Result<Self, SplitError> {
        let neither = || SplitError::Neither(text.chars().take(40).collect());
        let trimmed = text.trim();
        let unit_at = trimmed.find(|c: char| c.is_ascii_alphabetic()).ok_or_else(neither)?;
        let (number, unit) = trimmed.split_at(unit_at);
        let number: f64 = number.trim().parse().map_err(|_| neither())?;
        let range = |what, least: String, most: String| SplitError::Range { text: text.to_owned(), what, least, most };
        let bytes = match unit.to_ascii_lowercase().as_str() {
            "kb" => 1e3,
            "mb" => 1e6,
            "gb" => 1e9,
            "tb" => 1e12,
            "mib" => f64::from(1 << 20),
            "gib" => f64::from(1 << 30),
            "tib" => f64::from(1 << 20) * f64::from(1 << 20),
            time => {
                let seconds = match time {
                    "s" => 1.0,
                    "min" => 60.0,
                    "h" => 3600.0,
                    _ => return Err(neither()),
                };
                let seconds = number * seconds;
                return if (LEAST_S..=MOST_S).contains(&seconds) {
                    Ok(Self::Time((seconds * 1e9) as i64))
                } else {
                    Err(range("time", format!("{}s", Brief(LEAST_S)), format!("{}h", Brief(MOST_S / 3600.0))))
                };
            }
        };
        let bytes = number * bytes;
        if (LEAST_BYTES..=MOST_BYTES).contains(&bytes) {
            Ok(Self::Bytes(bytes as u64))
        } else {
            Err(range("size", format!("{}MB", Brief(LEAST_BYTES / 1e6)), format!("{}TB", Brief(MOST_BYTES / 1e12))))
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn sizes_and_times_are_read_with_their_units() {
        for (text, split) in [
            ("10GB", Split::Bytes(10_000_000_000)),
            ("500MB", Split::Bytes(500_000_000)),
            (" 1.5 gib", Split::Bytes(3 << 29)),
            ("2TB", Split::Bytes(2_000_000_000_000)),
            ("10000kB", Split::Bytes(10_000_000)),
            ("5min", Split::Time(300_000_000_000)),
            ("90s", Split::Time(90_000_000_000)),
            ("0.5h", Split::Time(1_800_000_000_000)),
        ] {
            assert_eq!(text.parse(), Ok(split), "{text}");
        }
    }

    #[test]
    fn nonsense_is_refused_with_an_example_and_what_is_too_small_with_the_least() {
        for text in ["", "10", "GB", "10G", "5m", "1e3", "ten GB", "10 GB/s", "--5s", "5min90s", "10GB "] {
            let split = text.parse::<Split>();
            assert!(
                text == "10GB " || split.as_ref().is_err_and(|error| error.to_string().contains("5min")),
                "{text}: {split:?}"
            );
        }
        for (text, least) in [
            ("1MB", "10MB"),
            ("0GB", "10MB"),
            ("-3GB", "10MB"),
            ("99999999TB", "10MB"),
            ("0.1s", "1s"),
            ("1000000h", "1s"),
        ] {
            let error = text.parse::<Split>().unwrap_err();
            assert!(matches!(error, SplitError::Range { .. }) && error.to_string().contains(least), "{error}");
        }
    }

    proptest! {
        #[test]
        fn no_text_is_read_as_a_part_that_is_too_small(text in "[-+0-9.eE]{0,12} ?(kB|MB|GB|TB|MiB|s|min|h|inf|nan)?") {
            match text.parse::<Split>() {
                Ok(Split::Bytes(bytes)) => prop_assert!(bytes >= 10_000_000),
                Ok(Split::Time(ns)) => prop_assert!(ns >= 1_000_000_000),
                Err(_) => {}
            }
        }
    }
}
