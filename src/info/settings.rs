//! The settings of a stream, as they were read back from its device, for people.

use serde_json::{Map, Value};

/// Long lists that say little to anybody who does not look for one of them; `--json` has them.
const LEFT_OUT: [&str; 1] = ["registers"];
/// Longer lists are counted.
const LONGEST_LIST: usize = 12;

/// A name and its value, for each setting; what was not applied comes first, since somebody should know.
pub fn rows(settings: &Map<String, Value>) -> Vec<[String; 2]> {
    let row = |(name, value): (&String, &Value)| {
        let text = text(value);
        (!LEFT_OUT.contains(&name.as_str()) && !text.is_empty()).then(|| [name.clone(), text])
    };
    let mut rows: Vec<[String; 2]> = settings.iter().filter_map(row).collect();
    rows.sort_by_key(|[name, _]| name != "not_applied");
    rows
}

/// A value in words; empty for nothing.
fn text(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::Bool(true) => "yes".to_owned(),
        Value::Bool(false) => "no".to_owned(),
        Value::Number(number) => number.to_string(),
        Value::String(text) => text.clone(),
        Value::Array(list) if list.len() > LONGEST_LIST => format!("{} of them", list.len()),
        Value::Array(list) => list.iter().map(text).filter(|text| !text.is_empty()).collect::<Vec<_>>().join(", "),
        Value::Object(object) => {
            let entry = |(name, value): (&String, &Value)| {
                let inner = text(value);
                match value {
                    _ if inner.is_empty() => None,
                    Value::Object(_) => Some(format!("{name} ({inner})")),
                    _ => Some(format!("{name} {inner}")),
                }
            };
            object.iter().filter_map(entry).collect::<Vec<_>>().join(", ")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_told_in_words_and_what_was_not_applied_first() {
        let settings = serde_json::json!({
            "biases": { "diff_on": { "offset": 20, "value": 122 }, "fo": { "offset": 0, "value": 85 } },
            "firmware": "3.9.0",
            "masked_pixels": [],
            "not_applied": ["rate_hz = 30 (it has 25)"],
            "registers": { "0x0004": "0x1" },
            "usb": { "device": "1-2", "link": "5 Gbit/s" },
            "wide": vec![1; 40],
        });
        let rows = rows(settings.as_object().unwrap());
        let rows: Vec<[&str; 2]> = rows.iter().map(|row| row.each_ref().map(String::as_str)).collect();
        assert_eq!(
            rows,
            [
                ["not_applied", "rate_hz = 30 (it has 25)"],
                ["biases", "diff_on (offset 20, value 122), fo (offset 0, value 85)"],
                ["firmware", "3.9.0"],
                ["usb", "device 1-2, link 5 Gbit/s"],
                ["wide", "40 of them"],
            ]
        );
    }
}
