//! Values in YAML files.

use std::path::Path;

use yaml_rust2::{Yaml, YamlLoader};

use super::ConvertError;

/// The first document of a file. OpenCV begins its files with a directive that is none (`%YAML:1.0`).
pub(super) fn load(path: &Path) -> Result<Yaml, ConvertError> {
    let io = |source| ConvertError::Io { doing: "read", path: path.into(), source };
    let text = std::fs::read_to_string(path).map_err(io)?;
    let text = if text.starts_with("%YAML:") { text.split_once('\n').map_or("", |(_, rest)| rest) } else { &text };
    let documents = YamlLoader::load_from_str(text).map_err(|error| malformed(path, format!("no YAML: {error}")))?;
    documents.into_iter().next().ok_or_else(|| malformed(path, "it is empty".into()))
}

pub(super) fn malformed(path: &Path, what: String) -> ConvertError {
    ConvertError::Malformed { path: path.into(), what }
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

/// The numbers of a list, or of an OpenCV matrix, row by row.
pub(super) fn numbers(value: &Yaml) -> Option<Vec<f64>> {
    let list = if let Yaml::Hash(_) = value { &value["data"] } else { value };
    list.as_vec()?.iter().map(number).collect()
}

/// A list as YAML.
pub(super) fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
    format!("[{}]", values.join(", "))
}
