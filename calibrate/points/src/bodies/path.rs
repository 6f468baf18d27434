//! Curves through places at known times.

use glam::{DMat3, DVec3};

use super::flight::Bounce;

/// Beyond its ends a path goes straight on for so long, seconds, and then stands still.
const ON_S: f64 = 0.08;

/// A smooth path through places: cubic between two, with tangents that do not swing (Akima's, modified as MATLAB's `makima` does);
/// its velocity jumps at bounces; straight on beyond its ends, and then still.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Path {
    times_s: Vec<f64>,
    places: Vec<DVec3>,
    /// Before and after each place.
    tangents: Vec<[DVec3; 2]>,
    /// Which of the places are bounces.
    bounces: Vec<usize>,
}

impl Path {
    /// Through `places` at `times_s`, which increase.
    #[cfg(test)]
    pub fn new(times_s: Vec<f64>, places: Vec<DVec3>) -> Self {
        Self::bouncing(&times_s, &places, &[], 0.0)
    }

    /// The same with bounces, in the order of time; what was seen within `blurred_s` of one is left out, since it was seen partly before
    /// and partly after it.
    pub fn bouncing(times_s: &[f64], places: &[DVec3], bounces: &[Bounce], blurred_s: f64) -> Self {
        let clear = |time: f64| bounces.iter().all(|bounce| (bounce.t_s - time).abs() > blurred_s);
        let mut path = Self::default();
        let mut next = bounces.iter().peekable();
        for (&t_s, &place) in std::iter::zip(times_s, places).filter(|(time, _)| clear(**time)) {
            while let Some(bounce) = next.next_if(|bounce| bounce.t_s < t_s) {
                path.push_bounce(bounce);
            }
            path.times_s.push(t_s);
            path.places.push(place);
        }
        let tangents = path.tangents_of(&path.places);
        path.tangents = tangents;
        for bounce in bounces {
            if let Some(index) = path.times_s.iter().position(|&time| time == bounce.t_s) {
                path.tangents[index] = bounce.velocities;
            }
        }
        path
    }

    fn push_bounce(&mut self, bounce: &Bounce) {
        if self.times_s.last().is_some_and(|&last| last < bounce.t_s) {
            self.bounces.push(self.times_s.len());
            self.times_s.push(bounce.t_s);
            self.places.push(bounce.place);
        }
    }

