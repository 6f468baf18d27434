//! A thing's own shape: carved in its frame by the silhouettes of all instants, carried there by its motion.

use erfgs_calibrate::statistics::median;
use erfgs_dataset::SurfacePoint;
use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::{film::Film, smooth::smooth_volume, turn::directions_apart};
use crate::photo::median_colour;

/// A cell is of the thing if at least this share of the views that see it at some instant see something that moves there; less, down
/// to the least, where hardly anything would be left.
pub const AGREE: f64 = 0.86;
const LEAST_AGREE: f64 = 0.5;
const AGREE_STEP: f64 = 0.04;
/// So much of the hull must be left: hulls of few blurred views may be twice as wide as what they are of.
const LEFT: f64 = 0.1;
/// More cells are no small thing; they are made larger.
const MOST_CELLS: usize = 1 << 21;
/// Surfaces that a camera sees more aslant have no colour in it.
const FACING: f64 = 0.25;
/// Silhouettes are so much wider than what they are of, pixels: they are smoothed, and what is beside them is of them.
const GROWN_PX: f64 = 1.0;
/// A shape has at least so many points.
const FEWEST_POINTS: usize = 10;
/// A ball has at least and at most so many.
const POINTS_OF_BALL: [f64; 2] = [100.0, 20_000.0];

/// Where a thing is at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Index of the instant.
    pub moment: usize,
    /// Where its frame has its origin, metres.
    pub centre: DVec3,
    /// From its frame to the world.
    pub rotation: DQuat,
    /// Where it is soon after the exposure begins and soon before it ends: centre, and from its frame to the world.
    pub exposed: [(DVec3, DQuat); 2],
}

/// A shape and how sure it is.
#[derive(Clone, Debug)]
pub struct Carved {
    /// Its surface, in its frame.
    pub points: Vec<SurfacePoint>,
    /// The share of views that had to agree.
    pub agree: f64,
    /// Size of its cells, metres.
    pub cell_m: f64,
}

/// A box of cells.
struct Grid {
    corner: DVec3,
    cell_m: f64,
    size: [usize; 3],
}

impl Grid {
    /// Around places, with `margin_m` besides, of cells of `cell_m` or as much larger as must be.
    fn around(places: &[DVec3], margin_m: f64, mut cell_m: f64) -> Option<Self> {
        let low = places.iter().copied().reduce(DVec3::min)? - margin_m;
        let high = places.iter().copied().reduce(DVec3::max)? + margin_m;
        loop {
            let size = ((high - low) / cell_m).ceil().max(DVec3::ONE);
            if size.element_product() <= MOST_CELLS as f64 {
                return Some(Self { corner: low, cell_m, size: size.to_array().map(|cells| cells as usize) });
            }
            if !size.is_finite() {
                return None;
            }
            cell_m *= 1.25;
        }
    }

    fn len(&self) -> usize {
        self.size.iter().product()
    }

    fn cell(&self, index: usize) -> [usize; 3] {
        [index / (self.size[1] * self.size[2]), index / self.size[2] % self.size[1], index % self.size[2]]
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.size[1] + y) * self.size[2] + z
    }

    fn centre(&self, index: usize) -> DVec3 {
        self.corner + self.cell_m * DVec3::from(self.cell(index).map(|at| at as f64 + 0.5))
    }

    /// The six cells beside one; none beyond the edge.
    fn beside(&self, index: usize) -> [Option<usize>; 6] {
        let at = self.cell(index);
        std::array::from_fn(|side| {
            let (axis, mut cell) = (side / 2, at);
            cell[axis] = if side % 2 == 0 { at[axis].checked_sub(1)? } else { at[axis] + 1 };
            (cell[axis] < self.size[axis]).then(|| self.index(cell))
        })
    }

    /// The cells within `reach_m` of places, and what they enclose.
    fn solid(&self, places: &[DVec3], reach_m: f64) -> Vec<bool> {
        let mut shell = vec![false; self.len()];
        for &place in places {
            let low = ((place - reach_m - self.corner) / self.cell_m - 0.5).ceil().max(DVec3::ZERO);
            let high = ((place + reach_m - self.corner) / self.cell_m - 0.5).floor();
            let [low, high] = [low.to_array(), high.to_array()];
            let range = |axis: usize| low[axis] as usize..((high[axis] + 1.0).max(0.0) as usize).min(self.size[axis]);
            for x in range(0) {
                for y in range(1) {
                    for z in range(2) {
                        let index = self.index([x, y, z]);
                        shell[index] |= self.centre(index).distance_squared(place) <= reach_m * reach_m;
                    }
                }
            }
        }
        // What can be reached from the faces of the box is outside.
        let mut outside = vec![false; self.len()];
        let mut open: Vec<usize> =
            (0..self.len()).filter(|&index| !shell[index] && self.beside(index).iter().any(Option::is_none)).collect();
        for &index in &open {
            outside[index] = true;
        }
        while let Some(index) = open.pop() {
            for next in self.beside(index).into_iter().flatten() {
                if !shell[next] && !outside[next] {
                    outside[next] = true;
                    open.push(next);
                }
            }
        }
        outside.into_iter().map(|outside| !outside).collect()
    }
}

