//! Things that are round: where a ball is, and how large it is.
//!
//! The hull of a ball that is seen from one side is longer than the ball, and its middle is nearer or farther away. All silhouettes of
//! a ball are discs, which are longer where it moves while the shutter is open. So its middle and its radius are where discs fit them
//! best; what hides a part of it, or is one silhouette with it in some views, hardly matters.

use erfgs_calibrate::statistics::median;
use glam::DVec3;
use rayon::prelude::*;

use super::{
    carve::AGREE,
    centres::Track,
    film::{Eye, Film, View},
    globe::Globe,
    path::Path,
    shades::Shape,
    turn::directions_apart,
};

/// Places of a disc and around it that are looked at, and how far they reach, radii.
const PLACES: usize = 240;
const REACH: f64 = 1.45;
/// What moves around a disc counts so much, compared with what does not move in it: it may be another thing.
const AROUND: f64 = 0.5;
/// For so much of the exposure a silhouette is clearly seen to move.
const EXPOSED: f64 = 0.7;
/// So large a share of a disc must be in view, and in so many views.
const IN_VIEW: f64 = 0.7;
const FEWEST_VIEWS: usize = 3;
/// Radii that are tried, of that of the hull, and how much larger one is than the one before; at the end that much finer.
const SMALLEST: f64 = 0.3;
const LARGEST: f64 = 1.2;
const LARGER: f64 = 1.08;
const FINER: f64 = 1.02;
/// So many instants tell the radius.
const TELLING: usize = 12;
/// A ball is seen clearly at so many instants at least.
const FEWEST_INSTANTS: usize = 3;
/// The first and the last step of a middle, radii.
const FIRST_STEP: f64 = 0.4;
const LAST_STEP: f64 = 0.015;
/// A thing is round if discs are off by at most so much at most instants; where they are off by more than is clear, and by
/// so many times more than usual, it is not seen clearly.
const ROUND: f64 = 0.19;
const CLEAR: f64 = 0.2;
const CLEARER: f64 = 1.5;
/// A point is beside a disc that is so many radii from its middle, and so large a share of a round thing's points is at most.
const BESIDE: f64 = 1.35;
const ASIDE: f64 = 0.11;
/// The same two of what is seen at two instants (`thrown.rs`): it flies, others move behind it, and its hull has what it covers while
/// the shutter is open. Anything else is off by 0.38 and more.
const ROUND_AT_TWO: f64 = 0.3;
const ASIDE_AT_TWO: f64 = 0.2;
/// A disc has at least so many pixels from its middle to its edge.
const SMALLEST_PX: f64 = 3.0;
/// A ball is given at least and at most so many points.
const POINTS: [f64; 2] = [200.0, 4000.0];

/// A round thing.
#[derive(Clone, Debug)]
pub struct Ball {
    /// The radius of its silhouettes, metres.
    pub radius_m: f64,
    /// Where its middle is at the instants at which it is seen clearly.
    pub places: Vec<(usize, DVec3)>,
    /// How far its discs are off at most instants.
    pub off: f64,
}

/// A disc among silhouettes of an instant.
struct Disc {
    middle: DVec3,
    /// So far the ball moves within half of the exposure, metres.
    smear: DVec3,
    radius_m: f64,
}

