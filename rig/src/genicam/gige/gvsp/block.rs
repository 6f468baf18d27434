//! A block that is being put together.

use super::{
    Timing,
    packet::{Content, Datagram},
};
use crate::genicam::block::{Block, Damage, Leader};

/// The packets of one block so far.
#[derive(Debug)]
pub(super) struct Open {
    pub number: u64,
    /// The block id as the camera sends it.
    pub id: u64,
    pub first_ns: i64,
    pub last_ns: i64,
    pub restarted: bool,
    leader: Option<Leader>,
    /// Packet number of the trailer.
    trailer: Option<u32>,
    bytes: Vec<u8>,
    slot: usize,
    /// A bit for each packet of payload that can be: number 1 is bit 0.
    seen: Vec<u64>,
    count: u32,
    /// Most packets of payload.
    most: u32,
    highest: u32,
    /// Number and length of the last packet that is shorter than others.
    short: Option<(u32, usize)>,
    damage: Option<Damage>,
    /// Packets asked for again so far, counted as often as asked.
    pub asked: u32,
    /// Packets below this number were asked for before.
    asked_below: u32,
    /// When what is missing is asked for: what was not asked for yet, and all.
    fresh_due_ns: Option<i64>,
    again_due_ns: Option<i64>,
}

impl Open {
    pub fn new(number: u64, id: u64, now_ns: i64, block_bytes: usize, slot: usize) -> Self {
        let most = block_bytes.div_ceil(slot);
        Self {
            number,
            id,
            first_ns: now_ns,
            last_ns: now_ns,
            restarted: false,
            leader: None,
            trailer: None,
            bytes: vec![0; block_bytes],
            slot,
            seen: vec![0; most.div_ceil(64)],
            count: 0,
            most: u32::try_from(most).unwrap_or(u32::MAX - 2),
            highest: 0,
            short: None,
            damage: None,
            asked: 0,
            asked_below: 0,
            fresh_due_ns: None,
            again_due_ns: None,
        }
    }

    /// Takes a datagram of the block. `false` if it was there before.
    pub fn take(&mut self, datagram: &Datagram<'_>, now_ns: i64, timing: &Timing) -> bool {
        self.last_ns = now_ns;
        // Of a packet of payload it says that the camera does not have it now; it stays missing.
        if datagram.is_error() && !matches!(datagram.content, Content::Payload(_)) {
            self.damage.get_or_insert(Damage::Camera(datagram.status));
        }
        let fresh = match datagram.content {
            Content::Leader(leader) => self.leader.replace(leader).is_none(),
            Content::Trailer => self.end(datagram.packet),
            Content::Payload(_) if datagram.is_error() => false,
            Content::Payload(data) => self.place(datagram.packet, data),
        };
        let gap = datagram.packet > self.highest.saturating_add(1) || (self.leader.is_none() && datagram.packet > 0);
        self.highest = self.highest.max(datagram.packet.min(self.most + 1));
        if gap && fresh && self.fresh_due_ns.is_none() {
            self.fresh_due_ns = Some(now_ns + timing.ask_after_ns);
        }
        fresh
    }

    fn end(&mut self, packet: u32) -> bool {
        if packet == 0 || packet - 1 > self.most {
            self.damage.get_or_insert(Damage::Layout);
        }
        self.trailer.replace(packet.clamp(1, self.most + 1)).is_none()
    }

    fn place(&mut self, packet: u32, data: &[u8]) -> bool {
        if packet == 0 || packet > self.most || data.len() > self.slot {
            self.damage.get_or_insert(Damage::Layout);
            return false;
        }
        let index = (packet - 1) as usize;
        let (word, bit) = (index / 64, 1_u64 << (index % 64));
        if self.seen[word] & bit != 0 {
            return false;
        }
        let at = index * self.slot;
        let room = &mut self.bytes[at..];
        if data.len() > room.len() {
            self.damage.get_or_insert(Damage::Layout);
            return false;
        }
        room[..data.len()].copy_from_slice(data);
        self.seen[word] |= bit;
        self.count += 1;
        if data.len() < self.slot {
            // Only the last packet may be short.
            if self.short.is_some() {
                self.damage.get_or_insert(Damage::Layout);
            }
            self.short = Some((packet, data.len()));
        }
        true
    }

    /// How many packets of payload the block has, as far as that is known.
    fn packets(&self) -> u32 {
        self.trailer.map_or(self.most, |trailer| trailer - 1)
    }

    pub fn is_whole(&self) -> bool {
        self.leader.is_some() && self.trailer.is_some() && self.count >= self.packets()
    }

    fn has(&self, packet: u32) -> bool {
        match packet {
            0 => self.leader.is_some(),
            packet if self.trailer == Some(packet) => true,
            packet => {
                let index = (packet - 1) as usize;
                self.seen.get(index / 64).is_some_and(|word| word & 1 << (index % 64) != 0)
            }
        }
    }

    /// The block's end should have come: no more datagrams of it do.
    pub fn expect_end(&mut self, now_ns: i64) {
        if self.waits_for_end() {
            self.highest = self.most + 1;
            self.fresh_due_ns = Some(now_ns);
        }
    }

    /// Whether more of it may come without being asked for.
    pub fn waits_for_end(&self) -> bool {
        self.trailer.is_none() && self.highest < self.most + 1
    }

    /// When something is to be asked for, next.
    pub fn due_ns(&self) -> Option<i64> {
        [self.fresh_due_ns, self.again_due_ns].into_iter().flatten().min()
    }

    /// What is to be asked for now: first and last packets of stretches, of `most` packets in all.
    pub fn ask(&mut self, now_ns: i64, most: u32, timing: &Timing) -> Vec<[u32; 2]> {
        let all = self.again_due_ns.is_some_and(|due| due <= now_ns);
        if !all && self.fresh_due_ns.is_none_or(|due| due > now_ns) {
            return Vec::new();
        }
        let from = if all { 0 } else { self.asked_below };
        let left = most.saturating_sub(self.asked) as usize;
        let missing = (from..=self.highest).filter(|&packet| !self.has(packet)).take(left);
        let mut stretches: Vec<[u32; 2]> = Vec::new();
        for packet in missing {
            match stretches.last_mut() {
                Some([_, last]) if *last + 1 == packet => *last = packet,
                _ => stretches.push([packet, packet]),
            }
        }
        self.asked += stretches.iter().map(|[first, last]| last - first + 1).sum::<u32>();
        self.fresh_due_ns = None;
        self.asked_below = self.highest + 1;
        if all || self.again_due_ns.is_none() {
            self.again_due_ns = (!stretches.is_empty()).then(|| now_ns + timing.ask_again_ns);
        }
        stretches
    }

    /// Hands the block over, whole or not.
    pub fn close(mut self) -> Block {
        let packets = self.packets();
        let missing_payload = packets.saturating_sub(self.count);
        let missing = missing_payload + u32::from(self.leader.is_none()) + u32::from(self.trailer.is_none());
        if missing > 0 {
            self.damage.get_or_insert(Damage::Missing);
        }
        let full = packets as usize * self.slot;
        let length = match self.short {
            Some((packet, length)) if packet == packets => full - self.slot + length,
            // In the middle of a block.
            Some(_) => {
                self.damage.get_or_insert(Damage::Layout);
                full
            }
            None => full,
        };
        self.bytes.truncate(length);
        Block {
            number: self.number,
            first_ns: self.first_ns,
            leader: self.leader,
            bytes: self.bytes,
            missing,
            damage: self.damage,
            restarted: self.restarted,
        }
    }
}
