//! Downhill by changing one number at a time.

use rayon::prelude::*;

/// How numbers are changed: by steps that are halved so often, and so many of each size at most.
#[derive(Clone, Copy, Debug)]
pub struct Steps {
    pub halvings: i32,
    pub most: usize,
}

impl Steps {
    /// Where costs are least near `start`, and what they are there: `changed` gives the same with one of its first `numbers` changed by
    /// a share of its first step, to either side.
    pub fn descend<T: Copy + Send + Sync>(
        self,
        start: T,
        numbers: usize,
        changed: impl Fn(&T, usize, f64) -> T + Sync,
        cost: impl Fn(&T) -> f64 + Sync,
    ) -> (T, f64) {
        let mut best = (start, cost(&start));
        for halving in 0..=self.halvings {
            let step = 0.5_f64.powi(halving);
            for _ in 0..self.most {
                let tries = (0..2 * numbers).into_par_iter().map(|side| {
                    let next = changed(&best.0, side / 2, if side % 2 == 0 { step } else { -step });
                    (next, cost(&next))
                });
                let tries: Vec<(T, f64)> = tries.collect();
                match tries.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)) {
                    Some(next) if next.1 < best.1 => best = next,
                    _ => break,
                }
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_numbers_come_to_the_least_cost_and_the_others_stay() {
        let changed = |at: &[f64; 3], number: usize, step: f64| {
            let mut next = *at;
            next[number] += step;
            next
        };
        let cost = |at: &[f64; 3]| (at[0] - 1.25).abs() + (at[1] + 2.5).abs() + at[2].abs();
        let (at, least) = Steps { halvings: 2, most: 8 }.descend([0.0, 0.0, 7.0], 2, changed, cost);
        assert_eq!((at, least), ([1.25, -2.5, 7.0], 7.0));
    }
}