impl Ball {
    /// A thing as a ball; none of what is not round.
    pub fn new(film: &Film, track: &Track, path: &Path, shapes: &[Shape]) -> Option<Self> {
        let sure: Vec<&Shape> = shapes.iter().filter(|shape| track.sure[shape.moment]).collect();
        let step = sure.len().div_ceil(TELLING).max(1);
        let telling: Vec<&Shape> = sure.into_iter().step_by(step).collect();
        let (fewest, most_off, most_aside) =
            if shapes.len() == 2 { (2, ROUND_AT_TWO, ASIDE_AT_TWO) } else { (FEWEST_INSTANTS, ROUND, ASIDE) };
        if telling.len() < fewest {
            return None;
        }
        let (radius_m, off) = radius(film, path, &telling, track.radius_m);
        let pixels = telling.iter().map(|shape| pixels(film, shape, radius_m)).fold(0.0, f64::max);
        if off > most_off || pixels < SMALLEST_PX {
            return None;
        }
        let found: Vec<(DVec3, f64)> = shapes.par_iter().map(|shape| fitted(film, path, shape, radius_m)).collect();
        let found = || std::iter::zip(shapes, &found);
        let sure = found().filter(|(shape, _)| track.sure[shape.moment]).step_by(step);
        let mut aside: Vec<f64> =
            sure.map(|(shape, (middle, _))| aside(film, path, shape, *middle, radius_m)).collect();
        aside.sort_unstable_by(f64::total_cmp);
        if aside[aside.len() / 4] > most_aside {
            return None;
        }
        let clear = found().filter(|(_, (_, misfit))| *misfit <= CLEAR.max(CLEARER * off));
        let places: Vec<(usize, DVec3)> = clear.map(|(shape, (middle, _))| (shape.moment, *middle)).collect();
        (places.len() >= fewest).then_some(Self { radius_m, places, off })
    }

    /// The share of silhouettes that agrees on it, as far as is asked of what is carved. Of what is seen at two instants it is not what
    /// moves behind it that counts, but that discs of one size fit all views.
    pub fn agree(&self) -> f64 {
        if self.places.len() == 2 { AGREE } else { (1.0 - self.off).min(AGREE) }
    }

    /// Its points at an instant.
    pub fn shape(&self, film: &Film, moment: usize, centre: DVec3) -> Shape {
        let normals = self.normals(film);
        let places: Vec<DVec3> = normals.iter().map(|along| self.radius_m * *along).collect();
        let colours = vec![Default::default(); places.len()];
        Shape { moment, centre, places, normals, colours }
    }

    /// Those of its points that are seen, with their colours.
    pub fn seen(&self, film: &Film, moment: usize, centre: DVec3) -> Shape {
        let globe = Globe::new(film, moment, centre, self.radius_m);
        let seen = self.normals(film).into_iter().filter_map(|along| Some((along, globe.colour(along)?)));
        let (normals, colours): (Vec<DVec3>, Vec<[u8; 3]>) = seen.unzip();
        let places = normals.iter().map(|along| self.radius_m * *along).collect();
        Shape { moment, centre, places, normals, colours }
    }

    fn normals(&self, film: &Film) -> Vec<DVec3> {
        directions_apart(self.radius_m, film.cell_m, POINTS)
    }
}

/// The radius of the hull's that fits silhouettes best, and how far discs are off then.
fn radius(film: &Film, path: &Path, telling: &[&Shape], hull_m: f64) -> (f64, f64) {
    let off =
        |radius_m: f64| -> Vec<f64> { telling.par_iter().map(|shape| fitted(film, path, shape, radius_m).1).collect() };
    let better = |best: (f64, Vec<f64>), radius_m: f64| {
        let next = off(radius_m);
        if next.iter().sum::<f64>() < best.1.iter().sum() { (radius_m, next) } else { best }
    };
    let (first, tries) = (SMALLEST * hull_m, ((LARGEST / SMALLEST).ln() / LARGER.ln()).ceil() as i32);
    let coarse = (1..=tries).map(|power| first * LARGER.powi(power)).fold((first, off(first)), better);
    let around = [-2, -1, 1, 2].map(|power| coarse.0 * FINER.powi(power));
    let (radius_m, off) = around.into_iter().fold(coarse, better);
    (radius_m, median(off).unwrap_or(1.0))
}

/// The share of a thing's points at an instant, over views, that are beside its disc, wherever it is while the shutter is open.
fn aside(film: &Film, path: &Path, shape: &Shape, middle: DVec3, radius_m: f64) -> f64 {
    let moment = &film.moments[shape.moment];
    let smear = 0.5 * moment.exposure_s * path.velocity(moment.t_s);
    let (mut beside, mut all) = (0_u32, 0_u32);
    for view in &moment.views {
        let from = film.eyes[view.eye].centre;
        let (sight, away_m) = ((middle - from).normalize_or_zero(), middle.distance(from));
        let seen_smear = smear.reject_from_normalized(sight);
        for place in &shape.places {
            let along = (shape.centre + *place - from).normalize_or_zero();
            let off = away_m * along.reject_from_normalized(sight);
            let went = off.dot(seen_smear) / seen_smear.length_squared().max(1e-18);
            all += 1;
            beside += u32::from((off - went.clamp(-1.0, 1.0) * seen_smear).length() > BESIDE * radius_m);
        }
    }
    f64::from(beside) / f64::from(all.max(1))
}

