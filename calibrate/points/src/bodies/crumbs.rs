//! Crumbs: what is left of the hull of a thing where it is blurred.
//!
//! Hulls of what turns fast fall to pieces at some instants, which are followed as if they were things. What falls freely tells where it
//! is then: all that does falls alike, and what stays inside of it is of it.

use glam::DVec3;

use super::{centres::Track, chains::Chain};

/// Things fall alike if their accelerations differ from the usual one by so large a share of it at most.
const ALIKE: f64 = 0.35;
/// What falls is pulled by so much at least, metres per second squared.
const LEAST: f64 = 2.0;
/// A crumb is nearer to the middle of a thing than so many of its radii, at so large a share of its instants.
const INSIDE: f64 = 1.2;
const MOSTLY: f64 = 0.75;

/// How what flies freely accelerates, metres per second squared: as most things that fly do; none where none falls.
pub fn fall(tracks: &[Track], times_s: &[f64], [cell_m, exposure_s]: [f64; 2]) -> Option<DVec3> {
    usual(tracks.iter().filter_map(|track| track.flights(times_s, exposure_s, cell_m).fall()))
}

/// The mean of the accelerations that most have, metres per second squared; none where they are not those of a fall.
pub fn usual(falls: impl Iterator<Item = DVec3>) -> Option<DVec3> {
    let falls: Vec<DVec3> = falls.collect();
    let usual = DVec3::from_array(
        [0, 1, 2].map(|axis| erfgs_calibrate::statistics::median(falls.iter().map(|fall| fall[axis])).unwrap_or(0.0)),
    );
    let alike: Vec<DVec3> =
        falls.iter().copied().filter(|fall| fall.distance(usual) < ALIKE * usual.length()).collect();
    let mean = alike.iter().sum::<DVec3>() / alike.len().max(1) as f64;
    (2 * alike.len() > falls.len() && mean.length() > LEAST).then_some(mean)
}

/// Leaves out the chains of what stays inside of things that fall freely; `tracks` are what the chains tell.
pub fn forget(chains: &mut Vec<Chain>, tracks: &[Track], times_s: &[f64], [cell_m, exposure_s]: [f64; 2]) {
    let flights: Vec<_> = tracks.iter().map(|track| track.flights(times_s, exposure_s, cell_m)).collect();
    let is_inside = |crumb: &Track, thing: usize| {
        let reach = INSIDE * tracks[thing].radius_m;
        let near = |&instant: &usize| {
            let away = crumb.centres[instant].zip(flights[thing].at(times_s[instant]));
            away.is_some_and(|(here, there)| here.distance(there) < reach)
        };
        let all = crumb.instants().count();
        crumb.instants().filter(near).count() as f64 >= MOSTLY * all as f64
    };
    // The one that is seen alone at more instants, and then the larger, is the thing.
    let rank = |track: usize| {
        let of = &tracks[track];
        (of.sure.iter().filter(|sure| **sure).count(), of.usual_points, std::cmp::Reverse(track))
    };
    let is_crumb = |track: usize| {
        (0..tracks.len()).any(|thing| thing != track && rank(thing) > rank(track) && is_inside(&tracks[track], thing))
    };
    let crumbs: Vec<bool> = (0..tracks.len()).map(is_crumb).collect();
    let mut crumbs = crumbs.into_iter();
    chains.retain(|_| crumbs.next() != Some(true));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::detections::Histogram;

    const GRAVITY: DVec3 = DVec3::new(0.0, 9.81, 0.0);
    const SIZES: [f64; 2] = [0.02, 0.0];

    fn track(times_s: &[f64], points: f64, way: impl Fn(usize, f64) -> Option<DVec3>) -> Track {
        let centres: Vec<Option<DVec3>> = times_s.iter().enumerate().map(|(at, &time)| way(at, time)).collect();
        Track {
            sure: centres.iter().map(Option::is_some).collect(),
            centres,
            met: Vec::new(),
            radius_m: 0.15,
            fall: None,
            colours: Histogram::of(&[[200, 30, 30]; 9]),
            usual_points: points,
        }
    }

    #[test]
    fn crumbs_of_what_falls_are_left_out_and_things_that_pass_are_not() {
        let times: Vec<f64> = (0..10).map(|at| f64::from(at) / 15.0).collect();
        let falls = |x: f64| {
            move |_: usize, time: f64| Some(DVec3::X * x + time * DVec3::NEG_Y * 3.0 + 0.5 * time * time * GRAVITY)
        };
        // Its hull is to pieces from the sixth instant on; a crumb of it is followed from there.
        let first = |at: usize, time: f64| falls(0.8)(at, time).filter(|_| at < 6);
        let crumb = |at: usize, time: f64| falls(0.9)(at, time).filter(|_| at >= 6);
        // It flies across the first and is inside of it for an instant.
        let across = |_: usize, time: f64| Some(DVec3::new(4.0 * time - 1.0, -0.9, 0.0));
        let mut tracks = vec![
            track(&times, 500.0, falls(0.0)),
            track(&times, 400.0, first),
            track(&times, 60.0, crumb),
            track(&times, 300.0, across),
        ];
        let fall = fall(&tracks, &times, SIZES).expect("things fall");
        assert!(fall.distance(GRAVITY) < 0.1, "{fall}");
        tracks.iter_mut().for_each(|track| track.fall = Some(fall));
        let chain = |at: usize| Chain { seen: vec![(at, at)], met: Vec::new() };
        let mut chains: Vec<Chain> = (0..4).map(chain).collect();
        forget(&mut chains, &tracks, &times, SIZES);
        assert_eq!(chains, [chain(0), chain(1), chain(3)]);
    }

    #[test]
    fn what_most_things_accelerate_by_is_how_things_fall() {
        let flung = DVec3::new(9.0, 2.0, 0.0);
        assert_eq!(usual([GRAVITY, GRAVITY, flung].into_iter()), Some(GRAVITY));
        assert_eq!(usual([GRAVITY, flung].into_iter()), None);
        assert_eq!(usual([0.1 * GRAVITY].into_iter()), None);
    }

    #[test]
    fn nothing_falls_where_all_goes_straight_or_each_as_it_likes() {
        let times: Vec<f64> = (0..10).map(|at| f64::from(at) / 15.0).collect();
        let straight = track(&times, 300.0, |_, time| Some(DVec3::X * time));
        assert_eq!(fall(&[straight], &times, SIZES), None);
        let pulled = |pull: DVec3| track(&times, 300.0, move |_, time| Some(0.5 * time * time * pull));
        assert_eq!(fall(&[pulled(GRAVITY), pulled(-GRAVITY)], &times, SIZES), None);
        assert_eq!(fall(&[], &times, SIZES), None);
    }
}
