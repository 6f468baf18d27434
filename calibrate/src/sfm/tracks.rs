//! Tracks: features of several views that are the same point, and where that point is.

use erfgs_base::random;
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

use super::run::Placed;
use crate::colmap::database::Keypoints;

/// Pairs of views, and which of their features belong together.
pub(super) type PairMatches = ((usize, usize), Vec<[u32; 2]>);

/// A point, and the features that it was seen as: view, index of the feature.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Track {
    pub position: DVec3,
    pub seen: Vec<(usize, u32)>,
}

/// At most so many pairs of a component's observations propose a point.
const PROPOSALS: u64 = 40;
/// Two rays at a smaller angle propose none, radians.
const LEAST_ANGLE: f64 = 0.026;

/// A component has at most so many times as many observations as there are views. A point has one in each; where a texture
/// repeats itself, wrong matches would join a whole room, whose points are then looked for among all of its features.
const MOST_A_VIEW: usize = 8;

/// Joins matches that share features, as long as that makes no component too large; each has at least `fewest` observations.
pub(super) fn components(features: &[Keypoints], matches: &[PairMatches], fewest: usize) -> Vec<Vec<(usize, u32)>> {
    let mut starts = vec![0usize];
    for view in features {
        starts.push(starts[starts.len() - 1] + view.positions.len());
    }
    let mut parent: Vec<u32> = (0..starts[features.len()] as u32).collect();
    let mut sizes = vec![1_u32; parent.len()];
    let most = (MOST_A_VIEW * features.len()) as u32;
    fn root(parent: &mut [u32], mut index: u32) -> u32 {
        while parent[index as usize] != index {
            parent[index as usize] = parent[parent[index as usize] as usize];
            index = parent[index as usize];
        }
        index
    }
    for ((a, b), pairs) in matches {
        for [i, j] in pairs {
            let (i, j) = (starts[*a] as u32 + i, starts[*b] as u32 + j);
            let (i, j) = (root(&mut parent, i), root(&mut parent, j));
            let together = sizes[i as usize] + sizes[j as usize];
            if i != j && together <= most {
                parent[i.max(j) as usize] = i.min(j);
                sizes[i.min(j) as usize] = together;
            }
        }
    }
    let mut members = vec![Vec::new(); parent.len()];
    for view in 0..features.len() {
        for index in starts[view]..starts[view + 1] {
            let root = root(&mut parent, index as u32);
            members[root as usize].push((view, (index - starts[view]) as u32));
        }
    }
    members.into_iter().filter(|component| component.len() >= fewest).collect()
}

/// The points of the components: each is proposed by pairs of its observations, borne out by at least `fewest` views within
/// `limit_px`. A component that holds several points gives each.
pub(super) fn triangulate(
    features: &[Keypoints],
    cameras: &[Option<Placed>],
    components: &[Vec<(usize, u32)>],
    fewest: usize,
    limit_px: f64,
) -> Vec<Track> {
    let tracks = components.par_iter().enumerate().map(|(number, component)| {
        let mut rest: Vec<Ray> =
            component.iter().filter_map(|&(view, index)| Ray::new(features, cameras, view, index)).collect();
        let mut found = Vec::new();
        while rest.len() >= fewest {
            let key = random::key(number as u64, &[random::purpose("pairs of a track"), rest.len() as u64]);
            let Some((position, chosen)) = consensus(&rest, cameras, limit_px, key) else { break };
            if chosen.len() < fewest {
                break;
            }
            found.push(Track {
                position,
                seen: chosen.iter().map(|&index| (rest[index].view, rest[index].feature)).collect(),
            });
            let mut index = 0;
            rest.retain(|_| {
                index += 1;
                !chosen.contains(&(index - 1))
            });
        }
        found
    });
    tracks.collect::<Vec<_>>().into_iter().flatten().collect()
}

/// The ray of an observation.
#[derive(Clone, Copy, Debug)]
struct Ray {
    view: usize,
    feature: u32,
    pixel: DVec2,
    origin: DVec3,
    direction: DVec3,
}

impl Ray {
    fn new(features: &[Keypoints], cameras: &[Option<Placed>], view: usize, feature: u32) -> Option<Self> {
        let camera = cameras[view].as_ref()?;
        let pixel = features[view].positions[feature as usize];
        let direction = camera.pose.rotation.conjugate() * camera.intrinsics.unproject(pixel).ok()?;
        Some(Self { view, feature, pixel, origin: camera.pose.centre(), direction: direction.normalize() })
    }

    fn error(&self, cameras: &[Option<Placed>], point: DVec3) -> f64 {
        let Some(camera) = &cameras[self.view] else { return f64::INFINITY };
        let seen = camera.intrinsics.project(camera.pose.transform(point));
        seen.map_or(f64::INFINITY, |seen| seen.distance(self.pixel))
    }
}

/// The point nearest to all rays.
fn nearest<'a>(rays: impl Iterator<Item = &'a Ray>) -> Option<DVec3> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for ray in rays {
        let d = ray.direction;
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        normal += across;
        right += across * ray.origin;
    }
    let point = normal.inverse() * right;
    (normal.determinant() > 1e-9 && point.is_finite()).then_some(point)
}

