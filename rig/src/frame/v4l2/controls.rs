//! Exposure, gain, white balance and focus: locked, and read back. Numbers from v4l2-controls.h.

use serde_json::{Map, Value, json};

use super::sys::Node;
use crate::{
    frame::{FrameConfig, FrameError, Lock, config::NamedLock},
    not_applied::NotApplied,
};

const AUTO_WHITE_BALANCE: u32 = 0x98_090c;
const AUTOGAIN: u32 = 0x98_0912;
const GAIN: u32 = 0x98_0913;
const WHITE_BALANCE_TEMPERATURE: u32 = 0x98_091a;
const EXPOSURE_AUTO: u32 = 0x9a_0901;
const EXPOSURE_ABSOLUTE: u32 = 0x9a_0902;
/// Lets the camera lower its frame rate in the dark.
const EXPOSURE_AUTO_PRIORITY: u32 = 0x9a_0903;
const FOCUS_ABSOLUTE: u32 = 0x9a_090a;
const FOCUS_AUTO: u32 = 0x9a_090c;

/// A quantity, the automatic that sets it, and how the two are used.
struct Quantity {
    name: &'static str,
    value: u32,
    automatic: u32,
    /// Values of the automatic for off, and, in order of preference, on.
    off: i32,
    on: &'static [i32],
    /// Our unit in the camera's: exposures count 100 µs.
    scale: f64,
}

const EXPOSURE: Quantity = Quantity {
    name: "exposure_us",
    value: EXPOSURE_ABSOLUTE,
    automatic: EXPOSURE_AUTO,
    // 1 manual; 3 aperture priority is the automatic of UVC cameras, 0 that of others.
    off: 1,
    on: &[3, 0],
    scale: 100.0,
};
const GAIN_QUANTITY: Quantity =
    Quantity { name: "gain", value: GAIN, automatic: AUTOGAIN, off: 0, on: &[1], scale: 1.0 };
const WHITE_BALANCE: Quantity = Quantity {
    name: "white_balance_k",
    value: WHITE_BALANCE_TEMPERATURE,
    automatic: AUTO_WHITE_BALANCE,
    off: 0,
    on: &[1],
    scale: 1.0,
};
const FOCUS: Quantity =
    Quantity { name: "focus", value: FOCUS_ABSOLUTE, automatic: FOCUS_AUTO, off: 0, on: &[1], scale: 1.0 };

impl Quantity {
    fn lock(&self, node: &Node, id: &str, lock: Lock, missed: &mut NotApplied) -> Result<(), FrameError> {
        match lock {
            Lock::Named(NamedLock::Auto) => {
                // Cameras without this automatic hold the value anyway.
                if self.on.iter().all(|&on| node.set_control(self.automatic, on).is_err()) {
                    missed.because(&format!("{} = \"auto\"", self.name), "the camera has no automatic mode for it");
                }
                Ok(())
            }
            Lock::Named(NamedLock::Hold) => {
                if node.control_range(self.automatic).is_ok_and(|range| !range.disabled)
                    && node.control(self.automatic).is_ok_and(|now| now != self.off)
                {
                    node.set_control(self.automatic, self.off).map_err(|error| self.refused(id, "hold", &error))?;
                }
                Ok(())
            }
            Lock::At(wanted) => {
                let refuse = |reason: String| FrameError::Control {
                    id: id.to_owned(),
                    control: self.name,
                    value: wanted.to_string(),
                    reason,
                };
                let range = node
                    .control_range(self.value)
                    .map_err(|_| refuse("it has no such control; leave it at \"hold\"".into()))?;
                let value = (wanted / self.scale).round();
                if !(f64::from(range.minimum)..=f64::from(range.maximum)).contains(&value) {
                    let unit = |n: i32| f64::from(n) * self.scale;
                    return Err(refuse(format!("allowed is {} to {}", unit(range.minimum), unit(range.maximum))));
                }
                if node.control_range(self.automatic).is_ok() {
                    node.set_control(self.automatic, self.off)
                        .map_err(|error| self.refused(id, &wanted.to_string(), &error))?;
                }
                node.set_control(self.value, value as i32)
                    .map_err(|error| self.refused(id, &wanted.to_string(), &error))?;
                // A camera takes the nearest value that it has; further off than a step, something is in the way.
                let step = f64::from(range.step.max(1)) * self.scale;
                if let Ok(now) = node.control(self.value).map(|now| f64::from(now) * self.scale)
                    && (now - wanted).abs() > step
                {
                    missed.compare(self.name, wanted, now);
                }
                Ok(())
            }
        }
    }

    fn refused(&self, id: &str, value: &str, error: &std::io::Error) -> FrameError {
        FrameError::Control {
            id: id.to_owned(),
            control: self.name,
            value: value.to_owned(),
            reason: error.to_string(),
        }
    }

    /// What the camera says now: the value, and whether it is locked. Nothing if it has no such control.
    fn read(&self, node: &Node, settings: &mut Map<String, Value>) {
        if let Ok(value) = node.control(self.value) {
            settings.insert(self.name.into(), json!(f64::from(value) * self.scale));
        }
        if let Ok(automatic) = node.control(self.automatic) {
            settings.insert(format!("{}_locked", self.name), json!(automatic == self.off));
        }
    }
}

const QUANTITIES: [Quantity; 4] = [EXPOSURE, GAIN_QUANTITY, WHITE_BALANCE, FOCUS];

/// Locks everything as the configuration says, and reads it back.
pub fn lock(node: &Node, config: &FrameConfig, missed: &mut NotApplied) -> Result<Map<String, Value>, FrameError> {
    let locks = [config.exposure_us, config.gain, config.white_balance_k, config.focus];
    for (quantity, lock) in QUANTITIES.iter().zip(locks) {
        quantity.lock(node, &config.id, lock, missed)?;
    }
    // A rate that follows the light is no rate; a camera that cannot be told so has none of that.
    if let Err(error) = node.set_control(EXPOSURE_AUTO_PRIORITY, 0) {
        tracing::debug!("camera {}: exposure priority: {error}", config.id);
    }
    let mut settings = Map::new();
    for quantity in &QUANTITIES {
        quantity.read(node, &mut settings);
    }
    Ok(settings)
}
