//! Pictures of the page: a body at each instant beside what was carved of it, and which points belong to which body.

use erfgs_dataset::{Body, BodyPose};
use erfgs_page::{html::Escaped, picture::data_uri};
use erfgs_scene::image::{ImageRgb8, jpeg};
use glam::{DQuat, DVec2, DVec3};

use super::Shown;
use crate::{
    bodies::film::{Eye, Film, Moment, View},
    rig::spread,
};

/// Instants of a body that are shown, at most, and how large a picture of one is, pixels: at least, and at most.
const SHOWN: usize = 12;
const SIDE_PX: [u32; 2] = [84, 160];
/// So much of a picture is around the body, of its radius.
const AROUND: f64 = 1.5;
/// A crop is of no fewer pixels of the frame.
const LEAST_HALF_PX: f64 = 6.0;
const QUALITY: u8 = 88;
/// Pictures of all points.
const OF_POINTS: usize = 4;
/// Colours of bodies, as lines of plots have them, on dark pictures.
const COLOURS: [[u8; 3]; 8] = [
    [0x62, 0xae, 0xe8],
    [0xf0, 0x89, 0x4a],
    [0x45, 0xc4, 0x9c],
    [0xdd, 0x8f, 0xc4],
    [0xe0, 0xb3, 0x45],
    [0x8f, 0xc9, 0xef],
    [0xb7, 0x93, 0xea],
    [0xb3, 0xb7, 0xbd],
];
const NOBODYS: [u8; 3] = [255, 40, 40];

/// A picture that is put together.
struct Canvas {
    image: ImageRgb8,
}

impl Canvas {
    fn new(width: u32, height: u32) -> Self {
        Self { image: ImageRgb8::new(width, height) }
    }

    fn set(&mut self, x: i64, y: i64, colour: [u8; 3]) {
        if (0..i64::from(self.image.width)).contains(&x) && (0..i64::from(self.image.height)).contains(&y) {
            let at = 3 * (y as usize * self.image.width as usize + x as usize);
            self.image.data[at..at + 3].copy_from_slice(&colour);
        }
    }

    /// A square around a place.
    fn dot(&mut self, at: DVec2, side: f64, colour: [u8; 3]) {
        let half = 0.5 * side.clamp(1.0, 64.0);
        let [low, high] = [(at - half).round(), (at + half).round()];
        for y in low.y as i64..high.y as i64 {
            for x in low.x as i64..high.x as i64 {
                self.set(x, y, colour);
            }
        }
    }

    fn html(&self, class: &str, alt: &str) -> String {
        let bytes = jpeg(&self.image.data, self.image.width, self.image.height, QUALITY).unwrap_or_default();
        let alt = Escaped(alt);
        format!(
            "<img class=\"{class}\" style=\"max-width:100%\" src=\"{}\" alt=\"{alt}\">",
            data_uri("image/jpeg", &bytes)
        )
    }
}

/// The pose of a body at an instant; none of a body without poses.
fn pose(body: &Body, t_ns: i64) -> Option<(DVec3, DQuat)> {
    let of = |pose: &BodyPose| (DVec3::from(pose.translation_m), pose.rotation());
    let next = body.poses.partition_point(|pose| pose.t_ns <= t_ns);
    match (next.checked_sub(1).map(|before| &body.poses[before]), body.poses.get(next)) {
        (Some(before), Some(after)) => {
            let share = (t_ns - before.t_ns) as f64 / (after.t_ns - before.t_ns).max(1) as f64;
            let ((a, p), (b, q)) = (of(before), of(after));
            Some((a.lerp(b, share), p.slerp(q, share)))
        }
        (Some(only), None) | (None, Some(only)) => Some(of(only)),
        (None, None) => None,
    }
}

/// What a body fills of a camera's image: half the side of a square around it, pixels of the frame.
fn half_px(eye: &Eye, centre: DVec3, radius_m: f64) -> Option<f64> {
    let (_, depth) = eye.see(centre)?;
    Some((AROUND * radius_m * eye.intrinsics.fx / depth).max(LEAST_HALF_PX))
}

