//! Rates over the last second, from totals.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

/// Rates are means over this long.
const WINDOW: Duration = Duration::from_millis(1000);

/// Two totals over the last second.
#[derive(Debug, Default)]
pub(super) struct Meter {
    samples: VecDeque<(Instant, [u64; 2])>,
}

impl Meter {
    /// Takes note of the totals at `now` and gives their growth a second.
    pub fn rates(&mut self, now: Instant, totals: [u64; 2]) -> [f64; 2] {
        // One sample at the far end of the window or beyond stays.
        while self.samples.get(1).is_some_and(|&(at, _)| now.saturating_duration_since(at) >= WINDOW) {
            self.samples.pop_front();
        }
        self.samples.push_back((now, totals));
        let Some(&(since, first)) = self.samples.front() else { return [0.0; 2] };
        let seconds = now.saturating_duration_since(since).as_secs_f64();
        if seconds <= 0.0 {
            return [0.0; 2];
        }
        std::array::from_fn(|index| totals[index].saturating_sub(first[index]) as f64 / seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_those_of_the_last_second() {
        let (mut meter, begin) = (Meter::default(), Instant::now());
        let mut rates = [0.0; 2];
        for step in 0..=30_u64 {
            // 100 a second for two seconds, then nothing on the first, ten times as much on the second.
            let totals = [10 * step.min(20), 10 * step + 90 * step.saturating_sub(20)];
            rates = meter.rates(begin + Duration::from_millis(100 * step), totals);
            if step == 20 {
                assert!((rates[0] - 100.0).abs() < 1e-9);
            }
        }
        assert!((rates[0], rates[1] - 1000.0) == (0.0, 0.0), "{rates:?}");
        assert!(meter.samples.len() < 15);
    }
}
