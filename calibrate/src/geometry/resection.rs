//! Resection: where a camera with known intrinsics stands, from points whose positions are known.
//!
//! Three points give up to four poses (Grunert's quartic, in the form of Haralick, Lee, Ottenberg and Noelle, "Review and
//! analysis of solutions of the three point perspective pose estimation problem", 1994); the one that the most points bear
//! out is improved by Gauss's and Newton's steps on these.

use erfgs_base::random;
use erfgs_scene::{Intrinsics, Pose};
use glam::{DMat3, DQuat, DVec2, DVec3};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

/// A pose, and what speaks for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Resection {
    /// World to camera.
    pub pose: Pose,
    /// Which correspondences it holds for.
    pub inliers: Vec<bool>,
    /// Root mean square reprojection error of these, pixels.
    pub rms_px: f64,
}

/// Triples of points that propose poses.
const TRIPLES: u64 = 3000;
/// A pose that is proposed is held against so many correspondences at first, evenly taken; and the best of them against all.
const LOOKED_AT: usize = 256;
const LOOKED_AT_AGAIN: usize = 100;
/// Fewer correspondences prove nothing: three always fit.
const FEWEST: usize = 5;

impl Resection {
    /// How many correspondences it holds for.
    #[must_use]
    pub fn count(&self) -> usize {
        self.inliers.iter().filter(|inlier| **inlier).count()
    }
}

/// The pose from which most of `seen` (world point, pixel) are within `limit_px` of where they should be. `None` if there is
/// none that five of them bear out.
#[must_use]
pub fn resect(intrinsics: &Intrinsics, seen: &[(DVec3, DVec2)], limit_px: f64, seed: u64) -> Option<Resection> {
    if seen.len() < FEWEST {
        return None;
    }
    let rays: Vec<Option<DVec3>> = seen.iter().map(|(_, pixel)| intrinsics.unproject(*pixel).ok()).collect();
    let key = random::key(seed, &[random::purpose("resection")]);
    let cost = |pose: &Pose, &(point, pixel): &(DVec3, DVec2)| {
        let error = intrinsics.project(pose.transform(point)).map_or(f64::INFINITY, |at| at.distance(pixel));
        if error < limit_px { 1.0 - (error / limit_px).powi(2) } else { 0.0 }
    };
    let score = |pose: &Pose| -> f64 { seen.iter().map(|seen| cost(pose, seen)).sum() };
    let step = seen.len().div_ceil(LOOKED_AT);
    let first_score = |pose: &Pose| -> f64 { seen.iter().step_by(step).map(|seen| cost(pose, seen)).sum() };
    let proposals = (0..TRIPLES).into_par_iter().filter_map(|triple| {
        let pick = |word| random::below(random::extend(key, 3 * triple + word), seen.len() as u64) as usize;
        let chosen = [pick(0), pick(1), pick(2)];
        if chosen[0] == chosen[1] || chosen[1] == chosen[2] || chosen[0] == chosen[2] {
            return None;
        }
        let rays = [rays[chosen[0]]?, rays[chosen[1]]?, rays[chosen[2]]?];
        let poses = three_points(chosen.map(|index| seen[index].0), rays);
        poses.into_iter().map(|pose| (first_score(&pose), triple, pose)).max_by(|a, b| a.0.total_cmp(&b.0))
    });
    // The earlier triple wins a tie, whatever the threads do.
    let order = |a: &(f64, u64, Pose), b: &(f64, u64, Pose)| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1));
    let mut proposals: Vec<(f64, u64, Pose)> = proposals.collect();
    proposals.sort_unstable_by(order);
    proposals.truncate(LOOKED_AT_AGAIN);
    let again = proposals.into_par_iter().map(|(_, triple, pose)| (score(&pose), triple, pose));
    let (mut best, _, mut pose) = again.min_by(order)?;
    for _ in 0..3 {
        let inliers = within(intrinsics, &pose, seen, limit_px);
        let members: Vec<(DVec3, DVec2)> =
            seen.iter().zip(&inliers).filter(|(_, inlier)| **inlier).map(|(seen, _)| *seen).collect();
        let Some(better) = improve(intrinsics, pose, &members) else { break };
        let reached = score(&better);
        if reached <= best {
            break;
        }
        (best, pose) = (reached, better);
    }
    let inliers = within(intrinsics, &pose, seen, limit_px);
    let squares =
        seen.iter().zip(&inliers).filter(|(_, inlier)| **inlier).filter_map(|(&(point, pixel), _)| {
            Some(intrinsics.project(pose.transform(point))?.distance_squared(pixel))
        });
    let squares: Vec<f64> = squares.collect();
    let rms_px = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
    (squares.len() >= FEWEST).then_some(Resection { pose, inliers, rms_px })
}