/// Carves a thing: `hull` are the places of its points in its frame at the instant it is best seen, `places` where it is at each
/// instant. None where too little is left.
pub fn carve(film: &Film, hull: &[DVec3], places: &[Place], cell_m: f64) -> Option<Carved> {
    let grid = Grid::around(hull, film.cell_m, cell_m)?;
    let solid = grid.solid(hull, film.cell_m);
    let inside: Vec<usize> = (0..grid.len()).filter(|&index| solid[index]).collect();
    let agreement: Vec<f64> = inside.par_iter().map(|&index| agreement(film, places, grid.centre(index))).collect();
    let left = |least: f64| agreement.iter().filter(|agree| **agree >= least).count();
    let mut agree = AGREE;
    while (left(agree) as f64) < LEFT * inside.len() as f64 && agree > LEAST_AGREE {
        agree -= AGREE_STEP;
    }
    let mut volume = vec![0.0_f32; grid.len()];
    for (&index, &share) in std::iter::zip(&inside, &agreement) {
        volume[index] = if share >= agree { 1.0 } else { 0.0 };
    }
    let full = |index: usize| volume[index] > 0.5;
    let on_surface =
        |index: &usize| full(*index) && grid.beside(*index).into_iter().any(|next| next.is_none_or(|next| !full(next)));
    let surface: Vec<usize> = (0..grid.len()).filter(on_surface).collect();
    if surface.len() < FEWEST_POINTS {
        return None;
    }
    // The gradient of the smoothed volume points inwards.
    let mut soft = volume.clone();
    smooth_volume(&mut soft, grid.size, 4);
    let normal = |index: usize| {
        let beside = grid.beside(index).map(|next| f64::from(next.map_or(0.0, |next| soft[next])));
        let inwards = DVec3::new(beside[1] - beside[0], beside[3] - beside[2], beside[5] - beside[4]);
        (-inwards).try_normalize().unwrap_or_else(|| grid.centre(index).try_normalize().unwrap_or(DVec3::X))
    };
    let points = surface.par_iter().map(|&index| {
        let (position, normal) = (grid.centre(index), normal(index));
        let colour = colour(film, places, position, normal);
        (
            SurfacePoint {
                position_m: position.to_array(),
                normal: normal.to_array(),
                colour: colour.unwrap_or_default(),
            },
            colour.is_some(),
        )
    });
    let mut points: Vec<(SurfacePoint, bool)> = points.collect();
    // What no view faces has the usual colour of what is seen.
    let seen: Vec<[u8; 3]> = points.iter().filter(|(_, seen)| *seen).map(|(point, _)| point.colour).collect();
    let usual = median_colour(&seen);
    for (point, _) in points.iter_mut().filter(|(_, seen)| !seen) {
        point.colour = usual;
    }
    let shrink_m = GROWN_PX * pixel_m(film, places);
    for (point, _) in &mut points {
        point.position_m = (DVec3::from(point.position_m) - shrink_m * DVec3::from(point.normal)).to_array();
    }
    Some(Carved { points: points.into_iter().map(|(point, _)| point).collect(), agree, cell_m: grid.cell_m })
}

