//! Matching of two images' features along the epipolar lines of their known poses.
//!
//! A keypoint is compared only with those keypoints of the other image that its ray passes within the band, at a depth
//! and an angle that make sense. They are found by walking the ray's projection through a grid over the other image.

use erfgs_scene::{Intrinsics, Pose};
use glam::{DMat3, DVec2, DVec3};

/// Bytes of a SIFT descriptor.
pub const DESCRIPTOR: usize = 128;

/// Side of a grid cell, pixels.
const CELL_PX: f64 = 16.0;

/// Which pairs of keypoints may belong together.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Greatest distance from the epipolar line, pixels of the images that the features are of.
    pub band_px: f64,
    /// The nearest descriptor's angle must be below this share of the second nearest's.
    pub ratio: f64,
    /// Greatest angle between two descriptors, radians.
    pub max_descriptor_angle: f64,
    /// Greatest angle between the two rays, radians.
    pub max_ray_angle: f64,
    /// `[nearest, farthest]` depth in either camera, metres.
    pub depth_m: [f64; 2],
}

/// The features of one image.
#[derive(Clone, Debug)]
pub struct Features {
    /// Positions, pixels.
    points: Vec<DVec2>,
    descriptors: Vec<[u8; DESCRIPTOR]>,
    /// One over the length of each descriptor.
    inverse_length: Vec<f32>,
    grid: Grid,
}

impl Features {
    /// Features of an image of `width` x `height` pixels; `points` and `descriptors` belong together by index.
    pub fn new(width: u32, height: u32, points: Vec<DVec2>, descriptors: Vec<[u8; DESCRIPTOR]>) -> Self {
        debug_assert_eq!(points.len(), descriptors.len());
        let inverse_length = descriptors.iter().map(|d| 1.0 / (dot(d, d).max(1) as f32).sqrt()).collect();
        let grid = Grid::new(width, height, &points);
        Self { points, descriptors, inverse_length, grid }
    }

    /// How many features there are.
    pub fn count(&self) -> usize {
        self.points.len()
    }
}

