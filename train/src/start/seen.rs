//! The shape of what bends: what was seen of it at one instant, where silhouettes of all instants agree on a part of it alone.

use erfgs_dataset::{Body, BodyPose, SurfacePoint};
use glam::DVec3;

use super::{
    bodies::{Recording, seen_best},
    rest::{NEAR, spacing},
};
use crate::scene::Point;
use erfgs_splat::gaussians::Neighbours;

/// Points are of a body no farther from its middle than so many times its radius.
const REACH: f64 = 1.3;
/// Fewer points are no shape.
const FEWEST: usize = 48;
/// A surface faces away from the middle of so many of its points.
const AROUND: usize = 24;
/// The instant is no farther from that at which a body was seen best, RGB intervals.
const SOON: f64 = 0.5;
/// Where this share of what was seen lies on the shape of all instants, that is the better one.
const ENOUGH: f64 = 0.65;

/// `bodies`, those of which that `bend` with the `points` that move (instants in [0, 1]) at the instant at which they were seen best, as
/// far as they are of no other body; with their own where these are few, or lie on it.
#[must_use]
pub fn seen_at_once(
    mut bodies: Vec<Body>,
    bend: &[String],
    points: &[(Point, f64)],
    recording: Recording,
) -> Vec<Body> {
    let bends = |body: &Body| bend.contains(&body.name);
    let shapes: Vec<_> =
        bodies.iter().map(|body| bends(body).then(|| shape(body, &bodies, points, recording))).collect();
    for (body, shape) in bodies.iter_mut().zip(shapes) {
        if let Some(shape) = shape.flatten() {
            body.points = shape;
        }
    }
    bodies
}

fn shape(body: &Body, all: &[Body], points: &[(Point, f64)], recording: Recording) -> Option<Vec<SurfacePoint>> {
    let best = seen_best(body, recording);
    let away = |t01: f64| (t01 - best).abs();
    let instant = points.iter().map(|(_, t01)| *t01).min_by(|a, b| away(*a).total_cmp(&away(*b)))?;
    if away(instant) * recording.intervals > SOON {
        return None;
    }
    let t_ns = recording.span_ns[0] + (1e9 * instant * recording.length()) as i64;
    let here = points.iter().filter(|(_, t01)| *t01 == instant).map(|(point, _)| *point);
    let seen = seen_beside(body, all, here, t_ns)?;
    Some(surface(&seen, body.pose_at(t_ns)?))
}

fn exact(place: &[f32; 3]) -> DVec3 {
    DVec3::from(place.map(f64::from))
}

/// Those of the points of an instant that are of a body and of no other; none where these are few, or lie on its own shape.
fn seen_beside(body: &Body, all: &[Body], here: impl Iterator<Item = Point>, t_ns: i64) -> Option<Vec<Point>> {
    let places = |body: &Body| -> Option<Vec<[f32; 3]>> {
        let pose = body.pose_at(t_ns)?;
        let place = |point: &SurfacePoint| pose.place(DVec3::from(point.position_m)).as_vec3().to_array();
        Some(body.points.iter().map(place).collect())
    };
    let there = |body: &&Body| body.span_ns[0] <= t_ns && t_ns <= body.span_ns[1];
    let others: Vec<[f32; 3]> =
        all.iter().filter(|other| other.name != body.name).filter(there).filter_map(places).flatten().collect();
    let own = places(body)?;
    let middle = own.iter().map(exact).sum::<DVec3>() / own.len().max(1) as f64;
    let widest = own.iter().map(|place| exact(place).distance(middle)).fold(0.0, f64::max);
    let told = body.found_by.get("radius_m").and_then(serde_json::Value::as_f64).unwrap_or(0.0);
    let reach = REACH * widest.max(told);
    let [own, others] = [own, others].map(|places| Neighbours::new(&places));
    let nearest =
        |all: &Neighbours, place: &[f32; 3]| all.nearest(place, 1).first().map_or(f32::INFINITY, |near| near.1);
    let is_own =
        |(place, _): &Point| exact(place).distance(middle) <= reach && nearest(&own, place) <= nearest(&others, place);
    let seen: Vec<Point> = here.filter(is_own).collect();
    let near = NEAR * spacing(&seen.iter().map(|(place, _)| *place).collect::<Vec<_>>());
    let on_it = seen.iter().filter(|(place, _)| nearest(&own, place) <= near * near).count();
    let is_more = seen.len() >= FEWEST && (on_it as f64) < ENOUGH * seen.len() as f64;
    is_more.then_some(seen)
}

