//! Where a board's corners were at a time between a camera's frames.
//!
//! Cameras that do not run together see a board that moves at other instants. A corner is brought to an instant along its own
//! track: by Hermite's cubic between two frames, by a straight line beyond them. The speed there is kept, since it ties the
//! camera's time offset to what was seen; it is that at both ends of the interval, whose noise has little to do with that of the
//! place between them.

use glam::DVec2;

use super::BoardView;

/// Frames farther apart say nothing about what was between them, seconds.
const NEAR_S: f64 = 0.5;
/// So near to a frame it is that frame, seconds.
const SAME_S: f64 = 1e-5;
/// What a cubic may be wrong by, as a share of what lies between it and a straight line.
const CUBIC: f64 = 0.1;
/// What a straight line beyond the last frame may be wrong by, as a share of the way.
const BEYOND: f64 = 0.3;

/// A corner at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Passing {
    /// Where, pixels.
    pub pixel: DVec2,
    /// How fast, pixels a second.
    pub velocity: DVec2,
    /// What bringing it there may be wrong by, pixels.
    pub extra_px: f64,
}

/// The views of one camera in order of time.
pub(super) struct Track<'a> {
    views: Vec<(f64, &'a BoardView)>,
    time: fn(&BoardView) -> Option<f64>,
    /// How fast corners move in half of the views, pixels a second.
    typical: f64,
}

impl<'a> Track<'a> {
    /// Of the views that have times.
    pub fn of(views: &'a [BoardView]) -> Self {
        Self::by(views, |view| view.time_s)
    }

    /// Of pictures without times, whose numbers tell their order: a second of it is ten of them.
    pub fn by_number(views: &'a [BoardView]) -> Self {
        Self::by(views, |view| view.instant.parse::<u32>().ok().map(|number| 0.1 * f64::from(number)))
    }

    fn by(views: &'a [BoardView], time: fn(&BoardView) -> Option<f64>) -> Self {
        let timed = views.iter().filter_map(|view| Some((time(view)?, view)));
        let mut views: Vec<(f64, &BoardView)> = timed.filter(|(time, _)| time.is_finite()).collect();
        views.sort_by(|a, b| a.0.total_cmp(&b.0));
        views.dedup_by(|a, b| a.0 - b.0 < SAME_S);
        let mut track = Self { views, time, typical: 0.0 };
        let speeds = (0..track.views.len()).filter_map(|index| track.speed(index));
        track.typical = crate::statistics::median(speeds).unwrap_or(0.0);
        track
    }

    /// How fast the corners of a view move, root mean square, pixels a second; `None` where no frame is near.
    pub fn speed_of(&self, view: &BoardView) -> Option<f64> {
        self.speed(self.index(view)?)
    }

    fn speed(&self, index: usize) -> Option<f64> {
        let corners = &self.views[index].1.corners;
        let each = corners.iter().filter_map(|corner| self.slope(index, corner.id)).map(DVec2::length_squared);
        let (sum, count) = each.fold((0.0, 0_usize), |(sum, count), square| (sum + square, count + 1));
        (count > 0).then(|| (sum / count as f64).sqrt())
    }

    /// The corner `id`, which `view` shows, at a time of this camera's clock.
    pub fn at(&self, view: &BoardView, id: u32, time_s: f64) -> Option<Passing> {
        let index = self.index(view)?;
        let (own_s, _) = self.views[index];
        let (pixel, ahead_s) = (self.pixel(index, id)?, time_s - own_s);
        let slope = self.slope(index, id);
        if ahead_s.abs() > SAME_S {
            let after = self.views.partition_point(|(time, _)| *time < time_s);
            if let Some(passing) = after.checked_sub(1).and_then(|before| self.between(before, id, time_s)) {
                return Some(passing);
            }
        }
        let velocity = slope.unwrap_or(DVec2::ZERO);
        let unknown = if slope.is_some() { BEYOND * velocity.length() } else { self.typical };
        Some(Passing { pixel: pixel + velocity * ahead_s, velocity, extra_px: unknown * ahead_s.abs() })
    }

    fn between(&self, before: usize, id: u32, time_s: f64) -> Option<Passing> {
        let (start_s, end_s) = (self.views[before].0, self.views.get(before + 1)?.0);
        let span = end_s - start_s;
        if span >= NEAR_S {
            return None;
        }
        let (from, to) = (self.pixel(before, id)?, self.pixel(before + 1, id)?);
        let slope = |index| self.slope(index, id).unwrap_or((to - from) / span);
        let (start, end) = (slope(before) * span, slope(before + 1) * span);
        let u = (time_s - start_s) / span;
        let (u2, u3) = (u * u, u * u * u);
        let pixel = from * (2.0 * u3 - 3.0 * u2 + 1.0)
            + start * (u3 - 2.0 * u2 + u)
            + to * (3.0 * u2 - 2.0 * u3)
            + end * (u3 - u2);
        let bent = (pixel - from.lerp(to, u)).length();
        Some(Passing { pixel, velocity: start.lerp(end, u) / span, extra_px: CUBIC * bent })
    }

