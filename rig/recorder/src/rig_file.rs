//! Settings that were changed while a rig ran, written into its `RIG.toml`: the values alone, so that comments and order stay.

use std::{collections::BTreeMap, fs, ops::Range, path::Path};

use erfgs_base::{FileError, atomic};
use serde::Deserialize;
use serde_json::{Map, Value};
use toml::{Spanned, Table};

use super::config::{ConfigError, RigConfig};

/// The tables of devices that can be changed while they run, with the places of their values.
#[derive(Deserialize, Default)]
#[serde(default)]
struct Places {
    evk4: Vec<BTreeMap<String, Spanned<toml::Value>>>,
    davis346: Vec<BTreeMap<String, Spanned<toml::Value>>>,
}

/// Writes settings of the device `id` into the file: tables are changed entry by entry, and `null` takes an entry out.
///
/// # Errors
/// If the file cannot be read, does not have the device, or is written so that values cannot be changed one by one; it is
/// left alone then.
pub fn keep_settings(path: &Path, id: &str, changed: &Map<String, Value>) -> Result<(), ConfigError> {
    let text = fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })?;
    let new = edited(&text, path, id, changed)?;
    atomic::write(path, new.as_bytes())
        .map_err(FileError::when("write the rig's configuration", path))
        .map_err(ConfigError::Write)
}

/// The text with these settings.
fn edited(text: &str, path: &Path, id: &str, changed: &Map<String, Value>) -> Result<String, ConfigError> {
    let syntax = |message: String| ConfigError::Syntax { path: path.to_owned(), message };
    let places: Places = toml::from_str(text).map_err(|error| syntax(error.to_string()))?;
    let is_it = |table: &&BTreeMap<String, Spanned<toml::Value>>| {
        table.get("id").is_some_and(|of| of.as_ref().as_str() == Some(id))
    };
    let Some(device) = places.evk4.iter().chain(&places.davis346).find(is_it) else {
        return Err(syntax(format!("there is no event camera '{id}' in it any more")));
    };
    let mut edits: Vec<(Range<usize>, String)> = Vec::new();
    let mut wanted = Vec::new();
    for (name, change) in changed {
        let before = device.get(name);
        let value = merged(before.map(Spanned::as_ref), change).map_err(&syntax)?;
        match (before, &value) {
            (Some(before), Some(value)) => edits.push((before.span(), value.to_string())),
            (None, Some(value)) => {
                let end = device.get("id").map_or(0, |id| id.span().end);
                let line = text[end..].find('\n').map_or(text.len(), |at| end + at + 1);
                let begin = if text[..line].ends_with('\n') { "" } else { "\n" };
                edits.push((line..line, format!("{begin}{name} = {value}\n")));
            }
            (Some(before), None) => {
                let begin = text[..before.span().start].rfind('\n').map_or(0, |at| at + 1);
                let end = text[before.span().end..].find('\n').map_or(text.len(), |at| before.span().end + at + 1);
                edits.push((begin..end, String::new()));
            }
            (None, None) => {}
        }
        wanted.push((name, value));
    }
    edits.sort_by_key(|(range, _)| range.start);
    let mut new = text.to_owned();
    for (range, value) in edits.into_iter().rev() {
        new.replace_range(range, &value);
    }
    // Whatever the file looked like: what it says now must be what is wanted, and nothing else.
    let mut expected: Table = text.parse().map_err(|error: toml::de::Error| syntax(error.to_string()))?;
    for (name, value) in wanted {
        for kind in ["evk4", "davis346"] {
            let tables = expected.get_mut(kind).and_then(toml::Value::as_array_mut).into_iter().flatten();
            let of_id = |table: &&mut Table| table.get("id").and_then(toml::Value::as_str) == Some(id);
            for table in tables.filter_map(toml::Value::as_table_mut).filter(of_id) {
                match &value {
                    Some(value) => drop(table.insert(name.clone(), value.clone())),
                    None => drop(table.remove(name)),
                }
            }
        }
    }
    if new.parse::<Table>().ok().as_ref() != Some(&expected) || RigConfig::parse(&new, path).is_err() {
        let what = Value::Object(changed.clone());
        return Err(syntax(format!("'{id}' cannot be changed in a file of this form; write by hand: {what}")));
    }
    Ok(new)
}

/// A value with some of its entries changed; `None` where nothing of it is left.
fn merged(before: Option<&toml::Value>, change: &Value) -> Result<Option<toml::Value>, String> {
    match change {
        Value::Null => Ok(None),
        Value::Object(entries) => {
            let mut table = before.and_then(toml::Value::as_table).cloned().unwrap_or_default();
            for (name, change) in entries {
                match merged(table.get(name), change)? {
                    Some(value) => drop(table.insert(name.clone(), value)),
                    None => drop(table.remove(name)),
                }
            }
            Ok(Some(table.into()))
        }
        other => toml::Value::try_from(other).map(Some).map_err(|error| error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const RIG: &str = "# my rig\n[rig]\nname = \"lab\"\n\n[[evk4]]\nid = \"left\"   # the left one\nserial = \"1\"\n\
        biases = { diff_on = 10, fo = -3 }  # quiet\nrate_limit = { events_per_second = 5000000 }\n\n[[evk4]]\nid = \"right\"\n\n\
        [[davis346]]\nid = \"davis\"\nevents = { refractory_us = 250 }\n";

    fn with(id: &str, changed: Value) -> Result<String, String> {
        edited(RIG, Path::new("RIG.toml"), id, changed.as_object().unwrap()).map_err(|error| error.to_string())
    }

    #[test]
    fn values_are_changed_and_everything_else_stays() {
        let new = with("left", json!({ "biases": { "diff_on": 25 }, "rate_limit": null })).unwrap();
        let expected = RIG
            .replace("biases = { diff_on = 10, fo = -3 }", "biases = { diff_on = 25, fo = -3 }")
            .replace("rate_limit = { events_per_second = 5000000 }\n", "");
        assert_eq!(new, expected);
        let new =
            with("right", json!({ "region": { "windows": [{ "x": 1, "y": 2, "width": 3, "height": 4 }] } })).unwrap();
        let line = "id = \"right\"\nregion = { windows = [{ height = 4, width = 3, x = 1, y = 2 }] }\n";
        assert_eq!(new, RIG.replace("id = \"right\"\n", line));
        let new = with("davis", json!({ "events": { "refractory_us": 500 }, "biases": { "on": 7 } })).unwrap();
        assert!(new.contains("refractory_us = 500") && new.contains("biases = { on = 7 }"), "{new}");
    }

    #[test]
    fn what_cannot_be_changed_so_is_refused_and_the_file_stays() {
        assert!(with("middle", json!({ "biases": { "fo": 1 } })).unwrap_err().contains("'middle'"));
        assert!(with("left", json!({ "biases": { "nonsense": 1 } })).unwrap_err().contains("by hand"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("RIG.toml");
        let text = "[[evk4]]\nid = \"left\"\n[evk4.biases]\nfo = 3\n";
        fs::write(&path, text).unwrap();
        // A table of its own: either it is changed rightly, or not at all.
        let changed = json!({ "biases": { "fo": 4 } });
        match keep_settings(&path, "left", changed.as_object().unwrap()) {
            Ok(()) => assert!(fs::read_to_string(&path).unwrap().contains('4')),
            Err(error) => {
                assert!(error.to_string().contains("by hand"), "{error}");
                assert_eq!(fs::read_to_string(&path).unwrap(), text);
            }
        }
    }
}
