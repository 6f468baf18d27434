//! What of a DAVIS346 can be changed while it runs.

use erfgs_session::source::{Knob, KnobKind};
use serde_json::{Value, json};

use super::{Davis346Config, HEIGHT, WIDTH, bias::MOST_PA};

impl Davis346Config {
    /// See the module. Ranges are those of [`Davis346Config::validate`].
    pub(super) fn knobs(&self) -> Vec<Knob> {
        let number = |least, most, step| KnobKind::Number { least, most, step };
        let current = |path, label, value: Option<u32>| Knob {
            path,
            label,
            value: value.map_or(Value::Null, Value::from),
            kind: number(0, MOST_PA.into(), 1),
            off: Some(path),
        };
        let microseconds = |path, label, value: u32, kind| Knob { path, label, value: value.into(), kind, off: None };
        let steps = number(0, 1_000_000, 250);
        let window = self.events.region.map_or(Value::Null, |window| json!(window));
        vec![
            current("biases.on", "threshold, brighter, pA", self.biases.on),
            current("biases.off", "threshold, darker, pA", self.biases.off),
            current("biases.diff", "reference of both, pA", self.biases.diff),
            current("biases.photoreceptor", "photoreceptor, pA", self.biases.photoreceptor),
            current("biases.photoreceptor_follower", "low-pass, pA", self.biases.photoreceptor_follower),
            current("biases.refractory", "refractory period, pA", self.biases.refractory),
            microseconds(
                "events.background_activity_us",
                "background filter, us",
                self.events.background_activity_us,
                steps,
            ),
            microseconds("events.refractory_us", "refractory filter, us", self.events.refractory_us, steps),
            Knob {
                path: "events.region",
                label: "region",
                value: window,
                kind: KnobKind::Window { columns: WIDTH, rows: HEIGHT, list: false },
                off: Some("events.region"),
            },
            microseconds(
                "frames.exposure_us",
                "exposure of frames, us",
                self.frames.exposure_us,
                number(1, 1_000_000, 1),
            ),
        ]
    }
}
