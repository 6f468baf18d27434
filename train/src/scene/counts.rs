//! The events of a camera, kept as events. How many there were between two edges of bins is counted when it is asked for, so that a long
//! recording takes the memory of its events, and not that of an image for every edge.

use std::{io, ops::Range, path::Path};

use super::words::Words;

/// ON and OFF events of a pixel.
type Pair = [u32; 2];

/// Events in bins, and the counts of all pixels at some edges, from which no other edge is far.
#[derive(Debug)]
pub(super) struct Counts {
    pixels: usize,
    /// Of each event twice its pixel, and one more if it is ON; bin by bin.
    events: Words,
    /// Where in these each bin begins, and where the last ends: as many as there are edges.
    begins: Vec<usize>,
    /// Some edges, ascending.
    known: Vec<usize>,
    /// Counts from the first edge to each of these, of all pixels.
    images: Words,
    /// What they are at the last edge so far.
    now: Vec<Pair>,
}

/// What the counts between two edges are added up from: known counts of all pixels, and events. Both are added or taken away modulo 2^32, in
/// any order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Way {
    /// Which image of counts is added, and which is taken away.
    pub images: [Option<usize>; 2],
    /// Which events are counted, and whether they are added or taken away.
    pub events: [(Range<usize>, bool); 2],
}

/// Known counts, and the events between them and an edge.
struct Nearest {
    /// Which of the images; nothing where all are 0, at the first edge.
    image: Option<usize>,
    way: Range<usize>,
    /// Whether they are those of the edge or of an earlier one.
    before: bool,
}

impl Counts {
    /// None yet, at the first edge. They lie in files in `folder`, or in memory.
    pub fn new(pixels: usize, folder: Option<&Path>) -> io::Result<Self> {
        let [events, images] = [Words::new(folder)?, Words::new(folder)?];
        Ok(Self { pixels, events, begins: vec![0], known: Vec::new(), images, now: vec![[0; 2]; pixels] })
    }

    /// An event of the bin that the next edge ends.
    pub fn push(&mut self, pixel: usize, on: bool) -> io::Result<()> {
        self.now[pixel][usize::from(!on)] += 1;
        // Images of 2^31 pixels cannot be rendered.
        self.events.push((2 * pixel + usize::from(on)) as u32)
    }

    /// The counts of all pixels since the first edge, before it is finished.
    pub fn now(&self) -> &[Pair] {
        &self.now
    }

    /// The end of a bin. An image of counts is kept where it takes no more room than the events since the last one.
    pub fn edge(&mut self) -> io::Result<()> {
        self.begins.push(self.events.len());
        let last = self.known.last().map_or(0, |&edge| self.begins[edge]);
        if self.events.len() - last >= 2 * self.pixels {
            self.known.push(self.begins.len() - 1);
            for count in self.now.as_flattened() {
                self.images.push(*count)?;
            }
        }
        Ok(())
    }

    /// No edge follows.
    pub fn finish(mut self) -> io::Result<Self> {
        self.now = Vec::new();
        self.events.finish()?;
        self.images.finish()?;
        Ok(self)
    }

    /// The counts of all pixels between two edges.
    pub fn between(&self, from: usize, to: usize) -> io::Result<Vec<Pair>> {
        let Way { images: [more, less], events } = self.way(from, to);
        let mut sums = vec![[0; 2]; self.pixels];
        self.add_image(&mut sums, more, true)?;
        self.add_image(&mut sums, less, false)?;
        for (events, more) in events {
            self.add(&mut sums, events, more)?;
        }
        Ok(sums)
    }

    /// What the counts between two edges are added up from, with the fewest events.
    pub fn way(&self, from: usize, to: usize) -> Way {
        let to = to.max(from);
        let direct = self.begins[from]..self.begins[to];
        let [start, end] = [from, to].map(|edge| self.nearest(edge));
        if direct.len() <= start.way.len() + end.way.len() + self.pixels {
            return Way { images: [None; 2], events: [(direct, true), (0..0, true)] };
        }
        Way { images: [end.image, start.image], events: [(start.way, !start.before), (end.way, end.before)] }
    }

