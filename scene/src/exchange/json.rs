//! JSON as Python writes it.

use std::path::Path;

use erfgs_base::FileError;
use serde::{Deserialize, Deserializer, de::DeserializeOwned};

use super::ExchangeError;

/// A number; NaN and infinities, which Python writes as bare words, come out as NaN, so that the camera that they
/// belong to can be named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Number(pub f64);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Either {
            Number(f64),
            Word(String),
        }
        match Either::deserialize(deserializer) {
            Ok(Either::Number(number)) => Ok(Self(number)),
            Ok(Either::Word(word)) if word == NOT_A_NUMBER => Ok(Self(f64::NAN)),
            _ => Err(serde::de::Error::custom("a number is expected")),
        }
    }
}

/// What stands for NaN once the text is JSON.
const NOT_A_NUMBER: &str = "NaN";

/// Reads and parses a file.
///
/// # Errors
/// If it cannot be read, or is no JSON of this type.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, ExchangeError> {
    let text = erfgs_base::text::read(path).map_err(FileError::when("read", path))?;
    serde_json::from_str(&without_nan(&text)).map_err(|error| ExchangeError::Malformed {
        path: path.to_owned(),
        what: format!("{error}; the file is cut short or of another layout"),
    })
}

/// `NaN`, `Infinity` and `-Infinity` outside strings replaced by the string `"NaN"`.
fn without_nan(text: &str) -> String {
    let (mut out, mut rest, mut quoted) = (String::with_capacity(text.len()), text, false);
    while let Some(at) = rest.find(['"', '\\', 'N', 'I', '-']) {
        out.push_str(&rest[..at]);
        rest = &rest[at..];
        let word = ["NaN", "Infinity", "-Infinity"].into_iter().find(|word| !quoted && rest.starts_with(word));
        let taken = match (word, rest.as_bytes()) {
            (Some(word), _) => {
                out.extend(["\"", NOT_A_NUMBER, "\""]);
                word.len()
            }
            // An escaped character within a string; it may be a quote.
            (None, [b'\\', ..]) => {
                let length = 1 + rest.chars().nth(1).map_or(0, char::len_utf8);
                out.push_str(&rest[..length]);
                length
            }
            (None, first) => {
                quoted ^= first.first() == Some(&b'"');
                out.push_str(&rest[..1]);
                1
            }
        };
        rest = &rest[taken..];
    }
    out.push_str(rest);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pythons_words_become_strings_outside_strings_only() {
        let text = r#"{"NaN": [NaN, -Infinity, Infinity, -1.5], "a\"NaN\\": "-Infinity é"}"#;
        let expected = r#"{"NaN": ["NaN", "NaN", "NaN", -1.5], "a\"NaN\\": "-Infinity é"}"#;
        assert_eq!(without_nan(text), expected);
        let numbers: Vec<Number> = serde_json::from_str(&without_nan("[1, NaN, -2.5e3]")).unwrap();
        assert!(numbers[0] == Number(1.0) && numbers[1].0.is_nan() && numbers[2] == Number(-2500.0));
        assert!(serde_json::from_str::<Number>("null").is_err() && serde_json::from_str::<Number>("\"1\"").is_err());
        assert_eq!(without_nan("\\"), "\\");
    }
}
