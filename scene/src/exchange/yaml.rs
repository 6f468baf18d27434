//! Values in YAML files.

use std::{collections::BTreeMap, path::Path};

use erfgs_base::FileError;
use yaml_rust2::{
    Yaml, YamlLoader,
    parser::{Event, Parser},
    scanner::ScanError,
};

use super::{
    ExchangeError,
    unit::{self, Unit},
};

/// The first document of a file. OpenCV begins its files with a directive that is none (`%YAML:1.0`).
pub(super) fn load(path: &Path) -> Result<Yaml, ExchangeError> {
    let io = |source| ExchangeError::from(FileError::when("read", path)(source));
    let text = erfgs_base::text::read(path).map_err(io)?;
    let text = if text.starts_with("%YAML:") { text.split_once('\n').map_or("", |(_, rest)| rest) } else { &text };
    let small = is_small(text).map_err(|error| malformed(path, format!("no YAML: {error}")))?;
    if !small {
        return Err(malformed(path, "no description of a camera has so many values, or so deep ones".into()));
    }
    let documents = YamlLoader::load_from_str(text).map_err(|error| malformed(path, format!("no YAML: {error}")))?;
    documents.into_iter().next().ok_or_else(|| malformed(path, "it is empty".into()))
}

/// The most values that a document may have, and how many may lie within each other.
const MOST_VALUES: usize = 100_000;
const DEEPEST: usize = 32;

/// Whether a text stays within limits once its aliases are replaced by copies, each of which may hold others, and whether it
/// can be read by a function that calls itself.
fn is_small(text: &str) -> Result<bool, ScanError> {
    let mut parser = Parser::new_from_str(text);
    // The values within each list that is open, with its anchor; those of each anchor that is known.
    let (mut open, mut known, mut all): (Vec<(usize, usize)>, BTreeMap<usize, usize>, usize) = Default::default();
    loop {
        let (anchor, values) = match parser.next_token()?.0 {
            Event::StreamEnd => return Ok(true),
            Event::SequenceStart(anchor, _) | Event::MappingStart(anchor, _) => {
                open.push((anchor, 1));
                (0, 0)
            }
            Event::SequenceEnd | Event::MappingEnd => open.pop().unwrap_or_default(),
            Event::Scalar(_, _, anchor, _) => (anchor, 1),
            Event::Alias(anchor) => (0, known.get(&anchor).copied().unwrap_or(1)),
            _ => (0, 0),
        };
        if anchor != 0 {
            known.insert(anchor, values);
        }
        let around = open.last_mut().map_or(&mut all, |(_, within)| within);
        *around = around.saturating_add(values);
        if *around > MOST_VALUES || open.len() > DEEPEST {
            return Ok(false);
        }
    }
}

pub(super) fn malformed(path: &Path, what: String) -> ExchangeError {
    ExchangeError::Malformed { path: path.into(), what }
}

/// The finite number that a value is.
pub(super) fn number(value: &Yaml) -> Option<f64> {
    let number = match value {
        Yaml::Integer(whole) => *whole as f64,
        Yaml::Real(text) => text.parse().ok()?,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

/// The numbers of a list, of a list of lists, or of an OpenCV matrix, row by row.
pub(super) fn numbers(value: &Yaml) -> Option<Vec<f64>> {
    let list = if let Yaml::Hash(_) = value { &value["data"] } else { value };
    let mut found = Vec::new();
    for value in list.as_vec()? {
        match value {
            Yaml::Array(_) => found.extend(numbers(value)?),
            value => found.push(number(value)?),
        }
    }
    Some(found)
}

/// The names of a mapping's values.
pub(super) fn keys(document: &Yaml) -> impl Iterator<Item = &str> {
    document.as_hash().into_iter().flatten().map(|(key, _)| key.as_str().unwrap_or("a key that is no word"))
}

/// The unit of lengths that a document says.
pub(super) fn unit(document: &Yaml) -> Result<Option<Unit>, String> {
    unit::stated(keys(document).filter(|key| unit::is_key(key)).map(|key| document[key].as_str()))
}

/// A list as YAML.
pub(super) fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
    format!("[{}]", values.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_of_copies_and_deep_lists_are_refused() {
        let copies: String = (1..30).map(|n| format!("a{n}: &a{n} [*a{0}, *a{0}, *a{0}, *a{0}]\n", n - 1)).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.yaml");
        for text in [format!("a0: &a0 1\n{copies}"), "- ".repeat(100_000), "[".repeat(200)] {
            std::fs::write(&path, text).unwrap();
            let message = load(&path).unwrap_err().to_string();
            assert!(message.contains("a.yaml"), "{message}");
        }
        std::fs::write(&path, "a: &x [1, 2]\nb: *x\nc: [[*x], 3]\n").unwrap();
        let document = load(&path).unwrap();
        assert_eq!(numbers(&document["b"]), Some(vec![1.0, 2.0]));
        assert_eq!(numbers(&document["c"]), Some(vec![1.0, 2.0, 3.0]));
        assert_eq!(keys(&document).collect::<Vec<_>>(), ["a", "b", "c"]);
    }
}