fn within(intrinsics: &Intrinsics, pose: &Pose, seen: &[(DVec3, DVec2)], limit_px: f64) -> Vec<bool> {
    let near = |&(point, pixel): &(DVec3, DVec2)| {
        intrinsics.project(pose.transform(point)).is_some_and(|at| at.distance(pixel) < limit_px)
    };
    seen.iter().map(near).collect()
}

/// The poses from which three world points are seen along three rays of length 1.
#[must_use]
pub fn three_points(points: [DVec3; 3], rays: [DVec3; 3]) -> Vec<Pose> {
    let [p1, p2, p3] = points;
    let (a2, b2, c2) = (p2.distance_squared(p3), p1.distance_squared(p3), p1.distance_squared(p2));
    if a2.min(b2).min(c2) <= 0.0 {
        return Vec::new();
    }
    let (cos_a, cos_b, cos_c) = (rays[1].dot(rays[2]), rays[0].dot(rays[2]), rays[0].dot(rays[1]));
    let (minus, plus) = ((a2 - c2) / b2, (a2 + c2) / b2);
    let (a_b, c_b) = (a2 / b2, c2 / b2);
    let quartic = [
        (1.0 + minus).powi(2) - 4.0 * a_b * cos_c * cos_c,
        4.0 * (-minus * (1.0 + minus) * cos_b + 2.0 * a_b * cos_c * cos_c * cos_b - (1.0 - plus) * cos_a * cos_c),
        2.0 * (minus * minus - 1.0 + 2.0 * minus * minus * cos_b * cos_b + 2.0 * (1.0 - c_b) * cos_a * cos_a
            - 4.0 * plus * cos_a * cos_b * cos_c
            + 2.0 * (1.0 - a_b) * cos_c * cos_c),
        4.0 * (minus * (1.0 - minus) * cos_b - (1.0 - plus) * cos_a * cos_c + 2.0 * c_b * cos_a * cos_a * cos_b),
        (minus - 1.0).powi(2) - 4.0 * c_b * cos_a * cos_a,
    ];
    let mut poses = Vec::new();
    for v in real_roots(quartic) {
        let under = 2.0 * (cos_c - v * cos_a);
        let u = ((minus - 1.0) * v * v - 2.0 * minus * cos_b * v + 1.0 + minus) / under;
        let s1 = (b2 / (1.0 + v * v - 2.0 * v * cos_b)).sqrt();
        if !(v > 0.0 && u > 0.0 && u.is_finite() && s1.is_finite()) {
            continue;
        }
        let seen = [rays[0] * s1, rays[1] * (u * s1), rays[2] * (v * s1)];
        let (Some(from), Some(to)) = (frame(points), frame(seen)) else { continue };
        let rotation = DQuat::from_mat3(&(to * from.transpose())).normalize();
        let pose = Pose { rotation, translation: seen[0] - rotation * points[0] };
        if pose.is_finite() {
            poses.push(pose);
        }
    }
    poses
}

/// Axes that three points span; `None` where they lie on a line.
fn frame([a, b, c]: [DVec3; 3]) -> Option<DMat3> {
    let x = (b - a).try_normalize()?;
    let z = x.cross(c - a).try_normalize()?;
    Some(DMat3::from_cols(x, z.cross(x), z))
}

/// The real roots of a quartic (coefficients from the constant up): the eigenvalues of its companion matrix, improved by
/// Newton's steps.
fn real_roots(coefficients: [f64; 5]) -> Vec<f64> {
    let leading = coefficients[4];
    let greatest = coefficients.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    if !(greatest.is_finite() && leading.abs() > 1e-14 * greatest) {
        return Vec::new();
    }
    let mut companion = SMatrix::<f64, 4, 4>::zeros();
    for row in 0..4 {
        companion[(row, 3)] = -coefficients[row] / leading;
        if row > 0 {
            companion[(row, row - 1)] = 1.0;
        }
    }
    let value = |x: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c);
    let slope = |x: f64| (1..5).rev().fold(0.0, |sum, k| sum * x + k as f64 * coefficients[k]);
    let Some(schur) = nalgebra::Schur::try_new(companion, 1e-12, 200) else { return Vec::new() };
    schur
        .complex_eigenvalues()
        .iter()
        .filter(|root| root.im.abs() <= 1e-4 * (1.0 + root.re.abs()))
        .map(|root| {
            let mut x = root.re;
            for _ in 0..3 {
                let step = value(x) / slope(x);
                if step.is_finite() {
                    x -= step;
                }
            }
            x
        })
        .collect()
}