/// Keypoints by grid cell, row-major, as one index list with offsets.
#[derive(Clone, Debug)]
struct Grid {
    columns: usize,
    rows: usize,
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Grid {
    fn new(width: u32, height: u32, points: &[DVec2]) -> Self {
        let columns = (f64::from(width) / CELL_PX).ceil().max(1.0) as usize;
        let rows = (f64::from(height) / CELL_PX).ceil().max(1.0) as usize;
        let cell = |point: &DVec2| {
            let column = ((point.x / CELL_PX).max(0.0) as usize).min(columns - 1);
            let row = ((point.y / CELL_PX).max(0.0) as usize).min(rows - 1);
            row * columns + column
        };
        let mut starts = vec![0u32; columns * rows + 1];
        for point in points {
            starts[cell(point) + 1] += 1;
        }
        for index in 1..starts.len() {
            starts[index] += starts[index - 1];
        }
        let mut next = starts.clone();
        let mut members = vec![0; points.len()];
        for (index, point) in points.iter().enumerate() {
            let slot = &mut next[cell(point)];
            members[*slot as usize] = index as u32;
            *slot += 1;
        }
        Self { columns, rows, starts, members }
    }

    fn cell(&self, column: usize, row: usize) -> &[u32] {
        let index = row * self.columns + column;
        &self.members[self.starts[index] as usize..self.starts[index + 1] as usize]
    }

    /// Calls `visit` with every member of the cells that come within `margin` pixels of the segment `from`..`to`.
    fn along(&self, from: DVec2, to: DVec2, margin: f64, mut visit: impl FnMut(u32)) {
        let steep = (to.y - from.y).abs() > (to.x - from.x).abs();
        let swap = |p: DVec2| if steep { DVec2::new(p.y, p.x) } else { p };
        let (mut start, mut end) = (swap(from), swap(to));
        if start.x > end.x {
            (start, end) = (end, start);
        }
        let slope = if end.x > start.x { (end.y - start.y) / (end.x - start.x) } else { 0.0 };
        let reach = margin * (1.0 + slope * slope).sqrt();
        let (major_cells, minor_cells) = if steep { (self.rows, self.columns) } else { (self.columns, self.rows) };
        let Some((first, last)) = cells(start.x - margin, end.x + margin, major_cells) else { return };
        for major in first..=last {
            let low = (major as f64 * CELL_PX).clamp(start.x - margin, end.x + margin);
            let high = ((major + 1) as f64 * CELL_PX).clamp(start.x - margin, end.x + margin);
            let (a, b) = (start.y + slope * (low - start.x), start.y + slope * (high - start.x));
            let Some((from, to)) = cells(a.min(b) - reach, a.max(b) + reach, minor_cells) else { continue };
            for minor in from..=to {
                let (column, row) = if steep { (minor, major) } else { (major, minor) };
                self.cell(column, row).iter().copied().for_each(&mut visit);
            }
        }
    }
}

/// The cells that the interval touches, none if it misses the image. Keypoints outside the image lie in edge cells,
/// which therefore reach half a cell beyond it.
fn cells(low: f64, high: f64, count: usize) -> Option<(usize, usize)> {
    let (low, high) = ((low / CELL_PX).floor(), (high / CELL_PX).floor());
    let last = count as f64 - 1.0;
    // Phrased so that NaN misses.
    if !(high >= -0.5 && low <= last + 0.5) {
        return None;
    }
    Some((low.clamp(0.0, last) as usize, high.clamp(0.0, last) as usize))
}

/// The cosine's numerator: small integers, which compilers turn into multiply-add instructions.
fn dot(a: &[u8; DESCRIPTOR], b: &[u8; DESCRIPTOR]) -> i32 {
    a.iter().zip(b).map(|(&a, &b)| i32::from(a) * i32::from(b)).sum()
}

/// Two cameras' relative pose: `x_b = rotation x_a + translation`, and the matrices made of it.
#[derive(Clone, Copy, Debug)]
pub struct Relative {
    /// Rotation from the first to the second camera.
    pub rotation: DMat3,
    /// Translation, metres: the first camera's centre in the second camera.
    pub translation: DVec3,
    /// Essential matrix: `b' E a = 0` for rays.
    pub essential: DMat3,
    /// Fundamental matrix: `b' F a = 0` for homogeneous pixels.
    pub fundamental: DMat3,
}

impl Relative {
    /// Of camera `b` with respect to camera `a`; the intrinsics without distortion.
    pub fn new(a: (&Intrinsics, &Pose), b: (&Intrinsics, &Pose)) -> Self {
        let rotation = DMat3::from_quat((b.1.rotation * a.1.rotation.conjugate()).normalize());
        let translation = b.1.translation - rotation * a.1.translation;
        let t = translation;
        let cross =
            DMat3::from_cols(DVec3::new(0.0, t.z, -t.y), DVec3::new(-t.z, 0.0, t.x), DVec3::new(t.y, -t.x, 0.0));
        let essential = cross * rotation;
        let fundamental = inverse_calibration(b.0).transpose() * essential * inverse_calibration(a.0);
        Self { rotation, translation, essential, fundamental }
    }
}

/// Takes homogeneous pixels to rays of depth one.
fn inverse_calibration(k: &Intrinsics) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(1.0 / k.fx, 0.0, 0.0),
        DVec3::new(0.0, 1.0 / k.fy, 0.0),
        DVec3::new(-k.cx / k.fx, -k.cy / k.fy, 1.0),
    )
}

/// The two best similarities (cosines) of a feature, and whose the best is.
#[derive(Clone, Copy)]
pub(super) struct Best {
    first: f32,
    second: f32,
    pub index: u32,
}

impl Best {
    pub const NONE: Self = Self { first: -1.0, second: -1.0, index: u32::MAX };

    pub fn offer(&mut self, similarity: f32, index: u32) {
        if similarity > self.first || (similarity == self.first && index < self.index) {
            *self = Self { first: similarity, second: self.first, index };
        } else if similarity > self.second {
            self.second = similarity;
        }
    }

    /// Whether it is near enough, and nearer than the second by the ratio.
    pub fn accepted(&self, ratio: f64, max_descriptor_angle: f64) -> bool {
        if self.index == u32::MAX {
            return false;
        }
        let angle = |similarity: f32| f64::from(similarity.clamp(-1.0, 1.0)).acos();
        let rival = if self.second < 0.0 { max_descriptor_angle } else { angle(self.second) };
        let nearest = angle(self.first);
        nearest < ratio * rival && nearest < max_descriptor_angle
    }
}

/// The part of a ray of camera A in which a point may lie, as depths in A; none if it is empty.
///
/// `u` is the ray in B's axes with depth one in A; `t` is A's centre in B. Depths are within the limits in both cameras,
/// and the angle between the rays (which falls with depth) is below the limit: by the law of sines in the triangle of
/// both centres and the point.
fn depth_range(u: DVec3, t: DVec3, limits: &Limits) -> Option<(f64, f64)> {
    let [near, far] = limits.depth_m;
    let (mut low, mut high) = (near, far);
    let alpha = u.angle_between(-t);
    let shortest = t.length() * (alpha + limits.max_ray_angle).sin() / limits.max_ray_angle.sin() / u.length();
    low = low.max(shortest);
    // near <= z u.z + t.z <= far
    if u.z.abs() < 1e-12 {
        if !(near..=far).contains(&t.z) {
            return None;
        }
    } else {
        let (a, b) = ((near - t.z) / u.z, (far - t.z) / u.z);
        (low, high) = (low.max(a.min(b)), high.min(a.max(b)));
    }
    (low < high).then_some((low, high))
}

