//! What goes wrong on the way from the camera to its host, on demand.

use std::collections::BTreeSet;

/// Faults of a stream. Blocks are counted from 1 since the acquisition began, packets as the protocol numbers them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GigeFaults {
    /// Packets (block, packet) that are lost when they are sent first.
    pub lost: BTreeSet<(u64, u32)>,
    /// Packets that are lost whenever they are sent.
    pub lost_for_good: BTreeSet<(u64, u32)>,
    /// Packets that are sent twice.
    pub doubled: BTreeSet<(u64, u32)>,
    /// Packets that the next two overtake.
    pub overtaken: BTreeSet<(u64, u32)>,
    /// Blocks whose trailer is never sent.
    pub without_trailer: BTreeSet<u64>,
    /// Blocks of which nothing is sent.
    pub lost_blocks: BTreeSet<u64>,
    /// Most bytes of a packet that the way lets through, headers of the network included; larger ones vanish.
    pub mtu: Option<u32>,
    /// Commands, counted from 0, that never arrive.
    pub lost_commands: BTreeSet<u64>,
}

impl GigeFaults {
    /// Puts the packets of a block into the order in which they arrive, without those that do not.
    pub(super) fn way(&self, block: u64, packets: &[(u32, Vec<u8>)]) -> Vec<Vec<u8>> {
        if self.lost_blocks.contains(&block) {
            return Vec::new();
        }
        let last = packets.last().map_or(0, |(packet, _)| *packet);
        let mut sent: Vec<(usize, usize)> = Vec::new();
        for (index, (packet, _)) in packets.iter().enumerate() {
            let key = (block, *packet);
            if self.lost.contains(&key) || self.stays_lost(block, *packet, last) {
                continue;
            }
            let at = if self.overtaken.contains(&key) { index + 2 } else { index };
            sent.push((at, index));
            if self.doubled.contains(&key) {
                sent.push((at, index));
            }
        }
        // One that was overtaken comes behind what is at its place.
        sent.sort_by_key(|&(at, index)| (at, at != index));
        sent.into_iter().map(|(_, index)| packets[index].1.clone()).filter(|bytes| self.passes(bytes.len())).collect()
    }

    /// Whether a packet is lost however often it is sent.
    pub(super) fn stays_lost(&self, block: u64, packet: u32, last: u32) -> bool {
        self.lost_for_good.contains(&(block, packet)) || (packet == last && self.without_trailer.contains(&block))
    }

    /// Whether a datagram of so many bytes comes through.
    pub(super) fn passes(&self, bytes: usize) -> bool {
        self.mtu.is_none_or(|mtu| bytes + 28 <= mtu as usize)
    }
}
