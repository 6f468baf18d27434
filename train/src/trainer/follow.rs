//! Bodies are followed: the fine stage learns from a part of the recording more often at first, which grows to both sides from its middle.
//!
//! Where a body is known a while before and after, an error of its start a little beyond is small, however wrong it is at the ends. Those
//! that are followed, since frames did not tell how they turn, are there in the part alone: elsewhere they would learn what is wrong. All
//! others learn from all of the recording, as errors of poses that frames told do not add up, and what is blurred at first finds to itself
//! even across a bounce.
//!
//! What bends is followed from the frame at which it was seen best: its nodes know nothing of how they go, so that little more than one
//! exposure is the first part, and it grows by less.

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
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Follow {
    middle: f64,
    first: f64,
    step: f64,
    steps: u32,
    /// Of the fine stage.
    share: f64,
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
    /// For bodies that are in view in `spans`, in a recording of so many RGB `intervals`; none where nothing is to be gained. `bends` is
    /// the exposure that those that bend are followed from, in [0, 1].
    pub fn new(spans: &[[f64; 2]], intervals: f64, bends: Option<[f64; 2]>, config: &Config) -> Option<Self> {
        let earl = &config.earl;
        // Events are drawn from the part only where frames and they are not one pool, and pairs lie anywhere.
        let draws = !earl.enabled || (earl.share > 0.0 && earl.pairing != Pairing::FrameAnchored);
        let share = f64::from(config.bodies.follow);
        if share <= 0.0 || !draws {
            return None;
        }
        let away = |span: &[f64; 2]| (span[0] - 0.5).max(0.5 - span[1]).max(0.0);
        let nearest = spans.iter().filter(|span| span[0] <= span[1]).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        let middle = 0.5_f64.clamp(nearest[0], nearest[1]).clamp(0.0, 1.0);
        let whole = intervals.max(1e-6);
        let (middle, first, step, fewest, share) = match bends {
            None => (middle, FIRST / whole, STEP, FEWEST, share),
            Some([begin, end]) => {
                let first = (FIRST_BENT / whole).max(0.5 * (end - begin) + BEYOND / whole);
                ((0.5 * (begin + end)).clamp(0.0, 1.0), first, STEP_BENT, FEWEST_BENT, share.max(SHARE_BENT))
            }
        };
        let rest = middle.max(1.0 - middle) - first;
        let most = (share * f64::from(config.fine_iterations) / fewest - LEAD).floor();
        let steps = (rest * intervals / step).ceil().min(most);
        (steps >= 1.0).then(|| Self { middle, first, step: rest / steps, steps: steps as u32, share })
    }

    /// How often the part is to have grown when so much of the fine stage is done; none once it is the whole.
    fn due(&self, progress: f64) -> Option<u32> {
        let at = progress / self.share * (f64::from(self.steps) + LEAD) - LEAD + 1.0;
        (progress < self.share).then(|| (at.max(0.0) as u32).min(self.steps))
    }

    fn window(&self, grown: u32) -> [f64; 2] {
        let reach = self.first + self.step * f64::from(grown);
        [(self.middle - reach).max(0.0), (self.middle + reach).min(1.0)]
    }
}