    /// How many pixels there are.
    pub fn pixels(&self) -> usize {
        self.pixels
    }

    /// The events and the images of counts, as they lie in memory or in files.
    pub fn words(&self) -> [&Words; 2] {
        [&self.events, &self.images]
    }

    /// The known counts with the fewest events between them and an edge.
    fn nearest(&self, edge: usize) -> Nearest {
        let begins = self.begins[edge];
        let after = self.known.partition_point(|known| *known <= edge);
        let earlier = after.checked_sub(1);
        let earlier_begins = earlier.map_or(0, |image| self.begins[self.known[image]]);
        match self.known.get(after).map(|&known| self.begins[known]) {
            Some(later_begins) if later_begins - begins < begins - earlier_begins => {
                Nearest { image: Some(after), way: begins..later_begins, before: false }
            }
            _ => Nearest { image: earlier, way: earlier_begins..begins, before: true },
        }
    }

    /// Adds events to sums, or takes them away. In between sums may be below zero, which wraps and comes back.
    fn add(&self, sums: &mut [Pair], events: Range<usize>, more: bool) -> io::Result<()> {
        let step = if more { 1 } else { u32::MAX };
        self.events.read(events.start, events.len(), |_, events| {
            for &event in events {
                let sum = &mut sums[event as usize / 2][usize::from(event & 1 == 0)];
                *sum = sum.wrapping_add(step);
            }
        })
    }

    /// Adds an image of counts to sums, or takes it away.
    fn add_image(&self, sums: &mut [Pair], image: Option<usize>, more: bool) -> io::Result<()> {
        let Some(image) = image else { return Ok(()) };
        let words = 2 * self.pixels;
        self.images.read(image * words, words, |before, counts| {
            for (sum, &count) in sums.as_flattened_mut()[before..].iter_mut().zip(counts) {
                *sum = if more { sum.wrapping_add(count) } else { sum.wrapping_sub(count) };
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random::{below, key};

    use super::*;

    #[test]
    fn counts_between_any_two_edges_are_those_of_the_events_between_them() {
        const PIXELS: usize = 7;
        let folder = tempfile::tempdir().expect("a folder");
        let places = [None, Some(folder.path())];
        for (edges, place) in [1_usize, 2, 40].into_iter().flat_map(|edges| places.map(|place| (edges, place))) {
            let mut counts = Counts::new(PIXELS, place).expect("a file");
            let mut bins: Vec<Vec<(usize, bool)>> = Vec::new();
            for bin in 1..edges {
                let draw = |what: usize, limit: usize| below(key(bin as u64, &[what as u64]), limit as u64) as usize;
                // Bins with nothing, with little and with more than there are pixels.
                let size = [0, 3, 9, 40][draw(1000, 4)];
                bins.push((0..size).map(|at| (draw(2 * at, PIXELS), draw(2 * at + 1, 2) == 1)).collect());
                bins.last().into_iter().flatten().for_each(|&(pixel, on)| counts.push(pixel, on).expect("written"));
                counts.edge().expect("written");
            }
            let counts = counts.finish().expect("written");
            let kept = counts.known.len() * 2 * PIXELS;
            assert!(kept <= counts.events.len(), "images take no more room than events");
            assert!(edges < 40 || counts.known.len() > 3, "some are kept");
            for from in 0..edges {
                for to in from..edges {
                    let mut want = vec![[0; 2]; PIXELS];
                    bins[from..to].iter().flatten().for_each(|&(pixel, on)| want[pixel][usize::from(!on)] += 1);
                    assert_eq!(counts.between(from, to).expect("read"), want, "{from} to {to}");
                }
            }
        }
    }
}
