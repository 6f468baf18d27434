//! Epipolar lines through any lens: what another camera sees of a pixel's ray.
//!
//! Seen from the other camera, the points of a ray lie on an arc of a great circle: from the first camera's centre (the
//! epipole, depth nil) to the direction of the ray (depth infinite). The lens makes a curve of the arc. All depths are
//! walked at equal angles, and neither end needs a limit.

use std::f64::consts::PI;

use erfgs_scene::{Intrinsics, Pose, lens::NoRay};
use glam::{DVec2, DVec3};

/// A lens and where it stands (world to camera).
type PlacedLens<'a> = (&'a Intrinsics, &'a Pose);

/// An arc shorter than this is a point, radians.
const POINT: f64 = 1e-9;
/// Places of a curve from which the nearest one to a pixel is looked for.
const TRIED: u32 = 64;
/// Distance of two samples of a curve near the optical axis, pixels.
const STEP_PX: f64 = 8.0;
/// Samples of a whole half circle at least, and at most.
const SAMPLES: [f64; 2] = [256.0, 8192.0];

/// The image of a pixel's ray in another camera.
#[derive(Clone, Debug, PartialEq)]
pub struct EpipolarCurve {
    lens: Intrinsics,
    /// Where the ray starts, as a direction in the other camera's space, length 1.
    start: DVec3,
    /// At right angles to it, towards where the ray goes, length 1.
    towards: DVec3,
    /// The angle from the start to the ray's direction, radians.
    end: f64,
    /// Directions with a smaller z lie outside what the lens model is asked for.
    edge: f64,
}

impl EpipolarCurve {
    /// The image in `to` of the ray that meets `pixel` in `from`; `None` where the lens of `from` has no ray there.
    #[must_use]
    pub fn new(from: PlacedLens<'_>, pixel: DVec2, to: PlacedLens<'_>) -> Option<Self> {
        let ray = from.0.unproject(pixel).ok()?;
        let direction = to.1.rotation * (from.1.rotation.conjugate() * ray);
        let centre = from.1.centre();
        let origin = to.1.transform(centre);
        // From one centre, up to rounding, the ray is a point.
        let apart = origin.length() > 1e-12 * (1.0 + centre.length());
        let start = if apart { origin.normalize() } else { direction };
        let across = direction - start * direction.dot(start);
        let mut end = across.length().atan2(direction.dot(start));
        // A ray through both centres has no plane: it is seen end on, or on both sides of the other camera.
        let mut towards = start.any_orthonormal_vector();
        if across.length() > POINT {
            towards = across.normalize();
        } else {
            end = if direction.dot(start) < 0.0 { PI } else { 0.0 };
        }
        let finite = start.is_finite() && towards.is_finite() && end.is_finite();
        finite.then(|| Self { lens: *to.0, start, towards, end, edge: edge(to.0) })
    }

    /// Whether the ray is seen end on, as a point (or, where it runs through the other camera's centre, as two).
    #[must_use]
    pub fn is_point(&self) -> bool {
        self.end < POINT || self.end > PI - POINT
    }

    fn direction(&self, angle: f64) -> DVec3 {
        let (sine, cosine) = angle.sin_cos();
        self.start * cosine + self.towards * sine
    }

    fn at(&self, angle: f64) -> Option<DVec2> {
        let direction = self.direction(angle);
        if direction.z < self.edge { None } else { self.lens.project(direction) }
    }

