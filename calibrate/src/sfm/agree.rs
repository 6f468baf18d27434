//! Which cameras independent runs agree on.

use erfgs_scene::Pose;

use super::{
    align::{Alignment, Tolerance, align, spread},
    run::Placed,
};
use crate::geometry::Similarity;

/// A run's arrangement after its own adjustment.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// The run's name.
    pub name: String,
    /// Its cameras, by view.
    pub cameras: Vec<Option<Placed>>,
}

/// What the runs say about a camera.
#[derive(Clone, Debug, Default)]
pub(super) struct Verdict {
    /// Where most runs put it, in the frame of the reference.
    pub placed: Option<Placed>,
    /// The runs that put it there.
    pub alike: Vec<usize>,
    /// Where the others put it.
    pub others: Vec<(usize, Placed)>,
    /// Greatest distance among those that agree, as share of the arrangement's size.
    pub apart: f64,
}

impl Verdict {
    /// Whether at least two runs agree, and more than contradict.
    pub fn agreed(&self) -> bool {
        self.alike.len() >= 2 && self.alike.len() > self.others.len()
    }
}

/// What the runs agree on.
#[derive(Clone, Debug)]
pub(super) struct Agreement {
    /// The run in whose frame everything is.
    pub reference: usize,
    /// By view.
    pub verdicts: Vec<Verdict>,
    /// Size of the reference arrangement: root mean square distance of the cameras from their middle.
    pub size: f64,
    /// Two poses at most this far apart are alike.
    pub tolerance: Tolerance,
}

fn poses(cameras: &[Option<Placed>]) -> Vec<Option<Pose>> {
    cameras.iter().map(|camera| camera.as_ref().map(|camera| camera.pose)).collect()
}

/// Lays all runs over the one that agrees best with another. `share` of the arrangement's size and `angle` (radians) are
/// how far apart poses may be to be alike. `None` without two runs that agree on three cameras.
pub(super) fn agree(candidates: &[Candidate], share: f64, angle: f64) -> Option<Agreement> {
    let all: Vec<Vec<Option<Pose>>> = candidates.iter().map(|candidate| poses(&candidate.cameras)).collect();
    let tolerance = |to: &[Option<Pose>]| Tolerance { centre: share * spread(to), angle };
    let count = |alignment: &Alignment| alignment.alike.iter().filter(|alike| **alike).count();
    let onto = |reference: usize| -> Vec<Option<Alignment>> {
        let to = &all[reference];
        let one = |from: &Vec<Option<Pose>>| align(from, to, tolerance(to)).filter(|found| count(found) >= 3);
        all.iter().enumerate().map(|(run, from)| if run == reference { None } else { one(from) }).collect()
    };
    let total = |alignments: &[Option<Alignment>]| alignments.iter().flatten().map(count).sum::<usize>();
    let laid = (0..candidates.len()).map(|reference| (reference, onto(reference)));
    let (reference, alignments) = laid.max_by_key(|(run, laid)| (total(laid), std::cmp::Reverse(*run)))?;
    if total(&alignments) == 0 {
        return None;
    }
    let size = spread(&all[reference]);
    let tolerance = tolerance(&all[reference]);
    let views = all[reference].len();
    let verdict = |view: usize| {
        let entries: Vec<(usize, Placed)> = (0..candidates.len())
            .filter_map(|run| {
                let placed = candidates[run].cameras[view]?;
                if run == reference {
                    return Some((run, placed));
                }
                let similarity = alignments[run].as_ref()?.similarity;
                Some((run, Placed { pose: similarity.of_camera(&placed.pose), ..placed }))
            })
            .collect();
        judge(&entries, tolerance, size, reference)
    };
    let verdicts = (0..views).map(verdict).collect();
    Some(Agreement { reference, verdicts, size, tolerance })
}

/// Whether two poses in the same frame are alike.
pub(super) fn alike(a: &Pose, b: &Pose, tolerance: Tolerance) -> bool {
    let (centre, angle) = Similarity::IDENTITY.difference(a, b);
    centre <= tolerance.centre && angle <= tolerance.angle
}

/// The place that most entries have in common; the reference's among equals.
fn judge(entries: &[(usize, Placed)], tolerance: Tolerance, size: f64, reference: usize) -> Verdict {
    let near = |a: &Placed| entries.iter().filter(|(_, b)| alike(&a.pose, &b.pose, tolerance)).count();
    let best = entries.iter().max_by_key(|(run, placed)| (near(placed), *run == reference, std::cmp::Reverse(*run)));
    let Some((_, best)) = best else { return Verdict::default() };
    let (same, others): (Vec<_>, Vec<_>) = entries.iter().partition(|(_, b)| alike(&best.pose, &b.pose, tolerance));
    let apart = same.iter().map(|(_, b)| b.pose.centre().distance(best.pose.centre()) / size).fold(0.0, f64::max);
    Verdict { placed: Some(*best), alike: same.iter().map(|(run, _)| *run).collect(), others, apart }
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics};
    use glam::{DQuat, DVec3};

    use super::*;

    const LENS: Intrinsics =
        Intrinsics { width: 4, height: 4, fx: 4.0, fy: 4.0, cx: 2.0, cy: 2.0, distortion: Distortion::None };

    fn candidate(name: &str, moved: &Similarity, wrong: &[usize], missing: &[usize]) -> Candidate {
        let camera = |index: usize| {
            let angle = 0.7 * index as f64;
            let mut eye = DVec3::new(3.0 * angle.cos(), -1.0, 3.0 * angle.sin());
            if wrong.contains(&index) {
                eye = DVec3::new(-eye.x, eye.y, -eye.z);
            }
            let pose = moved.of_camera(&Pose::look_at(eye, DVec3::ZERO, DVec3::Y));
            (!missing.contains(&index)).then_some(Placed { intrinsics: LENS, pose, points: 100 })
        };
        Candidate { name: name.into(), cameras: (0..8).map(camera).collect() }
    }

    fn turned(scale: f64) -> Similarity {
        Similarity { scale, pose: Pose { rotation: DQuat::from_rotation_x(scale), translation: DVec3::splat(scale) } }
    }

    #[test]
    fn a_camera_on_the_wrong_side_in_one_run_is_outvoted_by_two_and_in_doubt_between_two() {
        let same = turned(1.0);
        let runs = [
            candidate("a", &same, &[3], &[]),
            candidate("b", &turned(0.4), &[], &[]),
            candidate("c", &turned(2.0), &[], &[5]),
        ];
        let all = agree(&runs, 0.02, 0.03).unwrap();
        assert!(all.verdicts.iter().all(Verdict::agreed));
        assert_eq!(all.verdicts[3].alike, [1, 2]);
        assert_eq!(all.verdicts[3].others.len(), 1);
        assert_eq!(all.verdicts[5].alike, [0, 1]);
        let two = agree(&runs[..2], 0.02, 0.03).unwrap();
        let doubtful: Vec<usize> = (0..8).filter(|view| !two.verdicts[*view].agreed()).collect();
        assert_eq!(doubtful, [3]);
    }

    #[test]
    fn one_run_and_runs_that_share_nothing_do_not_agree() {
        let one = candidate("a", &turned(1.0), &[], &[]);
        assert!(agree(std::slice::from_ref(&one), 0.02, 0.03).is_none());
        let other = candidate("b", &turned(1.0), &[], &[0, 1, 2, 3, 4, 5]);
        assert!(agree(&[one, other], 0.02, 0.03).is_none());
    }
}
