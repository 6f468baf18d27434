//! Exposures of one camera that overlap.
//!
//! A sensor ends one exposure before it begins the next. Where the recording has it otherwise, the camera did not take the exposure that it
//! was set to (many shorten one that is longer than their frame interval without a word), or its stamps are off by more than the gap.

use erfgs_base::plausible::OVERLAP;
use erfgs_scene::ImageRgb8;
use erfgs_session::clock::Exposure;

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

/// Half of its length, nanoseconds; 0 where that is not known.
fn half_ns(exposure: &Exposure) -> i64 {
    (exposure.length_ns.unwrap_or(0) / 2).max(0)
}

/// Shortens exposures that overlap, so that each ends half-way to the middle of the next; their middles stay. `exposures` are ordered.
pub(super) fn part(exposures: &mut [Exposure]) -> Option<Overlaps> {
    let whole: Vec<i64> = exposures.iter().map(half_ns).collect();
    let mut apart_ns = i64::MAX;
    for at in 1..exposures.len() {
        let gap_ns = exposures[at].mid_ns.saturating_sub(exposures[at - 1].mid_ns);
        let over_ns = whole[at - 1].saturating_add(whole[at]).saturating_sub(gap_ns);
        if over_ns as f64 <= OVERLAP.most * gap_ns as f64 {
            continue;
        }
        apart_ns = apart_ns.min(gap_ns);
        // An odd nanosecond stays where nothing is taken off.
        for exposure in exposures[at - 1..=at].iter_mut().filter(|exposure| half_ns(exposure) > gap_ns / 2) {
            exposure.length_ns = Some(gap_ns / 2 * 2);
        }
    }
    let shortened = exposures.iter().zip(&whole).filter(|(exposure, whole)| half_ns(exposure) < **whole);
    let (mut frames, mut longest_ns) = (0, 0);
    for (_, whole) in shortened {
        frames += 1;
        longest_ns = longest_ns.max(2 * whole);
    }
    (frames > 0).then_some(Overlaps { frames, longest_ns, apart_ns })
}

/// The same of the pictures that an event camera took, which are put into order.
pub(super) fn part_pictures(pictures: &mut [([i64; 2], ImageRgb8)]) -> Option<Overlaps> {
    pictures.sort_by_key(|(span_ns, _)| Exposure::between(*span_ns));
    let mut exposures: Vec<Exposure> = pictures.iter().map(|(span_ns, _)| Exposure::between(*span_ns)).collect();
    let overlaps = part(&mut exposures)?;
    for ((span_ns, _), exposure) in pictures.iter_mut().zip(exposures) {
        *span_ns = exposure.span_ns();
    }
    Some(overlaps)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn exposures(length_us: i64, mids_us: &[i64]) -> Vec<Exposure> {
        let of = |mid: &i64| Exposure { mid_ns: 1000 * mid, length_ns: Some(1000 * length_us) };
        mids_us.iter().map(of).collect()
    }

    #[test]
    fn an_exposure_that_is_longer_than_the_frame_interval_ends_with_it() {
        let mut long = exposures(40_000, &[0, 33_000, 66_000, 99_000]);
        let found = part(&mut long).unwrap();
        assert_eq!(found, Overlaps { frames: 4, longest_ns: 40_000_000, apart_ns: 33_000_000 });
        assert_eq!(long, exposures(33_000, &[0, 33_000, 66_000, 99_000]));
        // One stamp is off: the others stay.
        let mut off = exposures(20_000, &[0, 33_000, 45_000, 99_000]);
        assert_eq!(part(&mut off).unwrap(), Overlaps { frames: 2, longest_ns: 20_000_000, apart_ns: 12_000_000 });
        assert_eq!(
            off.iter().map(|exposure| half_ns(exposure) / 1000).collect::<Vec<_>>(),
            [10_000, 6000, 6000, 10_000]
        );
        // Rounding is no overlap, and neither is an exposure of nobody knows how long.
        for (length, mids) in [(33_000, [0, 33_000, 65_000, 98_000]), (0, [0, 0, 0, 1])] {
            let mut good = exposures(length, &mids);
            assert_eq!(part(&mut good), None);
            assert_eq!(good, exposures(length, &mids));
        }
    }

    proptest! {
        #[test]
        fn what_is_left_is_plausible_and_in_its_place(
            frames in prop::collection::vec((1..i64::MAX / 64, 0..400_000_000_000_i64), 0..20),
        ) {
            let mut mid_ns = i64::MIN / 2;
            let given: Vec<Exposure> = frames
                .into_iter()
                .map(|(gap, half_ns)| {
                    // Gaps of nanoseconds to years.
                    mid_ns = mid_ns.saturating_add(gap >> (gap % 60)).saturating_add(1);
                    Exposure { mid_ns, length_ns: Some(2 * half_ns) }
                })
                .collect();
            let mut left = given.clone();
            let overlaps = part(&mut left);
            prop_assert_eq!(overlaps.is_some(), left != given);
            for (given, left) in given.iter().zip(&left) {
                prop_assert!(left.mid_ns == given.mid_ns && (0..=half_ns(given)).contains(&half_ns(left)));
                prop_assert_eq!(Exposure::between(left.span_ns()), *left);
            }
            for pair in left.windows(2) {
                let shared = pair[0].span_ns()[1] - pair[1].span_ns()[0];
                prop_assert!(shared as f64 <= OVERLAP.most * (pair[1].mid_ns - pair[0].mid_ns) as f64);
            }
        }
    }
}
