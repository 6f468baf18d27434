//! Bodies are followed: the fine stage learns from a part of the recording more often at first, which grows to both sides from its middle.
//!
//! Where a body is known a while before and after, an error of its start a little beyond is small, however wrong it is at the ends. Those
//! that are followed, since frames did not tell how they turn, are there in the part alone: elsewhere they would learn what is wrong. All
//! others learn from all of the recording, as errors of poses that frames told do not add up, and what is blurred at first finds to itself
//! even across a bounce.
//!
//! What bends is followed from a frame at which it was seen, each piece of it from its own: its nodes know nothing of how they go, so that
//! little more than one exposure is the first part, and it grows by less.

use super::{TrainError, Trainer};
use crate::config::{Config, Pairing};
use erfgs_splat::motion::Motion;

/// The first part reaches so many RGB intervals to either side, and grows by so many at a time.
const FIRST: f64 = 1.1;
const STEP: f64 = 0.25;
/// The first part has as long as so many steps.
const LEAD: f64 = 2.0;
/// Each step has at least so many iterations; with less time, the part grows by more.
const FEWEST: f64 = 20.0;
/// The same of what bends, and for how much of the fine stage it is followed.
const FIRST_BENT: f64 = 0.31;
const STEP_BENT: f64 = 0.125;
const FEWEST_BENT: f64 = 10.0;
const SHARE_BENT: f64 = 0.8;
/// The first part reaches so far beyond the exposure in its middle, RGB intervals.
const BEYOND: f64 = 0.1;

/// How the part that is learned from grows. Times are in [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Follow {
    /// Of each body; none of those that are not followed.
    windows: Vec<Option<Window>>,
    steps: u32,
    /// Of the fine stage.
    share: f64,
}

/// When a body is shown while it is followed: so far to either side of an instant, and farther by so much with each step.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Window {
    middle: f64,
    first: f64,
    step: f64,
}

impl Window {
    fn grown(&self, steps: u32) -> [f64; 2] {
        let reach = self.first + self.step * f64::from(steps);
        [(self.middle - reach).max(0.0), (self.middle + reach).min(1.0)]
    }
}

/// A body that is followed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    /// When it is in view, in [0, 1].
    pub span: [f64; 2],
    /// The exposure that it is followed from if it bends, in [0, 1].
    pub bends: Option<[f64; 2]>,
}

/// A part of the recording that is looked at more often, in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    /// From when to when.
    pub whole: [f64; 2],
    /// The same before it grew last.
    pub before: [f64; 2],
}

impl Follow {
    /// For `bodies` (none: it is not followed) in a recording of so many RGB `intervals`; none where nothing is to be gained.
    pub fn new(bodies: &[Option<Followed>], intervals: f64, config: &Config) -> Option<Self> {
        let earl = &config.earl;
        // Events are drawn from the part only where frames and they are not one pool, and pairs lie anywhere.
        let draws = !earl.enabled || (earl.share > 0.0 && earl.pairing != Pairing::FrameAnchored);
        let share = f64::from(config.bodies.follow);
        if share <= 0.0 || !draws {
            return None;
        }
        let whole = intervals.max(1e-6);
        let rigid = bodies.iter().flatten().filter(|body| body.bends.is_none()).map(|body| body.span);
        let away = |span: &[f64; 2]| (span[0] - 0.5).max(0.5 - span[1]).max(0.0);
        let nearest = rigid.filter(|span| span[0] <= span[1]).min_by(|a, b| away(a).total_cmp(&away(b)));
        // Those that do not bend are followed from one instant, and all of them are shown from the same instants on.
        let middle = nearest.map(|span| 0.5_f64.clamp(span[0], span[1]).clamp(0.0, 1.0));
        // Where each begins, how far it goes, and how long its steps may be.
        let way = |body: &Followed| match body.bends {
            None => middle.map(|middle| (middle, FIRST / whole, middle.max(1.0 - middle), STEP)),
            Some([begin, end]) => {
                let middle = (0.5 * (begin + end)).clamp(0.0, 1.0);
                let first = (FIRST_BENT / whole).max(0.5 * (end - begin) + BEYOND / whole);
                let far = (middle - body.span[0]).max(body.span[1] - middle);
                Some((middle, first, far, STEP_BENT))
            }
        };
        let ways: Vec<_> = bodies.iter().map(|body| body.as_ref().and_then(way)).collect();
        let bends = bodies.iter().flatten().any(|body| body.bends.is_some());
        let (fewest, share) = if bends { (FEWEST_BENT, share.max(SHARE_BENT)) } else { (FEWEST, share) };
        let most = (share * f64::from(config.fine_iterations) / fewest - LEAD).floor();
        let needed = ways.iter().flatten().map(|(_, first, far, step)| ((far - first) * intervals / step).ceil());
        let steps = needed.fold(0.0, f64::max).min(most);
        let window = |(middle, first, far, _): (f64, f64, f64, f64)| Window {
            middle,
            first,
            step: (far - first).max(0.0) / steps,
        };
        let windows = ways.into_iter().map(|way| way.map(window)).collect();
        (steps >= 1.0).then_some(Self { windows, steps: steps as u32, share })
    }

