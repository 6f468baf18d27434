//! Any bytes as EVT 2.1. Options: the sensor's size is unknown if bit 0 is set; legacy word order if bit 1 is set.

use erfgs_events::{EventEncoding, Evt21Decoder, SensorSize, WordOrder};

use crate::{Plan, check_device};

/// Checks one input.
pub fn evt21(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    let (order, encoding) = match plan.options & 2 {
        0 => (WordOrder::Little, EventEncoding::Evt21),
        _ => (WordOrder::Legacy, EventEncoding::Evt21Legacy),
    };
    let size = SensorSize { width: 1280, height: 720 };
    check_device(&plan, encoding, size, |size| Evt21Decoder::new(order, size));
}