    /// When it bounces, seconds.
    pub fn bounces_s(&self) -> impl Iterator<Item = f64> + '_ {
        self.bounces.iter().map(|&index| self.times_s[index])
    }

    /// With places at some of its times instead of its own, and the tangents that they bring. Bounces go along with what is beside them.
    pub fn through(&self, places: &[(f64, DVec3)]) -> Self {
        let mut new = self.places.clone();
        for &(t_s, place) in places {
            if let Some(index) = self.times_s.iter().position(|&time| time == t_s) {
                new[index] = place;
            }
        }
        for &index in &self.bounces {
            let beside = [index.checked_sub(1), Some(index + 1)].into_iter().flatten();
            let beside: Vec<usize> = beside.filter(|at| *at < new.len() && !self.bounces.contains(at)).collect();
            let moved = beside.iter().map(|&at| new[at] - self.places[at]).sum::<DVec3>();
            new[index] += moved / beside.len().max(1) as f64;
        }
        let (before, after) = (self.tangents_of(&self.places), self.tangents_of(&new));
        let tangents = std::iter::zip(&self.tangents, std::iter::zip(before, after))
            .map(|(own, (before, after))| [0, 1].map(|side| own[side] + after[side] - before[side]));
        Self { tangents: tangents.collect(), places: new, ..self.clone() }
    }

    /// The tangents through `places` at its times: those before and after a bounce know nothing of one another.
    fn tangents_of(&self, places: &[DVec3]) -> Vec<[DVec3; 2]> {
        let mut all = vec![[DVec3::ZERO; 2]; places.len()];
        let Some(last) = places.len().checked_sub(1) else { return all };
        let ends: Vec<usize> = [0].into_iter().chain(self.bounces.iter().copied()).chain([last]).collect();
        for pair in ends.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let found = tangents(&self.times_s[from..=to], &places[from..=to]);
            for (at, tangent) in (from..=to).zip(found) {
                let sides = [at > from || from == 0, at < to || to == last];
                for side in [0, 1].into_iter().filter(|&side| sides[side]) {
                    all[at][side] = tangent;
                }
            }
        }
        all
    }

    /// The same, moved by a shift at a time, and away from there by a velocity, metres and metres per second.
    pub fn moved(&self, [shift, velocity]: [DVec3; 2], from_s: f64) -> Self {
        let places = std::iter::zip(&self.times_s, &self.places);
        let places = places.map(|(t_s, place)| *place + shift + (t_s - from_s) * velocity).collect();
        let tangents = self.tangents.iter().map(|sides| sides.map(|side| side + velocity)).collect();
        Self { places, tangents, ..self.clone() }
    }

    /// With velocities at some of its times, metres per second, instead of those that its places tell.
    pub fn with_velocities(mut self, velocities: &[(f64, DVec3)]) -> Self {
        for &(t_s, velocity) in velocities {
            if let Some(index) = self.times_s.iter().position(|&time| time == t_s) {
                self.tangents[index] = [velocity; 2];
            }
        }
        self
    }

    /// Where it is at a time; the origin if there is no place at all.
    pub fn at(&self, t_s: f64) -> DVec3 {
        let (Some(&first), Some(&last)) = (self.times_s.first(), self.times_s.last()) else { return DVec3::ZERO };
        let end = self.places.len() - 1;
        if t_s <= first {
            return self.places[0] - self.leaving(0) * (first - t_s).min(ON_S);
        }
        if t_s >= last {
            return self.places[end] + self.leaving(end) * (t_s - last).min(ON_S);
        }
        let (index, u, step) = self.piece(t_s);
        let (p, q) = (self.places[index], self.places[index + 1]);
        let (m, n) = (self.tangents[index][1] * step, self.tangents[index + 1][0] * step);
        p + (m + (3.0 * (q - p) - 2.0 * m - n + (2.0 * (p - q) + m + n) * u) * u) * u
    }

    /// How fast it goes at a time, metres per second; that at its ends beyond them.
    pub fn velocity(&self, t_s: f64) -> DVec3 {
        let (Some(&first), Some(&last)) = (self.times_s.first(), self.times_s.last()) else { return DVec3::ZERO };
        if self.places.len() < 2 {
            return DVec3::ZERO;
        }
        let (index, u, step) = self.piece(t_s.clamp(first, last));
        let (p, q) = (self.places[index], self.places[index + 1]);
        let (m, n) = (self.tangents[index][1] * step, self.tangents[index + 1][0] * step);
        (m + (2.0 * (3.0 * (q - p) - 2.0 * m - n) + 3.0 * (2.0 * (p - q) + m + n) * u) * u) / step
    }

    /// Which piece a time is in, how far along it, and how long the piece is.
    fn piece(&self, t_s: f64) -> (usize, f64, f64) {
        let index = self.times_s.partition_point(|&time| time <= t_s).clamp(1, self.times_s.len() - 1) - 1;
        let step = self.times_s[index + 1] - self.times_s[index];
        (index, (t_s - self.times_s[index]) / step, step)
    }

    /// How it goes on beyond an end: as it went on the whole between the last two places, which noise disturbs less than a tangent.
    fn leaving(&self, end: usize) -> DVec3 {
        if self.places.len() < 2 {
            return DVec3::ZERO;
        }
        let index = end.min(self.places.len() - 2);
        (self.places[index + 1] - self.places[index]) / (self.times_s[index + 1] - self.times_s[index])
    }
}

fn tangents(times_s: &[f64], places: &[DVec3]) -> Vec<DVec3> {
    if places.len() < 2 {
        return vec![DVec3::ZERO; places.len()];
    }
    let slope = |index: usize| (places[index + 1] - places[index]) / (times_s[index + 1] - times_s[index]);
    let inner: Vec<DVec3> = (0..places.len() - 1).map(slope).collect();
    // Two slopes more at either end, on the parabola through the last three places.
    let beyond = |last: DVec3, next: DVec3| [2.0 * last - next, 3.0 * last - 2.0 * next];
    let end = inner.len() - 1;
    let before = beyond(inner[0], inner[1.min(end)]);
    let after = beyond(inner[end], inner[end.saturating_sub(1)]);
    let slopes: Vec<DVec3> = [before[1], before[0]].into_iter().chain(inner).chain(after).collect();
    let weight = |a: DVec3, b: DVec3| (a - b).length() + 0.5 * (a + b).length();
    let tangent = |four: &[DVec3]| {
        let [far, near] = [weight(four[3], four[2]), weight(four[1], four[0])];
        if far + near > 0.0 { (far * four[1] + near * four[2]) / (far + near) } else { DVec3::ZERO }
    };
    slopes.windows(4).map(tangent).collect()
}

