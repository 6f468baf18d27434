//! Any bytes as EVT 2.0. Options: the sensor's size is unknown if bit 0 is set.

#![no_main]

use erfgs_session::{
    codec::{Evt2Decoder, SensorSize},
    source::Encoding,
};
use erfgs_session_fuzz::{Plan, check_resumed, check_stream};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some(plan) = Plan::read(input) else { return };
    let size = (plan.options & 1 == 0).then_some(SensorSize { width: 640, height: 480 });
    let limit = 64 << 10;
    check_stream(&plan, size.unwrap_or(SensorSize::ALL), limit, || Evt2Decoder::new(size));
    check_resumed(&plan, Encoding::Evt2, size.unwrap_or(SensorSize::ALL));
});