impl Trainer<'_> {
    /// How the bodies of the fine stage are followed.
    pub(super) fn start_following(&mut self) {
        let bodies = self.model.drawn.motion.as_ref().and_then(Motion::bodies);
        // What its looks tell at all instants need not be followed.
        let bodies = bodies.filter(|bodies| bodies.some_are_followed());
        self.follow = bodies.and_then(|bodies| {
            let bends = bodies.seen_best().and_then(|at| self.exposure_nearest(at));
            Follow::new(bodies.spans(), self.scene.intervals(), bends, &self.config)
        });
    }

    /// The exposure whose middle is nearest to an instant; all in [0, 1].
    fn exposure_nearest(&self, at: f64) -> Option<[f64; 2]> {
        let exposures = self.scene.frames.iter().map(|frame| frame.exposure);
        let away = |[begin, end]: &[f64; 2]| (0.5 * (begin + end) - at).abs();
        exposures.min_by(|a, b| away(a).total_cmp(&away(b)))
    }

    /// The part of the recording that is looked at more often now, while bodies are followed.
    pub(super) fn part(&self) -> Option<Part> {
        let follow = self.follow?;
        follow.due(self.schedule.progress(&self.clock))?;
        let grown = self.clock.followed;
        Some(Part { whole: follow.window(grown), before: follow.window(grown.saturating_sub(1)) })
    }

    /// Lets the part grow if it is to, and carries what was learned in it on beyond it.
    pub(super) fn follow(&mut self) -> Result<(), TrainError> {
        let Some(follow) = self.follow else { return Ok(()) };
        let due = follow.due(self.schedule.progress(&self.clock));
        let (grown, to) = (self.clock.followed, due.unwrap_or(follow.steps));
        let first = self.clock.iteration == 0;
        let bodies = self.model.drawn.motion.as_mut().and_then(Motion::bodies_mut);
        if let Some(bodies) = bodies.filter(|_| first || to > grown) {
            if !first {
                bodies.carry_on(self.gpu, follow.window(grown))?;
            }
            bodies.show_followed(self.gpu, Some(follow.window(to)))?;
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

    #[test]
    fn the_part_grows_from_the_middle_until_it_is_all() {
        let follow = Follow::new(&[[0.0, 1.0], [0.7, 1.0]], 9.0, None, &config(1000)).unwrap();
        assert_eq!(follow.due(0.0), Some(0));
        let first = follow.window(0);
        assert!((first[0] + first[1] - 1.0).abs() < 1e-12 && (first[1] - first[0] - 2.2 / 9.0).abs() < 1e-12);
        let mut last = first;
        for thousandth in 0..400 {
            let due = follow.due(0.001 * f64::from(thousandth)).unwrap();
            let window = follow.window(due);
            assert!(window[0] <= last[0] && window[1] >= last[1]);
            last = window;
        }
        assert!(last[0] < 1e-12 && last[1] > 1.0 - 1e-12, "{last:?}");
        assert_eq!(follow.due(f64::from(config(1000).bodies.follow)), None);
        // With few iterations by more at a time.
        let hasty = Follow::new(&[[0.0, 1.0]], 9.0, None, &config(200)).unwrap();
        assert!(hasty.steps < follow.steps && hasty.window(hasty.steps) == [0.0, 1.0]);
    }

    #[test]
    fn where_nothing_is_in_view_in_the_middle_it_begins_elsewhere() {
        let follow = Follow::new(&[[0.0, 0.3], [0.8, 1.0]], 12.0, None, &config(1000)).unwrap();
        assert!((follow.middle - 0.3).abs() < 1e-12);
        assert_eq!(follow.window(follow.steps), [0.0, 1.0]);
    }

    #[test]
    fn what_bends_is_followed_from_the_exposure_in_which_it_was_seen_best() {
        let exposure = [0.55, 0.65];
        let follow = Follow::new(&[[0.0, 1.0]], 9.0, Some(exposure), &config(1000)).unwrap();
        let first = follow.window(0);
        assert!(first[0] < exposure[0] && first[1] > exposure[1], "{first:?}");
        assert!((first[0] + first[1] - 1.2).abs() < 1e-12 && first[1] - first[0] < 2.0 * FIRST / 9.0, "{first:?}");
        let rigid = Follow::new(&[[0.0, 1.0]], 9.0, None, &config(1000)).unwrap();
        assert!(follow.step < 0.6 * rigid.step, "by smaller steps");
        assert_eq!(follow.window(follow.steps), [0.0, 1.0]);
        assert!(follow.due(0.79).is_some() && follow.due(0.8).is_none());
    }

    #[test]
    fn short_recordings_and_those_without_bodies_are_learned_from_at_once() {
        assert_eq!(Follow::new(&[], 9.0, None, &config(1000)), None);
        assert_eq!(Follow::new(&[[0.0, 1.0]], 2.0, None, &config(1000)), None);
        assert_eq!(Follow::new(&[[0.0, 1.0]], 9.0, None, &config(40)), None);
        assert_eq!(Follow::new(&[[f64::NAN, f64::NAN]], 9.0, None, &config(1000)), None);
        let mut off = config(1000);
        off.bodies.follow = 0.0;
        assert_eq!(Follow::new(&[[0.0, 1.0]], 9.0, None, &off), None);
        let mut anchored = config(1000);
        anchored.earl.pairing = Pairing::FrameAnchored;
        assert_eq!(Follow::new(&[[0.0, 1.0]], 9.0, None, &anchored), None);
    }
}
