//! The times that frames are labelled with.
//!
//! Cameras of one trigger expose at the same instants but for a different length, and free-running ones at instants of their
//! own. Where the middles of exposures lie next to each other, all of these frames get one label, so that the trainer has as
//! few instants as there are.

use super::Written;

/// Middles of exposures that lie within so much time are one instant, nanoseconds.
const SAME_NS: i64 = 100_000;

/// Gives frames of different views whose exposures have nearly the same middle one time, wherever it lies within all of
/// their exposures (or these are not known).
pub(super) fn share(views: &mut [Written]) {
    let mut order: Vec<(i64, usize, usize)> = Vec::new();
    for (at, view) in views.iter().enumerate() {
        order.extend(view.frames.iter().enumerate().map(|(index, frame)| (frame.t_ns, at, index)));
    }
    order.sort_unstable();
    let mut from = 0;
    while from < order.len() {
        let mut to = from + 1;
        while to < order.len()
            && order[to].0 - order[from].0 <= SAME_NS
            && order[from..to].iter().all(|&(_, view, _)| view != order[to].1)
        {
            to += 1;
        }
        let group = &order[from..to];
        let middle = group[group.len() / 2].0;
        for &(_, view, index) in group {
            let frame = &mut views[view].frames[index];
            let [start, end] = frame.exposure_ns;
            if start == end {
                frame.exposure_ns = [middle; 2];
            }
            frame.t_ns = if start == end { middle } else { middle.clamp(start, end) };
        }
        from = to;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Frame;

    fn view(view: usize, exposure_ns: i64, mids: &[i64]) -> Written {
        let frame = |&mid: &i64| Frame {
            file: "a".into(),
            t_ns: mid,
            exposure_ns: [mid - exposure_ns / 2, mid + exposure_ns / 2],
            mask: None,
        };
        Written { view, frames: mids.iter().map(frame).collect(), lost: 0 }
    }

    #[test]
    fn neighbouring_instants_become_one_and_stay_within_the_exposures() {
        let mut views = [
            view(0, 4_000_000, &[10_000_000, 30_000_000]),
            view(1, 0, &[10_030_000, 30_000_500]),
            view(2, 20_000, &[9_990_000, 30_300_000]),
        ];
        share(&mut views);
        let times: Vec<Vec<i64>> = views.iter().map(|v| v.frames.iter().map(|f| f.t_ns).collect()).collect();
        assert_eq!(times, [[10_000_000, 30_000_500], [10_000_000, 30_000_500], [10_000_000, 30_300_000]]);
        assert_eq!(views[1].frames[0].exposure_ns, [10_000_000; 2], "an unknown exposure stays an instant");
        for frame in views.iter().flat_map(|view| &view.frames) {
            assert!((frame.exposure_ns[0]..=frame.exposure_ns[1]).contains(&frame.t_ns));
        }
        // Two frames of one camera never share a time.
        let mut fast = [view(0, 0, &[0, 50_000]), view(1, 0, &[20_000])];
        share(&mut fast);
        assert_eq!(fast[0].frames[0].t_ns, fast[1].frames[0].t_ns);
        assert!(fast[0].frames[1].t_ns > fast[0].frames[0].t_ns);
    }
}
