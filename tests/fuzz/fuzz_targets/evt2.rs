//! Any bytes as EVT 2.0. Options: the sensor's size is unknown if bit 0 is set.

#![no_main]

use erfgs_events::EventEncoding;
use erfgs_events::{Evt2Decoder, SensorSize};
use erfgs_session::source::Encoding;
use erfgs_session_fuzz::{Plan, check_device};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some(plan) = Plan::read(input) else { return };
    check_device(&plan, Encoding::Events(EventEncoding::Evt2), SensorSize { width: 640, height: 480 }, Evt2Decoder::new);
});