/// How many pixels a length is where a thing is at an instant, for the camera that sees it largest.
fn pixels(film: &Film, shape: &Shape, length_m: f64) -> f64 {
    let eyes = film.moments[shape.moment].views.iter().map(|view| &film.eyes[view.eye]);
    eyes.map(|eye| length_m * eye.intrinsics.fx / eye.centre.distance(shape.centre)).fold(0.0, f64::max)
}

/// The middle at which discs fit the silhouettes of an instant best, and how far they are off.
fn fitted(film: &Film, path: &Path, shape: &Shape, radius_m: f64) -> (DVec3, f64) {
    let moment = &film.moments[shape.moment];
    let smear = 0.5 * EXPOSED * moment.exposure_s * path.velocity(moment.t_s);
    let off = |middle: DVec3| off(film, &moment.views, &Disc { middle, smear, radius_m });
    let (mut best, mut middle) = (off(shape.centre), shape.centre);
    let mut step = FIRST_STEP;
    while step > LAST_STEP {
        let sides = steps().map(|side| middle + step * radius_m * side);
        match sides.map(|place| (off(place), place)).min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((next, place)) if next < best => (best, middle) = (next, place),
            _ => step *= 0.5,
        }
    }
    (middle, best)
}

/// Steps to all sides.
fn steps() -> impl Iterator<Item = DVec3> {
    let all = [-1.0, 0.0, 1.0];
    let cube = all.into_iter().flat_map(move |x| all.into_iter().flat_map(move |y| all.map(|z| DVec3::new(x, y, z))));
    cube.filter(|side| *side != DVec3::ZERO)
}

/// How far discs are off the silhouettes of views: the mean of the share of each that does not move, and of what moves around it.
fn off(film: &Film, views: &[View], disc: &Disc) -> f64 {
    let each = views.iter().filter_map(|view| disc.off(&film.eyes[view.eye], view));
    let (sum, count) = each.fold((0.0, 0), |(sum, count), off| (sum + off, count + 1));
    if count < FEWEST_VIEWS { 1.0 } else { sum / count as f64 }
}

