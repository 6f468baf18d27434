//! Any bytes as EVT 2.0. Options: the sensor's size is unknown if bit 0 is set.

use erfgs_events::{EventEncoding, Evt2Decoder, SensorSize};

use crate::{Plan, check_device};

/// Checks one input.
pub fn evt2(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    check_device(&plan, EventEncoding::Evt2, SensorSize { width: 640, height: 480 }, Evt2Decoder::new);
}
