//! Any bytes as EVT 2.1. Options: the sensor's size is unknown if bit 0 is set; legacy word order if bit 1 is set.

#![no_main]

use erfgs_events::EventEncoding;
use erfgs_events::{Evt21Decoder, SensorSize, WordOrder};
use erfgs_session::source::Encoding;
use erfgs_session_fuzz::{Plan, check_device};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some(plan) = Plan::read(input) else { return };
    let (order, encoding) = match plan.options & 2 {
        0 => (WordOrder::Little, Encoding::Events(EventEncoding::Evt21)),
        _ => (WordOrder::Legacy, Encoding::Events(EventEncoding::Evt21Legacy)),
    };
    let size = SensorSize { width: 1280, height: 720 };
    check_device(&plan, encoding, size, |size| Evt21Decoder::new(order, size));
});
