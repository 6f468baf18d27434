//! The camera's stream: frames as the packets of GVSP.

use super::TICK_HZ;
use crate::genicam::{
    Exposed, frame,
    registers::{Features, feature},
};

/// The packets of a frame by their numbers, for packets of so many bytes: leader, payload, trailer.
pub fn packets(features: &Features, id: u16, exposed: &Exposed, packet_bytes: u32) -> Vec<(u32, Vec<u8>)> {
    let kind = frame::kind(features);
    let header = |format: u8, packet: u32| {
        let mut bytes = vec![0, 0];
        bytes.extend(id.to_be_bytes());
        bytes.extend((u32::from(format) << 24 | packet).to_be_bytes());
        bytes
    };
    let ticks = (u128::from(exposed.clock_ns) * u128::from(TICK_HZ) / 1_000_000_000) as u64;
    let mut leader = header(1, 0);
    leader.extend([0, 0]);
    leader.extend(kind.to_be_bytes());
    leader.extend(ticks.to_be_bytes());
    let [width, height, x, y] =
        [feature::WIDTH, feature::HEIGHT, feature::OFFSET_X, feature::OFFSET_Y].map(|at| features.get(at));
    for word in [frame::code(features), width, height, x, y, 0] {
        leader.extend(word.to_be_bytes());
    }
    let slot = packet_bytes.max(100) as usize - 36;
    let mut all = vec![(0, leader)];
    for (index, piece) in frame::payload(features, exposed).chunks(slot).enumerate() {
        let packet = index as u32 + 1;
        let mut bytes = header(3, packet);
        bytes.extend(piece);
        all.push((packet, bytes));
    }
    let packet = all.len() as u32;
    let mut trailer = header(2, packet);
    trailer.extend([0, 0]);
    trailer.extend(kind.to_be_bytes());
    trailer.extend(height.to_be_bytes());
    if frame::has_chunks(features) {
        trailer.extend(1_u32.to_be_bytes());
    }
    all.push((packet, trailer));
    all
}
