//! The processor time of a piece of work, without what is set up before and judged after it.

use std::time::Instant;

use erfgs_base::cpu;

use crate::Refusal;

/// What one run of a piece of work took.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lap {
    cpu: f64,
    wall: f64,
}

/// Times pieces of work: each as often as its share of time allows, the median counts.
#[derive(Clone, Debug)]
pub struct Stopwatch {
    /// Work is repeated until it took so many seconds in all.
    enough: f64,
    laps: Vec<Lap>,
}

/// Most repetitions.
const MOST: usize = 1000;

impl Stopwatch {
    /// A stopwatch that repeats work for `enough` seconds of processor time; 0: nothing is repeated.
    #[must_use]
    pub const fn new(enough: f64) -> Self {
        Self { enough, laps: Vec::new() }
    }

    /// Does the work, more than once if it is short, and gives what came of it last. The first run of several warms up and does
    /// not count. Where a case times several pieces, the last one counts.
    ///
    /// # Errors
    /// Of the work.
    pub fn time<T>(
        &mut self,
        mut work: impl FnMut() -> std::result::Result<T, Refusal>,
    ) -> std::result::Result<T, Refusal> {
        self.laps.clear();
        loop {
            let (wall, cpu) = (Instant::now(), cpu::process_seconds());
            let came = work()?;
            let wall = wall.elapsed().as_secs_f64();
            // Where the system does not tell processor time, the clock on the wall is what there is.
            let cpu = cpu.zip(cpu::process_seconds()).map_or(wall, |(before, after)| after - before);
            self.laps.push(Lap { cpu, wall });
            let spent: f64 = self.laps.iter().map(|lap| lap.cpu).sum();
            if spent >= self.enough || self.laps.len() >= MOST {
                return Ok(came);
            }
        }
    }

    /// The laps that count.
    fn counted(&self) -> &[Lap] {
        if self.laps.len() > 2 { &self.laps[1..] } else { &self.laps }
    }

    /// The median of processor time and of the clock on the wall, seconds, and of how many runs.
    #[must_use]
    pub fn median(&self) -> (f64, f64, usize) {
        let counted = self.counted();
        let median = |of: fn(&Lap) -> f64| {
            let mut values: Vec<f64> = counted.iter().map(of).collect();
            values.sort_unstable_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        };
        (median(|lap| lap.cpu), median(|lap| lap.wall), counted.len())
    }

    /// The least and the greatest processor time of a run, seconds.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        let all = self.counted().iter().map(|lap| lap.cpu);
        [all.clone().fold(f64::INFINITY, f64::min), all.fold(0.0, f64::max)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_work_is_repeated_and_long_work_is_not() {
        let mut count = 0;
        let mut work = |enough: f64| {
            let mut stopwatch = Stopwatch::new(enough);
            let came = stopwatch.time(|| {
                count += 1;
                Ok::<u32, Refusal>((0..2_000_000_u32).fold(count, |sum, k| std::hint::black_box(sum ^ k)))
            });
            assert!(came.is_ok());
            let (cpu, wall, runs) = stopwatch.median();
            let [least, most] = stopwatch.range();
            assert!(least <= cpu && cpu <= most && wall >= 0.0);
            runs
        };
        assert_eq!(work(0.0), 1);
        assert!(work(0.05) > 1);
        assert!(count > 2);
    }
}