    /// How fast a corner moves in a view, pixels a second: the slope of the parabola through the frames before and after, or of
    /// the line to the one of them that is near.
    fn slope(&self, index: usize, id: u32) -> Option<DVec2> {
        let (here_s, here) = (self.views[index].0, self.pixel(index, id)?);
        let towards = |other: usize| {
            let apart_s = self.views.get(other)?.0 - here_s;
            (apart_s.abs() < NEAR_S).then_some(())?;
            Some(((self.pixel(other, id)? - here) / apart_s, apart_s.abs()))
        };
        match (index.checked_sub(1).and_then(towards), towards(index + 1)) {
            (Some((before, long)), Some((after, short))) => Some((before * short + after * long) / (long + short)),
            (one, other) => one.or(other).map(|(slope, _)| slope),
        }
    }

    fn pixel(&self, index: usize, id: u32) -> Option<DVec2> {
        let corners = &self.views.get(index)?.1.corners;
        corners.iter().find(|corner| corner.id == id).map(|corner| corner.pixel)
    }

    /// Which of the views it is, or the one that was taken at its time.
    fn index(&self, view: &BoardView) -> Option<usize> {
        let time_s = (self.time)(view)?;
        let index = self.views.partition_point(|(time, _)| *time < time_s - SAME_S);
        self.views.get(index).filter(|(time, _)| (time - time_s).abs() < 2.0 * SAME_S).map(|_| index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::Corner;

    /// A corner that goes around a circle of 100 pixels once in `round_s`, seen every tenth of a second.
    fn circle(round_s: f64, skip: &[usize]) -> Vec<BoardView> {
        let view = |number: usize| {
            let time_s = 0.1 * number as f64;
            let corners = vec![Corner { id: 3, pixel: place(time_s, round_s) }];
            BoardView { instant: number.to_string(), time_s: Some(time_s), file: "drawn".into(), frame: 0, corners }
        };
        (0..30).filter(|number| !skip.contains(number)).map(view).collect()
    }

    fn place(time_s: f64, round_s: f64) -> DVec2 {
        DVec2::new(300.0, 200.0) + 100.0 * DVec2::from_angle(std::f64::consts::TAU * time_s / round_s)
    }

    #[test]
    fn a_corner_is_where_its_path_leads_and_says_how_far_it_may_be_off() {
        for round_s in [1.5, 3.0] {
            let views = circle(round_s, &[20]);
            let track = Track::of(&views);
            let speed = std::f64::consts::TAU * 100.0 / round_s;
            assert!((track.speed_of(&views[7]).unwrap() / speed - 1.0).abs() < 0.05);
            // In its frame, between frames, across a frame that lacks, a frame ahead.
            for time_s in [0.7, 0.73, 0.78, 2.02, 1.0] {
                let passing = track.at(&views[7], 3, time_s).unwrap();
                let off = passing.pixel.distance(place(time_s, round_s));
                assert!(off <= passing.extra_px + 1e-9 && off < 2.0, "{round_s} {time_s}: {off} {passing:?}");
                let straight = 0.5 * (std::f64::consts::TAU / round_s).powi(2) * 100.0 * (time_s - 0.7).powi(2);
                assert!(time_s < 0.72 || off < 0.5 * straight, "no better than a straight line: {off} {straight}");
                assert!((passing.velocity.length() / speed - 1.0).abs() < 0.15, "{passing:?}");
            }
        }
    }

    #[test]
    fn beyond_the_last_frame_and_alone_it_says_how_little_is_known() {
        let views = circle(3.0, &[]);
        let beyond = Track::of(&views).at(&views[29], 3, 2.95).unwrap();
        assert!((0.3..5.0).contains(&beyond.extra_px), "{beyond:?}");
        assert!(beyond.pixel.distance(place(2.95, 3.0)) < beyond.extra_px);
        // A view with none near it is taken as it is.
        let alone = [views[7].clone()];
        let passing = Track::of(&alone).at(&alone[0], 3, 0.75).unwrap();
        assert_eq!((passing.pixel, passing.velocity), (alone[0].corners[0].pixel, DVec2::ZERO));
        assert_eq!(Track::of(&alone).speed_of(&alone[0]), None);
        assert_eq!(Track::of(&views).at(&views[3], 9, 0.3), None);
    }
}