/// A ball of a radius, with the colours that views see, and how surely it is one.
pub fn ball(film: &Film, places: &[Place], [radius_m, cell_m]: [f64; 2], agree: f64) -> Carved {
    let points = directions_apart(radius_m, cell_m, POINTS_OF_BALL).into_par_iter().map(|normal| {
        let position = radius_m * normal;
        (position, normal, colour(film, places, position, normal))
    });
    let points: Vec<_> = points.collect();
    let seen: Vec<[u8; 3]> = points.iter().filter_map(|point| point.2).collect();
    let usual = median_colour(&seen);
    let point = |(position, normal, colour): (DVec3, DVec3, Option<[u8; 3]>)| SurfacePoint {
        position_m: position.to_array(),
        normal: normal.to_array(),
        colour: colour.unwrap_or(usual),
    };
    Carved { points: points.into_iter().map(point).collect(), agree, cell_m }
}

/// How wide a pixel is where a thing is: the median over instants and views, metres.
fn pixel_m(film: &Film, places: &[Place]) -> f64 {
    let of = |place: &Place| {
        let views = film.moments[place.moment].views.iter().map(|view| &film.eyes[view.eye]);
        let centre = place.centre;
        views.map(move |eye| eye.centre.distance(centre) / eye.intrinsics.fx)
    };
    median(places.iter().flat_map(of)).unwrap_or(0.0)
}

/// The share of views that see something move where a place of the thing is, of those that see it at all.
fn agreement(film: &Film, places: &[Place], position: DVec3) -> f64 {
    let (mut seen, mut moving) = (0_u32, 0_u32);
    for place in places {
        let at = place.rotation * position + place.centre;
        // A blurred silhouette is fatter than the thing: what is of it stays inside all the time that the shutter is open.
        let exposed = place.exposed.map(|(centre, rotation)| rotation * position + centre);
        for view in &film.moments[place.moment].views {
            let eye = &film.eyes[view.eye];
            let Some(pixel) = eye.pixel(at) else { continue };
            seen += 1;
            let inside = exposed.iter().all(|&at| eye.pixel(at).is_none_or(|pixel| view.moving[pixel]));
            moving += u32::from(inside && view.moving[pixel]);
        }
    }
    f64::from(moving) / f64::from(seen.max(1))
}

