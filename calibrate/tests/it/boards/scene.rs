//! Pictures of printed boards before a camera that is known.

use erfgs_base::random;
use erfgs_calibrate::board::{Corner, Paper, Target, print};
use erfgs_scene::{ImageRgb8, Intrinsics, Pose};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

/// A board as it is printed, cut into squares so small that no edge runs through one.
pub struct Sheet {
    pub target: Target,
    unit_mm: f64,
    size: [usize; 2],
    pub black: Vec<bool>,
    /// The target's origin on the sheet, and whether its y points up.
    origin_mm: DVec2,
    up: bool,
}

impl Sheet {
    /// Reads what is printed for `target`, all of whose lengths are multiples of `unit_m`.
    pub fn of(target: &Target, unit_m: f64) -> Self {
        let svg = String::from_utf8(print(target, Paper::Svg, 0.0)).unwrap();
        let between = |from: &str, to: &str| {
            let start = svg.find(from).unwrap() + from.len();
            &svg[start..start + svg[start..].find(to).unwrap()]
        };
        let unit_mm = 1e3 * unit_m;
        let units = |text: &str| (text.parse::<f64>().unwrap() / unit_mm).round() as usize;
        let size = [units(between("width=\"", "mm")), units(between("height=\"", "mm"))];
        let mut black = vec![false; size[0] * size[1]];
        for rectangle in between("d=\"M", "z\"/>").split("zM") {
            let numbers: Vec<usize> =
                rectangle.split([' ', 'h', 'v']).map(|text| units(text.trim_start_matches('-'))).collect();
            let [x, y, width, height, _] = numbers[..] else { panic!("{rectangle}") };
            for row in y..y + height {
                black[row * size[0] + x..][..width].fill(true);
            }
        }
        let square = 1e3 * target.square_m();
        let (origin_mm, up) = match target {
            Target::Chessboard { .. } => (DVec2::splat(2.0 * square), false),
            Target::Charuco { .. } => (DVec2::splat(square), false),
            Target::AprilGrid { spacing, .. } => {
                let from = 2.0 * spacing * square;
                (DVec2::new(from, size[1] as f64 * unit_mm - from), true)
            }
        };
        Self { target: target.clone(), unit_mm, size, black, origin_mm, up }
    }

    /// The middle of the sheet in the target's frame, metres.
    fn middle(&self) -> DVec3 {
        let size = DVec2::new(self.size[0] as f64, self.size[1] as f64) * self.unit_mm;
        let off = (0.5 * size - self.origin_mm) / 1e3;
        DVec3::new(off.x, if self.up { -off.y } else { off.y }, 0.0)
    }

    /// The pose (target to camera) of a sheet whose middle is at `place`, upright and facing the camera but for `turn`.
    pub fn pose(&self, place: DVec3, turn: DVec3) -> Pose {
        let upright = if self.up { DQuat::from_axis_angle(DVec3::X, std::f64::consts::PI) } else { DQuat::IDENTITY };
        let rotation = DQuat::from_scaled_axis(turn) * upright;
        Pose { rotation, translation: place - rotation * self.middle() }
    }

    /// What is printed at a point of the target's plane; `None` beside the sheet.
    pub fn colour(&self, at: DVec2) -> Option<bool> {
        let at = DVec2::new(at.x, if self.up { -at.y } else { at.y }) * 1e3 + self.origin_mm;
        let at = at / self.unit_mm;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        // What is inside is cut off, as rounding down takes a call for each ray.
        inside.then(|| self.black[at.y as i32 as usize * self.size[0] + at.x as i32 as usize])
    }

    /// The sheet as a picture of `scale` pixels for each of its squares.
    pub fn picture(&self, scale: usize) -> ImageRgb8 {
        let [width, height] = self.size.map(|side| side * scale);
        let mut image = ImageRgb8::new(width as u32, height as u32);
        for (index, pixel) in image.data.chunks_exact_mut(3).enumerate() {
            let black = self.black[index / width / scale * self.size[0] + index % width / scale];
            pixel.fill(if black { 10 } else { 245 });
        }
        image
    }

    /// Where a corner is in that picture.
    pub fn in_picture(&self, id: u32, scale: usize) -> DVec2 {
        let point = self.target.point(id).unwrap().truncate() * 1e3;
        (self.origin_mm + DVec2::new(point.x, if self.up { -point.y } else { point.y })) / self.unit_mm * scale as f64
    }
}

/// The rays of a camera: of each pixel, row by row, `SUB` in each direction.
pub struct Rays<const SUB: usize> {
    width: usize,
    rays: Vec<DVec3>,
}