    /// How far `pixel` lies from the curve, pixels; `None` where the lens shows nothing of the curve near it.
    #[must_use]
    pub fn distance_px(&self, pixel: DVec2) -> Option<f64> {
        let away = |angle: f64| self.at(angle).map(|at| at.distance(pixel));
        if self.is_point() {
            return [0.0, self.end].into_iter().filter_map(away).min_by(f64::total_cmp);
        }
        // A strongly bent curve comes near in several places: some places all over it are tried, and the one that is nearest in
        // angle.
        let nearest_in_angle = self.lens.unproject(pixel).ok().map(|seen| {
            let angle = seen.dot(self.towards).atan2(seen.dot(self.start));
            angle.clamp(0.0, self.end)
        });
        let all_over = (0..=TRIED).map(|index| self.end * f64::from(index) / f64::from(TRIED));
        let tried = all_over.chain(nearest_in_angle).filter_map(|angle| Some((angle, away(angle)?)));
        let (mut angle, mut best) = tried.min_by(|a, b| a.1.total_cmp(&b.1))?;
        // From there, Gauss's and Newton's steps.
        for _ in 0..50 {
            let (sine, cosine) = angle.sin_cos();
            let along = self.towards * cosine - self.start * sine;
            let Some(projection) = self.lens.project_with_derivatives(self.direction(angle)) else { break };
            let slope = DVec2::new(projection.by_point[0].dot(along), projection.by_point[1].dot(along));
            let step = (pixel - projection.pixel).dot(slope) / slope.length_squared();
            let nearer = (0..20).find_map(|halvings| {
                let next = (angle + step * 0.5_f64.powi(halvings)).clamp(0.0, self.end);
                away(next).filter(|distance| *distance < best).map(|distance| (next, distance))
            });
            let Some(next) = nearer else { break };
            (angle, best) = next;
        }
        Some(best)
    }

    /// The parts of the curve in the image (half an image around it is taken in, so that lines run out of the picture), each
    /// drawn by points that lie within `tolerance_px` of it. A ray that is seen end on gives parts of one point.
    #[must_use]
    pub fn parts(&self, tolerance_px: f64) -> Vec<Vec<DVec2>> {
        let (width, height) = (f64::from(self.lens.width), f64::from(self.lens.height));
        let near =
            |at: &DVec2| (-0.5 * width..=1.5 * width).contains(&at.x) && (-0.5 * height..=1.5 * height).contains(&at.y);
        if self.is_point() {
            let ends = if self.end < POINT { vec![0.0] } else { vec![0.0, self.end] };
            return ends.into_iter().filter_map(|angle| self.at(angle).filter(near)).map(|at| vec![at]).collect();
        }
        let half_circle = (PI * self.lens.fx.max(self.lens.fy) / STEP_PX).clamp(SAMPLES[0], SAMPLES[1]);
        let count = (half_circle * self.end / PI).ceil().max(8.0) as usize;
        let mut parts: Vec<Vec<DVec2>> = vec![Vec::new()];
        for sample in 0..=count {
            match self.at(self.end * sample as f64 / count as f64).filter(near) {
                Some(at) => parts.last_mut().into_iter().for_each(|part| part.push(at)),
                None if parts.last().is_some_and(|part| !part.is_empty()) => parts.push(Vec::new()),
                None => {}
            }
        }
        parts.retain(|part| part.len() > 1);
        parts.iter().map(|part| simplified(part, tolerance_px)).collect()
    }
}

/// The least z of the directions that a lens sees in its image and half an image around it, or as far around it as the lens model
/// holds. Farther out its polynomial may turn back, and show in the image what is not there.
fn edge(lens: &Intrinsics) -> f64 {
    let (width, height) = (f64::from(lens.width), f64::from(lens.height));
    let least = |room: f64| {
        let share = [-room, 0.5, 1.0 + room];
        let places = share.iter().flat_map(|x| share.map(|y| DVec2::new(x * width, y * height)));
        places
            .map(|place| lens.unproject(place).map(|ray| ray.z))
            .try_fold(1.0_f64, |least, z| Ok::<_, NoRay>(least.min(z?)))
    };
    [0.5, 0.25, 0.0].into_iter().find_map(|room| least(room).ok()).unwrap_or(-1.0) - 1e-9
}

