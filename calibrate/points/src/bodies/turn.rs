//! How a body turns.

use glam::{DQuat, DVec3};

/// How a body turns: at one rate about one axis, or at a rate that changes steadily from one instant to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Turn {
    /// When the body's axes are those of the world, seconds.
    upright_s: f64,
    /// Times and rates, axis times radians per second; the first and the last hold beyond them.
    rates: Vec<(f64, DVec3)>,
    /// Rotations every so often since `from_s`, where the rate changes.
    samples: Vec<DQuat>,
    from_s: f64,
    /// Turns more, after those, at times; between two of them evenly, and the first and last beyond.
    more: Vec<(f64, DQuat)>,
}

/// Rotations are summed up in steps of so many seconds.
const STEP_S: f64 = 0.001;
/// With more steps they become longer.
const MOST_STEPS: f64 = 200_000.0;

impl Turn {
    /// At one rate.
    pub fn steady(upright_s: f64, rate: DVec3) -> Self {
        Self { upright_s, rates: vec![(upright_s, rate)], samples: Vec::new(), from_s: upright_s, more: Vec::new() }
    }

    /// At rates at times, which increase.
    pub fn changing(upright_s: f64, rates: Vec<(f64, DVec3)>) -> Self {
        let (Some(&(first, _)), Some(&(last, _))) = (rates.first(), rates.last()) else {
            return Self::steady(upright_s, DVec3::ZERO);
        };
        let mut turn = Self { upright_s, rates, samples: vec![DQuat::IDENTITY], from_s: first, more: Vec::new() };
        let step = turn.step();
        for index in 0..((last - first) / step).ceil() as usize {
            let rate = turn.bare_rate(first + (index as f64 + 0.5) * step);
            let before = turn.samples[index];
            turn.samples.push((DQuat::from_scaled_axis(rate * step) * before).normalize());
        }
        let upright = turn.bare(upright_s).conjugate();
        for sample in &mut turn.samples {
            *sample *= upright;
        }
        turn
    }

    /// The same with rotations at times that it has instead of its own, ordered.
    pub fn through(&self, rotations: &[(f64, DQuat)]) -> Self {
        let more = rotations.iter().map(|&(t_s, rotation)| (t_s, rotation * self.bare(t_s).conjugate()));
        Self { more: more.collect(), ..self.clone() }
    }

    fn step(&self) -> f64 {
        let [first, last] = [self.rates.first(), self.rates.last()].map(|end| end.map_or(0.0, |end| end.0));
        STEP_S.max((last - first) / MOST_STEPS)
    }

    /// Axis times rate at a time, radians per second.
    pub fn rate(&self, t_s: f64) -> DVec3 {
        if self.more.is_empty() {
            return self.bare_rate(t_s);
        }
        let turn = self.at(t_s + STEP_S) * self.at(t_s - STEP_S).conjugate();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        turn.to_scaled_axis() / (2.0 * STEP_S)
    }

    fn bare_rate(&self, t_s: f64) -> DVec3 {
        let next = self.rates.partition_point(|rate| rate.0 <= t_s);
        match (next.checked_sub(1).map(|before| self.rates[before]), self.rates.get(next)) {
            (Some((from, before)), Some(&(to, after))) => before.lerp(after, (t_s - from) / (to - from)),
            (Some((_, rate)), None) | (None, Some(&(_, rate))) => rate,
            (None, None) => DVec3::ZERO,
        }
    }

    /// Times and rates, axis times radians per second.
    pub fn rates(&self) -> &[(f64, DVec3)] {
        &self.rates
    }

    /// Whether its rate is not the same all the time.
    pub fn changes(&self) -> bool {
        self.rates.len() > 1 || self.more.len() > 1
    }

    /// The greatest rate with the turns that lead it through rotations, radians per second, or more.
    pub fn fastest_led(&self) -> f64 {
        let more = |pair: &[(f64, DQuat)]| pair[0].1.angle_between(pair[1].1) / (pair[1].0 - pair[0].0);
        self.fastest() + self.more.windows(2).map(more).fold(0.0, f64::max)
    }

    /// The greatest rate without those turns, radians per second.
    pub fn fastest(&self) -> f64 {
        self.rates.iter().map(|rate| rate.1.length()).fold(0.0, f64::max)
    }

    /// From the body's axes to the world's.
    pub fn at(&self, t_s: f64) -> DQuat {
        let next = self.more.partition_point(|more| more.0 <= t_s);
        let more = match (next.checked_sub(1).map(|before| self.more[before]), self.more.get(next)) {
            (Some((from, before)), Some(&(to, after))) => before.slerp(after, (t_s - from) / (to - from)),
            (Some((_, more)), None) | (None, Some(&(_, more))) => more,
            (None, None) => return self.bare(t_s),
        };
        more * self.bare(t_s)
    }

    fn bare(&self, t_s: f64) -> DQuat {
        let Some(end) = self.samples.len().checked_sub(1) else {
            return DQuat::from_scaled_axis(self.bare_rate(t_s) * (t_s - self.upright_s));
        };
        let step = self.step();
        let along = ((t_s - self.from_s) / step).clamp(0.0, end as f64);
        let index = along as usize;
        let here = self.samples[index].slerp(self.samples[(index + 1).min(end)], along - index as f64);
        let beyond = t_s - (self.from_s + along * step);
        DQuat::from_scaled_axis(self.bare_rate(t_s) * beyond) * here
    }
}

