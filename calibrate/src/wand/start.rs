//! Starting values out of nothing: pairs of cameras, chained along a tree.

use erfgs_scene::Pose;

use super::{WandCamera, WandError, WandOptions, instants::Instant, pair};
use crate::geometry::Forest;

/// Two cameras are tied by at least so many placements that agree.
const AGREE: usize = 4;
/// And by at least this share of those that both see.
const SHARE: f64 = 0.3;
/// A pair of which this share agrees is taken without looking at others.
const SURE: f64 = 0.6;

/// Two cameras that were estimated together.
#[derive(Clone, Copy, Debug)]
struct Tie {
    cameras: [usize; 2],
    motion: Pose,
    agreeing: f64,
    count: usize,
}

/// World-to-camera poses, from those that are `fixed` on.
///
/// # Errors
/// If some cameras are not tied to the others, by name.
pub(super) fn poses(
    cameras: &[WandCamera],
    instants: &[&Instant],
    fixed: &[Option<Pose>],
    options: &WandOptions,
) -> Result<Vec<Pose>, WandError> {
    let count = cameras.len();
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
    let mut shared: Vec<_> = pairs.map(|[a, b]| ([a, b], pair::shared(instants, a, b))).collect();
    shared.retain(|(_, views)| !views.is_empty());
    // The most views first; among equals the order of the cameras decides.
    shared.sort_by_key(|(_, views)| std::cmp::Reverse(views.len()));
    let mut forest = Forest::new(count);
    let mut there = (0..count).filter(|camera| fixed[*camera].is_some());
    if let Some(first) = there.next() {
        there.for_each(|camera| _ = forest.tie(first, camera));
    }
    let (mut sure, mut doubtful) = (Vec::new(), Vec::new());
    for (cameras_of, views) in shared.iter().filter(|(_, views)| views.len() >= AGREE) {
        let [a, b] = *cameras_of;
        if forest.tied(a, b) {
            continue;
        }
        let lenses = [&cameras[a].intrinsics, &cameras[b].intrinsics];
        let Some(found) = pair::pair(&options.stick, lenses, views, options.seed)? else { continue };
        let tie = Tie { cameras: [a, b], motion: found.motion, agreeing: found.agreeing, count: found.count };
        tracing::debug!(a = cameras[a].name, b = cameras[b].name, agreeing = tie.agreeing, count = tie.count, "pair");
        if tie.count >= AGREE && tie.agreeing >= SURE {
            forest.tie(a, b);
            sure.push(tie);
        } else if tie.count >= AGREE && tie.agreeing >= SHARE {
            doubtful.push(tie);
        }
    }
    doubtful.sort_by(|a, b| b.agreeing.total_cmp(&a.agreeing));
    for tie in doubtful {
        if forest.tie(tie.cameras[0], tie.cameras[1]) {
            sure.push(tie);
        }
    }
    let groups = forest.groups();
    if groups.len() > 1 {
        let across = shared.iter().filter(|([a, b], _)| !forest.tied(*a, *b)).map(|(_, views)| views.len());
        let groups = groups.into_iter().map(|group| group.into_iter().map(|c| cameras[c].name.clone()).collect());
        return Err(WandError::Groups { groups: groups.collect(), shared: across.max().unwrap_or(0), needed: AGREE });
    }
    Ok(chain(fixed, &sure))
}

/// Poses along the ties, from the fixed ones on.
fn chain(fixed: &[Option<Pose>], ties: &[Tie]) -> Vec<Pose> {
    let mut poses = fixed.to_vec();
    for _ in fixed {
        for tie in ties {
            let [a, b] = tie.cameras;
            match (poses[a], poses[b]) {
                (Some(first), None) => poses[b] = Some(after(&tie.motion, &first)),
                (None, Some(second)) => poses[a] = Some(after(&tie.motion.inverse(), &second)),
                _ => {}
            }
        }
    }
    poses.into_iter().map(|pose| pose.unwrap_or(Pose::IDENTITY)).collect()
}

/// First `first`, then `then`.
fn after(then: &Pose, first: &Pose) -> Pose {
    let rotation = (then.rotation * first.rotation).normalize();
    Pose { rotation, translation: then.transform(first.translation) }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn poses_follow_the_ties_in_both_directions() {
        let truth = [0.0, 1.0, 2.0, 3.0].map(|x| Pose::look_at(DVec3::new(x, 0.1, -3.0), DVec3::ZERO, DVec3::Y));
        let tie = |a: usize, b: usize| Tie {
            cameras: [a, b],
            motion: after(&truth[b], &truth[a].inverse()),
            agreeing: 1.0,
            count: 9,
        };
        let fixed = [None, None, Some(Pose::IDENTITY), None];
        let found = chain(&fixed, &[tie(0, 3), tie(1, 0), tie(1, 2)]);
        let to_world = truth[2].inverse();
        for (pose, known) in found.iter().zip(&truth) {
            let back = after(pose, &truth[2]);
            assert!((back.centre() - known.centre()).length() < 1e-12, "{to_world:?}");
        }
    }
}
