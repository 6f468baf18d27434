//! Bias files of Metavision (`.bias`), which its programs write and read: a line `VALUE % bias_NAME` for each bias, and comments.
//!
//! Of an IMX636 values are offsets from the unit's factory trim, as here. Files of older sensors (Gen 3) and of early releases hold
//! the DAC's own values, which are far from any offset that makes sense; they are refused.

use serde_json::{Map, Value};

use super::config::BiasOffsets;

/// Offsets of the reference that OpenEB recommends. A DAC's own value is 77 or so in an IMX636 and 300 in a Gen 3.
const REFERENCE: std::ops::RangeInclusive<i32> = -25..=23;

impl BiasOffsets {
    fn entry(&mut self, name: &str) -> Option<&mut i32> {
        Some(match name {
            "fo" => &mut self.fo,
            "hpf" => &mut self.hpf,
            "diff_on" => &mut self.diff_on,
            "diff" => &mut self.diff,
            "diff_off" => &mut self.diff_off,
            "refr" => &mut self.refr,
            _ => return None,
        })
    }

    /// The offsets in the text of a bias file; those that it lacks are 0.
    ///
    /// # Errors
    /// What is wrong, with the line: a bias that the sensor does not have, or that comes twice, no number, a value out of range, or
    /// values of a DAC.
    pub fn of_metavision(text: &str) -> Result<Self, String> {
        let mut found = Self::default();
        let mut names: Vec<&str> = Vec::new();
        for (at, line) in text.lines().enumerate() {
            let line = line.trim_start_matches('\u{feff}').trim();
            if line.is_empty() || line.starts_with('%') {
                continue;
            }
            let wrong = |what: String| format!("line {}: '{line}': {what}", at + 1);
            let mut parts = line.split('%').map(str::trim);
            let (value, name) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
            let value: i32 =
                value.parse().map_err(|_| wrong("no line of a bias file, which is VALUE % bias_NAME".into()))?;
            let plain = name.strip_prefix("bias_").unwrap_or_default();
            let Some(entry) = found.entry(plain) else {
                return Err(wrong(format!("an IMX636 has no '{name}': the file is of another sensor")));
            };
            *entry = value;
            if names.contains(&plain) {
                return Err(wrong(format!("'{name}' comes twice")));
            }
            names.push(plain);
        }
        if names.is_empty() {
            return Err("there is no bias in it; a line is VALUE % bias_NAME".into());
        }
        if !REFERENCE.contains(&found.diff) {
            return Err(format!(
                "bias_diff is {}, which is no offset from the factory trim ({} to {}): the file holds values of a DAC, of another sensor \
                 or an early release; load it there, and save the offsets",
                found.diff,
                REFERENCE.start(),
                REFERENCE.end()
            ));
        }
        match found.entries().find(|(_, value, allowed)| !allowed.contains(value)) {
            Some((name, value, allowed)) => {
                Err(format!("bias_{name} is {value}; it can be {} to {}", allowed.start(), allowed.end()))
            }
            None => Ok(found),
        }
    }

    /// The text of a bias file.
    #[must_use]
    pub fn to_metavision(&self) -> String {
        self.entries().map(|(name, value, _)| format!("{value:<5}% bias_{name}\n")).collect()
    }

    /// Those of a recorded stream, by its settings; `None` where it has none.
    #[must_use]
    pub fn of_settings(settings: &Map<String, Value>) -> Option<Self> {
        let mut found = Self::default();
        for (name, bias) in settings.get("biases")?.as_object()? {
            let offset = bias.get("offset")?.as_i64()?;
            *found.entry(name)? = i32::try_from(offset).ok()?;
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn any_offsets_that_a_sensor_takes_come_back(
            (fo, hpf, diff_on) in (-150..=200, 0..=255, -150..=200),
            (diff, diff_off, refr) in (-25..=23, -150..=200, -50..=255),
        ) {
            let offsets = BiasOffsets { fo, hpf, diff_on, diff, diff_off, refr };
            prop_assert_eq!(BiasOffsets::of_metavision(&offsets.to_metavision()), Ok(offsets));
        }

        #[test]
        fn whatever_a_text_says_offsets_are_ones_that_a_sensor_takes(
            text in "((-|\\+)?[0-9]{0,12} ?%? ?(bias_)?(fo|hpf|diff|diff_on|pr| )? ?%? ?v?\n){0,5}",
        ) {
            if let Ok(offsets) = BiasOffsets::of_metavision(&text) {
                prop_assert!(offsets.entries().all(|(_, value, allowed)| allowed.contains(&value)), "{:?}", offsets);
            }
        }
    }

    #[test]
    fn what_metavision_writes_is_read_and_what_is_written_is_read_back() {
        let text = "\u{feff}% system_ID 49\r\n% IMX636 CD standard biases\r\n\r\n0     % bias_diff\r\n-35  % bias_diff_off       %   v\n55\
            % bias_fo\n0 % bias_hpf\n 120 % bias_diff_on\n-20 % bias_refr\n";
        let found = BiasOffsets::of_metavision(text).unwrap();
        let expected = BiasOffsets { fo: 55, hpf: 0, diff_on: 120, diff: 0, diff_off: -35, refr: -20 };
        assert_eq!(found, expected);
        assert_eq!(BiasOffsets::of_metavision(&found.to_metavision()), Ok(expected));
        assert_eq!(BiasOffsets::of_metavision("7 % bias_fo"), Ok(BiasOffsets { fo: 7, ..BiasOffsets::default() }));
    }

    #[test]
    fn files_of_other_sensors_and_other_files_are_refused() {
        // OpenEB's test has the first, of a Gen 3.1; the second are the factory's values of an IMX636.
        for (text, says) in [
            (
                "% gen 3.1 CD standard biases\n300   % bias_diff           %   v\n222   % bias_diff_off       %   v\n",
                "values of a DAC",
            ),
            ("77 % bias_diff\n102 % bias_diff_on\n", "values of a DAC"),
            (
                "1250  % bias_pr             %   i\n",
                "line 1: '1250  % bias_pr             %   i': an IMX636 has no 'bias_pr'",
            ),
            ("7 % fo\n", "has no 'fo'"),
            ("7 % bias_fo\n8 % bias_fo\n", "line 2: '8 % bias_fo': 'bias_fo' comes twice"),
            ("bias_fo = 7\n", "line 1: 'bias_fo = 7': no line of a bias file"),
            ("1e3 % bias_fo\n", "no line of a bias file"),
            ("-1 % bias_hpf\n", "bias_hpf is -1; it can be 0 to 255"),
            ("% nothing\n", "there is no bias in it"),
            ("", "there is no bias in it"),
        ] {
            let error = BiasOffsets::of_metavision(text).unwrap_err();
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }

    #[test]
    fn the_settings_of_a_stream_tell_its_offsets() {
        let settings = serde_json::json!({ "biases": { "fo": { "trim": 74, "offset": -9, "value": 65 }, "refr": { "offset": 3 } } });
        let expected = BiasOffsets { fo: -9, refr: 3, ..BiasOffsets::default() };
        assert_eq!(BiasOffsets::of_settings(settings.as_object().unwrap()), Some(expected));
        for other in [
            serde_json::json!({}),
            serde_json::json!({ "biases": { "on": { "offset": 3 } } }),
            serde_json::json!({ "biases": 3 }),
        ] {
            assert_eq!(BiasOffsets::of_settings(other.as_object().unwrap()), None, "{other}");
        }
    }
}
