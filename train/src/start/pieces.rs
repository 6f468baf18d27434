//! The shape of what bends: what was seen of it at single instants, where silhouettes of all instants agree on a part of it alone.
//!
//! Limbs are followed well for an interval or two, and are lost when they are hidden or leave the view. So what bends is several pieces,
//! one after the other, each from an instant of its own.

use erfgs_dataset::{Body, BodyPose, SurfacePoint};
use glam::DVec3;

use super::{
    bodies::{Recording, seen_best, silhouettes_agree},
    rest::{NEAR, spacing},
};
use crate::scene::Point;
use erfgs_splat::{gaussians::Neighbours, motion::BodiesOptions};

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

/// A body, or what one that bends is for a part of the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Its path, its shape, and when it is there.
    pub body: Body,
    /// The instant that it is followed from, in [0, 1]; none if it does not bend.
    pub bends: Option<f64>,
    /// One over the number of pieces of the same body.
    pub share: f64,
}

impl Piece {
    /// A body that does not bend.
    #[must_use]
    pub fn whole(body: Body) -> Self {
        Self { body, bends: None, share: 1.0 }
    }
}

/// What `bodies` start from: those that bend with the `points` that move (instants in [0, 1]) at instants about `bodies.piece` RGB
/// intervals apart, as far as they are of no other body, each there for the time around its instant; with their own where these are few,
/// or lie on it.
#[must_use]
pub fn pieces(bodies: Vec<Body>, options: &BodiesOptions, points: &[(Point, f64)], recording: Recording) -> Vec<Piece> {
    let of = |body: &Body| {
        if !options.bend.contains(&body.name) {
            return vec![Piece::whole(body.clone())];
        }
        let seen = Observed { body, all: &bodies, points, recording };
        seen.pieces(f64::from(options.piece)).unwrap_or_else(|| {
            let bends = Some(seen_best(body, recording));
            vec![Piece { body: body.clone(), bends, share: 1.0 }]
        })
    };
    bodies.iter().flat_map(of).collect()
}

/// What was seen of a body at an instant, in [0, 1].
struct Shape {
    instant: f64,
    points: Vec<SurfacePoint>,
}

/// A body and what was seen of it.
struct Observed<'a> {
    body: &'a Body,
    all: &'a [Body],
    points: &'a [(Point, f64)],
    recording: Recording,
}

impl Observed<'_> {
    /// Pieces of so many RGB intervals (0: one); none where the shape that the body has is the better one.
    fn pieces(&self, intervals: f64) -> Option<Vec<Piece>> {
        // Where silhouettes agree on its shape, it is how it turns that is not known: that shape is nothing to go by.
        let best = self.shape_at(seen_best(self.body, self.recording), !silhouettes_agree(self.body))?;
        let [begin, end] = self.body.span_ns.map(|t_ns| self.recording.t01(t_ns));
        let long = (end - begin) * self.recording.intervals;
        let count = if intervals > 0.0 { (long / intervals).round().min(self.instants() as f64) as u32 } else { 1 };
        let middle = |k: u32| begin + (end - begin) * (f64::from(k) + 0.5) / f64::from(count);
        let mut shapes: Vec<Shape> = (0..count).filter_map(|k| self.shape_at(middle(k), false)).collect();
        shapes.dedup_by(|a, b| a.instant == b.instant);
        let pieces = shapes.len();
        if pieces < 2 {
            let body = Body { points: best.points, ..self.body.clone() };
            return Some(vec![Piece { body, bends: Some(best.instant), share: 1.0 }]);
        }
        // Each is there until the middle between its instant and the next.
        let between =
            |pair: &[Shape]| i64::midpoint(self.recording.t_ns(pair[0].instant), self.recording.t_ns(pair[1].instant));
        let mut ends: Vec<i64> = shapes.windows(2).map(between).collect();
        ends.push(self.body.span_ns[1]);
        let mut begin = self.body.span_ns[0];
        let piece = |(k, (shape, end)): (usize, (Shape, i64))| {
            let name = format!("{}.{}", self.body.name, k + 1);
            let span_ns = [std::mem::replace(&mut begin, end), end];
            let body = Body { name, span_ns, points: shape.points, ..self.body.clone() };
            Piece { body, bends: Some(shape.instant), share: 1.0 / pieces as f64 }
        };
        Some(std::iter::zip(shapes, ends).enumerate().map(piece).collect())
    }

    /// How many instants points were seen at.
    fn instants(&self) -> usize {
        let mut instants: Vec<f64> = self.points.iter().map(|(_, at)| *at).collect();
        instants.sort_by(f64::total_cmp);
        instants.dedup();
        instants.len()
    }

    /// What was seen at the instant nearest to `t01`; none if little was, or if it is to be more than what lies on the shape of all instants.
    fn shape_at(&self, t01: f64, is_more: bool) -> Option<Shape> {
        let away = |at: f64| (at - t01).abs();
        let instant = self.points.iter().map(|(_, at)| *at).min_by(|a, b| away(*a).total_cmp(&away(*b)))?;
        if away(instant) * self.recording.intervals > SOON {
            return None;
        }
        let here = self.points.iter().filter(|(_, at)| *at == instant).map(|(point, _)| *point);
        let t_ns = self.recording.t_ns(instant);
        let most_on_it = if is_more { ENOUGH } else { f64::INFINITY };
        let seen = seen_beside(self.body, self.all, here, t_ns, most_on_it)?;
        Some(Shape { instant, points: surface(&seen, self.body.pose_at(t_ns)?) })
    }
}

