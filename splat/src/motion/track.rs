//! A way through places at some instants, and where it is between them.

/// How many intervals later, and how far from the place at the instant itself: in the order of time, with (0, 0) among them.
pub type Track = Vec<(f32, [f32; 3])>;

/// Where `track` is `dt` intervals after its instant: a cubic from each place to the next with the tangents of parabolas through
/// three of them, and straight on beyond the last.
#[must_use]
pub fn along(track: &[(f32, [f32; 3])], dt: f32) -> [f32; 3] {
    std::array::from_fn(|axis| one_axis(track, dt, axis))
}

fn one_axis(track: &[(f32, [f32; 3])], dt: f32, axis: usize) -> f32 {
    let Some(last) = track.len().checked_sub(1).filter(|last| *last > 0) else { return 0.0 };
    let time = |i: usize| track[i].0;
    let place = |i: usize| track[i].1[axis];
    let slope = |i: usize| (place(i + 1) - place(i)) / (time(i + 1) - time(i));
    let inner = |i: usize| {
        let (before, after) = (time(i) - time(i - 1), time(i + 1) - time(i));
        (before * slope(i) + after * slope(i - 1)) / (before + after)
    };
    let tangent = |i: usize| match i {
        _ if last == 1 => slope(0),
        0 => 2.0 * slope(0) - inner(1),
        i if i == last => 2.0 * slope(last - 1) - inner(last - 1),
        i => inner(i),
    };
    if dt <= time(0) {
        return place(0) + (dt - time(0)) * tangent(0);
    }
    if dt >= time(last) {
        return place(last) + (dt - time(last)) * tangent(last);
    }
    let i = (0..last).rfind(|&i| time(i) <= dt).unwrap_or(0);
    let width = time(i + 1) - time(i);
    let t = (dt - time(i)) / width;
    let rest = 1.0 - t;
    (1.0 + 2.0 * t) * rest * rest * place(i)
        + t * t * (3.0 - 2.0 * t) * place(i + 1)
        + width * t * rest * (rest * tangent(i) - t * tangent(i + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_passes_its_places_and_follows_a_parabola() {
        let height = |dt: f32| 0.5 * dt - 0.3 * dt * dt;
        let track: Vec<_> = [-2.0, -0.5, 0.0, 1.0, 2.5].map(|dt| (dt, [dt, height(dt), 0.0])).to_vec();
        for step in -20..=25 {
            let dt = 0.1 * step as f32;
            let [x, y, z] = along(&track, dt);
            assert!((x - dt).abs() < 1e-5 && (y - height(dt)).abs() < 1e-5 && z == 0.0, "{dt}: {x} {y} {z}");
        }
        let beyond = along(&track, 3.5)[1] - along(&track, 2.5)[1];
        assert!((beyond - (0.5 - 0.6 * 2.5)).abs() < 1e-5, "straight on with the last tangent: {beyond}");
    }

    #[test]
    fn what_is_known_at_one_or_two_instants_stands_still_or_goes_straight() {
        assert_eq!(along(&[(0.0, [0.0; 3])], 3.0), [0.0; 3]);
        assert_eq!(along(&[(0.0, [0.0; 3]), (2.0, [1.0, 0.0, 0.0])], -1.0), [-0.5, 0.0, 0.0]);
    }
}
