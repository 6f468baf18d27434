//! A small textured room filmed by cameras around it, with a ball that moves.

use std::path::Path;

use erfgs_base::random;
use erfgs_dataset::{Camera, Dataset, Frame, Manifest, Provenance, Split};
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose, image::ImageRgb8};
use glam::{DVec2, DVec3};

/// Half the room's width and depth, metres; the floor is y = 0, y points down.
pub const HALF: f64 = 1.5;
pub const BALL_RADIUS: f64 = 0.3;
/// The instants, nanoseconds.
pub const TIMES: [i64; 2] = [0, 500_000_000];
const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;

pub fn ball(t_ns: i64) -> DVec3 {
    DVec3::new(-0.45 + 1.8e-9 * t_ns as f64, -0.5, 0.0)
}

/// Distance of a point from the nearest surface at time `t_ns`, metres.
pub fn distance_from_surface(point: DVec3, t_ns: i64) -> f64 {
    let walls = [point.y, HALF - point.x.abs(), HALF - point.z.abs()].map(f64::abs);
    let from_ball = (point.distance(ball(t_ns)) - BALL_RADIUS).abs();
    walls.into_iter().fold(from_ball, f64::min)
}

/// Value noise of three octaves, 0 to 1, at a position on surface `surface`.
fn texture(surface: u64, at: DVec2) -> f64 {
    let octave = |scale: f64, weight: f64| {
        let p = at / scale;
        let cell = p.floor();
        let f = p - cell;
        let of_octave = random::key(11, &[surface, scale.to_bits()]);
        let columns = [0, 1].map(|dx| random::extend(of_octave, (cell.x as i64 + dx) as u64));
        let corner = |dx: usize, dy: i64| random::uniform(random::extend(columns[dx], (cell.y as i64 + dy) as u64));
        let smooth = f * f * (DVec2::splat(3.0) - 2.0 * f);
        let upper = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * smooth.x;
        let lower = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * smooth.x;
        weight * (upper + (lower - upper) * smooth.y)
    };
    octave(0.2, 0.35) + octave(0.07, 0.4) + octave(0.03, 0.25)
}

/// What a ray sees.
fn shade(from: DVec3, along: DVec3, t_ns: i64) -> DVec3 {
    let along = along.normalize();
    let to_ball = from - ball(t_ns);
    let half = to_ball.dot(along);
    let under_root = half * half - to_ball.length_squared() + BALL_RADIUS * BALL_RADIUS;
    if under_root > 0.0 {
        let on_ball = to_ball + along * (-half - under_root.sqrt());
        let (azimuth, height) = (on_ball.z.atan2(on_ball.x) * BALL_RADIUS, on_ball.y);
        let grey = texture(9, DVec2::new(azimuth, height));
        return DVec3::new(0.3 + 0.7 * grey, 0.7 * grey, 0.3 * grey);
    }
    // The cameras stand inside the room: the nearest of the planes ahead is what they see.
    let hits = [
        (1, (0.0 - from.y) / along.y),
        (2, (HALF - from.x) / along.x),
        (3, (-HALF - from.x) / along.x),
        (4, (HALF - from.z) / along.z),
        (5, (-HALF - from.z) / along.z),
    ];
    let hit = hits.into_iter().filter(|hit| hit.1 > 1e-9).min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((surface, s)) = hit else { return DVec3::ZERO };
    let point = from + along * s;
    let at = match surface {
        1 => DVec2::new(point.x, point.z),
        2 | 3 => DVec2::new(point.y, point.z),
        _ => DVec2::new(point.x, point.y),
    };
    let grey = texture(surface, at);
    DVec3::new(grey, 0.2 + 0.6 * grey, 0.9 * grey)
}

fn render(k: &Intrinsics, pose: &Pose, t_ns: i64) -> ImageRgb8 {
    let to_world = pose.inverse();
    let mut image = ImageRgb8::new(k.width, k.height);
    for (index, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (index as u32 % k.width, index as u32 / k.width);
        let mut sum = DVec3::ZERO;
        for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
            let at = DVec2::new(f64::from(x) + dx, f64::from(y) + dy);
            sum += shade(to_world.translation, to_world.rotation * k.unproject_pinhole(at, 1.0), t_ns);
        }
        pixel.copy_from_slice(&(sum * (255.0 / 4.0)).to_array().map(|value| value.clamp(0.0, 255.0) as u8));
    }
    image
}

/// [`film_at`] at both [`TIMES`].
pub fn film(folder: &Path, count: usize) -> Dataset {
    film_at(folder, count, &TIMES)
}

/// `count` training cameras on an arc at one side of the room, one held out and one of events alone between them. The
/// files of the latter two do not exist: nothing may read them.
pub fn film_at(folder: &Path, count: usize, times: &[i64]) -> Dataset {
    let k = Intrinsics {
        width: WIDTH,
        height: HEIGHT,
        fx: 230.0,
        fy: 228.0,
        cx: 163.0,
        cy: 118.0,
        distortion: Distortion::None,
    };
    let camera = |index: usize, angle: f64, split: Split, modality: Modality| {
        let eye = DVec3::new(1.3 * angle.sin(), -0.9 - 0.1 * (index % 3) as f64, -1.3 * angle.cos());
        let frames = times.iter().enumerate().map(|(frame, &t_ns)| Frame {
            file: format!("images/{index}/{frame:04}.png").into(),
            t_ns,
            exposure_ns: [t_ns, t_ns],
            mask: None,
        });
        Camera {
            name: format!("view_{index}"),
            modality,
            split,
            intrinsics: k,
            world_to_camera: Pose::look_at(eye, DVec3::new(0.0, -0.4, 0.2), DVec3::Y),
            pose_sigma: None,
            clock_sigma_s: None,
            frames: frames.collect(),
            events: None,
        }
    };
    let angle = |index: usize| -0.7 + 1.4 * index as f64 / (count - 1) as f64;
    let mut cameras: Vec<Camera> =
        (0..count).map(|index| camera(index, angle(index), Split::Train, Modality::Rgb)).collect();
    for seen in &cameras {
        for frame in &seen.frames {
            render(&k, &seen.world_to_camera, frame.t_ns).write_png(&folder.join(&frame.file)).unwrap();
        }
    }
    cameras.push(camera(90, 0.15, Split::Test, Modality::Rgb));
    cameras.push(camera(91, -0.15, Split::Train, Modality::Event));
    let manifest = Manifest {
        format: Manifest::FORMAT.into(),
        version: Manifest::VERSION,
        name: "room".into(),
        provenance: Provenance::default(),
        span_ns: [times[0], times[times.len() - 1]],
        seed: 0,
        variant: Vec::new(),
        linear_exposure: false,
        points: None,
        bodies: None,
        cameras,
        sha256: Default::default(),
    };
    Dataset::new(folder, manifest)
}
