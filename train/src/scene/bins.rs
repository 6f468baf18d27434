//! The bins of time that events are counted in, which all event cameras share.

use super::Flicker;

/// Edges of the bins, microseconds, ascending. Bin `k` holds the events with `edges[k] < t <= edges[k + 1]`: an event
/// that a simulator stamps with a frame's time belongs to the change up to that frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bins {
    /// The edges, µs.
    pub edges_us: Vec<i64>,
    /// The edges, in [0, 1].
    pub edges: Vec<f64>,
    /// Bins from a camera's frame to its next one.
    pub per_interval: usize,
    /// Indices into `edges` that are RGB frame times.
    pub anchors: Vec<usize>,
}

/// A time without a frame of any camera is split into no more bins than so many of a camera's intervals have.
const LONGEST_SPLIT: i64 = 4;

/// Edges in nanoseconds, and which of them are times of frames.
struct Edges {
    edges_ns: Vec<i64>,
    anchors: Vec<usize>,
}

impl Edges {
    /// Frames' times, as many `parts` between neighbours as is said of their distance, and on from the last in steps of `width` up
    /// to `end_ns`.
    fn new(frame_times_ns: &[i64], parts: impl Fn(i64) -> i64, width: i64, end_ns: i64) -> Self {
        let (mut edges_ns, mut anchors) = (Vec::new(), Vec::new());
        for pair in frame_times_ns.windows(2) {
            anchors.push(edges_ns.len());
            let (gap, parts) = (pair[1] - pair[0], parts(pair[1] - pair[0]));
            edges_ns.extend((0..parts).map(|k| pair[0] + (i128::from(gap) * i128::from(k) / i128::from(parts)) as i64));
        }
        if let Some(&last) = frame_times_ns.last() {
            anchors.push(edges_ns.len());
            edges_ns.push(last);
            let width = width.max(1_000);
            // A remainder of less than half a bin is left out rather than made a bin of its own.
            let mut edge = last + width;
            while edge <= end_ns + width / 2 && edges_ns.len() < 1_000_000 {
                edges_ns.push(edge.min(end_ns));
                edge += width;
            }
        }
        Self { edges_ns, anchors }
    }
}

impl Bins {
    /// Splits every interval between consecutive `frame_times_ns` into `per_interval` bins, and goes on with bins of the
    /// last width up to `end_ns`.
    #[must_use]
    pub fn new(frame_times_ns: &[i64], per_interval: usize, span_ns: [i64; 2], end_ns: i64) -> Self {
        let last = match frame_times_ns {
            [.., before, last] => last - before,
            [last] => end_ns - last,
            [] => 0,
        };
        let width = last / per_interval.max(1) as i64;
        let edges = Edges::new(frame_times_ns, |_| per_interval as i64, width, end_ns);
        Self::at(edges, per_interval, span_ns)
    }

    /// Of cameras that run freely, each at instants of its own: `instants` of them lie between a camera's frame and its next
    /// one, evenly or not. Intervals between neighbours are split into bins of about the width that `per_interval` bins would have
    /// between the frames of one camera; shorter ones are a bin.
    #[must_use]
    pub fn shared(
        frame_times_ns: &[i64],
        per_interval: usize,
        instants: usize,
        span_ns: [i64; 2],
        end_ns: i64,
    ) -> Self {
        let (Some(first), Some(last), true) = (frame_times_ns.first(), frame_times_ns.last(), instants > 1) else {
            return Self::new(frame_times_ns, per_interval, span_ns, end_ns);
        };
        // So many times does a camera's interval go into the whole.
        let intervals = (frame_times_ns.len() - 1) as f64 / instants as f64;
        let width = (last - first) as f64 / (intervals * per_interval.max(1) as f64).max(1e-9);
        // Where all cameras pause for long, a bin is longer.
        let most = LONGEST_SPLIT * per_interval.max(1) as i64;
        let parts = |gap: i64| ((gap as f64 / width).round() as i64).clamp(1, most);
        let edges = Edges::new(frame_times_ns, parts, width as i64, end_ns);
        let between = edges.anchors.last().copied().unwrap_or(0);
        let per_interval = (between as f64 / intervals.max(1e-9)).round() as usize;
        Self::at(edges, per_interval.max(1), span_ns)
    }

