//! Corners that lie elsewhere than all others of the board say.
//!
//! A board is flat and its corners are known to be where they are printed. So one map of a plane, bent by one radial term about the middle
//! of the picture as most lenses bend it, says where each corner is by all others. On boards that lean this tells a corner that was
//! pulled aside by the marker printed beside it, which its own pixels and the few corners next to it do not tell. Where the map does not
//! explain the corners (a lens that bends otherwise, a board that is not flat, noise), nothing is said of any.

use glam::{DMat2, DVec2};
use nalgebra::{SMatrix, SVector};

use super::{Corner, Target};
use crate::{geometry::homography::homography, statistics::median};

/// Corners are farther off than this, pixels...
const LEAST_PX: f64 = 0.25;
/// ...and than so many times what half of the corners are off by.
const FAR: f64 = 4.0;
/// Half of the corners are off by less where the map explains them, pixels.
const EXPLAINED_PX: f64 = 0.2;
/// Fewer corners do not say where another is.
const FEW: usize = 10;
/// Numbers of the map: eight of the plane, and how the lens bends.
const NUMBERS: usize = 9;
const ROUNDS: usize = 12;

/// The corners without those that are elsewhere than the others say, in a picture of this `size`, pixels.
pub(super) fn consistent(mut corners: Vec<Corner>, target: &Target, size: DVec2) -> Vec<Corner> {
    while corners.len() > FEW {
        let Some(off) = off(&corners, target, size) else { break };
        let Some(usual) = median(off.iter().copied()).filter(|usual| *usual < EXPLAINED_PX) else { break };
        let limit = LEAST_PX.max(FAR * usual);
        // One after the other, since a wrong one pulls the map.
        match off.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)) {
            Some((index, worst)) if *worst > limit => corners.remove(index),
            _ => break,
        };
    }
    corners
}

/// How far each corner is from where all others say, pixels; `None` where they say nothing.
fn off(corners: &[Corner], target: &Target, size: DVec2) -> Option<Vec<f64>> {
    let (middle, scale) = (0.5 * size, size.max_element());
    let plane: Option<Vec<DVec2>> = corners.iter().map(|corner| Some(target.point(corner.id)?.truncate())).collect();
    let plane = plane?;
    let mean = plane.iter().sum::<DVec2>() / plane.len() as f64;
    let reach = plane.iter().map(|at| at.distance(mean)).fold(0.0, f64::max);
    let plane: Vec<DVec2> = plane.into_iter().map(|at| (at - mean) / reach).collect();
    let seen: Vec<DVec2> = corners.iter().map(|corner| (corner.pixel - middle) / scale).collect();
    let map = homography(&plane, &seen)?;
    let map = map * (1.0 / map.z_axis.z);
    let (x, y, z) = (map.x_axis, map.y_axis, map.z_axis);
    let mut state = SVector::<f64, NUMBERS>::from([x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, 0.0]);
    let pairs = || plane.iter().zip(&seen);
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (SMatrix::<f64, NUMBERS, NUMBERS>::zeros(), SVector::<f64, NUMBERS>::zeros());
        for (at, seen) in pairs() {
            let (there, by) = project(&state, *at);
            let error = *seen - there;
            normal += by.transpose() * by;
            right += by.transpose() * SVector::from([error.x, error.y]);
        }
        let step = normal.cholesky()?.solve(&right);
        state += step;
        if step.amax() < 1e-9 {
            break;
        }
    }
    let normal = pairs().fold(SMatrix::<f64, NUMBERS, NUMBERS>::zeros(), |sum, (at, _)| {
        let (_, by) = project(&state, *at);
        sum + by.transpose() * by
    });
    let inverse = normal.try_inverse()?;
    // The difference from the map through all corners, and how much of it the corner itself has taken away.
    let off = pairs().map(|(at, seen)| {
        let (there, by) = project(&state, *at);
        let own = by * inverse * by.transpose();
        let left = DMat2::IDENTITY - DMat2::from_cols_array(&[own[(0, 0)], own[(1, 0)], own[(0, 1)], own[(1, 1)]]);
        scale * (left.inverse() * (*seen - there)).length()
    });
    let off: Vec<f64> = off.collect();
    off.iter().all(|off| off.is_finite()).then_some(off)
}

