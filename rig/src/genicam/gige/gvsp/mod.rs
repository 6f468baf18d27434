//! The stream protocol of GigE Vision (GVSP), without input or output: datagrams and times go in, blocks and requests for
//! missing packets come out.
//!
//! A block is a leader, packets of payload and a trailer. Blocks come out in the order of their numbers: whole as soon as all of
//! it is there, incomplete (and marked so) when nothing of it has come for a time. Every loss is counted once: blocks of which
//! nothing came as [`Counts::lost`], others by what is missing in them.

mod block;
mod packet;

use std::collections::VecDeque;

use block::Open;
pub use packet::{Content, Datagram, HEADER_BYTES, NETWORK_BYTES};

pub use crate::genicam::block::{Block, Damage, Image, Leader};

/// So many blocks are put together at once; the oldest is handed over when another begins.
const MOST_OPEN: usize = 8;
/// A block so far behind those before it is no late packet: the camera counts anew.
const RESTART_BEHIND: i64 = 64;
/// So far ahead no camera is: ids of 64 bits that are noise.
const MOST_AHEAD: i64 = 1 << 20;
/// Ids of 16 bits run from 1 to this.
const SHORT_IDS: i64 = 65_535;

/// When what is missing is asked for, and given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// A packet that was overtaken is asked for after so long: it may only be late.
    pub ask_after_ns: i64,
    /// And again after so long.
    pub ask_again_ns: i64,
    /// A block whose end does not come is over after so long without a packet.
    pub end_after_ns: i64,
    /// A block of which nothing came for so long is handed over as it is.
    pub give_up_ns: i64,
}

impl Default for Timing {
    fn default() -> Self {
        Self { ask_after_ns: 1_000_000, ask_again_ns: 20_000_000, end_after_ns: 10_000_000, give_up_ns: 100_000_000 }
    }
}

/// What is known of a stream before it begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Bytes of a datagram of the stream, header included.
    pub datagram_bytes: usize,
    /// Most bytes of a block.
    pub block_bytes: usize,
    /// Whether missing packets are asked for.
    pub resend: bool,
    /// When.
    pub timing: Timing,
}

/// A request for packets of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// Block id as the camera sends it.
    pub block: u64,
    /// First and last packet.
    pub packets: [u32; 2],
    /// Whether ids are of 64 bits.
    pub long_ids: bool,
}

/// What happened so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Blocks of which nothing came.
    pub lost: u64,
    /// Packets missing in blocks that were handed over.
    pub missing: u64,
    /// Packets asked for again.
    pub asked: u64,
    /// Packets that came twice.
    pub doubled: u64,
    /// Packets of blocks that had been handed over.
    pub late: u64,
    /// Datagrams that are none of this protocol.
    pub strange: u64,
}

/// Puts the blocks of a stream together.
#[derive(Debug)]
pub struct Receiver {
    plan: Plan,
    open: VecDeque<Open>,
    /// The block that was handed over last.
    done: Option<u64>,
    /// The highest number so far, and its id.
    newest: Option<(u64, u64)>,
    long_ids: bool,
    /// Whether no block begins any more.
    ending: bool,
    blocks: VecDeque<Block>,
    requests: VecDeque<Request>,
    counts: Counts,
}

impl Receiver {
    /// A receiver for a stream that begins.
    #[must_use]
    pub fn new(plan: Plan) -> Self {
        Self {
            plan,
            open: VecDeque::new(),
            done: None,
            newest: None,
            long_ids: false,
            ending: false,
            blocks: VecDeque::new(),
            requests: VecDeque::new(),
            counts: Counts::default(),
        }
    }

    /// What happened so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Takes a datagram.
    pub fn take(&mut self, bytes: &[u8], now_ns: i64) {
        let Some(datagram) = Datagram::read(bytes) else {
            self.counts.strange += 1;
            return;
        };
        if let Some(at) = self.find(&datagram, now_ns) {
            if !self.open[at].take(&datagram, now_ns, &self.plan.timing) && !datagram.is_error() {
                self.counts.doubled += 1;
            }
            // What is behind a block that has begun is over, but for packets that were overtaken.
            for open in self.open.range_mut(..at) {
                if now_ns - open.last_ns >= self.plan.timing.ask_after_ns {
                    open.expect_end(now_ns);
                }
            }
            self.settle(now_ns);
        }
    }

    /// Lets time pass: asks for what is missing, and gives up what does not come.
    pub fn advance(&mut self, now_ns: i64) {
        for open in &mut self.open {
            if now_ns - open.last_ns >= self.plan.timing.end_after_ns {
                open.expect_end(now_ns);
            }
        }
        self.settle(now_ns);
    }

    /// When [`Receiver::advance`] has something to do, if nothing comes until then.
    #[must_use]
    pub fn wake_ns(&self) -> Option<i64> {
        let timing = self.plan.timing;
        let of = |open: &Open| {
            let asked = if self.plan.resend { open.due_ns() } else { None };
            let end = open.waits_for_end().then_some(open.last_ns + timing.end_after_ns);
            [asked, end, Some(open.last_ns + timing.give_up_ns)]
        };
        // One that is whole waits for those before it, of which nothing has come.
        let front = self.open.front().filter(|open| open.is_whole()).map(|open| open.first_ns + timing.ask_after_ns);
        self.open.iter().flat_map(of).flatten().chain(front).min()
    }

