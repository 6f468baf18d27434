//! Which of the points that move no body explains.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::scene::Point;
use erfgs_splat::{
    gaussians::Neighbours,
    motion::bodies::{EXTRA_FLOATS, Start, spline},
};

/// A point is of a body where the body's surface is nearer than so many distances between points of its instant.
pub(super) const NEAR: f32 = 3.0;
/// So long before a body appears, and after it vanishes, there is nothing of it, seconds.
const THERE: f64 = 0.05;

/// How body `body` is placed and turned at `t01`, by its path alone; none where it is not there.
fn pose(start: &Start, body: usize, t01: f64, length: f64) -> Option<(DVec3, DQuat)> {
    let gate = &start.other[4 * body..4 * body + 4];
    let seconds = t01 * length;
    let away = (f64::from(gate[0]) - seconds).max(seconds - f64::from(gate[1]));
    if gate[2] > 0.0 && away > THERE {
        return None;
    }
    let spline::Basis { first, weights } = spline::basis(t01 * (start.knots - 3) as f64, start.knots);
    let count = start.bodies + start.nodes;
    let mut sum = [0.0; 8];
    for (knot, weight) in (first..).zip(weights) {
        let control = &start.control[8 * (knot * count + body)..][..8];
        sum.iter_mut().zip(control).for_each(|(sum, value)| *sum += weight * f64::from(*value));
    }
    let turn = DQuat::from_xyzw(sum[5], sum[6], sum[7], sum[4]);
    Some((DVec3::new(sum[0], sum[1], sum[2]), if turn.length() > 1e-9 { turn.normalize() } else { DQuat::IDENTITY }))
}

/// The `points` (instants in [0, 1]) of a recording of `length` seconds that lie on no body.
#[must_use]
pub fn unexplained(start: &Start, points: &[(Point, f64)], length: f64) -> Vec<(Point, f64)> {
    let floats = start.gaussians.motion_floats;
    let of_body: Vec<usize> =
        start.gaussians.motion.chunks_exact(floats.max(1)).map(|row| row[floats - EXTRA_FLOATS] as usize - 1).collect();
    let mut instants: Vec<f64> = points.iter().map(|(_, t01)| *t01).collect();
    instants.sort_by(f64::total_cmp);
    instants.dedup();
    let left = |t01: &f64| -> Vec<(Point, f64)> {
        let here: Vec<(Point, f64)> = points.iter().filter(|(_, at)| at == t01).copied().collect();
        let poses: Vec<_> = (0..start.bodies).map(|body| pose(start, body, *t01, length)).collect();
        let surface: Vec<[f32; 3]> = of_body
            .iter()
            .enumerate()
            .filter_map(|(row, &body)| {
                let (shift, turn) = poses[body]?;
                let [x, y, z] = start.gaussians.mean(row).map(f64::from);
                Some((turn * DVec3::new(x, y, z) + shift).as_vec3().to_array())
            })
            .collect();
        let near = NEAR * spacing(&here.iter().map(|((place, _), _)| *place).collect::<Vec<_>>());
        let surface = Neighbours::new(&surface);
        let explained = |place: &[f32; 3]| surface.nearest(place, 1).iter().any(|(_, squared)| *squared <= near * near);
        here.into_iter().filter(|((place, _), _)| !explained(place)).collect()
    };
    instants.par_iter().flat_map_iter(left).collect()
}

/// How far points are apart, metres: the median distance to the nearest other.
pub(super) fn spacing(places: &[[f32; 3]]) -> f32 {
    let around = Neighbours::new(places);
    let mut apart: Vec<f32> =
        places.iter().filter_map(|place| around.nearest(place, 2).get(1).map(|(_, squared)| squared.sqrt())).collect();
    apart.sort_by(f32::total_cmp);
    apart.get(apart.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::start::{Piece, Recording, from_bodies};
    use erfgs_dataset::{Body, BodyPose, SurfacePoint};
    use erfgs_splat::motion::{BodiesOptions, FreeTimeOptions};

    #[test]
    fn what_lies_on_a_body_when_it_is_there_is_explained() {
        let grid = |k: u64| [0.05 * (k % 10) as f64, 0.05 * (k / 10) as f64, 0.0];
        let pose =
            |t_ns: i64, x: f64| BodyPose { t_ns, translation_m: [x, 0.0, 0.0], rotation_wxyz: [1.0, 0.0, 0.0, 0.0] };
        let plate = Body {
            name: "plate".into(),
            span_ns: [0, 600_000_000],
            poses: vec![pose(0, 0.0), pose(500_000_000, 1.0), pose(1_000_000_000, 2.0)],
            points: (0..100)
                .map(|k| SurfacePoint { position_m: grid(k), normal: [0.0, 0.0, 1.0], colour: [9; 3] })
                .collect(),
            found_by: Default::default(),
        };
        let recording = Recording { span_ns: [0, 1_000_000_000], intervals: 10.0 };
        let start =
            from_bodies(&[Piece::whole(plate)], recording, 0, &BodiesOptions::default(), &FreeTimeOptions::default());
        let seen = |t01: f64, aside: f64| {
            (0..100).map(move |k| {
                let [x, y, z] = grid(k);
                (([x + 2.0 * t01, y + aside, z].map(|at| at as f32), [9; 3]), t01)
            })
        };
        // On it, aside of it, and where it would be had it not gone.
        let points: Vec<_> = seen(0.5, 0.0).chain(seen(0.25, 1.0)).chain(seen(0.9, 0.0)).collect();
        let left = unexplained(&start, &points, 1.0);
        assert_eq!(left.len(), 200);
        assert!(left.iter().all(|(_, t01)| *t01 != 0.5));
        assert!(unexplained(&start, &[], 1.0).is_empty());
    }
}
