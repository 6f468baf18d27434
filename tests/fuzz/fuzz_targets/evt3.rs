//! Any bytes as EVT 3.0. Options: the sensor's size is unknown if bit 0 is set.

#![no_main]

use erfgs_events::EventEncoding;
use erfgs_events::{Evt3Decoder, SensorSize};
use erfgs_session::source::Encoding;
use erfgs_session_fuzz::{Plan, check_device};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some(plan) = Plan::read(input) else { return };
    check_device(&plan, Encoding::Events(EventEncoding::Evt3), SensorSize { width: 1280, height: 720 }, Evt3Decoder::new);
});