/// The body at its instants, in the camera that sees it largest at most of them: frames, silhouettes, and what was carved at the poses
/// that were found.
pub fn strip(shown: &Shown<'_>, body: &Body) -> String {
    let film = shown.film;
    let Some(thing) = shown.things.all.iter().find(|thing| thing.name == body.name) else { return String::new() };
    let moments: Vec<&Moment> = thing.shapes.iter().map(|shape| &film.moments[shape.moment]).collect();
    let half = |eye: &Eye, moment: &Moment| half_px(eye, pose(body, moment.t_ns)?.0, thing.track.radius_m);
    let size = |eye: &Eye| -> f64 {
        // The logarithm, so that a camera that sees it always is before one that sees it once and near.
        moments.iter().filter_map(|moment| half(eye, moment)).map(|half| half.min(60.0).ln()).sum()
    };
    let sizes = film.eyes.iter().map(size).enumerate();
    let Some((eye, _)) = sizes.filter(|(_, size)| *size > 0.0).max_by(|a, b| a.1.total_cmp(&b.1)) else {
        return String::new();
    };
    let seen: Vec<&Moment> =
        moments.into_iter().filter(|moment| moment.views.iter().any(|view| view.eye == eye)).collect();
    let picked: Vec<&Moment> = spread(seen.len(), SHOWN).into_iter().map(|index| seen[index]).collect();
    let halves = picked.iter().filter_map(|moment| half(&film.eyes[eye], moment));
    let half = halves.fold(LEAST_HALF_PX, f64::max).min(200.0);
    let side = ((2.0 * half).ceil() as u32).max(1);
    let scale = (SIDE_PX[0].div_ceil(side)).max(1);
    let crop = Crop { eye: &film.eyes[eye], half, scale };
    let side = (side * scale).min(SIDE_PX[1].max(side));
    let mut canvas = Canvas::new(side * picked.len() as u32, 3 * side);
    for (column, moment) in picked.iter().enumerate() {
        let Some(pose) = pose(body, moment.t_ns) else { continue };
        let Some(view) = moment.views.iter().find(|view| view.eye == eye) else { continue };
        crop.draw(&mut canvas, [column as u32 * side, side], view, body, pose);
    }
    let times: Vec<String> = picked
        .iter()
        .map(|moment| format!("{:.3}", 1e-9 * moment.t_ns.saturating_sub(film.span_ns[0]) as f64))
        .collect();
    format!(
        "<figure>{}<figcaption>In camera {eye} at {} s: its frames; of these what differs from the usual look; and its shape at the poses that \
         were found, which must look the same.</figcaption></figure>\n",
        canvas.html("detail", &format!("{} at {} instants", body.name, picked.len())),
        times.join(", ")
    )
}

/// A part of a camera's image, enlarged.
struct Crop<'a> {
    eye: &'a Eye,
    /// Half its side, pixels of the frame.
    half: f64,
    scale: u32,
}

impl Crop<'_> {
    /// Draws the frame, its silhouettes and the shape below each other, from `left` on, each `side` high and wide.
    fn draw(
        &self,
        canvas: &mut Canvas,
        [left, side]: [u32; 2],
        view: &View,
        body: &Body,
        (centre, rotation): (DVec3, DQuat),
    ) {
        let k = &self.eye.intrinsics;
        let middle = k.project_pinhole(self.eye.inside(centre));
        if !middle.is_finite() {
            return;
        }
        let corner = middle - self.half;
        let scale = f64::from(self.scale);
        for y in 0..side {
            for x in 0..side {
                let from = corner + (DVec2::new(f64::from(x), f64::from(y)) + 0.5) / scale;
                let inside =
                    from.x >= 0.0 && from.y >= 0.0 && from.x < f64::from(k.width) && from.y < f64::from(k.height);
                if !inside {
                    continue;
                }
                let pixel = from.y as usize * k.width as usize + from.x as usize;
                let colour = view.colour(pixel);
                let dim = colour.map(|value| value / 4);
                let rows = [colour, if view.moving[pixel] { colour } else { dim }, dim];
                for (row, colour) in rows.into_iter().enumerate() {
                    canvas.set(i64::from(left + x), i64::from(row as u32 * side + y), colour);
                }
            }
        }
        let placed = body.points.iter().filter_map(|point| {
            let (at, out) = (rotation * DVec3::from(point.position_m) + centre, rotation * DVec3::from(point.normal));
            let (pixel, depth) = self.eye.see(at)?;
            let place = (pixel - corner) * scale;
            let within = place.cmpge(DVec2::ZERO).all() && place.cmplt(DVec2::splat(f64::from(side))).all();
            (within && (self.eye.centre - at).dot(out) > 0.0).then_some((depth, place, point.colour))
        });
        let mut placed: Vec<(f64, DVec2, [u8; 3])> = placed.collect();
        placed.sort_by(|a, b| b.0.total_cmp(&a.0));
        let cell_m = body.found_by.get("carving_cell_m").and_then(serde_json::Value::as_f64).unwrap_or(0.01);
        let offset = DVec2::new(f64::from(left), f64::from(2 * side));
        for (depth, place, colour) in placed {
            canvas.dot(offset + place, 1.4 * cell_m * k.fx / depth * scale, colour);
        }
    }
}