/// Points in the frame of a body at a pose, facing away from those around them.
fn surface(seen: &[Point], pose: &BodyPose) -> Vec<SurfacePoint> {
    let places: Vec<[f32; 3]> = seen.iter().map(|(place, _)| *place).collect();
    let around = Neighbours::new(&places);
    let turn = pose.rotation().inverse();
    let of = |(place, colour): &Point| {
        let near = around.nearest(place, AROUND);
        let middle = near.iter().map(|(index, _)| exact(&places[*index])).sum::<DVec3>() / near.len().max(1) as f64;
        let normal = (exact(place) - middle).normalize_or(DVec3::Z);
        SurfacePoint {
            position_m: (turn * (exact(place) - DVec3::from(pose.translation_m))).to_array(),
            normal: (turn * normal).to_array(),
            colour: *colour,
        }
    };
    seen.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECORDING: Recording = Recording { span_ns: [1_000_000_000, 2_000_000_000], intervals: 10.0 };

    /// A body at x, turned by a quarter about z, of which points along its own x are known.
    fn body(name: &str, x: f64) -> Body {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let pose = |k: i64| BodyPose {
            t_ns: 1_000_000_000 + 100_000_000 * k,
            translation_m: [x + 0.1 * k as f64, 0.0, 0.0],
            rotation_wxyz: [half, 0.0, 0.0, half],
        };
        let point = |k: u64| SurfacePoint {
            position_m: [0.01 * k as f64, 0.0, 0.0],
            normal: [0.0, 0.0, 1.0],
            colour: [1, 2, 3],
        };
        Body {
            name: name.into(),
            span_ns: RECORDING.span_ns,
            poses: (0..=10).map(pose).collect(),
            points: (0..10).map(point).collect(),
            found_by: [("best_seen_ns".to_owned(), 1_400_000_000_i64.into()), ("radius_m".to_owned(), 0.5.into())]
                .into(),
        }
    }

    /// A limb along y at x, seen at an instant.
    fn limb(x: f32, t01: f64) -> impl Iterator<Item = (Point, f64)> {
        (0..60).map(move |k| (([x, 0.01 * k as f32, 0.0], [9, 8, 7]), t01))
    }

    #[test]
    fn what_bends_has_what_was_seen_of_it_at_its_best_and_others_what_they_had() {
        let bodies = vec![body("bends", 0.0), body("other", 1.0)];
        let points: Vec<_> = limb(0.4, 0.4).chain(limb(1.4, 0.4)).chain(limb(0.4, 0.5)).collect();
        let made = seen_at_once(bodies.clone(), &["bends".into()], &points, RECORDING);
        assert_eq!(made[1], bodies[1]);
        assert_eq!(
            (made[0].points.len(), made[0].points[0].colour),
            (60, [9, 8, 7]),
            "of one instant, and not of the other body"
        );
        for (k, point) in made[0].points.iter().enumerate() {
            // What lies along y in the world lies along x in its frame.
            let place = DVec3::from(point.position_m);
            assert!(place.abs_diff_eq(DVec3::new(0.01 * k as f64, 0.0, 0.0), 1e-6), "{k}: {place}");
            assert!((DVec3::from(point.normal).length() - 1.0).abs() < 1e-6);
        }
        // Its ends face outwards.
        assert!(made[0].points[59].normal[0] > 0.99 && made[0].points[0].normal[0] < -0.99);
    }

    #[test]
    fn where_little_was_seen_or_lies_on_its_own_shape_it_keeps_that() {
        let bodies = vec![body("bends", 0.0)];
        let bend = ["bends".to_owned()];
        for points in
            [Vec::new(), limb(0.4, 0.4).take(20).collect(), limb(0.4, 0.9).collect(), limb(3.0, 0.4).collect()]
        {
            assert_eq!(seen_at_once(bodies.clone(), &bend, &points, RECORDING), bodies);
        }
        // Of its own shape, which lies at x = 0.4 by then, and of more that is farther on.
        let along =
            |count: u32| (0..count).map(|k| (([0.4, 0.01 * k as f32, 0.0], [9, 8, 7]), 0.4)).collect::<Vec<_>>();
        let mut wide = bodies.clone();
        wide[0].points.extend(
            (10..50).map(|k| SurfacePoint { position_m: [0.01 * f64::from(k), 0.0, 0.0], ..bodies[0].points[0] }),
        );
        assert_eq!(seen_at_once(wide.clone(), &bend, &along(75), RECORDING), wide, "50 of 75 lie on it");
        assert_eq!(seen_at_once(wide, &bend, &along(90), RECORDING)[0].points.len(), 90);
        let seen: Vec<_> = limb(0.4, 0.4).collect();
        assert_eq!(seen_at_once(bodies.clone(), &[], &seen, RECORDING), bodies, "it does not bend");
    }
}