fn exact(place: &[f32; 3]) -> DVec3 {
    DVec3::from(place.map(f64::from))
}

/// Those of the points of an instant that are of a body and of no other; none where these are few, or `most_on_it` of them lie on its own
/// shape.
fn seen_beside(
    body: &Body,
    all: &[Body],
    here: impl Iterator<Item = Point>,
    t_ns: i64,
    most_on_it: f64,
) -> Option<Vec<Point>> {
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
    let radius_m = body.found_by.get("radius_m").and_then(serde_json::Value::as_f64).unwrap_or(0.0);
    let reach = REACH * widest.max(radius_m);
    let [own, others] = [own, others].map(|places| Neighbours::new(&places));
    let nearest =
        |all: &Neighbours, place: &[f32; 3]| all.nearest(place, 1).first().map_or(f32::INFINITY, |near| near.1);
    let is_own =
        |(place, _): &Point| exact(place).distance(middle) <= reach && nearest(&own, place) <= nearest(&others, place);
    let seen: Vec<Point> = here.filter(is_own).collect();
    let near = NEAR * spacing(&seen.iter().map(|(place, _)| *place).collect::<Vec<_>>());
    let on_it = seen.iter().filter(|(place, _)| nearest(&own, place) <= near * near).count();
    let is_more = seen.len() >= FEWEST && (on_it as f64) < most_on_it * seen.len() as f64;
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

    /// What bodies start from where `bends` bends, in pieces of so many RGB intervals.
    fn made(bodies: &[Body], piece: f32, points: &[(Point, f64)]) -> Vec<Piece> {
        let options = BodiesOptions { bend: vec!["bends".into()], piece, ..BodiesOptions::default() };
        pieces(bodies.to_vec(), &options, points, RECORDING)
    }

    #[test]
    fn what_bends_has_what_was_seen_of_it_at_its_best_and_others_what_they_had() {
        let bodies = vec![body("bends", 0.0), body("other", 1.0)];
        let points: Vec<_> = limb(0.4, 0.4).chain(limb(1.4, 0.4)).chain(limb(0.4, 0.5)).collect();
        let made = made(&bodies, 0.0, &points);
        assert_eq!(made[1], Piece::whole(bodies[1].clone()));
        let [piece, _] = &made[..] else { panic!("two bodies") };
        assert_eq!((piece.bends, piece.share, piece.body.name.as_str()), (Some(0.4), 1.0, "bends"));
        let points = &piece.body.points;
        assert_eq!((points.len(), points[0].colour), (60, [9, 8, 7]), "of one instant, and not of the other body");
        for (k, point) in points.iter().enumerate() {
            // What lies along y in the world lies along x in its frame.
            let place = DVec3::from(point.position_m);
            assert!(place.abs_diff_eq(DVec3::new(0.01 * k as f64, 0.0, 0.0), 1e-6), "{k}: {place}");
            assert!((DVec3::from(point.normal).length() - 1.0).abs() < 1e-6);
        }
        // Its ends face outwards.
        assert!(points[59].normal[0] > 0.99 && points[0].normal[0] < -0.99);
    }

    #[test]
    fn each_piece_has_what_was_seen_at_its_own_instant_and_they_follow_one_another() {
        let bodies = vec![body("bends", 0.0)];
        // It goes a tenth of a metre from instant to instant; little was seen of it at 0.8.
        let limbs = (0..=10).map(|k| (0.1 * k as f32, 0.1 * f64::from(k)));
        let points: Vec<_> = limbs.flat_map(|(x, t01)| limb(x, t01).take(if t01 > 0.75 { 20 } else { 60 })).collect();
        let made = made(&bodies, 2.0, &points);
        let names: Vec<&str> = made.iter().map(|piece| piece.body.name.as_str()).collect();
        assert_eq!(names, ["bends.1", "bends.2", "bends.3", "bends.4"]);
        assert_eq!(made[0].body.span_ns[0], RECORDING.span_ns[0]);
        assert_eq!(made[3].body.span_ns[1], RECORDING.span_ns[1], "the last one is there for what follows, too");
        assert!(made.windows(2).all(|pair| pair[0].body.span_ns[1] == pair[1].body.span_ns[0]));
        for (piece, at) in std::iter::zip(&made, [0.1, 0.3, 0.5, 0.7]) {
            assert!((piece.bends.unwrap() - at).abs() < 1e-9 && piece.share == 0.25);
            let [begin, end] = piece.body.span_ns.map(|t_ns| RECORDING.t01(t_ns));
            assert!(begin <= at && at <= end);
            // Each limb lies where its body is.
            assert!(DVec3::from(piece.body.points[0].position_m).abs_diff_eq(DVec3::ZERO, 1e-3));
        }
        // Not more pieces than instants, however short they are to be.
        assert_eq!(super::tests::made(&bodies, 1e-6, &points).len(), 8);
        // One where they are as long as the recording.
        assert_eq!(super::tests::made(&bodies, 10.0, &points).len(), 1);
    }

    #[test]
    fn where_little_was_seen_or_lies_on_its_own_shape_it_keeps_that() {
        let bodies = vec![body("bends", 0.0)];
        let kept = |bodies: &[Body], points: &[(Point, f64)]| {
            let made = made(bodies, 2.0, points);
            made.len() == 1 && made[0].body == bodies[0] && made[0].bends == Some(0.4)
        };
        for points in
            [Vec::new(), limb(0.4, 0.4).take(20).collect(), limb(0.4, 0.9).collect(), limb(3.0, 0.4).collect()]
        {
            assert!(kept(&bodies, &points));
        }
        // Of its own shape, which lies at x = 0.4 by then, and of more that is farther on.
        let along =
            |count: u32| (0..count).map(|k| (([0.4, 0.01 * k as f32, 0.0], [9, 8, 7]), 0.4)).collect::<Vec<_>>();
        let mut wide = bodies.clone();
        wide[0].points.extend(
            (10..50).map(|k| SurfacePoint { position_m: [0.01 * f64::from(k), 0.0, 0.0], ..bodies[0].points[0] }),
        );
        assert!(kept(&wide, &along(75)), "50 of 75 lie on it");
        assert_eq!(made(&wide, 2.0, &along(90))[0].body.points.len(), 90);
        // Where silhouettes agree on it, it is not what makes it a body that bends.
        let mut agreed = wide.clone();
        agreed[0].found_by.insert("carving_agreement".to_owned(), 0.86.into());
        assert_eq!(made(&agreed, 2.0, &along(75))[0].body.points.len(), 75);
        let rigid = pieces(bodies.clone(), &BodiesOptions::default(), &limb(0.4, 0.4).collect::<Vec<_>>(), RECORDING);
        assert_eq!(rigid, [Piece::whole(bodies[0].clone())]);
    }
}
