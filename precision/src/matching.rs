//! Which events of two lists are the same.

/// An event of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fired {
    /// When, microseconds.
    pub t_us: f64,
    /// Whether it is ON.
    pub on: bool,
}

/// Farther apart no two events are the same, microseconds.
const FARTHEST_US: f64 = 10_000.0;

/// What two lists have in common.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Matched {
    /// How much later than the true one each event is that has one, microseconds.
    pub late_us: Vec<f64>,
    /// True events without one.
    pub missed: usize,
    /// Events without a true one.
    pub false_ones: usize,
}

impl Matched {
    /// The events of each pixel, both in the order of time.
    #[must_use]
    pub fn of(truth: &[Vec<Fired>], computed: &[Vec<Fired>]) -> Self {
        let mut matched = Self::default();
        for (truth, computed) in truth.iter().zip(computed) {
            for on in [false, true] {
                let times = |of: &[Fired]| -> Vec<f64> {
                    of.iter().filter(|event| event.on == on).map(|event| event.t_us).collect()
                };
                matched.pair(&times(truth), &times(computed));
            }
        }
        matched
    }

    /// Pairs two lists in their order, each event at most once: as many pairs as there can be, and of those the nearest in sum. The
    /// classic table of an alignment, row by row.
    fn pair(&mut self, truth: &[f64], computed: &[f64]) {
        let columns = computed.len() + 1;
        // What the best alignment of what lies before costs; an event alone costs more than any two that are apart.
        let mut cost = vec![0.0; (truth.len() + 1) * columns];
        let together = |i: usize, j: usize| {
            let apart: f64 = (truth[i] - computed[j]).abs();
            if apart <= FARTHEST_US { apart } else { f64::INFINITY }
        };
        for i in 0..=truth.len() {
            for j in 0..=computed.len() {
                cost[i * columns + j] = match (i, j) {
                    (0, 0) => 0.0,
                    (0, _) => cost[j - 1] + FARTHEST_US,
                    (_, 0) => cost[(i - 1) * columns] + FARTHEST_US,
                    _ => {
                        let both = cost[(i - 1) * columns + j - 1] + together(i - 1, j - 1);
                        let alone = cost[(i - 1) * columns + j].min(cost[i * columns + j - 1]) + FARTHEST_US;
                        both.min(alone)
                    }
                };
            }
        }
        let (mut i, mut j) = (truth.len(), computed.len());
        while i > 0 || j > 0 {
            let here = cost[i * columns + j];
            if i > 0 && j > 0 && here == cost[(i - 1) * columns + j - 1] + together(i - 1, j - 1) {
                (i, j) = (i - 1, j - 1);
                self.late_us.push(computed[j] - truth[i]);
            } else if i > 0 && here == cost[(i - 1) * columns + j] + FARTHEST_US {
                i -= 1;
                self.missed += 1;
            } else {
                j -= 1;
                self.false_ones += 1;
            }
        }
    }

    /// How many true events there are.
    #[must_use]
    pub fn truths(&self) -> usize {
        self.late_us.len() + self.missed
    }

    /// The root of the mean square of the times' errors, microseconds.
    #[must_use]
    pub fn rms_us(&self) -> f64 {
        let squares: f64 = self.late_us.iter().map(|late| late * late).sum();
        (squares / self.late_us.len() as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fired(times: &[(f64, bool)]) -> Vec<Vec<Fired>> {
        vec![times.iter().map(|&(t_us, on)| Fired { t_us, on }).collect()]
    }

    #[test]
    fn events_are_paired_in_order_and_what_is_left_is_missed_or_false() {
        let truth = fired(&[(100.0, true), (200.0, true), (300.0, false), (90_000.0, true)]);
        let computed = fired(&[(110.0, true), (195.0, true), (300.0, true), (50_000.0, false)]);
        let matched = Matched::of(&truth, &computed);
        let mut late = matched.late_us.clone();
        late.sort_unstable_by(f64::total_cmp);
        assert_eq!((late, matched.missed, matched.false_ones), (vec![-5.0, 10.0], 2, 2));
        assert_eq!(matched.truths(), 4);
        assert!((matched.rms_us() - 62.5_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn one_event_too_many_shifts_no_other() {
        let truth = fired(&[(0.0, true), (1000.0, true), (2000.0, true)]);
        let computed = fired(&[(10.0, true), (500.0, true), (1010.0, true), (2010.0, true)]);
        let matched = Matched::of(&truth, &computed);
        assert_eq!((matched.missed, matched.false_ones), (0, 1));
        assert_eq!(matched.rms_us(), 10.0);
    }
}
