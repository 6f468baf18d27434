//! What a buffer's flags say (`V4L2_BUF_FLAG_*`, videodev2.h).

use erfgs_session::source::{FrameStamp, StampClock, StampPoint};

use super::sys::Filled;

const ERROR: u32 = 0x40;
const TIMESTAMP_MASK: u32 = 0xe000;
const TIMESTAMP_MONOTONIC: u32 = 0x2000;
const TSTAMP_SRC_MASK: u32 = 0x7_0000;
const TSTAMP_SRC_SOE: u32 = 0x1_0000;

/// Whether the driver marked the frame as damaged.
pub fn is_damaged(frame: &Filled) -> bool {
    frame.flags & ERROR != 0
}

/// The kernel's stamp.
pub fn stamp(frame: &Filled) -> FrameStamp {
    let monotonic = frame.flags & TIMESTAMP_MASK == TIMESTAMP_MONOTONIC;
    let start = frame.flags & TSTAMP_SRC_MASK == TSTAMP_SRC_SOE;
    FrameStamp {
        kernel_ns: frame.timestamp_ns,
        clock: if monotonic { StampClock::Monotonic } else { StampClock::Unknown },
        point: if start { StampPoint::StartOfExposure } else { StampPoint::EndOfFrame },
        sequence: frame.sequence,
    }
}
