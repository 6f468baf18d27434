//! What is known of event sensors that no device says of itself.

use crate::source::Description;

/// An event sensor as its maker describes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EventSensor {
    /// The sensor.
    pub name: &'static str,
    /// What models of cameras that have it are called, in capitals; a part of the name will do.
    pub models: &'static [&'static str],
    /// Nominal contrast thresholds of ON and OFF events at the maker's default biases, natural logarithm of intensity.
    pub contrast_thresholds: [f64; 2],
    /// Where they are stated.
    pub source: &'static str,
}

/// The sensors of the cameras that erfgs drives; the first stands for those that are not known.
pub const EVENT_SENSORS: [EventSensor; 2] = [
    EventSensor {
        name: "IMX636",
        models: &["EVK4", "IMX636"],
        contrast_thresholds: [0.223, 0.223],
        source: "Prophesee, EVK4: 25 %",
    },
    EventSensor {
        name: "DAVIS346",
        models: &["DAVIS"],
        contrast_thresholds: [0.134, 0.203],
        source: "iniVation, DAVIS346's data sheet: 14.3 % (ON) and 22.5 % (OFF)",
    },
];

impl EventSensor {
    /// The sensor of a camera, by the camera's model in whatever spelling; `None` if it is not known.
    #[must_use]
    pub fn of_model(model: &str) -> Option<&'static Self> {
        let model = model.to_ascii_uppercase();
        EVENT_SENSORS.iter().find(|sensor| sensor.models.iter().any(|name| model.contains(name)))
    }
}

impl Description {
    /// Nominal contrast thresholds of ON and OFF events, natural logarithm of intensity: at the maker's default biases,
    /// whatever the camera's own are. Of a model that is not known, those of an [IMX636](EVENT_SENSORS).
    #[must_use]
    pub fn contrast_thresholds(&self) -> [f64; 2] {
        EventSensor::of_model(&self.model).unwrap_or(&EVENT_SENSORS[0]).contrast_thresholds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_are_the_logarithms_of_what_the_makers_state() {
        let logarithm = |percent: f64| (1e3 * (1.0 + percent / 100.0).ln()).round() / 1e3;
        let of = |model| EventSensor::of_model(model).map(|sensor| sensor.contrast_thresholds);
        assert_eq!(of("Prophesee EVK4"), Some([logarithm(25.0); 2]));
        assert_eq!(of("iniVation DAVIS346"), Some([logarithm(14.3), logarithm(22.5)]));
        assert_eq!(of("simulated"), None);
    }
}
