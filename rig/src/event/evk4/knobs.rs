//! What of an EVK4 can be changed while it runs.

use erfgs_session::source::{Knob, KnobKind};
use serde_json::{Value, json};

use super::{Evk4Config, HEIGHT, WIDTH};

const BIASES: [(&str, &str, &str); 5] = [
    ("diff_on", "biases.diff_on", "threshold, brighter"),
    ("diff_off", "biases.diff_off", "threshold, darker"),
    ("fo", "biases.fo", "low-pass"),
    ("hpf", "biases.hpf", "high-pass"),
    ("refr", "biases.refr", "refractory period"),
];

impl Evk4Config {
    /// See the module. Ranges are those of [`Evk4Config::validate`].
    pub(super) fn knobs(&self) -> Vec<Knob> {
        let number = |least, most, step| KnobKind::Number { least, most, step };
        let mut knobs = Vec::new();
        for (name, path, label) in BIASES {
            if let Some((_, value, allowed)) = self.biases.entries().find(|(of, ..)| *of == name) {
                let kind = number((*allowed.start()).into(), (*allowed.end()).into(), 1);
                knobs.push(Knob { path, label, value: value.into(), kind, off: None });
            }
        }
        let mut add = |path, label, value: Option<Value>, kind, off| {
            knobs.push(Knob { path, label, value: value.unwrap_or(Value::Null), kind, off: Some(off) });
        };
        let limit = self.rate_limit.map(|limit| limit.events_per_second.into());
        let limits = number(0, 3_200_000_000, 1_000_000);
        add("rate_limit.events_per_second", "rate limit, events/s", limit, limits, "rate_limit");
        // The first of several windows: more than one the page does not show.
        let window = self.region.as_ref().and_then(|region| region.windows.first()).map(|window| json!(window));
        let whole = KnobKind::Window { columns: WIDTH, rows: HEIGHT, list: true };
        add("region.windows", "region", window, whole, "region");
        let [low, high] = [self.anti_flicker.map(|of| of.low_hz.into()), self.anti_flicker.map(|of| of.high_hz.into())];
        add("anti_flicker.low_hz", "flicker filter from, Hz", low, number(50, 520, 1), "anti_flicker");
        add("anti_flicker.high_hz", "flicker filter to, Hz", high, number(50, 520, 1), "anti_flicker");
        let kinds = KnobKind::Choice { choices: &["stc-cut-trail", "stc-keep-trail", "trail"] };
        let kind = self.trail_filter.map(|filter| json!(filter.kind));
        add("trail_filter.kind", "trail filter", kind, kinds, "trail_filter");
        let threshold = self.trail_filter.map(|filter| filter.threshold_ms.into());
        add("trail_filter.threshold_ms", "trail filter, ms", threshold, number(1, 100, 1), "trail_filter");
        knobs
    }
}
