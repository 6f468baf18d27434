//! Any bytes as words of a DAVIS. Options: bits 0 and 1 choose the size, bits 2 to 5 how events and frames turn.

use erfgs_events::{DavisDecoder, DavisLayout, EventEncoding, SensorSize};

use crate::{Plan, check_resumed, check_stream};

/// Checks one input.
pub fn davis(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    let size = |width, height| SensorSize { width, height };
    // The last is no sensor's: a size that a file claims.
    let size = [size(6, 4), size(346, 260), size(1, 1), size(u16::MAX, u16::MAX)][usize::from(plan.options & 3)];
    let bit = |at: u8| u32::from(plan.options >> at & 1);
    let layout =
        DavisLayout::from_registers(size, bit(2) << 2, bit(3) << 2 | bit(4) << 1 | bit(5), bit(4) << 2, 2 * bit(5));
    // A frame grows by a column for each word that begins one.
    let limit = (1 << 20) + 16 * usize::from(size.width.max(size.height).min(4096)) * plan.len();
    check_stream(&plan, size, limit, || DavisDecoder::new(layout));
    check_resumed(&plan, EventEncoding::Davis, size);
}