/// The pose of least squares, from one near it. `None` if the points do not determine it.
fn improve(intrinsics: &Intrinsics, mut pose: Pose, seen: &[(DVec3, DVec2)]) -> Option<Pose> {
    const STEP: f64 = 1e-6;
    for _ in 0..10 {
        let mut normal = SMatrix::<f64, 6, 6>::zeros();
        let mut right = SVector::<f64, 6>::zeros();
        for &(point, pixel) in seen {
            let at = pose.transform(point);
            let Some(centre) = intrinsics.project(at) else { continue };
            // By the camera-space point, along each axis.
            let step = STEP * at.length();
            let by = |axis: DVec3| Some((intrinsics.project(at + axis * step)? - centre) / step);
            let (Some(x), Some(y), Some(z)) = (by(DVec3::X), by(DVec3::Y), by(DVec3::Z)) else { continue };
            let mut rows = [SVector::<f64, 6>::zeros(), SVector::<f64, 6>::zeros()];
            for axis in 0..3 {
                let turned = DVec3::AXES[axis].cross(at);
                for (row, d) in rows.iter_mut().zip([DVec3::new(x.x, y.x, z.x), DVec3::new(x.y, y.y, z.y)]) {
                    row[axis] = d.dot(turned);
                    row[3 + axis] = d[axis];
                }
            }
            for (row, residual) in rows.iter().zip([pixel.x - centre.x, pixel.y - centre.y]) {
                normal += row * row.transpose();
                right += row * residual;
            }
        }
        let step = normal.cholesky()?.solve(&right);
        let turn = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]));
        let rotation = (turn * pose.rotation).normalize();
        let translation = turn * pose.translation + DVec3::new(step[3], step[4], step[5]);
        pose = Pose { rotation, translation };
        if step.norm() < 1e-10 {
            break;
        }
    }
    pose.is_finite().then_some(pose)
}

#[cfg(test)]
mod tests {
    use erfgs_base::random::{key, normal, range};
    use erfgs_scene::Distortion;

    use super::*;

    const LENS: Intrinsics = Intrinsics {
        width: 640,
        height: 480,
        fx: 500.0,
        fy: 510.0,
        cx: 330.0,
        cy: 235.0,
        distortion: Distortion::BrownConrady([-0.1, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    };

    fn scene(seed: u64, flat: bool) -> (Pose, Vec<(DVec3, DVec2)>) {
        let at = |word: u64, spread: f64| range(key(seed, &[word]), -spread, spread);
        let pose = Pose::look_at(DVec3::new(at(1, 1.0), at(2, 1.0), -4.0), DVec3::new(at(3, 0.5), 0.0, 0.0), DVec3::Y);
        let point = |index: u64| {
            let depth = if flat { 0.0 } else { at(300 + index, 1.0) };
            DVec3::new(at(100 + index, 1.2), at(200 + index, 0.9), depth)
        };
        let seen = (0..60).filter_map(|index| Some((point(index), LENS.project(pose.transform(point(index)))?)));
        (pose, seen.collect())
    }

    #[test]
    fn three_points_give_the_pose_among_others() {
        for seed in 0..200 {
            let (pose, seen) = scene(seed, false);
            let rays = [0, 1, 2].map(|index: usize| LENS.unproject(seen[index].1).unwrap());
            let found = three_points([seen[0].0, seen[1].0, seen[2].0], rays);
            let nearest = found.iter().map(|p| p.centre().distance(pose.centre())).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-5, "seed {seed}: {nearest} of {}", found.len());
        }
    }

    #[test]
    fn half_of_the_correspondences_may_be_wrong_and_the_points_may_be_flat() {
        for (seed, flat) in [(1, false), (2, true), (3, false)] {
            let (pose, mut seen) = scene(seed, flat);
            let count = seen.len();
            for (index, (_, pixel)) in seen.iter_mut().enumerate() {
                let random = |word: u64| key(seed, &[900, index as u64, word]);
                *pixel += DVec2::new(normal(random(0)), normal(random(1))) * 0.3;
                if index % 2 == 0 {
                    *pixel = DVec2::new(range(random(2), 0.0, 640.0), range(random(3), 0.0, 480.0));
                }
            }
            let found = resect(&LENS, &seen, 2.0, 7).unwrap();
            assert!(
                found.pose.centre().distance(pose.centre()) < 0.02,
                "{}",
                found.pose.centre().distance(pose.centre())
            );
            assert!(found.count() >= count / 2 - 2 && found.count() <= count / 2 + 4);
            assert!(found.rms_px < 0.8);
        }
    }

    #[test]
    fn noise_alone_and_points_on_one_spot_give_no_well_supported_pose() {
        let random = |word: u64, index: u64| key(5, &[word, index]);
        let noise: Vec<(DVec3, DVec2)> = (0..100)
            .map(|i| {
                let at = |word| range(random(word, i), -1.0, 1.0);
                let pixel = DVec2::new(range(random(4, i), 0.0, 640.0), range(random(5, i), 0.0, 480.0));
                (DVec3::new(at(1), at(2), at(3)), pixel)
            })
            .collect();
        assert!(resect(&LENS, &noise, 2.0, 1).is_none_or(|found| found.count() < 12));
        let spot = vec![(DVec3::ONE, DVec2::new(100.0, 100.0)); 20];
        assert!(resect(&LENS, &spot, 2.0, 1).is_none());
        assert!(resect(&LENS, &noise[..4], 2.0, 1).is_none());
    }
}
