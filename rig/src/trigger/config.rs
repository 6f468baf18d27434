use serde::{Deserialize, Serialize};

use super::TriggerError;
use erfgs_session::trigger::protocol::{EXPOSURE_GUARD_TICKS, EXPOSURE_MIN_TICKS, PERIOD_TICKS, TICK_HZ};

/// The trigger board's table in `RIG.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TriggerConfig {
    /// Name within the rig: letters, digits, `-` and `_`.
    pub id: String,
    /// Serial port: `/dev/ttyACM0`, `COM3`. Empty: the only board among the ports.
    pub port: String,
    /// Pulses a second: 0.06 to 1000. The nearest period in whole ticks of 62.5 ns is taken, and recorded.
    pub rate_hz: f64,
    /// Width of the frame triggers, µs: the exposure of cameras that expose while their trigger is high. From 20 µs to
    /// 50 µs less than the period.
    pub exposure_us: f64,
    /// Frame outputs in use, 1 to 4.
    pub outputs: Vec<u8>,
    /// What the three LEDs of a calibration wand do: `"off"`, `"on"`, or a frequency in Hz (0.1 to 5000; the nearest of
    /// 5000/n is taken).
    pub leds: [Led; 3],
}

impl Default for TriggerConfig {
    fn default() -> Self {
        Self {
            id: "trigger".into(),
            port: String::new(),
            rate_hz: 30.0,
            exposure_us: 5000.0,
            outputs: vec![1, 2, 3, 4],
            leds: [Led::Switch(Switch::Off); 3],
        }
    }
}

/// What an LED does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "\"on\", \"off\" or a number of periods a second is needed")]
pub enum Led {
    /// It is dark or lit.
    Switch(Switch),
    /// It blinks: periods a second, half of each lit.
    Hz(f64),
}

/// Dark or lit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Switch {
    /// Dark.
    Off,
    /// Lit.
    On,
}

/// Units in which the board counts the half periods of LEDs, per second.
const LED_UNITS_HZ: f64 = 10_000.0;

impl Led {
    /// As the board takes it; `None` if out of range.
    fn half_period(self) -> Option<u16> {
        match self {
            Self::Switch(Switch::Off) => Some(0),
            Self::Switch(Switch::On) => Some(0xffff),
            Self::Hz(hz) => {
                let units = (LED_UNITS_HZ / (2.0 * hz)).round();
                ((0.1..=5000.0).contains(&hz) && units < f64::from(u16::MAX)).then_some(units as u16)
            }
        }
    }
}

/// A configuration as the board takes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TriggerSettings {
    /// From one rising edge to the next, ticks.
    pub period: u32,
    /// Width of the frame triggers, ticks.
    pub exposure: u32,
    /// Frame outputs in use; bit 0 is output 1.
    pub outputs: u32,
    /// Half periods of the LEDs in units of 100 µs; 0 dark, 0xffff lit.
    pub leds: [u16; 3],
}

impl TriggerSettings {
    /// Pulses a second, exactly as the board gives them.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        f64::from(TICK_HZ) / f64::from(self.period)
    }

    /// Width of the frame triggers, microseconds.
    #[must_use]
    pub fn exposure_us(&self) -> f64 {
        f64::from(self.exposure) * 1e6 / f64::from(TICK_HZ)
    }
}

impl TriggerConfig {
    /// Turns frequencies and times into ticks.
    ///
    /// # Errors
    /// If something is out of the board's range.
    pub fn settings(&self) -> Result<TriggerSettings, TriggerError> {
        let fail = |problem: String| Err(TriggerError::Config { id: self.id.clone(), problem });
        let period = (f64::from(TICK_HZ) / self.rate_hz).round();
        if !(f64::from(*PERIOD_TICKS.start())..=f64::from(*PERIOD_TICKS.end())).contains(&period) {
            return fail(format!("rate_hz is {}; the board gives 0.06 to 1000 pulses a second", self.rate_hz));
        }
        let exposure = (self.exposure_us * f64::from(TICK_HZ) / 1e6).round();
        let longest = period - f64::from(EXPOSURE_GUARD_TICKS);
        if !(f64::from(EXPOSURE_MIN_TICKS)..=longest).contains(&exposure) {
            let longest_us = longest * 1e6 / f64::from(TICK_HZ);
            return fail(format!(
                "exposure_us is {}; at {} Hz it can be 20 to {longest_us:.0}",
                self.exposure_us, self.rate_hz
            ));
        }
        let mut outputs = 0;
        for &output in &self.outputs {
            if !(1..=4).contains(&output) {
                return fail(format!("outputs names {output}; the board has outputs 1 to 4"));
            }
            outputs |= 1 << (output - 1);
        }
        let mut leds = [0; 3];
        for (half_period, led) in leds.iter_mut().zip(self.leds) {
            match led.half_period() {
                Some(units) => *half_period = units,
                None => {
                    return fail(format!("leds has {led:?}; an LED is \"off\", \"on\" or blinks at 0.1 to 5000 Hz"));
                }
            }
        }
        Ok(TriggerSettings { period: period as u32, exposure: exposure as u32, outputs, leds })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_become_ticks() {
        let config =
            TriggerConfig { leds: [Led::Hz(1000.0), Led::Switch(Switch::On), Led::Hz(700.0)], ..Default::default() };
        let settings = config.settings().unwrap();
        assert_eq!(settings, TriggerSettings { period: 533_333, exposure: 80_000, outputs: 15, leds: [5, 0xffff, 7] });
        assert!((settings.rate_hz() - 30.0).abs() < 3e-5);
    }

    #[test]
    fn what_the_board_cannot_do_is_refused_with_the_range() {
        let refused = |change: fn(&mut TriggerConfig)| {
            let mut config = TriggerConfig::default();
            change(&mut config);
            config.settings().unwrap_err().to_string()
        };
        assert!(refused(|c| c.rate_hz = 2000.0).contains("1000 pulses"));
        assert!(refused(|c| c.rate_hz = 0.0).contains("0.06"));
        assert!(refused(|c| c.rate_hz = f64::NAN).contains("NaN"));
        assert!(refused(|c| c.exposure_us = 33_300.0).contains("20 to 33283"));
        assert!(refused(|c| c.outputs = vec![5]).contains("outputs 1 to 4"));
        assert!(refused(|c| c.leds[1] = Led::Hz(6000.0)).contains("5000 Hz"));
    }

    #[test]
    fn the_table_is_read_and_unknown_fields_are_refused() {
        let table = r#"{"rate_hz": 50.0, "leds": ["off", 250, "on"]}"#;
        let config: TriggerConfig = serde_json::from_str(table).unwrap();
        assert_eq!(config.leds, [Led::Switch(Switch::Off), Led::Hz(250.0), Led::Switch(Switch::On)]);
        assert_eq!(config.id, "trigger");
        assert!(serde_json::from_str::<TriggerConfig>(r#"{"rate": 50}"#).is_err());
    }
}
