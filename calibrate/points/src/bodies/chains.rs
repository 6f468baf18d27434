//! Tracks: chains of detections through the instants, the best first.
//!
//! A chain is rewarded for each detection, and less where colours or sizes differ, speeds are great, an instant is left out or the
//! velocity changes. The best chain is taken out, and the search goes on with what is left.

use glam::DVec3;

use super::detections::Detection;

/// Nothing that is tracked goes faster, metres per second.
pub const FASTEST: f64 = 15.0;
/// So many tracks at most.
const MOST_TRACKS: usize = 16;
/// A track has at least so many detections.
const SHORTEST: usize = 3;
/// At most so many instants from one detection of a chain to the next.
const WIDEST_GAP: usize = 3;

/// A detection: its instant and its index.
type At = (usize, usize);
/// A chain of detections.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Chain {
    /// Where it goes through.
    pub seen: Vec<At>,
    /// Before which instants it bounces off another.
    pub met: Vec<usize>,
}

/// A detection and one before it, as a chain may go.
#[derive(Clone, Copy)]
struct Link {
    from: At,
    score: f64,
    velocity: DVec3,
    /// The detection before `from`.
    before: Option<At>,
}

/// The chains of all tracks, the best first. `times_s` are the instants.
pub fn chains(detections: &[Vec<Detection>], times_s: &[f64]) -> Vec<Chain> {
    let mut free: Vec<Vec<bool>> = detections.iter().map(|found| vec![true; found.len()]).collect();
    let mut found = Vec::new();
    while found.len() < MOST_TRACKS {
        let Some(chain) = best(detections, &free, times_s) else { break };
        if chain.seen.len() < SHORTEST.min(times_s.len()) {
            break;
        }
        for &(instant, index) in &chain.seen {
            free[instant][index] = false;
        }
        found.push(chain);
    }
    found
}

/// The chain with the greatest score among detections that are free.
fn best(detections: &[Vec<Detection>], free: &[Vec<bool>], times_s: &[f64]) -> Option<Chain> {
    let mut links: Vec<Vec<Vec<Link>>> = detections.iter().map(|found| vec![Vec::new(); found.len()]).collect();
    let mut top: Option<(f64, At, At)> = None;
    for to in 1..detections.len() {
        for (index, there) in detections[to].iter().enumerate().filter(|(index, _)| free[to][*index]) {
            let mut new = Vec::new();
            for gap in 1..=WIDEST_GAP.min(to) {
                let from = to - gap;
                let seconds = times_s[to] - times_s[from];
                for (before, here) in detections[from].iter().enumerate().filter(|(before, _)| free[from][*before]) {
                    let velocity = (there.centre - here.centre) / seconds;
                    if velocity.length() > FASTEST || !velocity.is_finite() {
                        continue;
                    }
                    let cost = 1.2 * (1.0 - here.colours.overlap(&there.colours))
                        + 0.4 * (here.members.len() as f64 / there.members.len() as f64).ln().abs()
                        + 0.02 * velocity.length()
                        + 0.35 * (gap - 1) as f64;
                    let mut link = Link { from: (from, before), score: 2.0 - cost, velocity, before: None };
                    for earlier in &links[from][before] {
                        let bend = 0.2 * velocity.distance(earlier.velocity) * (0.05 / seconds).min(1.0);
                        let score = earlier.score + 1.0 - cost - bend.min(1.5);
                        if score > link.score {
                            (link.score, link.before) = (score, Some(earlier.from));
                        }
                    }
                    new.push(link);
                }
            }
            for link in &new {
                if top.is_none_or(|(score, ..)| link.score > score) {
                    top = Some((link.score, (to, index), link.from));
                }
            }
            links[to][index] = new;
        }
    }
    let (_, mut at, mut from) = top?;
    let mut chain = vec![at];
    loop {
        chain.push(from);
        let link = links[at.0][at.1].iter().find(|link| link.from == from)?;
        let Some(before) = link.before else { break };
        (at, from) = (from, before);
    }
    chain.reverse();
    Some(Chain { seen: chain, met: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::detections::Histogram;

    fn detection(centre: DVec3, colour: [u8; 3]) -> Detection {
        Detection { members: (0..50).collect(), centre, colours: Histogram::of(&[colour; 50]) }
    }

    #[test]
    fn two_that_cross_keep_their_ways_and_one_that_flickers_is_no_track() {
        let times: Vec<f64> = (0..9).map(|k| 0.05 * f64::from(k)).collect();
        let way = |t: f64, side: f64| DVec3::new(4.0 * t - 0.8, side * (t - 0.2), 2.0);
        let found: Vec<Vec<Detection>> = times
            .iter()
            .enumerate()
            .map(|(k, &t)| {
                // The same colour: only their ways tell them apart. Their order changes, and one is not seen once.
                let mut both = vec![detection(way(t, 3.0), [200, 40, 40]), detection(way(t, -3.0), [200, 40, 40])];
                if k % 2 == 1 {
                    both.reverse();
                }
                if k == 6 {
                    both.pop();
                }
                if k == 3 {
                    both.push(detection(DVec3::new(0.0, 5.0, 0.0), [0, 0, 200]));
                }
                both
            })
            .collect();
        let chains = chains(&found, &times);
        assert_eq!(chains.len(), 2, "{chains:?}");
        for chain in chains {
            let chain = chain.seen;
            let side = (found[chain[0].0][chain[0].1].centre.y / (times[chain[0].0] - 0.2)).signum() * 3.0;
            for (instant, index) in chain {
                assert!(found[instant][index].centre.distance(way(times[instant], side)) < 0.01, "at {instant}");
            }
        }
    }

    #[test]
    fn nothing_is_found_in_nothing() {
        assert!(chains(&[], &[]).is_empty());
        assert!(chains(&[vec![], vec![]], &[0.0, 0.1]).is_empty());
        let lone = vec![vec![detection(DVec3::ZERO, [0; 3])], vec![], vec![]];
        assert!(chains(&lone, &[0.0, 0.1, 0.2]).is_empty());
    }
}