/// `count` directions, evenly spread: a Fibonacci spiral on the sphere.
pub fn directions(count: usize) -> Vec<DVec3> {
    let direction = |index: usize| {
        let at = index as f64 + 0.5;
        let up = 1.0 - 2.0 * at / count as f64;
        let (sin, cos) = (std::f64::consts::PI * (1.0 + 5_f64.sqrt()) * at).sin_cos();
        let flat = (1.0 - up * up).max(0.0).sqrt();
        DVec3::new(cos * flat, sin * flat, up)
    };
    (0..count).map(direction).collect()
}

/// Directions in which points of a ball are about `apart_m` from one another, as many as are within the bounds.
pub fn directions_apart(radius_m: f64, apart_m: f64, [least, most]: [f64; 2]) -> Vec<DVec3> {
    directions((4.0 * std::f64::consts::PI * (radius_m / apart_m).powi(2)).clamp(least, most) as usize)
}

/// No turn first, and then each direction with each rate.
pub fn rates(directions_count: usize, rates: &[f64]) -> Vec<DVec3> {
    let all = directions(directions_count).into_iter().flat_map(|along| rates.iter().map(move |&rate| along * rate));
    std::iter::once(DVec3::ZERO).chain(all).collect()
}

/// Improves `start` by steps along the axes of `first` radians per second, halved `halvings` times, as long as `score` grows.
pub fn climb(start: (f64, DVec3), first: f64, halvings: u32, score: impl Fn(&[DVec3]) -> Vec<f64>) -> (f64, DVec3) {
    let (mut best, mut at) = start;
    for halving in 0..=halvings {
        let step = first * 0.5_f64.powi(halving as i32);
        for _ in 0..6 {
            let tries: Vec<DVec3> =
                DVec3::AXES.into_iter().chain(DVec3::AXES.map(|axis| -axis)).map(|axis| at + step * axis).collect();
            let scores = score(&tries);
            let top = std::iter::zip(scores, tries).max_by(|a, b| a.0.total_cmp(&b.0));
            match top {
                Some((score, rate)) if score > best => (best, at) = (score, rate),
                _ => break,
            }
        }
    }
    (best, at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_of_length_one_and_leave_no_gap() {
        let all = directions(60);
        assert!(all.iter().all(|along| (along.length() - 1.0).abs() < 1e-12));
        for probe in directions(997) {
            let nearest = all.iter().map(|along| along.angle_between(probe)).fold(9.0, f64::min);
            assert!(nearest < 0.35, "{nearest} rad from the next");
        }
    }

    #[test]
    fn climbing_ends_near_the_top() {
        let top = DVec3::new(3.0, -7.0, 12.0);
        let score = |tries: &[DVec3]| tries.iter().map(|rate| -rate.distance(top)).collect::<Vec<_>>();
        let start = DVec3::new(5.0, -5.0, 10.0);
        let (_, found) = climb((-start.distance(top), start), 3.0, 5, score);
        assert!(found.distance(top) < 0.2, "{found}");
    }

    #[test]
    fn a_turn_is_none_when_upright_and_half_a_turn_half_a_turn_later() {
        let turn = Turn::steady(0.3, DVec3::Z * std::f64::consts::PI);
        assert!((turn.at(0.3) * DVec3::X).abs_diff_eq(DVec3::X, 1e-12));
        assert!((turn.at(0.8) * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12));
    }

    #[test]
    fn a_turn_whose_rate_changes_is_the_sum_of_its_parts() {
        // From 2 to 6 rad/s about z in a second: 4 rad; and on at 6.
        let turn = Turn::changing(1.0, vec![(1.0, DVec3::Z * 2.0), (2.0, DVec3::Z * 6.0)]);
        let angle = |t: f64| {
            let x = turn.at(t) * DVec3::X;
            x.y.atan2(x.x)
        };
        let wrapped =
            |angle: f64| (angle + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
        for (t, expected) in [(0.5, -1.0), (1.0, 0.0), (1.5, 1.5), (2.0, 4.0), (2.5, 7.0)] {
            assert!((wrapped(angle(t) - expected)).abs() < 1e-6, "{} at {t} s", angle(t));
        }
        assert_eq!(turn.fastest(), 6.0);
        assert_eq!(Turn::changing(0.0, vec![]).at(3.0), DQuat::IDENTITY);
        let steady = Turn::changing(0.2, vec![(0.0, DVec3::X), (1.0, DVec3::X)]);
        assert!(steady.at(0.7).abs_diff_eq(Turn::steady(0.2, DVec3::X).at(0.7), 1e-9));
    }

    #[test]
    fn a_turn_through_rotations_has_them_and_its_rate_is_that_of_its_rotations() {
        let turn = Turn::steady(0.0, DVec3::Z * 30.0);
        let off = |t_s: f64| DQuat::from_scaled_axis(DVec3::X * 2.0 * t_s) * turn.at(t_s);
        let rotations: Vec<(f64, DQuat)> = (0..5).map(|at| 0.1 * f64::from(at)).map(|t_s| (t_s, off(t_s))).collect();
        let through = turn.through(&rotations);
        for t_s in [0.0, 0.1, 0.25, 0.33, 0.4] {
            assert!(through.at(t_s).angle_between(off(t_s)) < 1e-6, "{t_s} s");
        }
        let expected = DVec3::X * 2.0 + DQuat::from_scaled_axis(DVec3::X * 0.5) * DVec3::Z * 30.0;
        assert!(through.rate(0.25).distance(expected) < 0.01, "{}", through.rate(0.25));
        assert!(turn.fastest_led() == 30.0 && (through.fastest_led() - 32.0).abs() < 1e-6);
        // Beyond the last, as it would have turned.
        assert!((through.rate(0.6).length() - 30.0).abs() < 1e-3);
        assert!(through.through(&[]).at(0.2).angle_between(turn.at(0.2)) < 1e-6);
    }
}
