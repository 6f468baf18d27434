//! Any bytes as items of a DAT file. Options: bit 0, version 1; bit 1, trigger items; bit 2, the sensor's size is unknown.

use erfgs_events::{DatDecoder, DatFormat, DatItems, SensorSize};

use crate::{Plan, check_stream};

/// Checks one input.
pub fn dat(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    let format = DatFormat {
        version: 2 - (plan.options & 1),
        items: if plan.options & 2 == 0 { DatItems::Events } else { DatItems::Triggers },
        size: (plan.options & 4 == 0).then_some(SensorSize { width: 640, height: 480 }),
    };
    let size = format.size.unwrap_or(SensorSize { width: 1 << 14, height: 1 << 14 });
    check_stream(&plan, size, 64 << 10, || DatDecoder::new(format));
}
