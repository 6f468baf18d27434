//! The events of a camera, kept as events. How many there were between two edges of bins is counted when it is asked for, so that a long
//! recording takes the memory of its events, and not that of an image for every edge.

use std::ops::Range;

/// ON and OFF events of a pixel.
type Pair = [u32; 2];

/// Events in bins, and the counts of all pixels at some edges, from which no other edge is far.
#[derive(Debug)]
pub(super) struct Counts {
    pixels: usize,
    /// Of each event twice its pixel, and one more if it is ON; bin by bin.
    events: Vec<u32>,
    /// Where in these each bin begins, and where the last ends: as many as there are edges.
    begins: Vec<usize>,
    /// Counts since the first edge, at some edges, ascending.
    known: Vec<(usize, Vec<Pair>)>,
    /// What they are at the last edge so far.
    now: Vec<Pair>,
}

/// Known counts, and the events between them and an edge.
struct Nearest<'a> {
    /// Nothing where all are 0, at the first edge.
    counts: Option<&'a [Pair]>,
    way: Range<usize>,
    /// Whether they are those of the edge or of an earlier one.
    before: bool,
}

impl Counts {
    /// None yet, at the first edge.
    pub fn new(pixels: usize) -> Self {
        Self { pixels, events: Vec::new(), begins: vec![0], known: Vec::new(), now: vec![[0; 2]; pixels] }
    }

    /// An event of the bin that the next edge ends.
    pub fn push(&mut self, pixel: usize, on: bool) {
        // Images of 2^31 pixels cannot be rendered.
        self.events.push((2 * pixel + usize::from(on)) as u32);
        self.now[pixel][usize::from(!on)] += 1;
    }

    /// The end of a bin. An image of counts is kept where it takes no more memory than the events since the last one.
    pub fn edge(&mut self) {
        self.begins.push(self.events.len());
        let last = self.known.last().map_or(0, |(edge, _)| self.begins[*edge]);
        if self.events.len() - last >= 2 * self.pixels {
            self.known.push((self.begins.len() - 1, self.now.clone()));
        }
    }

    /// No edge follows.
    pub fn finish(mut self) -> Self {
        self.now = Vec::new();
        self.events.shrink_to_fit();
        self
    }

    /// The counts of all pixels between two edges.
    pub fn between(&self, from: usize, to: usize) -> Vec<Pair> {
        let to = to.max(from);
        let direct = self.begins[from]..self.begins[to];
        let [start, end] = [from, to].map(|edge| self.nearest(edge));
        if direct.len() <= start.way.len() + end.way.len() + self.pixels {
            let mut sums = vec![[0; 2]; self.pixels];
            self.add(&mut sums, direct, true);
            return sums;
        }
        let mut sums = end.counts.map_or_else(|| vec![[0; 2]; self.pixels], <[Pair]>::to_vec);
        for (sum, before) in sums.iter_mut().zip(start.counts.unwrap_or_default()) {
            *sum = [0, 1].map(|kind| sum[kind].wrapping_sub(before[kind]));
        }
        self.add(&mut sums, start.way, !start.before);
        self.add(&mut sums, end.way, end.before);
        sums
    }

    /// The known counts with the fewest events between them and an edge.
    fn nearest(&self, edge: usize) -> Nearest<'_> {
        let begins = self.begins[edge];
        let after = self.known.partition_point(|(known, _)| *known <= edge);
        let earlier = after.checked_sub(1).map(|index| &self.known[index]);
        let earlier_begins = earlier.map_or(0, |(known, _)| self.begins[*known]);
        match self.known.get(after).map(|(known, counts)| (self.begins[*known], counts)) {
            Some((later_begins, counts)) if later_begins - begins < begins - earlier_begins => {
                Nearest { counts: Some(counts), way: begins..later_begins, before: false }
            }
            _ => Nearest { counts: earlier.map(|(_, counts)| &counts[..]), way: earlier_begins..begins, before: true },
        }
    }

    /// Adds events to sums, or takes them away. In between sums may be below zero, which wraps and comes back.
    fn add(&self, sums: &mut [Pair], events: Range<usize>, more: bool) {
        let step = if more { 1 } else { u32::MAX };
        for &event in &self.events[events] {
            let sum = &mut sums[event as usize / 2][usize::from(event & 1 == 0)];
            *sum = sum.wrapping_add(step);
        }
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random::{below, key};

    use super::*;

    #[test]
    fn counts_between_any_two_edges_are_those_of_the_events_between_them() {
        const PIXELS: usize = 7;
        for edges in [1_usize, 2, 40] {
            let mut counts = Counts::new(PIXELS);
            let mut bins: Vec<Vec<(usize, bool)>> = Vec::new();
            for bin in 1..edges {
                let draw = |what: usize, limit: usize| below(key(bin as u64, &[what as u64]), limit as u64) as usize;
                // Bins with nothing, with little and with more than there are pixels.
                let size = [0, 3, 9, 40][draw(1000, 4)];
                bins.push((0..size).map(|at| (draw(2 * at, PIXELS), draw(2 * at + 1, 2) == 1)).collect());
                bins.last().into_iter().flatten().for_each(|&(pixel, on)| counts.push(pixel, on));
                counts.edge();
            }
            let counts = counts.finish();
            let kept = counts.known.len() * 2 * PIXELS;
            assert!(kept <= counts.events.len(), "images take no more room than events");
            assert!(edges < 40 || counts.known.len() > 3, "some are kept");
            for from in 0..edges {
                for to in from..edges {
                    let mut want = vec![[0; 2]; PIXELS];
                    bins[from..to].iter().flatten().for_each(|&(pixel, on)| want[pixel][usize::from(!on)] += 1);
                    assert_eq!(counts.between(from, to), want, "{from} to {to}");
                }
            }
        }
    }
}
