//! Any bytes as an AEDAT 4 file. A packet may unpack to 64 MiB, however short it is; memory is allowed for a few of that.

use erfgs_events::{Aedat4Decoder, SensorSize};

use crate::{Plan, check_stream};

/// Checks one input.
pub fn aedat4(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    let limit = (512 << 20) + 64 * plan.len();
    // Without a size in the file's header, addresses are what 15 bits can say.
    let size = SensorSize { width: u16::MAX, height: u16::MAX };
    check_stream(&plan, size, limit, Aedat4Decoder::new);
}
