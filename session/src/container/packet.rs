//! How a packet lies in a message: a header of 40 bytes, then the bytes of the device.
//!
//! The header is laid out as CDR (little-endian) so that any reader of ROS 2 messages takes it apart by the schema in
//! the file; for everybody else it is a fixed structure:
//!
//! | Offset | Type | Field |
//! |---|---|---|
//! | 0 | 4 bytes | `00 01 00 00`: CDR, little-endian |
//! | 4 | u64 | `sequence` |
//! | 12 | i64 | `host_ns` |
//! | 20 | i64 | `kernel_ns`, 0 without a stamp |
//! | 28 | u32 | `kernel_sequence`, 0 without a stamp |
//! | 32 | u32 | `flags`: the constants of [`flag`] |
//! | 36 | u32 | number of bytes that follow |
//! | 40 | bytes | the payload, exactly as the device sent it |

use bytes::Bytes;

use crate::source::{FrameStamp, Packet, StampClock, StampPoint};

/// Bytes before the payload.
pub const HEADER_BYTES: usize = 40;

/// Name of the schema of packets.
pub const SCHEMA_NAME: &str = "erfgs_msgs/msg/Packet";

/// The schema of packets, as ROS 2 writes message definitions.
pub const SCHEMA: &str = "\
uint32 DISCONTINUITY=1
uint32 DAMAGED=2
uint32 KERNEL_STAMP=4
uint32 KERNEL_CLOCK_MONOTONIC=8
uint32 KERNEL_START_OF_EXPOSURE=16
uint32 CAMERA_CLOCK=32
# Counts the packets of the stream from 0; what was lost leaves a gap.
uint64 sequence
# Arrival, CLOCK_MONOTONIC, nanoseconds.
int64 host_ns
# The kernel's stamp (with CAMERA_CLOCK: the camera's), nanoseconds, and its count of frames; valid if flags has KERNEL_STAMP.
int64 kernel_ns
uint32 kernel_sequence
uint32 flags
# The bytes of the device as received; the channel's metadata says how they are encoded.
uint8[] data
";

/// Bits of the header's flags.
pub mod flag {
    /// Data was lost or cut before this packet.
    pub const DISCONTINUITY: u32 = 1;
    /// The device or the kernel marked the data as damaged.
    pub const DAMAGED: u32 = 2;
    /// The kernel's stamp and sequence are valid.
    pub const KERNEL_STAMP: u32 = 4;
    /// The kernel stamped with `CLOCK_MONOTONIC`.
    pub const KERNEL_CLOCK_MONOTONIC: u32 = 8;
    /// The stamp marks the start of the exposure; without it, the end of the frame.
    pub const KERNEL_START_OF_EXPOSURE: u32 = 16;
    /// The stamp and the count are the camera's own, not the kernel's.
    pub const CAMERA_CLOCK: u32 = 32;
}

const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// The header of `packet`. The payload must be shorter than 4 GiB.
#[must_use]
pub fn header(packet: &Packet) -> [u8; HEADER_BYTES] {
    let mut flags = 0;
    let mut set = |on, bit| flags |= if on { bit } else { 0 };
    set(packet.discontinuity, flag::DISCONTINUITY);
    set(packet.damaged, flag::DAMAGED);
    let (mut kernel_ns, mut kernel_sequence) = (0, 0);
    if let Some(stamp) = packet.stamp {
        (kernel_ns, kernel_sequence) = (stamp.kernel_ns, stamp.sequence);
        set(true, flag::KERNEL_STAMP);
        set(stamp.clock == StampClock::Monotonic, flag::KERNEL_CLOCK_MONOTONIC);
        set(stamp.clock == StampClock::Camera, flag::CAMERA_CLOCK);
        set(stamp.point == StampPoint::StartOfExposure, flag::KERNEL_START_OF_EXPOSURE);
    }
    let mut bytes = [0; HEADER_BYTES];
    bytes[0..4].copy_from_slice(&ENCAPSULATION);
    bytes[4..12].copy_from_slice(&packet.sequence.to_le_bytes());
    bytes[12..20].copy_from_slice(&packet.host_ns.to_le_bytes());
    bytes[20..28].copy_from_slice(&kernel_ns.to_le_bytes());
    bytes[28..32].copy_from_slice(&kernel_sequence.to_le_bytes());
    bytes[32..36].copy_from_slice(&flags.to_le_bytes());
    bytes[36..40].copy_from_slice(&(packet.payload.len() as u32).to_le_bytes());
    bytes
}

/// The packet in a message. `None` if the message is shorter than its header says or starts otherwise.
#[must_use]
pub fn parse(message: &Bytes) -> Option<Packet> {
    let head: &[u8; HEADER_BYTES] = message.first_chunk()?;
    if head[0..4] != ENCAPSULATION {
        return None;
    }
    let u32_at = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let flags = u32_at(32);
    let has = |bit| flags & bit != 0;
    let end = HEADER_BYTES.checked_add(u32_at(36) as usize)?;
    if message.len() < end {
        return None;
    }
    let stamp = has(flag::KERNEL_STAMP).then(|| FrameStamp {
        kernel_ns: u64_at(20).cast_signed(),
        clock: match (has(flag::KERNEL_CLOCK_MONOTONIC), has(flag::CAMERA_CLOCK)) {
            (true, _) => StampClock::Monotonic,
            (false, true) => StampClock::Camera,
            (false, false) => StampClock::Unknown,
        },
        point: if has(flag::KERNEL_START_OF_EXPOSURE) { StampPoint::StartOfExposure } else { StampPoint::EndOfFrame },
        sequence: u32_at(28),
    });
    Some(Packet {
        sequence: u64_at(4),
        host_ns: u64_at(12).cast_signed(),
        discontinuity: has(flag::DISCONTINUITY),
        damaged: has(flag::DAMAGED),
        stamp,
        payload: message.slice(HEADER_BYTES..end),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn stamp() -> impl Strategy<Value = FrameStamp> {
        let clock = prop::sample::select(vec![StampClock::Monotonic, StampClock::Camera, StampClock::Unknown]);
        (any::<i64>(), clock, any::<bool>(), any::<u32>()).prop_map(|(kernel_ns, clock, start, sequence)| FrameStamp {
            kernel_ns,
            clock,
            point: if start { StampPoint::StartOfExposure } else { StampPoint::EndOfFrame },
            sequence,
        })
    }

    fn packet() -> impl Strategy<Value = Packet> {
        let payload = prop::collection::vec(any::<u8>(), 0..64);
        (any::<u64>(), any::<i64>(), any::<bool>(), any::<bool>(), prop::option::of(stamp()), payload).prop_map(
            |(sequence, host_ns, discontinuity, damaged, stamp, payload)| Packet {
                sequence,
                host_ns,
                discontinuity,
                damaged,
                stamp,
                payload: payload.into(),
            },
        )
    }

    proptest! {
        #[test]
        fn a_packet_comes_back_from_its_message_and_from_no_shorter_one(packet in packet()) {
            let mut message = header(&packet).to_vec();
            message.extend_from_slice(&packet.payload);
            let message = Bytes::from(message);
            prop_assert_eq!(parse(&message), Some(packet));
            for cut in 0..message.len() {
                prop_assert_eq!(parse(&message.slice(..cut)), None);
            }
        }
    }
}