impl<const SUB: usize> Rays<SUB> {
    pub fn of(camera: &Intrinsics) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let ray = |x: usize, y: usize| camera.unproject(DVec2::new(x as f64, y as f64)).unwrap();
        let corners: Vec<DVec3> =
            (0..(width + 1) * (height + 1)).map(|i| ray(i % (width + 1), i / (width + 1))).collect();
        let of_pixel = |i: usize| {
            let at = i / width * (width + 1) + i % width;
            let around = [corners[at], corners[at + 1], corners[at + width + 1], corners[at + width + 2]];
            (0..SUB * SUB).map(move |sub| {
                // Anywhere in its part of the pixel: edges along the rows would else lie at fifths of a pixel only.
                let share = |index: usize, of| {
                    (index as f64 + random::uniform(random::key(of, &[i as u64, sub as u64]))) / SUB as f64
                };
                let (x, y) = (share(sub % SUB, 11), share(sub / SUB, 12));
                around[0].lerp(around[1], x).lerp(around[2].lerp(around[3], x), y)
            })
        };
        Self { width, rays: (0..width * height).into_par_iter().flat_map_iter(of_pixel).collect() }
    }

    /// A picture of the sheet before a wall, from 0 to 255: the mean over each pixel, then a lens that spreads a point over
    /// `blur_px` (standard deviation).
    pub fn light(&self, sheet: &Sheet, pose: &Pose, blur_px: f64) -> Vec<f64> {
        let back = pose.inverse();
        let (from, turn) = (back.translation, DMat3::from_quat(back.rotation));
        let seen = |rays: &[DVec3]| {
            let level = |ray: &DVec3| {
                let along = turn * *ray;
                let colour = sheet.colour((from - along * (from.z / along.z)).truncate());
                colour.map_or(110.0, |black| if black { 25.0 } else { 225.0 })
            };
            rays.iter().map(level).sum::<f64>() / (SUB * SUB) as f64
        };
        let sharp: Vec<f64> = self.rays.par_chunks_exact(SUB * SUB).map(seen).collect();
        let height = sharp.len() / self.width;
        blurred(&blurred(&sharp, self.width, blur_px), height, blur_px)
    }
}

/// A picture as [`Rays::light`] makes it.
pub fn light<const SUB: usize>(sheet: &Sheet, camera: &Intrinsics, pose: &Pose, blur_px: f64) -> Vec<f64> {
    Rays::<SUB>::of(camera).light(sheet, pose, blur_px)
}

/// A Gaussian along the rows; the result is transposed.
fn blurred(values: &[f64], width: usize, sigma: f64) -> Vec<f64> {
    let reach = (3.0 * sigma).ceil() as usize;
    let weight = |k: usize| if sigma > 0.0 { (-0.5 * ((k as f64 - reach as f64) / sigma).powi(2)).exp() } else { 1.0 };
    let weights: Vec<f64> = (0..=2 * reach).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    let height = values.len() / width;
    let mut out = vec![0.0; values.len()];
    for (y, row) in values.chunks_exact(width).enumerate() {
        let padded = [vec![row[0]; reach], row.to_vec(), vec![row[width - 1]; reach]].concat();
        for (x, near) in padded.windows(2 * reach + 1).enumerate() {
            out[x * height + y] = near.iter().zip(&weights).map(|(value, weight)| value * weight).sum::<f64>() / sum;
        }
    }
    out
}

/// As a camera takes it, with noise of `noise` (standard deviation, of 255).
pub fn photograph(light: &[f64], [width, height]: [u32; 2], noise: f64, key: u64) -> ImageRgb8 {
    let mut image = ImageRgb8::new(width, height);
    for (index, (pixel, value)) in image.data.chunks_exact_mut(3).zip(light).enumerate() {
        let noisy = value + noise * random::normal(random::key(key, &[index as u64]));
        pixel.fill(noisy.round().clamp(0.0, 255.0) as u8);
    }
    image
}

/// How far the corners that were found are from where they are, pixels.
pub fn errors(corners: &[Corner], target: &Target, camera: &Intrinsics, pose: &Pose) -> Vec<f64> {
    let error = |corner: &Corner| {
        let at = camera.project(pose.transform(target.point(corner.id).unwrap()));
        at.map_or(f64::INFINITY, |at| at.distance(corner.pixel))
    };
    corners.iter().map(error).collect()
}

/// Root mean square, and the largest.
pub fn summary(errors: &[f64]) -> (f64, f64) {
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt();
    (rms, errors.iter().copied().fold(0.0, f64::max))
}