/// Which points of what moves belong to which body, at some instants, in the camera that sees most of them.
pub fn owners(shown: &Shown<'_>) -> String {
    let Shown { film, things, .. } = shown;
    let colour = |owner: Option<usize>| {
        let body = owner.and_then(|owner| shown.bodies.iter().position(|body| body.name == things.all[owner].name));
        body.map_or(NOBODYS, |body| COLOURS[body % COLOURS.len()])
    };
    let mut figures = String::new();
    for index in spread(film.moments.len(), OF_POINTS) {
        let moment = &film.moments[index];
        let seen =
            |view: &&View| moment.points.iter().filter(|point| film.eyes[view.eye].see(**point).is_some()).count();
        let Some(view) = moment.views.iter().max_by_key(seen) else { continue };
        let colours: Vec<[u8; 3]> = things.owners[index].iter().map(|owner| colour(*owner)).collect();
        let nobodys = colours.iter().filter(|colour| **colour == NOBODYS).count();
        figures += &format!(
            "<figure><figcaption>{:.3} s, camera {}: {nobodys} of {} points are of no body</figcaption>{}</figure>\n",
            1e-9 * moment.t_ns.saturating_sub(film.span_ns[0]) as f64,
            view.eye,
            moment.points.len(),
            dotted(film, moment, view, &colours).html("", "points of bodies")
        );
    }
    format!(
        "<div class=\"pictures\" style=\"--columns: 2\">\n{figures}</div>\n<p class=\"caption\">Points on the hulls of what moves, in the \
         colours of bodies; red ones belong to none.</p>\n"
    )
}

fn dotted(film: &Film, moment: &Moment, view: &View, colours: &[[u8; 3]]) -> Canvas {
    let eye = &film.eyes[view.eye];
    let (width, height) = (view.image.width, view.image.height);
    let scale = (640 / width.max(1)).clamp(1, 4);
    let mut canvas = Canvas::new(width * scale, height * scale);
    for y in 0..height * scale {
        for x in 0..width * scale {
            let pixel = (y / scale) as usize * width as usize + (x / scale) as usize;
            canvas.set(i64::from(x), i64::from(y), view.colour(pixel).map(|value| value / 3));
        }
    }
    let mut seen: Vec<(f64, DVec2, [u8; 3])> = std::iter::zip(&moment.points, colours)
        .filter_map(|(point, colour)| eye.see(*point).map(|(pixel, depth)| (depth, pixel, *colour)))
        .collect();
    seen.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (_, pixel, colour) in seen {
        canvas.dot(pixel * f64::from(scale), f64::from(scale), colour);
    }
    canvas
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_are_spread_from_the_first_to_the_last() {
        assert_eq!(spread(3, 12), [0, 1, 2]);
        assert_eq!(spread(25, 4), [0, 8, 16, 24]);
        assert_eq!((spread(0, 4), spread(1, 4)), (vec![], vec![0]));
    }

    #[test]
    fn dots_stay_on_the_picture() {
        let mut canvas = Canvas::new(4, 3);
        canvas.dot(DVec2::new(-1.0, 2.0), 4.0, [9; 3]);
        canvas.dot(DVec2::new(1e300, f64::NAN), 1e300, [8; 3]);
        assert_eq!(canvas.image.data.iter().filter(|value| **value == 9).count(), 3 * 3);
    }
}