/// The value at time 0 of the polynomial of a degree (at most 2) that fits `values` at `times` best.
pub fn fitted(times: &[f64], values: &[DVec3], degree: usize) -> DVec3 {
    let count = times.len() as f64;
    let scale = times.iter().fold(0.0, |most: f64, time| most.max(time.abs()));
    let mean = values.iter().sum::<DVec3>() / count.max(1.0);
    if times.len() < 2 || degree == 0 || scale <= 0.0 {
        return mean;
    }
    // Normal equations of 1, t, t^2 with |t| <= 1.
    let (mut sums, mut right) = ([0.0; 5], [DVec3::ZERO; 3]);
    for (time, &value) in std::iter::zip(times, values) {
        let mut power = 1.0;
        for (index, sum) in sums.iter_mut().enumerate() {
            *sum += power;
            if let Some(right) = right.get_mut(index) {
                *right += power * value;
            }
            power *= time / scale;
        }
    }
    if degree >= 2 && times.len() > 2 {
        let [a, b, c, d, e] = sums;
        let normal = DMat3::from_cols_array(&[a, b, c, b, c, d, c, d, e]);
        if normal.determinant() > 1e-9 * count.powi(3) {
            let first = normal.inverse().row(0);
            return right[0] * first.x + right[1] * first.y + right[2] * first.z;
        }
    }
    let determinant = sums[0] * sums[2] - sums[1] * sums[1];
    if determinant > 1e-9 * count.powi(2) { (right[0] * sums[2] - right[1] * sums[1]) / determinant } else { mean }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thrown(t: f64) -> DVec3 {
        DVec3::new(4.0 * t, -3.0 * t + 4.905 * t * t, 0.3)
    }

    #[test]
    fn a_throw_is_followed_between_its_instants_and_goes_straight_on_and_then_stops() {
        let times: Vec<f64> = (0..9).map(|k| 0.0667 * f64::from(k)).collect();
        let path = Path::new(times.clone(), times.iter().map(|&t| thrown(t)).collect());
        for step in 0..530 {
            let t = 0.001 * f64::from(step);
            assert!(path.at(t).distance(thrown(t)) < 3e-3, "{t} s: {}", path.at(t).distance(thrown(t)));
            let slope = (path.at(t + 5e-7) - path.at(t - 5e-7)) / 1e-6;
            assert!(t < 1e-3 || slope.distance(path.velocity(t)) < 1e-4, "{t} s");
        }
        let last = times[8];
        assert!(path.at(last + 0.04).distance(thrown(last + 0.04)) < 0.03);
        assert!(path.at(last + 0.08).abs_diff_eq(path.at(last + 3.0), 1e-12));
        assert!(path.at(-0.08).abs_diff_eq(path.at(-9.0), 1e-12));
        assert!(path.at(-0.01).distance(thrown(-0.01)) < 0.01);
    }

    #[test]
    fn a_bounce_does_not_swing_and_few_places_are_a_line_or_a_point() {
        let fold = |t: f64| DVec3::new(t, -(t - 0.35).abs(), 0.0);
        let times: Vec<f64> = (0..8).map(|k| 0.1 * f64::from(k)).collect();
        let path = Path::new(times.clone(), times.iter().map(|&t| fold(t)).collect());
        for step in 0..700 {
            let t = 0.001 * f64::from(step);
            let allowed = if (0.3..0.4).contains(&t) { 0.051 } else { 0.011 };
            assert!(path.at(t).distance(fold(t)) < allowed, "{t} s: {}", path.at(t).distance(fold(t)));
        }
        let line = Path::new(vec![0.0, 0.2], vec![DVec3::ZERO, DVec3::X]);
        assert!(line.at(0.1).abs_diff_eq(DVec3::X * 0.5, 1e-12));
        assert_eq!(Path::new(vec![0.5], vec![DVec3::Y]).at(7.0), DVec3::Y);
        assert_eq!(Path::new(vec![0.5], vec![DVec3::Y]).velocity(7.0), DVec3::ZERO);
        assert_eq!(Path::new(vec![], vec![]).at(1.0), DVec3::ZERO);
    }

    #[test]
    fn at_a_bounce_the_velocity_jumps_and_what_was_blurred_by_it_is_left_out() {
        let velocities = [DVec3::new(1.0, 2.5, 0.0), DVec3::new(0.8, -2.0, 0.1)];
        let ball = |t: f64| {
            let after = t - 0.31;
            velocities[usize::from(after > 0.0)] * after + 4.905 * after * after * DVec3::Y
        };
        let times: Vec<f64> = (0..10).map(|k| 0.0667 * f64::from(k)).collect();
        // The one nearest to the bounce is wrong.
        let odd = |t: f64| if (t - 0.31_f64).abs() < 0.03 { DVec3::X } else { ball(t) };
        let places: Vec<DVec3> = times.iter().map(|&t| odd(t)).collect();
        let bounce = Bounce { t_s: 0.31, place: ball(0.31), velocities };
        let path = Path::bouncing(&times, &places, &[bounce], 0.03);
        assert_eq!(path.bounces_s().collect::<Vec<_>>(), [0.31]);
        for step in 0..590 {
            let t = 0.001 * f64::from(step);
            assert!(path.at(t).distance(ball(t)) < 4e-3, "{t} s: {}", path.at(t).distance(ball(t)));
        }
        assert!(
            path.velocity(0.309).distance(velocities[0]) < 0.2 && path.velocity(0.311).distance(velocities[1]) < 0.2
        );
        let moved = path.through(&times.iter().map(|&t| (t, ball(t) + DVec3::Z)).collect::<Vec<_>>());
        assert!(moved.at(0.31).abs_diff_eq(DVec3::Z, 1e-9) && moved.at(0.2).distance(ball(0.2) + DVec3::Z) < 4e-3);
        // Before the first place and after the last there is none, and without places nothing at all.
        for t_s in [-1.0, 9.0] {
            assert_eq!(
                Path::bouncing(&times, &places, &[Bounce { t_s, ..bounce }], 0.0),
                Path::new(times.clone(), places.clone())
            );
        }
        assert_eq!(Path::bouncing(&[], &[], &[bounce], 0.0).at(0.3), DVec3::ZERO);
    }

    #[test]
    fn a_fitted_parabola_tells_the_value_in_between_and_beyond() {
        let times = [-0.2, -0.1, 0.1, 0.25];
        let values = times.map(|t| thrown(t + 1.0));
        assert!(fitted(&times, &values, 2).abs_diff_eq(thrown(1.0), 1e-9));
        assert!(fitted(&times[..2], &values[..2], 1).abs_diff_eq(2.0 * values[1] - values[0], 1e-9));
        assert_eq!(fitted(&[0.1], &[DVec3::X], 2), DVec3::X);
        assert_eq!(fitted(&[], &[], 2), DVec3::ZERO);
        // Twice the same time: no parabola, and no division by zero.
        assert!(fitted(&[0.1, 0.1, 0.1], &[DVec3::X; 3], 2).abs_diff_eq(DVec3::X, 1e-9));
    }

    #[test]
    fn a_path_through_other_places_goes_through_them_and_keeps_velocities_that_were_told() {
        let times: Vec<f64> = (0..6).map(|k| 0.1 * f64::from(k)).collect();
        let path = Path::new(times.clone(), times.iter().map(|&t| thrown(t)).collect());
        let path = path.with_velocities(&[(0.2, DVec3::X)]);
        let moved = path.through(&times.iter().map(|&t| (t, thrown(t) + DVec3::Z)).collect::<Vec<_>>());
        for &t in &times {
            assert!(moved.at(t).abs_diff_eq(thrown(t) + DVec3::Z, 1e-12));
        }
        assert!(moved.velocity(0.2).abs_diff_eq(DVec3::X, 1e-9));
        assert_eq!(path.through(&[(7.0, DVec3::Z)]), path);
    }
}