/// The matches between the features of two images, as pairs of indices, in the order of the first.
pub fn match_pair(
    a: &Features,
    a_camera: (&Intrinsics, &Pose),
    b: &Features,
    b_camera: (&Intrinsics, &Pose),
    relative: &Relative,
    limits: &Limits,
) -> Vec<[u32; 2]> {
    let t = relative.translation;
    if t == DVec3::ZERO {
        return Vec::new();
    }
    let (a_inverse, b_inverse) = (inverse_calibration(a_camera.0), inverse_calibration(b_camera.0));
    let line = |matrix: &DMat3, p: DVec2| {
        let l = *matrix * p.extend(1.0);
        l / l.truncate().length()
    };
    let back = relative.fundamental.transpose();
    let b_lines: Vec<DVec3> = b.points.iter().map(|&p| line(&back, p)).collect();
    let b_rays: Vec<DVec3> = b.points.iter().map(|&p| b_inverse * p.extend(1.0)).collect();
    let least_cosine = limits.max_ray_angle.cos();

    let mut of_a = vec![Best::NONE; a.count()];
    let mut of_b = vec![Best::NONE; b.count()];
    for (i, &x) in a.points.iter().enumerate() {
        let u = relative.rotation * (a_inverse * x.extend(1.0));
        let Some((low, high)) = depth_range(u, t, limits) else { continue };
        let ends = [low, high].map(|depth| b_camera.0.project_pinhole(u * depth + t));
        let Some([from, to]) = clip(ends, b_camera.0, limits.band_px) else { continue };
        let epipolar = line(&relative.fundamental, x);
        b.grid.along(from, to, limits.band_px, |j| {
            let y = b.points[j as usize];
            let near_line = |line: DVec3, p: DVec2| line.dot(p.extend(1.0)).abs() < limits.band_px;
            if !near_line(epipolar, y) || !near_line(b_lines[j as usize], x) {
                return;
            }
            if !plausible(u, b_rays[j as usize], t, limits.depth_m, least_cosine) {
                return;
            }
            let similarity = dot(&a.descriptors[i], &b.descriptors[j as usize]) as f32
                * a.inverse_length[i]
                * b.inverse_length[j as usize];
            of_a[i].offer(similarity, j);
            of_b[j as usize].offer(similarity, i as u32);
        });
    }
    of_a.iter()
        .enumerate()
        .filter(|(_, best)| best.accepted(limits.ratio, limits.max_descriptor_angle))
        .map(|(i, best)| [i as u32, best.index])
        .filter(|&[i, j]| {
            of_b[j as usize].index == i && of_b[j as usize].accepted(limits.ratio, limits.max_descriptor_angle)
        })
        .collect()
}

/// Whether two rays (`u` from `t`, `g` from the origin) come closest at good depths, at a small enough angle.
fn plausible(u: DVec3, g: DVec3, t: DVec3, [near, far]: [f64; 2], least_cosine: f64) -> bool {
    let (uu, gg, ug) = (u.length_squared(), g.length_squared(), u.dot(g));
    if ug < least_cosine * (uu * gg).sqrt() {
        return false;
    }
    let determinant = uu * gg - ug * ug;
    let (ut, gt) = (u.dot(t), g.dot(t));
    let (depth_a, depth_b) = ((ug * gt - gg * ut) / determinant, (uu * gt - ug * ut) / determinant);
    // Parallel rays make these infinite or NaN, which no range contains.
    (near..=far).contains(&depth_a) && (near..=far).contains(&depth_b)
}

/// The part of a segment that lies in the image, with a margin; none if it misses it (Liang-Barsky).
fn clip([from, to]: [DVec2; 2], image: &Intrinsics, margin: f64) -> Option<[DVec2; 2]> {
    let delta = to - from;
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    let edges = [
        (-delta.x, from.x + margin),
        (delta.x, f64::from(image.width) + margin - from.x),
        (-delta.y, from.y + margin),
        (delta.y, f64::from(image.height) + margin - from.y),
    ];
    for (speed, room) in edges {
        if speed == 0.0 {
            if room < 0.0 {
                return None;
            }
        } else if speed < 0.0 {
            enter = enter.max(room / speed);
        } else {
            leave = leave.min(room / speed);
        }
    }
    (enter <= leave).then(|| [from + delta * enter, from + delta * leave])
}

#[cfg(test)]
#[path = "matching_tests.rs"]
mod tests;