/// The point that most views see, and the indices of their rays, one for each view.
fn consensus(rays: &[Ray], cameras: &[Option<Placed>], limit_px: f64, key: u64) -> Option<(DVec3, Vec<usize>)> {
    let n = rays.len();
    let all = (n * (n - 1) / 2) as u64;
    let mut best: Option<(f64, DVec3, Vec<usize>)> = None;
    for proposal in 0..all.min(PROPOSALS) {
        let (mut i, mut j) = if all <= PROPOSALS {
            nth_pair(proposal as usize, n)
        } else {
            let pick = |word| random::below(random::extend(key, 2 * proposal + word), n as u64) as usize;
            (pick(0), pick(1))
        };
        if i == j || rays[i].view == rays[j].view {
            continue;
        }
        if i > j {
            std::mem::swap(&mut i, &mut j);
        }
        if rays[i].direction.angle_between(rays[j].direction) < LEAST_ANGLE {
            continue;
        }
        let Some(point) = nearest([&rays[i], &rays[j]].into_iter()) else { continue };
        let (score, chosen) = supporters(rays, cameras, point, limit_px);
        if chosen.len() >= 2 && best.as_ref().is_none_or(|(most, ..)| score > *most) {
            best = Some((score, point, chosen));
        }
    }
    let (mut score, mut point, mut chosen) = best?;
    for _ in 0..2 {
        let Some(refined) = nearest(chosen.iter().map(|&index| &rays[index])) else { break };
        let (next, supporters) = supporters(rays, cameras, refined, limit_px);
        if next <= score {
            break;
        }
        (score, point, chosen) = (next, refined, supporters);
    }
    Some((point, chosen))
}

/// The best ray of each view within the limit, and a score that grows with their number and nearness.
fn supporters(rays: &[Ray], cameras: &[Option<Placed>], point: DVec3, limit_px: f64) -> (f64, Vec<usize>) {
    let mut chosen: Vec<(usize, f64)> = Vec::new();
    for (index, ray) in rays.iter().enumerate() {
        let error = ray.error(cameras, point);
        if error > limit_px {
            continue;
        }
        match chosen.iter_mut().find(|(other, _)| rays[*other].view == ray.view) {
            Some(same) if same.1 <= error => {}
            Some(same) => *same = (index, error),
            None => chosen.push((index, error)),
        }
    }
    let score = chosen.iter().map(|(_, error)| 1.0 - 0.5 * (error / limit_px).powi(2)).sum();
    (score, chosen.into_iter().map(|(index, _)| index).collect())
}

fn nth_pair(mut number: usize, n: usize) -> (usize, usize) {
    for i in 0..n {
        let row = n - 1 - i;
        if number < row {
            return (i, i + 1 + number);
        }
        number -= row;
    }
    (0, 0)
}

#[cfg(test)]
mod tests {
    use erfgs_scene::{Distortion, Intrinsics, Pose};

    use super::*;

    /// Matches that join each point to the next, as on a wall with a pattern: the points are found all the same.
    #[test]
    fn points_are_found_where_wrong_matches_join_them_all() {
        let intrinsics = Intrinsics {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            distortion: Distortion::None,
        };
        let views = 6_usize;
        let cameras: Vec<Option<Placed>> = (0..views)
            .map(|view| {
                let eye = DVec3::new(view as f64 - 2.5, 0.2 * (view % 2) as f64, -3.0);
                Some(Placed { intrinsics, pose: Pose::look_at(eye, DVec3::ZERO, DVec3::Y), points: 0 })
            })
            .collect();
        let points: Vec<DVec3> = (0..400)
            .map(|index| DVec3::new((index % 20) as f64 * 0.08 - 0.8, (index / 20) as f64 * 0.08 - 0.8, 0.0))
            .collect();
        let see = |camera: &Placed, point: &DVec3| camera.intrinsics.project(camera.pose.transform(*point)).unwrap();
        let features: Vec<Keypoints> = cameras
            .iter()
            .flatten()
            .map(|camera| Keypoints {
                positions: points.iter().map(|point| see(camera, point)).collect(),
                ..Keypoints::default()
            })
            .collect();
        let last = points.len() as u32 - 1;
        let right = (1..views).map(|view| ((view - 1, view), (0..=last).map(|k| [k, k]).collect()));
        let wrong: PairMatches = ((0, 2), (0..last).map(|k| [k, k + 1]).collect());
        let matches: Vec<PairMatches> = right.chain([wrong]).collect();
        let joined = components(&features, &matches, 3);
        assert!(joined.iter().all(|component| component.len() <= MOST_A_VIEW * views) && joined.len() >= 50);
        assert!(joined.iter().any(|component| component.len() > 3 * views), "some hold several points");
        let tracks = triangulate(&features, &cameras, &joined, 3, 2.0);
        let found = points.iter().filter(|point| {
            tracks.iter().any(|track| track.position.distance(**point) < 1e-6 && track.seen.len() == views)
        });
        assert_eq!(found.count(), points.len());
    }
}