    fn at(edges: Edges, per_interval: usize, span_ns: [i64; 2]) -> Self {
        let Edges { edges_ns, anchors } = edges;
        let length = (span_ns[1] - span_ns[0]).max(1) as f64;
        let edges = edges_ns.iter().map(|&t| ((t - span_ns[0]) as f64 / length).clamp(0.0, 1.0)).collect();
        // As simulators round: an event at a frame's time is stamped with the nearest microsecond.
        let edges_us = edges_ns.iter().map(|t| (t + 500).div_euclid(1000)).collect();
        Self { edges_us, edges, per_interval, anchors }
    }

    /// Bins of about the same width over the same time, from peak to peak of the light, none of which need begin with a frame; `None`
    /// where there are not two peaks.
    #[must_use]
    pub(super) fn at_peaks(&self, flicker: &Flicker, span_ns: [i64; 2]) -> Option<Self> {
        let (&first, &last) = (self.edges_us.first()?, self.edges_us.last()?);
        let width = (last - first) as f64 / self.len().max(1) as f64;
        let edges_ns: Vec<i64> = flicker.peaks([first, last], width).into_iter().map(|t| 1000 * t).collect();
        let bins = edges_ns.len().checked_sub(1).filter(|&bins| bins > 0)?;
        let longer = (edges_ns[bins] - edges_ns[0]) as f64 * 1e-3 / (bins as f64 * width);
        let per_interval = (self.per_interval as f64 / longer).round().max(1.0) as usize;
        Some(Self::at(Edges { edges_ns, anchors: Vec::new() }, per_interval, span_ns))
    }

    /// The first and the last edge within `covers_ns`, give or take a microsecond, in which times are told.
    #[must_use]
    pub fn within(&self, covers_ns: [i64; 2]) -> [usize; 2] {
        let [from, to] = [covers_ns[0].div_euclid(1000), covers_ns[1].div_euclid(1000)];
        let first = self.edges_us.partition_point(|&edge| edge < from);
        let after = self.edges_us.partition_point(|&edge| edge <= to + 1);
        [first, after.saturating_sub(1)]
    }

    /// How many bins there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.edges.len().saturating_sub(1)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_split_frame_intervals_and_go_on_to_the_end() {
        let bins = Bins::new(&[0, 20_000_000, 40_000_000], 2, [0, 50_000_000], 50_000_000);
        assert_eq!(bins.edges_us, [0, 10_000, 20_000, 30_000, 40_000, 50_000]);
        assert_eq!(bins.anchors, [0, 2, 4]);
        assert!((bins.edges[1] - 0.2).abs() < 1e-12);
    }

    #[test]
    fn edges_round_as_the_times_of_events_do() {
        // Every fourth frame of thirty a second: the source's frames lie at 33,333.3 and 66,666.7 us.
        let bins = Bins::new(&[0, 133_333_333, 266_666_667], 4, [0, 300_000_000], 266_666_667);
        assert_eq!(bins.edges_us[..5], [0, 33_333, 66_667, 100_000, 133_333]);
    }

    #[test]
    fn cameras_that_run_freely_share_the_bins_of_one_frame() {
        // Four cameras at 25 frames a second, a quarter of a period apart.
        let times: Vec<i64> = (0..40).map(|n| n * 10_000_000).collect();
        let bins = Bins::shared(&times, 8, 4, [0, 390_000_000], 390_000_000);
        assert_eq!((bins.len(), bins.per_interval), (78, 8));
        assert_eq!(Bins::shared(&times, 8, 1, [0, 390_000_000], 390_000_000).len(), 8 * 39);
        assert_eq!(Bins::shared(&times, 2, 30, [0, 390_000_000], 390_000_000).per_interval, 30);
    }

    #[test]
    fn cameras_that_are_nearly_together_leave_the_time_between_them_its_bins() {
        // Four cameras at 25 frames a second, a tenth of a millisecond apart; the recording goes on for an interval.
        let times: Vec<i64> = (0..40).map(|n| n / 4 * 40_000_000 + n % 4 * 100_000).collect();
        let bins = Bins::shared(&times, 8, 4, [0, 400_000_000], 400_000_000);
        let widest = bins.edges_us.windows(2).map(|pair| pair[1] - pair[0]).max();
        assert!(widest <= Some(6_000), "{widest:?} us, of 5,000");
        // Eight, and one for each of the three distances between neighbours.
        assert!((10..=11).contains(&bins.per_interval), "{}", bins.per_interval);
        assert!(bins.len() < 10 * 13, "{}: the end, too, has bins of the usual width", bins.len());
        assert_eq!(bins.anchors.len(), 40);
    }
}
