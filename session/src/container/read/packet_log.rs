//! Which packets of a stream were met: one that comes again is read once, and numbers that are passed over are missing.

use std::collections::BTreeMap;

use crate::source::Packet;

/// The packets of one stream so far.
#[derive(Clone, Debug)]
pub(in crate::container) struct PacketLog {
    /// Numbers without a gap: the first of them, and the one behind the last.
    runs: BTreeMap<u64, u64>,
    last_host_ns: i64,
    next: Option<u64>,
    unmarked: u64,
    count: u64,
}

impl Default for PacketLog {
    fn default() -> Self {
        Self { runs: BTreeMap::new(), last_host_ns: i64::MIN, next: None, unmarked: 0, count: 0 }
    }
}

impl PacketLog {
    /// Takes note of a packet; `false` if it was met before. A device that begins to count anew does so later than before:
    /// what has a number that was there and a time that is over comes again.
    pub fn take(&mut self, packet: &Packet) -> bool {
        let number = packet.sequence;
        if packet.host_ns <= self.last_host_ns && self.holds(number) && !self.is_constant() {
            return false;
        }
        if let Some(next) = self.next
            && !packet.discontinuity
        {
            self.unmarked = self.unmarked.saturating_add(number.saturating_sub(next));
        }
        self.count += 1;
        self.next = Some(number.saturating_add(1));
        self.last_host_ns = self.last_host_ns.max(packet.host_ns);
        self.insert(number);
        true
    }

    /// How many packets there were, each once.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// How many numbers were passed over without a mark that data was lost: the recorder marks what it loses.
    pub fn unmarked(&self) -> u64 {
        self.unmarked
    }

    /// Whether all packets have one number, as those of a program do that does not count.
    fn is_constant(&self) -> bool {
        self.count > 1 && self.runs.len() == 1 && self.runs.iter().all(|(&first, &behind)| behind - first == 1)
    }

    fn holds(&self, number: u64) -> bool {
        self.runs.range(..=number).next_back().is_some_and(|(_, &end)| number < end)
    }

    fn insert(&mut self, number: u64) {
        let behind = number.saturating_add(1);
        let following = self.runs.remove(&behind).unwrap_or(behind);
        match self.runs.range_mut(..=number).next_back() {
            Some((_, end)) if *end >= number => *end = following.max(*end),
            _ => drop(self.runs.insert(number, following)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(sequence: u64, host_ns: i64, discontinuity: bool) -> Packet {
        Packet { sequence, host_ns, discontinuity, damaged: false, stamp: None, payload: bytes::Bytes::new() }
    }

    #[test]
    fn what_comes_again_is_told_from_what_comes_late_and_from_a_count_that_begins_anew() {
        let mut log = PacketLog::default();
        let mut take = |sequence, host_ns| log.take(&packet(sequence, host_ns, false));
        assert!([5, 6, 7].into_iter().all(|at| take(at, at as i64)));
        assert!(![5, 6, 7].into_iter().any(|at| take(at, at as i64)), "again");
        assert!(take(3, 3) && take(4, 4), "these were never there");
        assert!(!take(4, 4));
        assert!(take(0, 8) && take(1, 9) && take(3, 10), "the device counts anew");
        // A number that is damaged costs none of the others.
        assert!(take(u64::MAX, 11) && take(9, 12) && !take(9, 12));
    }

    #[test]
    fn numbers_that_are_passed_over_are_missing_unless_it_is_said() {
        let mut log = PacketLog::default();
        for (sequence, marked) in [(100, false), (101, false), (105, true), (106, false), (109, false)] {
            assert!(log.take(&packet(sequence, sequence as i64, marked)));
        }
        assert_eq!(log.unmarked(), 2);
    }
}
