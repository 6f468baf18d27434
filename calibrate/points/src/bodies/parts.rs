//! Parts of points: those that are nearest to one of several middles.

use glam::DVec3;

use super::detections::mean;

/// Rounds after which the middles of parts hardly move any more.
const ROUNDS: usize = 20;

/// Which of the middles is nearest to a place; the first of none.
pub fn nearest(middles: &[DVec3], place: DVec3) -> usize {
    let away = |at: &usize| middles[*at].distance_squared(place);
    (0..middles.len()).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(0)
}

/// Places that are far apart: the one that is farthest from the middle of all, and then always the farthest from those before.
pub fn far_apart(places: &[DVec3], count: usize) -> Vec<DVec3> {
    let middle = mean(places.iter().copied());
    let mut chosen: Vec<DVec3> = Vec::new();
    while chosen.len() < count {
        let away = |place: &DVec3| {
            let from = if chosen.is_empty() { std::slice::from_ref(&middle) } else { &chosen };
            from.iter().map(|other| other.distance_squared(*place)).fold(f64::INFINITY, f64::min)
        };
        let farthest = places.iter().max_by(|a, b| away(a).total_cmp(&away(b)));
        chosen.push(farthest.copied().unwrap_or(middle));
    }
    chosen
}

/// Middles of the places that are nearest to each; a middle that nothing is near stays.
pub fn settled(places: &[DVec3], mut middles: Vec<DVec3>) -> Vec<DVec3> {
    for _ in 0..ROUNDS {
        let near: Vec<usize> = places.iter().map(|place| nearest(&middles, *place)).collect();
        for (part, middle) in middles.iter_mut().enumerate() {
            let mine: Vec<DVec3> = (0..places.len()).filter(|&at| near[at] == part).map(|at| places[at]).collect();
            if !mine.is_empty() {
                *middle = mean(mine);
            }
        }
    }
    middles
}