    /// How often the part is to have grown when so much of the fine stage is done; none once it is the whole.
    fn due(&self, progress: f64) -> Option<u32> {
        let at = progress / self.share * (f64::from(self.steps) + LEAD) - LEAD + 1.0;
        (progress < self.share).then(|| (at.max(0.0) as u32).min(self.steps))
    }

    /// Of each body, after so many steps.
    fn grown(&self, steps: u32) -> Vec<[f64; 2]> {
        self.windows.iter().map(|window| window.map_or([0.0, 1.0], |window| window.grown(steps))).collect()
    }

    /// The parts of the recording that bodies are shown in after so many steps, each once.
    fn parts(&self, steps: u32) -> Vec<Part> {
        let mut parts: Vec<Part> = Vec::new();
        for window in self.windows.iter().flatten() {
            let part = Part { whole: window.grown(steps), before: window.grown(steps.saturating_sub(1)) };
            if !parts.contains(&part) {
                parts.push(part);
            }
        }
        parts
    }
}

impl Trainer<'_> {
    /// How the bodies of the fine stage are followed.
    pub(super) fn start_following(&mut self) {
        let bodies = self.model.drawn.motion.as_ref().and_then(Motion::bodies);
        self.follow = bodies.and_then(|bodies| {
            // What its looks tell at all instants need not be followed.
            let followed = |body: usize| {
                let exposure = bodies.bends()[body].and_then(|at| self.exposure_nearest(at));
                bodies.followed()[body].then(|| Followed { span: bodies.spans()[body], bends: exposure })
            };
            let all: Vec<_> = (0..bodies.names().len()).map(followed).collect();
            Follow::new(&all, self.scene.intervals(), &self.config)
        });
    }

    /// The exposure whose middle is nearest to an instant; all in [0, 1].
    fn exposure_nearest(&self, at: f64) -> Option<[f64; 2]> {
        let exposures = self.scene.frames.iter().map(|frame| frame.exposure);
        let away = |[begin, end]: &[f64; 2]| (0.5 * (begin + end) - at).abs();
        exposures.min_by(|a, b| away(a).total_cmp(&away(b)))
    }

    /// The parts of the recording that are looked at more often now, while bodies are followed.
    pub(super) fn parts(&self) -> Vec<Part> {
        let Some(follow) = &self.follow else { return Vec::new() };
        let due = follow.due(self.schedule.progress(&self.clock));
        due.map_or(Vec::new(), |_| follow.parts(self.clock.followed))
    }

    /// Lets the parts grow if they are to, and carries what was learned in them on beyond them.
    pub(super) fn follow(&mut self) -> Result<(), TrainError> {
        let Some(follow) = &self.follow else { return Ok(()) };
        let due = follow.due(self.schedule.progress(&self.clock));
        let (grown, to) = (self.clock.followed, due.unwrap_or(follow.steps));
        let first = self.clock.iteration == 0;
        let bodies = self.model.drawn.motion.as_mut().and_then(Motion::bodies_mut);
        if let Some(bodies) = bodies.filter(|_| first || to > grown) {
            if !first {
                bodies.carry_on(self.gpu, &follow.grown(grown))?;
            }
            bodies.show_followed(self.gpu, Some(&follow.grown(to)))?;
            self.clock.followed = to;
        }
        if due.is_none() { self.end_following() } else { Ok(()) }
    }

    /// Shows bodies that were followed whenever they are in view: from now on all of the recording is learned from.
    pub(super) fn end_following(&mut self) -> Result<(), TrainError> {
        let bodies = self.model.drawn.motion.as_mut().and_then(Motion::bodies_mut);
        if let (Some(follow), Some(bodies)) = (self.follow.take(), bodies)
            && self.clock.followed <= follow.steps
        {
            bodies.show_followed(self.gpu, None)?;
            self.clock.followed = follow.steps + 1;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Method, MotionModel, Preset};

    fn config(iterations: u32) -> Config {
        let mut config = Config::preset(Method::ErfGs, Preset::Default);
        config.motion = MotionModel::Bodies;
        config.fine_iterations = iterations;
        config
    }

    fn rigid(spans: &[[f64; 2]]) -> Vec<Option<Followed>> {
        spans.iter().map(|&span| Some(Followed { span, bends: None })).collect()
    }

    #[test]
    fn the_part_grows_from_the_middle_until_it_is_all() {
        let follow = Follow::new(&rigid(&[[0.0, 1.0], [0.7, 1.0]]), 9.0, &config(1000)).unwrap();
        assert_eq!(follow.due(0.0), Some(0));
        assert_eq!(follow.parts(3).len(), 1, "all that is rigid is followed from one instant");
        let first = follow.grown(0)[0];
        assert!((first[0] + first[1] - 1.0).abs() < 1e-12 && (first[1] - first[0] - 2.2 / 9.0).abs() < 1e-12);
        let mut last = first;
        for thousandth in 0..400 {
            let due = follow.due(0.001 * f64::from(thousandth)).unwrap();
            let window = follow.grown(due)[1];
            assert!(window[0] <= last[0] && window[1] >= last[1]);
            last = window;
        }
        assert!(last[0] < 1e-12 && last[1] > 1.0 - 1e-12, "{last:?}");
        assert_eq!(follow.due(f64::from(config(1000).bodies.follow)), None);
        // With few iterations by more at a time.
        let hasty = Follow::new(&rigid(&[[0.0, 1.0]]), 9.0, &config(200)).unwrap();
        assert!(hasty.steps < follow.steps && hasty.grown(hasty.steps) == [[0.0, 1.0]]);
    }

    #[test]
    fn where_nothing_is_in_view_in_the_middle_it_begins_elsewhere() {
        let follow = Follow::new(&rigid(&[[0.0, 0.3], [0.8, 1.0]]), 12.0, &config(1000)).unwrap();
        assert!((follow.windows[0].unwrap().middle - 0.3).abs() < 1e-12);
        assert_eq!(follow.grown(follow.steps), [[0.0, 1.0]; 2]);
    }

    #[test]
    fn what_bends_is_followed_from_the_exposure_in_which_it_was_seen_best() {
        let exposure = [0.55, 0.65];
        let bends = Some(Followed { span: [0.0, 1.0], bends: Some(exposure) });
        let follow = Follow::new(&[bends, None], 9.0, &config(1000)).unwrap();
        let [first, other] = follow.grown(0)[..] else { panic!("two bodies") };
        assert!(first[0] < exposure[0] && first[1] > exposure[1], "{first:?}");
        assert!((first[0] + first[1] - 1.2).abs() < 1e-12 && first[1] - first[0] < 2.0 * FIRST / 9.0, "{first:?}");
        assert_eq!(other, [0.0, 1.0], "what is not followed is shown whenever it is in view");
        let of_rigid = Follow::new(&rigid(&[[0.0, 1.0]]), 9.0, &config(1000)).unwrap();
        assert!(follow.windows[0].unwrap().step < 0.6 * of_rigid.windows[0].unwrap().step, "by smaller steps");
        assert_eq!(follow.grown(follow.steps)[0], [0.0, 1.0]);
        assert!(follow.due(0.79).is_some() && follow.due(0.8).is_none());
    }

    #[test]
    fn pieces_grow_together_each_from_its_own_instant_until_they_meet() {
        let piece =
            |begin: f64, at: f64, end: f64| Some(Followed { span: [begin, end], bends: Some([at - 0.02, at + 0.02]) });
        let pieces = [piece(0.0, 0.15, 0.3), piece(0.3, 0.45, 0.65), piece(0.65, 0.85, 1.0)];
        let follow = Follow::new(&pieces, 9.0, &config(1000)).unwrap();
        let one = Follow::new(&[piece(0.0, 0.45, 1.0)], 9.0, &config(1000)).unwrap();
        assert!(2 * follow.steps < one.steps, "{} and {} steps", follow.steps, one.steps);
        for steps in 0..=follow.steps {
            let parts = follow.parts(steps);
            assert_eq!(parts.len(), 3);
            assert!(parts.iter().all(|part| part.whole[0] <= part.before[0] && part.whole[1] >= part.before[1]));
        }
        for (window, piece) in std::iter::zip(follow.grown(follow.steps), pieces) {
            let [begin, end] = piece.unwrap().span;
            assert!(window[0] <= begin + 1e-12 && window[1] >= end - 1e-12, "{window:?}");
        }
    }

    #[test]
    fn short_recordings_and_those_without_bodies_are_learned_from_at_once() {
        let whole = rigid(&[[0.0, 1.0]]);
        assert_eq!(Follow::new(&[], 9.0, &config(1000)), None);
        assert_eq!(Follow::new(&[None], 9.0, &config(1000)), None);
        assert_eq!(Follow::new(&whole, 2.0, &config(1000)), None);
        assert_eq!(Follow::new(&whole, 9.0, &config(40)), None);
        assert_eq!(Follow::new(&rigid(&[[f64::NAN, f64::NAN]]), 9.0, &config(1000)), None);
        let mut off = config(1000);
        off.bodies.follow = 0.0;
        assert_eq!(Follow::new(&whole, 9.0, &off), None);
        let mut anchored = config(1000);
        anchored.earl.pairing = Pairing::FrameAnchored;
        assert_eq!(Follow::new(&whole, 9.0, &anchored), None);
    }
}
