//! Any bytes as Event Stream. Options: of an ATIS if bit 0 is set.

use erfgs_events::{EsDecoder, EsKind, SensorSize};

use crate::{Plan, check_stream};

/// Checks one input.
pub fn es(input: &[u8]) {
    let Some(plan) = Plan::read(input) else { return };
    let kind = if plan.options & 1 == 0 { EsKind::Dvs } else { EsKind::Atis };
    let size = SensorSize { width: 640, height: 480 };
    check_stream(&plan, size, 64 << 10, || EsDecoder::new(kind, size));
}
