//! What another host says, in bounds: no longer than an honest one has to say.

use serde::de::DeserializeOwned;
use serde_json::Value;

/// Characters of a text.
const TEXT: usize = 1000;
/// Entries of a list.
const LIST: usize = 1000;

/// Reads an answer, whose texts and lists are cut where they are too long.
pub(super) fn read<T: DeserializeOwned>(answer: &[u8]) -> serde_json::Result<T> {
    let mut value = serde_json::from_slice(answer)?;
    cut(&mut value);
    serde_json::from_value(value)
}

/// As deep as JSON is read.
fn cut(value: &mut Value) {
    match value {
        Value::String(text) => {
            if let Some((end, _)) = text.char_indices().nth(TEXT) {
                text.truncate(end);
                text.shrink_to_fit();
            }
        }
        Value::Array(list) => {
            // The latest come last.
            list.drain(..list.len().saturating_sub(LIST));
            list.iter_mut().for_each(cut);
        }
        Value::Object(map) => map.values_mut().for_each(cut),
        Value::Null | Value::Bool(_) | Value::Number(_) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_and_lists_are_cut_and_the_latest_kept() {
        let long = serde_json::json!({ "a": [{ "b": "é".repeat(50_000) }], "n": (0..5000).collect::<Vec<_>>() });
        let read: Value = read(long.to_string().as_bytes()).unwrap();
        assert_eq!(read["a"][0]["b"].as_str().unwrap().chars().count(), TEXT);
        let numbers = read["n"].as_array().unwrap();
        assert_eq!((numbers.len(), numbers[LIST - 1].as_u64()), (LIST, Some(4999)));
        let short = serde_json::json!({ "a": [1, null, true, "x"], "b": 1e300 });
        assert_eq!(super::read::<Value>(short.to_string().as_bytes()).unwrap(), short);
    }
}
