//! Holes in a stream of events: what is lost with a whole transfer leaves no mark in most formats.
//!
//! Where events are so dense that the next one is never far, a long time without any is no quiet scene. It lies between two
//! packets, or behind the first words of one, which are dated by a time word that was lost. A scene that comes to rest is no
//! hole either: events have to be dense on both sides.

/// So many packets with events tell how dense they are.
const FEWEST: usize = 20;
/// Events are dense where the longest time between two is so many times shorter than a packet.
const DENSE: u64 = 8;
/// So many packets on either side of a hole are dense.
const AROUND: usize = 2;

/// A packet, microseconds of the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Packet {
    /// From its first to its last event.
    span_us: u64,
    /// From the last event before it; 0 where time breaks there.
    before_us: u64,
    /// The longest time between two of its events.
    longest_us: u64,
}

/// The times without an event, packet by packet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Holes {
    packets: Vec<Packet>,
    last_us: Option<u64>,
}

impl Holes {
    /// Takes a packet: its first and its last event, `None` where it has none or time breaks; and the longest time between two.
    pub(crate) fn take(&mut self, span_us: Option<[u64; 2]>, longest_us: u64) {
        if let Some([first, last]) = span_us {
            let before_us = self.last_us.map_or(0, |before| first.saturating_sub(before));
            self.packets.push(Packet { span_us: last.saturating_sub(first), before_us, longest_us });
        }
        self.last_us = span_us.map(|[_, last]| last);
    }

    /// How many there are, and the longest, microseconds; `None` where events are too sparse to tell.
    #[must_use]
    pub fn count(&self) -> Option<(u64, u64)> {
        if self.packets.len() < FEWEST {
            return None;
        }
        let mut spans: Vec<u64> = self.packets.iter().map(|packet| packet.span_us).collect();
        let middle = spans.len() / 2;
        let usual = *spans.select_nth_unstable(middle).1;
        let is_dense = |packet: &Packet| packet.longest_us.saturating_mul(DENSE) <= usual;
        if 2 * self.packets.iter().filter(|packet| is_dense(packet)).count() < self.packets.len() {
            return None;
        }
        let holes = self.packets.iter().enumerate().filter_map(|(at, packet)| {
            let hole = packet.before_us.max(packet.longest_us);
            let around =
                self.packets[at.saturating_sub(AROUND)..at].iter().chain(self.packets.iter().skip(at + 1).take(AROUND));
            (hole > usual / 2 && around.into_iter().all(is_dense)).then_some(hole)
        });
        Some((holes.clone().count() as u64, holes.max().unwrap_or(0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packets of 4 ms of events that are `apart_us` apart, without some packets.
    fn holes(apart_us: impl Fn(u64) -> u64, gone: &[u64]) -> Holes {
        let mut holes = Holes::default();
        for packet in (0..50).filter(|packet| !gone.contains(packet)) {
            let (first, apart_us) = (packet * 4000 + apart_us(packet) / 2, apart_us(packet));
            holes.take(Some([first, first + 4000 - apart_us]), apart_us);
        }
        holes
    }

    #[test]
    fn a_packet_that_is_gone_leaves_a_hole() {
        assert_eq!(holes(|_| 20, &[]).count(), Some((0, 0)));
        assert_eq!(holes(|_| 20, &[7, 20, 21]).count(), Some((2, 8020)));
        // The first words behind it are dated by the time before it.
        let mut misdated = holes(|_| 20, &[]);
        misdated.packets[30].longest_us = 4100;
        assert_eq!(misdated.count(), Some((1, 4100)));
    }

    #[test]
    fn of_sparse_events_nothing_is_claimed() {
        assert_eq!(holes(|_| 1000, &[7]).count(), None);
        assert_eq!(Holes::default().count(), None);
    }

    #[test]
    fn a_scene_that_comes_to_rest_is_no_hole() {
        assert_eq!(holes(|packet| if packet < 35 { 20 } else { 2500 }, &[]).count(), Some((0, 0)));
    }

    #[test]
    fn where_time_breaks_there_is_no_hole() {
        let mut found = holes(|_| 20, &[]);
        found.take(None, 0);
        found.take(Some([900_000, 904_000]), 20);
        assert_eq!(found.count(), Some((0, 0)));
    }
}
