//! Frames that are off in time, one by one.
//!
//! Webcams deliver frames late by now more and now less, so that one time offset for a camera leaves errors over that grow with
//! the board's speed. How much they scatter is told by what is left over along each view's motion; corners then count as much as
//! they are known, those of a board that hardly moves as before.

use std::collections::BTreeMap;

use crate::{bundle::Bundle, statistics::median};

/// What lies farther from where it should than so many times the typical error, as far as that is known, is a mistake.
const GROSS: f64 = 8.0;
/// Half of the squares of a standard normal number are smaller.
const HALF_BELOW: f64 = 0.4549;
/// With fewer views nothing follows.
const FEWEST: usize = 8;
/// What is farther off, seconds, is of another time and not late.
const MOST_S: f64 = 0.1;

/// How much the times of each camera's frames scatter about its offset (standard deviation, seconds); their corners' standard
/// deviations are widened by it, at the speed at which each moves.
pub(super) fn weigh(bundle: &mut Bundle) -> Vec<f64> {
    let scatter: Vec<f64> = (0..bundle.cameras.len()).map(|camera| of_camera(bundle, camera)).collect();
    for observation in &mut bundle.observations {
        let late_px = scatter[observation.camera] * observation.velocity.length();
        observation.sigma_px = observation.sigma_px.hypot(late_px);
    }
    scatter
}

/// A view: by how much it is late, and how well that is known, seconds.
struct Late {
    late_s: f64,
    sigma_s: f64,
}

fn of_camera(bundle: &Bundle, camera: usize) -> f64 {
    let mut sums: BTreeMap<usize, [f64; 2]> = BTreeMap::new();
    for o in bundle.observations.iter().filter(|o| o.camera == camera) {
        let Some(residual) = bundle.residual_px(o) else { continue };
        let weight = 1.0 / (o.sigma_px * o.sigma_px);
        let [along, squares] = sums.entry(o.placement).or_default();
        *along += weight * residual.dot(o.velocity);
        *squares += weight * o.velocity.length_squared();
    }
    let known = sums.values().filter(|[_, squares]| *squares > 0.0);
    let all: Vec<Late> =
        known.map(|[along, squares]| Late { late_s: along / squares, sigma_s: 1.0 / squares.sqrt() }).collect();
    if all.len() < FEWEST { 0.0 } else { scatter(&all) }
}

/// The scatter with which half of the views are as far off as half of them should be; none where errors of corners explain it, and
/// none where no frame could be so late: what does not belong together is no scatter.
fn scatter(all: &[Late]) -> f64 {
    let excess = |scatter: f64| {
        let squares = all.iter().map(|late| late.late_s.powi(2) / (late.sigma_s.powi(2) + scatter * scatter));
        median(squares).unwrap_or(0.0) - HALF_BELOW
    };
    if excess(0.0) <= 0.0 || excess(MOST_S) > 0.0 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, MOST_S);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 { low = middle } else { high = middle }
    }
    high
}

/// Marks what is a mistaken corner, beside what the times of frames explain.
pub(super) fn mark_gross(bundle: &mut Bundle) {
    let deviations = bundle.observations.iter().filter_map(|o| Some(bundle.residual_px(o)?.length() / o.sigma_px));
    let typical = median(deviations).unwrap_or(0.0);
    bundle.mark_outliers((GROSS * typical).max(1.0), 1.0);
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    #[test]
    fn a_scatter_is_found_under_errors_of_corners_and_beside_frames_that_are_lost() {
        for true_s in [0.0, 0.01, 0.04] {
            let late = |index: u64| {
                let draw = |of| random::normal(random::key(5, &[index, of]));
                let sigma_s = 0.002 + 0.02 * random::uniform(random::key(6, &[index]));
                let lost_s = if index.is_multiple_of(12) { 0.3 } else { 0.0 };
                Late { late_s: sigma_s * draw(0) + true_s * draw(1) + lost_s, sigma_s }
            };
            let found = scatter(&(0..400).map(late).collect::<Vec<_>>());
            assert!((found - true_s).abs() < 0.2 * true_s + 0.006, "{found} {true_s}");
        }
        let elsewhere = |index: u64| Late { late_s: random::normal(random::key(7, &[index])), sigma_s: 0.01 };
        assert_eq!(scatter(&(0..100).map(elsewhere).collect::<Vec<_>>()), 0.0);
    }
}
