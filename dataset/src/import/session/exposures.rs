//! Exposures of one camera that overlap.
//!
//! A sensor ends one exposure before it begins the next. Where the recording has it otherwise, the camera did not take the exposure that it
//! was set to (many shorten one that is longer than their frame interval without a word), or its stamps are off by more than the gap.

use erfgs_base::plausible::OVERLAP;
use erfgs_scene::ImageRgb8;

/// The exposure of a frame by its middle and half its length, session nanoseconds; the half is 0 where the length is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Shot {
    pub mid_ns: i64,
    pub half_ns: i64,
}

impl Shot {
    pub fn between([open, close]: [i64; 2]) -> Self {
        Self { mid_ns: i64::midpoint(open, close), half_ns: (close.saturating_sub(open) / 2).max(0) }
    }

    /// When the shutter opened and closed.
    pub fn exposure_ns(self) -> [i64; 2] {
        [self.mid_ns.saturating_sub(self.half_ns), self.mid_ns.saturating_add(self.half_ns)]
    }
}

/// What was taken off the exposures of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Overlaps {
    /// Frames whose exposures were shortened.
    pub frames: u64,
    /// The longest exposure of them before.
    pub longest_ns: i64,
    /// The shortest time between two of them.
    pub apart_ns: i64,
}

/// Shortens exposures that overlap, so that each ends half-way to the middle of the next; their middles stay. `shots` are ordered.
pub(super) fn part(shots: &mut [Shot]) -> Option<Overlaps> {
    let whole: Vec<i64> = shots.iter().map(|shot| shot.half_ns).collect();
    let mut apart_ns = i64::MAX;
    for at in 1..shots.len() {
        let gap_ns = shots[at].mid_ns.saturating_sub(shots[at - 1].mid_ns);
        let over_ns = whole[at - 1].saturating_add(whole[at]).saturating_sub(gap_ns);
        if over_ns as f64 <= OVERLAP.most * gap_ns as f64 {
            continue;
        }
        apart_ns = apart_ns.min(gap_ns);
        for shot in &mut shots[at - 1..=at] {
            shot.half_ns = shot.half_ns.min(gap_ns / 2);
        }
    }
    let shortened = shots.iter().zip(&whole).filter(|(shot, whole)| shot.half_ns < **whole);
    let (mut frames, mut longest_ns) = (0, 0);
    for (_, whole) in shortened {
        frames += 1;
        longest_ns = longest_ns.max(2 * whole);
    }
    (frames > 0).then_some(Overlaps { frames, longest_ns, apart_ns })
}

/// The same of the pictures that an event camera took, which are put into order.
pub(super) fn part_pictures(pictures: &mut [([i64; 2], ImageRgb8)]) -> Option<Overlaps> {
    pictures.sort_by_key(|(exposure, _)| Shot::between(*exposure));
    let mut shots: Vec<Shot> = pictures.iter().map(|(exposure, _)| Shot::between(*exposure)).collect();
    let overlaps = part(&mut shots)?;
    for ((exposure, _), shot) in pictures.iter_mut().zip(shots) {
        // An odd nanosecond stays where nothing was taken off.
        if shot != Shot::between(*exposure) {
            *exposure = shot.exposure_ns();
        }
    }
    Some(overlaps)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn shots(length_us: i64, mids_us: &[i64]) -> Vec<Shot> {
        mids_us.iter().map(|mid| Shot { mid_ns: 1000 * mid, half_ns: 500 * length_us }).collect()
    }

    #[test]
    fn an_exposure_that_is_longer_than_the_frame_interval_ends_with_it() {
        let mut long = shots(40_000, &[0, 33_000, 66_000, 99_000]);
        let found = part(&mut long).unwrap();
        assert_eq!(found, Overlaps { frames: 4, longest_ns: 40_000_000, apart_ns: 33_000_000 });
        assert_eq!(long, shots(33_000, &[0, 33_000, 66_000, 99_000]));
        // One stamp is off: the others stay.
        let mut off = shots(20_000, &[0, 33_000, 45_000, 99_000]);
        assert_eq!(part(&mut off).unwrap(), Overlaps { frames: 2, longest_ns: 20_000_000, apart_ns: 12_000_000 });
        assert_eq!(off.iter().map(|shot| shot.half_ns / 1000).collect::<Vec<_>>(), [10_000, 6000, 6000, 10_000]);
        // Rounding is no overlap, and neither is an exposure of nobody knows how long.
        for (length, mids) in [(33_000, [0, 33_000, 65_000, 98_000]), (0, [0, 0, 0, 1])] {
            let mut good = shots(length, &mids);
            assert_eq!(part(&mut good), None);
            assert_eq!(good, shots(length, &mids));
        }
    }

    proptest! {
        #[test]
        fn what_is_left_is_plausible_and_in_its_place(
            frames in prop::collection::vec((1..i64::MAX / 64, 0..400_000_000_000_i64), 0..20),
        ) {
            let mut mid_ns = i64::MIN / 2;
            let given: Vec<Shot> = frames
                .into_iter()
                .map(|(gap, half_ns)| {
                    // Gaps of nanoseconds to years.
                    mid_ns = mid_ns.saturating_add(gap >> (gap % 60)).saturating_add(1);
                    Shot { mid_ns, half_ns }
                })
                .collect();
            let mut left = given.clone();
            let told = part(&mut left);
            prop_assert_eq!(told.is_some(), left != given);
            for (given, left) in given.iter().zip(&left) {
                prop_assert!(left.mid_ns == given.mid_ns && (0..=given.half_ns).contains(&left.half_ns));
                prop_assert_eq!(Shot::between(left.exposure_ns()), *left);
            }
            for pair in left.windows(2) {
                let shared = pair[0].exposure_ns()[1] - pair[1].exposure_ns()[0];
                prop_assert!(shared as f64 <= OVERLAP.most * (pair[1].mid_ns - pair[0].mid_ns) as f64);
            }
        }
    }
}
