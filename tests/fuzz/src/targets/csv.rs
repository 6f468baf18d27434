//! Any bytes as CSV. Options: the sensor's size is unknown if bit 0 is set.

use erfgs_events::{CsvDecoder, SensorSize};

use crate::{Plan, check_stream};

/// Checks one input.
pub fn csv(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    let size = (plan.options & 1 == 0).then_some(SensorSize { width: 640, height: 480 });
    let all = SensorSize { width: u16::MAX, height: u16::MAX };
    check_stream(&plan, size.unwrap_or(all), 64 << 10, || CsvDecoder::new(size));
}
