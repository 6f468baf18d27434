//! The stream of USB3 Vision, without input or output: transfers and times go in, blocks come out.
//!
//! A block is a leader, a payload and a trailer. Each of them ends the host's transfer with a short packet, except for a payload
//! that ends as its last transfer is full: then the trailer follows in the same one. Blocks come out in the order in which they came:
//! whole with their trailer; incomplete, and marked so, when another begins. Every loss is counted once: blocks of which nothing came,
//! or no leader, as [`Counts::lost`], others by what is missing in them.

mod packet;

use std::collections::VecDeque;

pub use packet::{Trailer, leader, trailer};

use super::Sizes;
use crate::genicam::block::{Block, Damage, Leader};

/// So many blocks wait to be taken; what comes beyond that is lost.
const MOST_WAITING: usize = 16;
/// So far ahead no camera is: it counts anew.
const MOST_AHEAD: u64 = 1 << 20;
/// What is missing is told in packets.
const PACKET_BYTES: usize = 1024;

/// What is known of a stream before it begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Most bytes of a block.
    pub block_bytes: usize,
    /// Most bytes of a leader.
    pub leader_bytes: usize,
}

impl From<&Sizes> for Plan {
    fn from(sizes: &Sizes) -> Self {
        Self { block_bytes: sizes.block_bytes, leader_bytes: sizes.told[0] as usize }
    }
}

/// What happened so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Blocks of which nothing came, or no leader, and those that nobody took in time.
    pub lost: u64,
    /// Those of them that nobody took in time.
    pub untaken: u64,
    /// Packets missing in blocks that were handed over.
    pub missing: u64,
    /// Blocks that had no trailer.
    pub endless: u64,
    /// Transfers that belong to no block.
    pub strange: u64,
}

/// A block that is being put together.
#[derive(Debug)]
struct Open {
    id: u64,
    number: u64,
    first_ns: i64,
    leader: Leader,
    bytes: Vec<u8>,
    excess: bool,
    restarted: bool,
}

/// Puts the blocks of a stream together.
#[derive(Debug)]
pub struct Receiver {
    plan: Plan,
    open: Option<Open>,
    /// Id and number of the newest block.
    newest: Option<(u64, u64)>,
    /// Whether no block begins any more.
    ending: bool,
    blocks: VecDeque<Block>,
    counts: Counts,
}

impl Receiver {
    /// A receiver for a stream that begins.
    #[must_use]
    pub fn new(plan: Plan) -> Self {
        Self { plan, open: None, newest: None, ending: false, blocks: VecDeque::new(), counts: Counts::default() }
    }

    /// What happened so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Takes a transfer.
    pub fn take(&mut self, bytes: &[u8], now_ns: i64) {
        let begins = if bytes.len() <= self.plan.leader_bytes { leader(bytes) } else { None };
        if let Some((id, leader)) = begins {
            self.close(None);
            self.begin(id, leader, now_ns);
            return;
        }
        let Some(open) = &mut self.open else {
            self.counts.strange += u64::from(!self.ending);
            return;
        };
        let end = |bytes: &[u8], id: u64| trailer(bytes).filter(|trailer| trailer.id == id);
        if let Some(trailer) = end(bytes, open.id) {
            return self.close(Some(trailer));
        }
        let room = self.plan.block_bytes - open.bytes.len();
        let (data, behind) = bytes.split_at(room.min(bytes.len()));
        open.bytes.extend_from_slice(data);
        if behind.is_empty() {
            return;
        }
        match end(behind, open.id) {
            Some(trailer) => self.close(Some(trailer)),
            None => open.excess = true,
        }
    }

    /// The next block, whole or not.
    pub fn next_block(&mut self) -> Option<Block> {
        self.blocks.pop_front()
    }

    /// Lets no block begin any more: one that has begun may come to its end.
    pub fn end(&mut self) {
        self.ending = true;
    }

    /// Whether a block waits to be taken.
    #[must_use]
    pub fn has_block(&self) -> bool {
        !self.blocks.is_empty()
    }

    /// Whether a block has begun, or one waits to be taken.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.open.is_some() || !self.blocks.is_empty()
    }

    /// Hands over what is there, at the end of a stream.
    pub fn finish(&mut self) {
        self.close(None);
    }

    fn begin(&mut self, id: u64, leader: Leader, now_ns: i64) {
        if self.ending {
            return;
        }
        let (number, restarted) = match self.newest {
            None => (id & u64::from(u32::MAX), false),
            Some((newest, number)) => match id.checked_sub(newest) {
                Some(ahead @ 1..MOST_AHEAD) => {
                    self.counts.lost += ahead - 1;
                    (number.saturating_add(ahead), false)
                }
                // It counts anew: nothing is known to be lost between the two.
                _ => (number.saturating_add(1), true),
            },
        };
        self.newest = Some((id, number));
        let bytes = Vec::with_capacity(self.plan.block_bytes);
        self.open = Some(Open { id, number, first_ns: now_ns, leader, bytes, excess: false, restarted });
    }

    /// Hands over the open block, whole or not.
    fn close(&mut self, trailer: Option<Trailer>) {
        let Some(open) = self.open.take() else { return };
        let mut bytes = open.bytes;
        let all = self.plan.block_bytes;
        let mut damage = open.excess.then_some(Damage::Layout);
        let valid = match trailer {
            Some(trailer) => {
                if trailer.status != 0 {
                    damage = Some(Damage::Camera(trailer.status));
                }
                usize::try_from(trailer.valid_bytes).ok().filter(|valid| *valid <= all).unwrap_or_else(|| {
                    damage.get_or_insert(Damage::Layout);
                    all
                })
            }
            None => {
                self.counts.endless += 1;
                damage.get_or_insert(Damage::Missing);
                all
            }
        };
        let missing = valid.saturating_sub(bytes.len()).div_ceil(PACKET_BYTES);
        if missing > 0 {
            damage.get_or_insert(Damage::Missing);
        }
        // What came is kept; where something is missing in it is not known. A frame has its bytes all the same.
        bytes.resize(if damage.is_some() { all } else { valid }, 0);
        let missing = u32::try_from(missing + usize::from(trailer.is_none())).unwrap_or(u32::MAX);
        self.counts.missing += u64::from(missing);
        if self.blocks.len() >= MOST_WAITING {
            self.counts.untaken += 1;
            self.counts.lost += 1;
            return;
        }
        self.blocks.push_back(Block {
            number: open.number,
            first_ns: open.first_ns,
            leader: Some(open.leader),
            bytes,
            missing,
            damage,
            restarted: open.restarted,
        });
    }
}

#[cfg(test)]
mod tests;
