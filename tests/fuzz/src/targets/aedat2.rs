//! Any bytes as pairs of an AEDAT 2 file. Options: a DVS128 if bit 0 is set, else a DAVIS346.

use erfgs_events::{Aedat2Chip, Aedat2Decoder, SensorSize};

use crate::{Plan, check_stream};

/// Checks one input.
pub fn aedat2(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    let davis = Aedat2Chip::Davis(SensorSize { width: 346, height: 260 });
    let chip = if plan.options & 1 == 1 { Aedat2Chip::Dvs128 } else { davis };
    check_stream(&plan, chip.size(), 64 << 10, || Aedat2Decoder::new(chip));
}
