//! The camera's stream: frames as leader, payload and trailer, each of them transfers that end when they are full or with a short packet.

use std::collections::VecDeque;

use super::{
    faults::U3vFaults,
    registers::{Memory, SIRM, sirm},
};
use crate::genicam::{
    Exposed, frame,
    registers::{Features, feature},
};

/// Most frames that wait for the host; what is exposed beyond that is lost.
const QUEUED_BLOCKS: usize = 4;
/// Bytes of a leader and of a trailer with chunks, the larger.
pub const LEADER_BYTES: u32 = 52;
pub const TRAILER_BYTES: u32 = 36;
/// The camera had no room for the rest of a block.
const OVERRUN: u16 = 0xa101;
const INCONSISTENT: u16 = 0xa004;
const MISALIGNED: u16 = 0xa003;

/// A transfer of the camera's.
#[derive(Debug)]
pub struct Part {
    bytes: Vec<u8>,
    /// Whether a packet that is short or empty tells its end: it is not as long as it can be.
    is_short: bool,
    ends_block: bool,
}

/// What the camera has for the host.
#[derive(Debug, Default)]
pub struct Outgoing {
    parts: VecDeque<Part>,
    /// How much of the first has left.
    sent: usize,
}

impl Outgoing {
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Whether another block has room.
    pub fn has_room(&self) -> bool {
        self.parts.iter().filter(|part| part.ends_block).count() < QUEUED_BLOCKS
    }

    /// Queues the transfers of a block.
    pub fn push(&mut self, mut parts: Vec<Part>) {
        if let Some(last) = parts.last_mut() {
            last.ends_block = true;
        }
        self.parts.extend(parts);
    }

    /// What fills a transfer of the host: whole packets until it is full, or until a short one.
    pub fn fill(&mut self, length: usize) -> Option<Vec<u8>> {
        let mut data = Vec::new();
        while let Some(part) = self.parts.front() {
            let left = &part.bytes[self.sent..];
            let count = left.len().min(length - data.len());
            data.extend(&left[..count]);
            self.sent += count;
            if self.sent < part.bytes.len() {
                break;
            }
            let is_short = part.is_short;
            self.parts.pop_front();
            self.sent = 0;
            if is_short || data.len() == length {
                break;
            }
        }
        (!data.is_empty()).then_some(data)
    }
}

/// The status of a stream that is to begin: 0 if the host's sizes hold a block.
pub fn status(memory: &Memory, alignment: u32) -> u16 {
    let [leader, transfer, count, first, second, trailer] = sirm::SIZES.map(|at| memory.word(SIRM + at));
    if [transfer, first, second].iter().any(|size| !size.is_multiple_of(alignment)) {
        return MISALIGNED;
    }
    let room = u64::from(transfer) * u64::from(count) + u64::from(first) + u64::from(second);
    let fits = room >= memory.word(SIRM + sirm::PAYLOAD).into() && leader >= LEADER_BYTES && trailer >= TRAILER_BYTES;
    if fits { 0 } else { INCONSISTENT }
}

/// The payload as the host's sizes cut it.
fn cut(memory: &Memory, mut payload: Vec<u8>, packet: usize) -> Vec<Part> {
    let [_, transfer, count, first, second, _] = sirm::SIZES.map(|at| memory.word(SIRM + at) as usize);
    let sizes = std::iter::repeat_n(transfer, count).chain([first, second]);
    let mut parts = Vec::new();
    for size in sizes {
        if payload.is_empty() {
            break;
        }
        let rest = payload.split_off(size.min(payload.len()));
        let bytes = std::mem::replace(&mut payload, rest);
        if !bytes.is_empty() {
            // Where the rest ends with a packet, as large as the host's last transfer, nothing tells the end.
            let is_short = bytes.len() < size || !bytes.len().is_multiple_of(packet);
            parts.push(Part { bytes, is_short, ends_block: false });
        }
    }
    parts
}

/// The transfers of a frame, as faults leave them.
pub fn block(memory: &Memory, features: &Features, exposed: &Exposed, packet: usize, faults: &U3vFaults) -> Vec<Part> {
    let id = exposed.truth.number;
    if faults.lost_blocks.contains(&id) || faults.stuck_from.is_some_and(|from| id >= from) {
        return Vec::new();
    }
    let mut payload = frame::payload(features, exposed);
    let mut status = 0;
    if let Some((_, bytes)) = faults.truncated.range((id, 0)..=(id, u32::MAX)).next() {
        payload.truncate(*bytes as usize);
        status = OVERRUN;
    }
    let trailer = trailer(features, id, status, payload.len());
    let lost = faults.lost_packets.range((id, 0)..=(id, u32::MAX)).map(|(_, lost)| *lost as usize);
    for lost in lost.collect::<Vec<_>>().into_iter().rev() {
        let at = (lost * packet).min(payload.len());
        payload.drain(at..(at + packet).min(payload.len()));
    }
    let mut parts = cut(memory, payload, packet);
    let short = |bytes| Part { bytes, is_short: true, ends_block: false };
    if !faults.without_leader.contains(&id) {
        parts.insert(0, short(leader(features, id, exposed.clock_ns)));
    }
    if !faults.without_trailer.contains(&id) {
        parts.push(short(trailer));
    }
    parts
}

fn leader(features: &Features, id: u64, clock_ns: u64) -> Vec<u8> {
    let mut leader = b"U3VL\0\0".to_vec();
    leader.extend((LEADER_BYTES as u16).to_le_bytes());
    leader.extend(id.to_le_bytes());
    leader.extend([0, 0]);
    leader.extend(frame::kind(features).to_le_bytes());
    leader.extend(clock_ns.to_le_bytes());
    let [width, height, x, y] =
        [feature::WIDTH, feature::HEIGHT, feature::OFFSET_X, feature::OFFSET_Y].map(|at| features.get(at));
    for word in [frame::code(features), width, height, x, y, 0] {
        leader.extend(word.to_le_bytes());
    }
    leader
}

fn trailer(features: &Features, id: u64, status: u16, payload_bytes: usize) -> Vec<u8> {
    let chunks = frame::has_chunks(features);
    let mut trailer = b"U3VT\0\0".to_vec();
    trailer.extend((if chunks { TRAILER_BYTES } else { TRAILER_BYTES - 4 } as u16).to_le_bytes());
    trailer.extend(id.to_le_bytes());
    trailer.extend(status.to_le_bytes());
    trailer.extend([0, 0]);
    trailer.extend((payload_bytes as u64).to_le_bytes());
    trailer.extend(features.get(feature::HEIGHT).to_le_bytes());
    if chunks {
        trailer.extend(1_u32.to_le_bytes());
    }
    trailer
}
