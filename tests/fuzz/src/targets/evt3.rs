//! Any bytes as EVT 3.0. Options: the sensor's size is unknown if bit 0 is set.

use erfgs_events::{EventEncoding, Evt3Decoder, SensorSize};

use crate::{Plan, check_device};

/// Checks one input.
pub fn evt3(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    check_device(&plan, EventEncoding::Evt3, SensorSize { width: 1280, height: 720 }, Evt3Decoder::new);
}
