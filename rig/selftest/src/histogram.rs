//! Histograms of the intervals between what comes from a device.

use serde::{Deserialize, Serialize};

/// Where bins begin within a decade.
const STEPS: [f64; 3] = [1.0, 2.0, 5.0];
/// The last bin begins at a thousand seconds.
const DECADES: i32 = 9;

/// Intervals, counted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Intervals {
    /// How many there are.
    pub count: u64,
    /// The shortest, microseconds.
    pub shortest_us: f64,
    /// Half of them are shorter, microseconds.
    pub median_us: f64,
    /// 95 of 100 are shorter, microseconds.
    pub p95_us: f64,
    /// The longest, microseconds.
    pub longest_us: f64,
    /// The bins that have any, the shortest first.
    pub bins: Vec<Bin>,
}

/// Intervals of about the same length.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bin {
    /// From this length on, microseconds.
    pub from_us: f64,
    /// Shorter than this, microseconds; absent for the last bin of all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to_us: Option<f64>,
    /// How many.
    pub count: u64,
}

/// Where the bins begin: 0, then 1, 2 and 5 of each decade from a microsecond on.
fn edges() -> impl Iterator<Item = f64> {
    let decade = |power: i32| STEPS.map(|step| step * 10_f64.powi(power));
    std::iter::once(0.0).chain((0..DECADES).flat_map(decade))
}

impl Intervals {
    /// Of times in their order, nanoseconds; nothing of fewer than two. A time before the one before it counts as an interval of 0.
    #[must_use]
    pub fn of(times_ns: &[i64]) -> Self {
        let passed = |pair: &[i64]| pair[1].saturating_sub(pair[0]).max(0) as f64 / 1e3;
        let mut lengths_us: Vec<f64> = times_ns.windows(2).map(passed).collect();
        lengths_us.sort_unstable_by(f64::total_cmp);
        let (Some(&shortest_us), Some(&longest_us)) = (lengths_us.first(), lengths_us.last()) else {
            return Self::default();
        };
        let quantile = |share: f64| {
            let rank = (share * lengths_us.len() as f64).ceil() as usize;
            lengths_us[rank.clamp(1, lengths_us.len()) - 1]
        };
        let begins: Vec<f64> = edges().collect();
        let bins = begins.iter().enumerate().filter_map(|(index, &from_us)| {
            let to_us = begins.get(index + 1).copied();
            let before = |end: f64| lengths_us.partition_point(|&length| length < end);
            let count = to_us.map_or(lengths_us.len(), before) - before(from_us);
            (count > 0).then_some(Bin { from_us, to_us, count: count as u64 })
        });
        Self {
            count: lengths_us.len() as u64,
            shortest_us,
            median_us: quantile(0.5),
            p95_us: quantile(0.95),
            longest_us,
            bins: bins.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_interval_is_in_one_bin() {
        let intervals = Intervals::of(&[0, 1_000, 3_000, 8_000, 33_000_000, 66_000_000, 99_000_000, 99_000_000]);
        assert_eq!((intervals.count, intervals.shortest_us, intervals.median_us), (7, 0.0, 5.0));
        assert_eq!((intervals.longest_us, intervals.p95_us), (33_000.0, 33_000.0));
        let found: Vec<(f64, u64)> = intervals.bins.iter().map(|bin| (bin.from_us, bin.count)).collect();
        assert_eq!(found, [(0.0, 1), (1.0, 1), (2.0, 1), (5.0, 1), (20_000.0, 3)]);
        assert_eq!(intervals.bins.iter().map(|bin| bin.count).sum::<u64>(), intervals.count);
    }

    #[test]
    fn what_is_absurd_has_a_place_too() {
        assert_eq!((Intervals::of(&[]), Intervals::of(&[7])), (Intervals::default(), Intervals::default()));
        let far = Intervals::of(&[i64::MIN, i64::MAX, 0]);
        assert_eq!(
            far.bins.iter().map(|bin| (bin.to_us.is_none(), bin.count)).collect::<Vec<_>>(),
            [(false, 1), (true, 1)]
        );
    }
}