    /// The next block, whole or not.
    pub fn next_block(&mut self) -> Option<Block> {
        self.blocks.pop_front()
    }

    /// The next request to send to the camera.
    pub fn next_request(&mut self) -> Option<Request> {
        self.requests.pop_front()
    }

    /// Lets no block begin any more: those that have begun may come to their end.
    pub fn end(&mut self) {
        self.ending = true;
    }

    /// Whether a block has begun and is not handed over.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        !self.open.is_empty()
    }

    /// Hands over what is there, at the end of a stream.
    pub fn finish(&mut self) {
        while let Some(open) = self.open.pop_front() {
            self.hand_over(open);
        }
    }

    /// The open block that a datagram belongs to, which may begin with it.
    fn find(&mut self, datagram: &Datagram<'_>, now_ns: i64) -> Option<usize> {
        self.long_ids = datagram.long_ids;
        // Not a block: test packets, and what is no id.
        if datagram.block == 0 {
            self.counts.strange += 1;
            return None;
        }
        let Some((newest, newest_id)) = self.newest else {
            if self.ending {
                return None;
            }
            self.newest = Some((1 << 32, datagram.block));
            return Some(self.begin(0, 1 << 32, datagram.block, now_ns));
        };
        let ahead = ahead(newest_id, datagram.block, datagram.long_ids);
        if ahead.unsigned_abs() > MOST_AHEAD.unsigned_abs() && ahead > 0 {
            self.counts.strange += 1;
            return None;
        }
        if self.ending && !(-RESTART_BEHIND..=0).contains(&ahead) {
            return None;
        }
        if ahead < -RESTART_BEHIND {
            return self.restart(datagram, newest, now_ns);
        }
        let number = newest.saturating_add_signed(ahead);
        if ahead > 0 {
            self.newest = Some((number, datagram.block));
        }
        if self.done.is_some_and(|done| number <= done) {
            self.counts.late += 1;
            return None;
        }
        match self.open.binary_search_by_key(&number, |open| open.number) {
            Ok(at) => Some(at),
            Err(at) => Some(self.begin(at, number, datagram.block, now_ns)),
        }
    }

    /// A camera that counts anew: what is open ends, and numbers go on without a gap.
    fn restart(&mut self, datagram: &Datagram<'_>, newest: u64, now_ns: i64) -> Option<usize> {
        if !matches!(datagram.content, Content::Leader(_)) {
            self.counts.late += 1;
            return None;
        }
        self.finish();
        let number = newest + 1;
        // Nothing is known to be lost between the two.
        self.done = Some(newest);
        self.newest = Some((number, datagram.block));
        let at = self.begin(0, number, datagram.block, now_ns);
        self.open[at].restarted = true;
        Some(at)
    }

    fn begin(&mut self, at: usize, number: u64, id: u64, now_ns: i64) -> usize {
        let header = HEADER_BYTES[usize::from(self.long_ids)];
        let slot = self.plan.datagram_bytes.saturating_sub(header).max(1);
        self.open.insert(at, Open::new(number, id, now_ns, self.plan.block_bytes, slot));
        at
    }

    /// Hands over and asks for what is due.
    fn settle(&mut self, now_ns: i64) {
        while let Some(open) = self.open.front() {
            let timing = self.plan.timing;
            let next = self.done.is_none_or(|done| open.number == done + 1);
            // Of the blocks before it nothing has come; they may have been overtaken.
            let settled = next || now_ns - open.first_ns >= timing.ask_after_ns;
            let over = (open.is_whole() && settled)
                || now_ns - open.last_ns >= timing.give_up_ns
                || self.open.len() > MOST_OPEN;
            if !over {
                break;
            }
            if let Some(open) = self.open.pop_front() {
                self.hand_over(open);
            }
        }
        if !self.plan.resend {
            return;
        }
        for open in &mut self.open {
            let before = open.asked;
            // More than a quarter would cost the link what the next block needs.
            let slot = self.plan.datagram_bytes.saturating_sub(HEADER_BYTES[usize::from(self.long_ids)]).max(1);
            let most = (self.plan.block_bytes / slot / 4).max(8) as u32;
            for packets in open.ask(now_ns, most, &self.plan.timing) {
                self.requests.push_back(Request { block: open.id, packets, long_ids: self.long_ids });
            }
            self.counts.asked += u64::from(open.asked - before);
        }
    }

    fn hand_over(&mut self, open: Open) {
        let number = open.number;
        if let Some(done) = self.done {
            self.counts.lost += number - done - 1;
        }
        self.done = Some(number);
        let block = open.close();
        self.counts.missing += u64::from(block.missing);
        self.blocks.push_back(block);
    }
}

/// How far an id is ahead of another.
fn ahead(of: u64, id: u64, long_ids: bool) -> i64 {
    if long_ids {
        return id.wrapping_sub(of).cast_signed();
    }
    let distance = (id.cast_signed() - of.cast_signed()).rem_euclid(SHORT_IDS);
    if distance > SHORT_IDS / 2 { distance - SHORT_IDS } else { distance }
}

#[cfg(test)]
mod tests;