impl Disc {
    /// None where too little of it is in view.
    fn off(&self, eye: &Eye, view: &View) -> Option<f64> {
        let sight = (self.middle - eye.centre).normalize_or_zero();
        let smear = self.smear.reject_from(sight);
        let along = smear.try_normalize().unwrap_or_else(|| sight.any_orthonormal_vector());
        let across = sight.cross(along);
        let (mut still, mut inside, mut around, mut outside) = (0, 0, 0, 0);
        for place in 0..PLACES {
            let (sin, cos) = (std::f64::consts::PI * (1.0 + 5_f64.sqrt()) * place as f64).sin_cos();
            let away = REACH * ((place as f64 + 0.5) / PLACES as f64).sqrt();
            let longer = smear.length().copysign(cos);
            let at = self.middle + (self.radius_m * away * cos + longer) * along + self.radius_m * away * sin * across;
            let Some(pixel) = eye.pixel(at) else { continue };
            let moves = view.moving[pixel];
            if away < 1.0 {
                inside += 1;
                still += u32::from(!moves);
            } else {
                outside += 1;
                around += u32::from(moves);
            }
        }
        if f64::from(inside + outside) < IN_VIEW * PLACES as f64 {
            return None;
        }
        let share = |of: u32, all: u32| f64::from(of) / f64::from(all.max(1));
        Some((share(still, inside) + AROUND * share(around, outside)).min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::bodies::{
        carve::{Place, tests::film},
        detections::Histogram,
        turn::directions,
    };

    const RADIUS: f64 = 0.2;

    fn centre(t_s: f64) -> DVec3 {
        DVec3::new(t_s - 0.2, 0.1 * t_s, 0.0)
    }

    /// A ball at five instants, and a thing that was followed as if it were 7 cm beside where it is.
    fn followed(points: impl Fn(DVec3) -> DVec3) -> (Film, Track, Path, Vec<Shape>) {
        let times: Vec<f64> = (0..5).map(|at| 0.1 * f64::from(at)).collect();
        let place = |(moment, t_s): (usize, &f64)| {
            let (centre, rotation) = (centre(*t_s), DQuat::IDENTITY);
            Place { moment, centre, rotation, exposed: [(centre, rotation); 2] }
        };
        let mut film = film(RADIUS, &times.iter().enumerate().map(place).collect::<Vec<_>>());
        for (moment, &t_s) in std::iter::zip(&mut film.moments, &times) {
            moment.t_s = t_s;
        }
        let seen = |t_s: f64| centre(t_s) + DVec3::new(0.03, 0.0, 0.06);
        let hull: Vec<DVec3> = directions(300).into_iter().map(|along| RADIUS * points(along)).collect();
        let shape = |(moment, &t_s): (usize, &f64)| {
            Shape::new(moment, seen(t_s), hull.iter().map(|place| (seen(t_s) + *place, [128; 3])))
        };
        let shapes = times.iter().enumerate().map(shape).collect();
        let track = Track {
            fall: None,
            centres: times.iter().map(|&t_s| Some(seen(t_s))).collect(),
            sure: vec![true; times.len()],
            met: vec![],
            radius_m: 1.8 * RADIUS,
            colours: Histogram::of(&[[128; 3]]),
            usual_points: 300.0,
        };
        let path = Path::new(times.clone(), times.iter().map(|&t_s| seen(t_s)).collect());
        (film, track, path, shapes)
    }

    #[test]
    fn a_ball_is_where_its_discs_are_and_not_where_its_hull_is() {
        let (film, track, path, shapes) = followed(|along| along * DVec3::new(1.0, 1.0, 1.2));
        let ball = Ball::new(&film, &track, &path, &shapes).unwrap();
        assert!((ball.radius_m / RADIUS - 1.0).abs() < 0.05, "{ball:?}");
        assert!(ball.off < 0.05 && ball.places.len() == 5, "{ball:?}");
        for (instant, place) in &ball.places {
            let apart = place.distance(centre(shapes[*instant].moment as f64 * 0.1));
            assert!(apart < 0.01, "{apart} m at {instant}");
        }
        assert_eq!(ball.agree(), AGREE);
    }

    #[test]
    fn what_is_long_or_hangs_on_something_is_no_ball() {
        // A rod: of each disc a third is left.
        let (mut film, track, path, shapes) = followed(|along| along * DVec3::new(1.0, 1.0, 1.2));
        for moment in &mut film.moments {
            let centre = centre(moment.t_s);
            for view in &mut moment.views {
                let middle = film.eyes[view.eye].see(centre).unwrap().0;
                for (pixel, moves) in view.moving.iter_mut().enumerate() {
                    *moves &= ((pixel % 320) as f64 - middle.x).abs() < 6.0;
                }
            }
        }
        assert!(Ball::new(&film, &track, &path, &shapes).is_none());
        // A bob on a rod that is three times as long.
        let bob = |along: DVec3| if along.y > 0.7 { along * DVec3::new(0.2, 6.0, 0.2) } else { along };
        let (film, track, path, shapes) = followed(bob);
        assert!(Ball::new(&film, &track, &path, &shapes).is_none());
        // What is seen too seldom.
        let (film, track, path, shapes) = followed(|along| along);
        assert!(Ball::new(&film, &track, &path, &shapes[..1]).is_none());
    }

    #[test]
    fn what_a_ball_covers_while_the_shutter_is_open_is_not_beside_it() {
        let (mut film, _, path, shapes) = followed(|along| along * DVec3::new(1.7, 1.0, 1.0));
        let shape = &shapes[2];
        let beside = |film: &Film| aside(film, &path, shape, centre(0.2), RADIUS);
        assert!(beside(&film) > ASIDE, "it is long, and no shutter was open");
        film.moments[2].exposure_s = 0.2;
        assert!(beside(&film) < 0.3 * ASIDE, "{}", beside(&film));
    }
}