/// The fewest of `points`, by halving, so that none lies farther than `tolerance` from the line through them (Ramer 1972;
/// Douglas and Peucker 1973).
fn simplified(points: &[DVec2], tolerance: f64) -> Vec<DVec2> {
    let mut keep = vec![false; points.len()];
    let mut open = vec![(0, points.len().saturating_sub(1))];
    while let Some((first, last)) = open.pop() {
        for end in [first, last] {
            keep.get_mut(end).into_iter().for_each(|keep| *keep = true);
        }
        let Some(inner) = points.get(first + 1..last).filter(|inner| !inner.is_empty()) else { continue };
        let (from, to) = (points[first], points[last]);
        let along = (to - from).normalize_or_zero();
        let off = inner.iter().map(|point| {
            let offset = *point - from;
            if along == DVec2::ZERO { offset.length() } else { along.perp_dot(offset).abs() }
        });
        let worst = off.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((index, _)) = worst.filter(|(_, off)| *off > tolerance) {
            open.extend([(first, first + 1 + index), (first + 1 + index, last)]);
        }
    }
    points.iter().zip(keep).filter(|(_, keep)| *keep).map(|(point, _)| *point).collect()
}

#[cfg(test)]
mod tests {
    use erfgs_scene::Distortion;

    use super::*;

    fn lenses() -> [Intrinsics; 3] {
        [
            Distortion::None,
            Distortion::BrownConrady([-0.25, 0.08, 1e-3, -2e-3, -0.01, 0.0, 0.0, 0.0]),
            Distortion::KannalaBrandt([0.05, -0.01, 2e-3, 0.0]),
        ]
        .map(|distortion| Intrinsics {
            width: 640,
            height: 480,
            fx: 400.0,
            fy: 405.0,
            cx: 322.0,
            cy: 238.0,
            distortion,
        })
    }

    fn poses() -> [Pose; 2] {
        [DVec3::new(-0.6, 0.1, -2.0), DVec3::new(0.9, -0.2, -1.6)].map(|eye| Pose::look_at(eye, DVec3::ZERO, DVec3::Y))
    }