/// The median colour over the views that a place of the thing faces.
fn colour(film: &Film, places: &[Place], position: DVec3, normal: DVec3) -> Option<[u8; 3]> {
    let mut colours = Vec::new();
    for place in places {
        let (at, out) = (place.rotation * position + place.centre, place.rotation * normal);
        for view in &film.moments[place.moment].views {
            let eye = &film.eyes[view.eye];
            if (eye.centre - at).normalize_or_zero().dot(out) > FACING {
                colours.extend(eye.pixel(at).map(|pixel| view.colour(pixel)));
            }
        }
    }
    (!colours.is_empty()).then(|| median_colour(&colours))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::bodies::{
        film::{Eye, Moment, View, test_eye},
        turn::directions,
    };
    use erfgs_scene::image::ImageRgb8;

    /// A ball that is red above and blue below its own middle, which flies and turns, before eight cameras.
    pub fn film(radius: f64, places: &[Place]) -> Film {
        ellipsoid(DVec3::splat(radius), places, |at| if at.y < 0.0 { [220, 30, 30] } else { [30, 30, 220] })
    }

    /// An ellipsoid of half axes and colours of its own, which flies and turns, before eight cameras.
    pub fn ellipsoid(half: DVec3, places: &[Place], colour: impl Fn(DVec3) -> [u8; 3]) -> Film {
        let eyes: Vec<Eye> = (0..8)
            .map(|index| {
                let angle = 0.785 * f64::from(index);
                test_eye(
                    DVec3::new(2.0 * angle.sin(), -0.8 + 0.3 * f64::from(index % 3), 2.0 * angle.cos()),
                    DVec3::ZERO,
                )
            })
            .collect();
        let view = |eye: usize, place: &Place| {
            let (k, mut image, mut moving) = (eyes[eye].intrinsics, ImageRgb8::new(320, 180), Vec::new());
            // In its frame, where it is a ball of radius 1.
            let own = |way: DVec3| place.rotation.conjugate() * way / half;
            let from = own(eyes[eye].centre - place.centre);
            for pixel in 0..320 * 180_u32 {
                let at = glam::DVec2::new(f64::from(pixel % 320) + 0.5, f64::from(pixel / 320) + 0.5);
                let along = own(eyes[eye].rotation.transpose() * k.unproject_pinhole(at, 1.0)).normalize();
                let under = from.dot(along).powi(2) - from.length_squared() + 1.0;
                moving.push(under > 0.0);
                if under > 0.0 {
                    let hit = from + along * (-from.dot(along) - under.sqrt());
                    image.data[3 * pixel as usize..][..3].copy_from_slice(&colour(hit));
                }
            }
            View { eye, soft: image.clone(), image, moving }
        };
        let moment = |place: &Place| Moment {
            t_ns: 0,
            t_s: 0.0,
            exposure_s: 0.0,
            points: vec![],
            colours: vec![],
            views: (0..8).map(|eye| view(eye, place)).collect(),
        };
        let moments = places.iter().map(moment).collect();
        Film { span_ns: [0, 1], eyes, moments, cell_m: 0.03 }
    }

    /// The film of the first of `places` at four instants, whose silhouettes are those of a ball that moves by `blur` either way.
    fn blurred(film: Film, places: &[Place], blur: DVec3) -> Film {
        let at: Vec<Place> =
            (-2..=2).map(|k| Place { centre: places[0].centre + 0.5 * f64::from(k) * blur, ..places[0] }).collect();
        let all = self::film(0.2, &at);
        let mut moment = all.moments[2].clone();
        for (index, view) in moment.views.iter_mut().enumerate() {
            for other in &all.moments {
                for (moving, more) in std::iter::zip(&mut view.moving, &other.views[index].moving) {
                    *moving |= more;
                }
            }
        }
        Film { moments: vec![moment; 4], ..film }
    }

    #[test]
    fn a_ball_is_carved_out_of_a_fat_hull_with_the_colours_of_its_halves() {
        let radius = 0.2;
        let places: Vec<Place> = (0..4)
            .map(|k| {
                let centre = DVec3::new(0.1 * k as f64 - 0.15, 0.05, 0.02 * k as f64);
                let rotation = DQuat::from_scaled_axis(DVec3::new(0.7, 0.2, 0.9) * k as f64);
                Place { moment: k, centre, rotation, exposed: [(centre, rotation); 2] }
            })
            .collect();
        let film = film(radius, &places);
        let hull: Vec<DVec3> = directions(1200).into_iter().map(|along| 1.3 * radius * along).collect();
        let carved = carve(&film, &hull, &places, 0.02).unwrap();
        let (mut right, mut outwards) = (0, 0);
        for point in &carved.points {
            let position = DVec3::from(point.position_m);
            assert!((position.length() - radius).abs() < 0.04, "{position}");
            outwards += usize::from(DVec3::from(point.normal).angle_between(position) < 0.5);
            right += usize::from((point.colour[0] > point.colour[2]) == (position.y < 0.0));
        }
        assert!(carved.points.len() > 300, "{}", carved.points.len());
        assert!(right * 20 > carved.points.len() * 19, "{right} of {}", carved.points.len());
        assert!(outwards * 20 > carved.points.len() * 19, "{outwards} of {}", carved.points.len());
        // By silhouettes that are blurred along x it is no longer than it is, if it is known to have moved so.
        let blur = DVec3::X * 0.06;
        let swept: Vec<Place> = (0..4)
            .map(|moment| {
                let centre = places[0].centre;
                let exposed = [(centre - blur, DQuat::IDENTITY), (centre + blur, DQuat::IDENTITY)];
                Place { moment, centre, rotation: DQuat::IDENTITY, exposed }
            })
            .collect();
        let longest = |places: &[Place], film: &Film| {
            let carved = carve(film, &hull, places, 0.02).unwrap();
            carved.points.iter().map(|point| point.position_m[0].abs()).fold(0.0, f64::max)
        };
        let film = blurred(film, &places, blur);
        let still: Vec<Place> =
            swept.iter().map(|place| Place { exposed: [(place.centre, DQuat::IDENTITY); 2], ..*place }).collect();
        assert!(longest(&swept, &film) < 0.23 && longest(&still, &film) > 0.24);
        // By a motion that is wrong, hardly anything agrees.
        let lost: Vec<Place> = places
            .iter()
            .map(|place| {
                let centre = place.centre + 3.0;
                Place { centre, exposed: [(centre, place.rotation); 2], ..*place }
            })
            .collect();
        assert!(carve(&film, &hull, &lost, 0.02).is_none());
        assert!(carve(&film, &[], &places, 0.02).is_none());
    }
}