/// Where the map takes a place, and how that changes with its numbers.
fn project(state: &SVector<f64, NUMBERS>, at: DVec2) -> (DVec2, SMatrix<f64, 2, NUMBERS>) {
    let depth = state[6] * at.x + state[7] * at.y + 1.0;
    let u = (state[0] * at.x + state[1] * at.y + state[2]) / depth;
    let v = (state[3] * at.x + state[4] * at.y + state[5]) / depth;
    let (x, y, one) = (at.x / depth, at.y / depth, 1.0 / depth);
    let of_u = [x, y, one, 0.0, 0.0, 0.0, -u * x, -u * y];
    let of_v = [0.0, 0.0, 0.0, x, y, one, -v * x, -v * y];
    let (bend, squared) = (state[8], u * u + v * v);
    let straight = 1.0 + bend * squared;
    let (along, across, aside) = (straight + 2.0 * bend * u * u, straight + 2.0 * bend * v * v, 2.0 * bend * u * v);
    let mut by = SMatrix::<f64, 2, NUMBERS>::zeros();
    for (number, (of_u, of_v)) in of_u.into_iter().zip(of_v).enumerate() {
        by[(0, number)] = along * of_u + aside * of_v;
        by[(1, number)] = aside * of_u + across * of_v;
    }
    (by[(0, 8)], by[(1, 8)]) = (u * squared, v * squared);
    (straight * DVec2::new(u, v), by)
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;

    const SIZE: DVec2 = DVec2::new(960.0, 720.0);

    /// Corners of a board that leans before a lens that bends, and noise.
    fn seen(target: &Target, bend: f64, noise_px: f64, key: u64) -> Vec<Corner> {
        let (columns, rows) = target.corners();
        let one = |id: u32| {
            let at = target.point(id).unwrap().truncate() - DVec2::new(0.1, 0.06);
            let depth = 0.7 + 0.9 * at.x - 0.3 * at.y;
            let ray = DVec2::new(0.12 + 0.4 * at.x + 0.3 * at.y, -0.1 - 0.3 * at.x + 0.8 * at.y) / depth;
            let normal = |axis: u64| random::normal(random::key(key, &[id.into(), axis]));
            let pixel = SIZE / 2.0 + DVec2::new(4.0, -6.0) + 780.0 * ray * (1.0 + bend * ray.length_squared());
            Corner { id, pixel: pixel + noise_px * DVec2::new(normal(0), normal(1)) }
        };
        (0..columns * rows).map(one).collect()
    }

    #[test]
    fn corners_that_were_pulled_aside_are_left_out_and_no_others() {
        for (key, text) in ["charuco:7x5:0.04:0.03:DICT_4X4_50", "chessboard:8x5:0.04", "aprilgrid:3x3:0.03:0.3"]
            .into_iter()
            .enumerate()
        {
            let target: Target = text.parse().unwrap();
            for (round, bend) in [0.0, -0.25, -0.1, 0.2].into_iter().enumerate() {
                for noise_px in [0.0, 0.03, 0.05] {
                    let right = seen(&target, bend, noise_px, 10 * key as u64 + round as u64);
                    let same = consistent(right.clone(), &target, SIZE);
                    assert_eq!(same.len(), right.len(), "{text}, {bend}, {noise_px} px");
                    let mut pulled = right.clone();
                    let [one, other] = [round, right.len() - 1 - 2 * round];
                    pulled[one].pixel += (8.0 * noise_px).max(0.5) * DVec2::from_angle(1.3 * round as f64);
                    pulled[other].pixel -= (8.0 * noise_px).max(0.5) * DVec2::from_angle(0.4);
                    let kept = consistent(pulled.clone(), &target, SIZE);
                    let expected: Vec<Corner> = right.iter().copied().filter(|c| pulled.contains(c)).collect();
                    assert_eq!(kept, expected, "{text}, {bend}, {noise_px} px");
                }
            }
        }
    }

    #[test]
    fn nothing_is_left_out_where_the_map_does_not_explain_the_corners() {
        let target: Target = "charuco:7x5:0.04:0.03:DICT_4X4_50".parse().unwrap();
        let mut bent = seen(&target, -0.1, 0.05, 2);
        // A lens that bends as no single radial term does.
        for corner in &mut bent {
            let from = (corner.pixel - SIZE / 2.0) / SIZE.x;
            corner.pixel += 100.0 * from.length_squared() * DVec2::new(from.y, from.x);
        }
        assert_eq!(consistent(bent.clone(), &target, SIZE), bent);
        let noisy = seen(&target, 0.0, 0.4, 3);
        assert_eq!(consistent(noisy.clone(), &target, SIZE), noisy);
    }

    #[test]
    fn few_corners_and_corners_on_a_line_are_left_as_they_are() {
        let target: Target = "chessboard:8x5:0.04".parse().unwrap();
        let all = seen(&target, 0.0, 5.0, 1);
        assert_eq!(consistent(all[..FEW].to_vec(), &target, SIZE).len(), FEW);
        let (columns, _) = target.corners();
        let line: Vec<Corner> = (0..12).map(|at| Corner { id: at % columns, ..all[(at % columns) as usize] }).collect();
        assert_eq!(consistent(line.clone(), &target, SIZE), line);
        assert_eq!(consistent(Vec::new(), &target, SIZE), Vec::new());
    }
}