    /// How far `pixel` lies from the drawn line.
    fn from_drawn(parts: &[Vec<DVec2>], pixel: DVec2) -> f64 {
        let pieces = parts.iter().flat_map(|part| part.windows(2));
        let off = pieces.map(|piece| {
            let along = piece[1] - piece[0];
            let share = ((pixel - piece[0]).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            (piece[0] + along * share).distance(pixel)
        });
        off.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn a_point_lies_on_its_line_through_every_lens() {
        let [a, b] = poses();
        for from in lenses() {
            for to in lenses() {
                for point in [DVec3::new(0.2, -0.3, 0.4), DVec3::new(-0.5, 0.3, 1.0), DVec3::new(0.1, 0.2, -0.5)] {
                    let pixel = from.project(a.transform(point)).unwrap();
                    let seen = to.project(b.transform(point)).unwrap();
                    let curve = EpipolarCurve::new((&from, &a), pixel, (&to, &b)).unwrap();
                    let off = curve.distance_px(seen).unwrap();
                    assert!(off < 1e-6, "{off}: {from:?} {to:?}");
                    let drawn = from_drawn(&curve.parts(0.05), seen);
                    assert!(drawn < 0.2, "{drawn}: {to:?}");
                }
            }
        }
    }

    #[test]
    fn a_distance_is_that_to_the_nearest_place_of_the_curve() {
        let [a, b] = poses();
        let [pinhole, brown, fisheye] = lenses();
        for to in [pinhole, brown, fisheye] {
            let curve = EpipolarCurve::new((&pinhole, &a), DVec2::new(500.0, 100.0), (&to, &b)).unwrap();
            for pixel in [DVec2::new(200.0, 300.0), DVec2::new(50.0, 30.0), DVec2::new(600.0, 450.0)] {
                let found = curve.distance_px(pixel).unwrap();
                let all = (0..=200_000).filter_map(|i| curve.at(curve.end * f64::from(i) / 2e5));
                let nearest = all.map(|at| at.distance(pixel)).fold(f64::INFINITY, f64::min);
                assert!((found - nearest).abs() < 1e-3, "{found} {nearest}");
            }
        }
    }

    #[test]
    fn a_ray_through_the_other_centre_is_a_point() {
        let [a, b] = poses();
        for lens in lenses() {
            // A camera that looks at the other one, so that its middle ray runs through the other's centre.
            let facing = Pose::look_at(a.centre(), b.centre(), DVec3::Y);
            let pixel = lens.project(DVec3::Z).unwrap();
            let curve = EpipolarCurve::new((&lens, &facing), pixel, (&lens, &b)).unwrap();
            assert!(curve.is_point() && curve.parts(0.1).iter().all(|part| part.len() == 1));
            // Seen end on from behind: the other camera stands on the ray and looks along it.
            let behind = Pose { translation: facing.translation + DVec3::Z, ..facing };
            let curve = EpipolarCurve::new((&lens, &facing), pixel, (&lens, &behind)).unwrap();
            assert!(curve.is_point());
            let seen = lens.project(DVec3::Z).unwrap();
            assert!(curve.distance_px(seen).unwrap() < 1e-6 && curve.parts(0.1).len() == 1);
        }
    }

    #[test]
    fn cameras_of_one_centre_see_a_ray_as_a_point() {
        let [a, _] = poses();
        let [lens, ..] = lenses();
        let curve = EpipolarCurve::new((&lens, &a), DVec2::new(30.0, 50.0), (&lens, &a)).unwrap();
        assert!(curve.is_point());
        assert!((curve.distance_px(DVec2::new(30.0, 53.0)).unwrap() - 3.0).abs() < 1e-6);
    }

    #[test]
    fn what_lies_behind_is_not_drawn() {
        let [pinhole, brown, fisheye] = lenses();
        let a = Pose::IDENTITY;
        // Looks the other way, from behind the first camera.
        let b = Pose::look_at(DVec3::new(0.3, 0.0, -1.0), DVec3::new(0.3, 0.0, -5.0), DVec3::Y);
        for lens in [pinhole, brown] {
            let curve = EpipolarCurve::new((&pinhole, &a), DVec2::new(300.0, 200.0), (&lens, &b)).unwrap();
            assert!(curve.parts(0.1).is_empty());
            assert_eq!(curve.distance_px(DVec2::new(300.0, 200.0)), None);
        }
        // A fisheye sees beside itself, but not what is right behind it.
        let curve = EpipolarCurve::new((&pinhole, &a), DVec2::new(322.0, 238.0), (&fisheye, &b)).unwrap();
        assert!(curve.parts(0.1).iter().flatten().all(|at| at.is_finite()));
        // And the half of the line behind the first camera is not the ray's: a point there lies away from it.
        let beside = Pose::look_at(DVec3::new(2.0, 0.0, 0.0), DVec3::new(0.0, 0.0, 0.3), DVec3::Y);
        let curve = EpipolarCurve::new((&pinhole, &a), DVec2::new(322.0, 238.0), (&pinhole, &beside)).unwrap();
        let [front, back] = [1.0, -1.0].map(|z| pinhole.project(beside.transform(DVec3::new(0.0, 0.0, z))).unwrap());
        assert!(curve.distance_px(front).unwrap() < 1e-6 && curve.distance_px(back).unwrap() > 50.0);
    }

    #[test]
    fn straight_lines_need_few_points() {
        let [a, b] = poses();
        let [pinhole, brown, _] = lenses();
        let line = |lens: &Intrinsics| {
            let curve = EpipolarCurve::new((&pinhole, &a), DVec2::new(400.0, 200.0), (lens, &b)).unwrap();
            curve.parts(0.1).iter().map(Vec::len).sum::<usize>()
        };
        assert_eq!(line(&pinhole), 2);
        assert!((3..80).contains(&line(&brown)), "{}", line(&brown));
    }
}
