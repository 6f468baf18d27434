//! The depth map of one view by plane sweep.

use erfgs_scene::image::ImageGrey8;
use glam::{DMat3, DVec3};

use super::{SweepView, window::BoxSum};
use crate::SweepOptions;

/// Windows with a smaller standard deviation of grey levels have nothing to compare.
const LEAST_SIGMA: f32 = 2.0;
/// Score of a plane that nothing is known about.
const UNKNOWN: f32 = -1.0;

/// A grey image of whole levels 0..=255 as `f32`.
#[derive(Clone, Debug)]
pub struct Grey {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    data: Vec<f32>,
}

impl Grey {
    /// Of an 8-bit image.
    pub fn new(image: &ImageGrey8) -> Self {
        let data = image.data.iter().map(|&grey| f32::from(grey)).collect();
        Self { width: image.width as usize, height: image.height as usize, data }
    }

    fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }
}

/// Inverse depths and scores of a view, row-major.
#[derive(Clone, Debug)]
pub struct DepthMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// One over the depth (1/m) of the best plane.
    pub inverse: Vec<f32>,
    /// Mean correlation of the best neighbours there, -1..=1.
    pub score: Vec<f32>,
}

impl DepthMap {
    /// How many pixels reach a score.
    pub fn count(&self, score: f32) -> usize {
        self.score.iter().filter(|&&found| found >= score).count()
    }
}

/// The best plane of each pixel so far.
struct Winner {
    best: Vec<f32>,
    plane: Vec<u32>,
    /// Scores of the planes before and after the best.
    around: Vec<[f32; 2]>,
    previous: Vec<f32>,
}

/// Sweeps `planes` (at least 2) planes parallel to the image of `view`, evenly spaced in inverse depth, over the depths
/// `[near, far]`.
pub fn depth_map(
    view: &SweepView<'_>,
    neighbours: &[&SweepView<'_>],
    depth_m: [f64; 2],
    planes: u32,
    options: &SweepOptions,
) -> DepthMap {
    let (width, height) = (view.grey.width, view.grey.height);
    let pixels = width * height;
    let radius = (options.window / 2) as usize;
    // Half of the neighbours, at most three, must see the same: the others may be hidden.
    let votes = neighbours.len().div_ceil(2).clamp(1, 3);
    let inverse_at = |plane: f32| {
        let (low, high) = (1.0 / depth_m[1], 1.0 / depth_m[0]);
        (low + (high - low) * f64::from(plane) / f64::from(planes - 1)) as f32
    };
    let reference = Reference::new(&view.grey, radius);
    let warps: Vec<Warp> = neighbours.iter().map(|other| Warp::new(view, other)).collect();
    let mut sweeper = Sweeper::new(width, height, radius);
    let mut winner = Winner {
        best: vec![UNKNOWN; pixels],
        plane: vec![0; pixels],
        around: vec![[UNKNOWN; 2]; pixels],
        previous: vec![UNKNOWN; pixels],
    };
    let mut top = [vec![UNKNOWN; pixels], vec![UNKNOWN; pixels], vec![UNKNOWN; pixels]];
    for plane in 0..planes {
        top.iter_mut().for_each(|scores| scores.fill(UNKNOWN));
        for (warp, other) in warps.iter().zip(neighbours) {
            sweeper.score(&reference, &view.grey, &other.grey, warp, f64::from(inverse_at(plane as f32)), &mut top);
        }
        winner.offer(plane, &top, votes);
    }
    let inverse = (0..pixels)
        .map(|pixel| inverse_at(winner.plane[pixel] as f32 + peak(winner.best[pixel], winner.around[pixel])))
        .collect();
    DepthMap { width, height, inverse, score: winner.best }
}

/// Where, from -0.5 to 0.5, a parabola through three neighbouring scores has its peak.
fn peak(best: f32, [before, after]: [f32; 2]) -> f32 {
    let bend = before + after - 2.0 * best;
    if before == UNKNOWN || after == UNKNOWN || bend > -1e-6 {
        0.0
    } else {
        (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
    }
}

impl Winner {
    /// Takes the mean of the `votes` best neighbours as the score of `plane`.
    fn offer(&mut self, plane: u32, top: &[Vec<f32>; 3], votes: usize) {
        let share = 1.0 / votes as f32;
        for pixel in 0..self.best.len() {
            let score = top[..votes].iter().map(|scores| scores[pixel]).sum::<f32>() * share;
            if score > self.best[pixel] {
                self.best[pixel] = score;
                self.plane[pixel] = plane;
                self.around[pixel] = [self.previous[pixel], UNKNOWN];
            } else if plane > 0 && self.plane[pixel] == plane - 1 {
                self.around[pixel][1] = score;
            }
            self.previous[pixel] = score;
        }
    }
}

/// Window means and inverse standard deviations of the view itself.
struct Reference {
    sum: Vec<f32>,
    /// 1 / sqrt(n sum of squares - squared sum); 0 where the window is flat or leaves the image.
    inverse_deviation: Vec<f32>,
}

impl Reference {
    fn new(grey: &Grey, radius: usize) -> Self {
        let (width, height) = (grey.width, grey.height);
        let ones = vec![1.0; width];
        let (mut sums, mut squares) = (BoxSum::new(width, radius), BoxSum::new(width, radius));
        let mut sum = vec![0.0; width * height];
        let mut inverse_deviation = vec![0.0; width * height];
        let n = window_area(radius);
        for y in 0..height {
            let row = grey.row(y);
            sums.enter(row, &ones);
            squares.enter(row, row);
            if y > 2 * radius {
                let old = grey.row(y - 2 * radius - 1);
                sums.leave(old, &ones);
                squares.leave(old, old);
            }
            if y < 2 * radius {
                continue;
            }
            let at = (y - radius) * width;
            let (s, ss) = (sums.row(), squares.row());
            for x in radius..width.saturating_sub(radius) {
                sum[at + x] = s[x];
                let spread = n * ss[x] - s[x] * s[x];
                inverse_deviation[at + x] = if spread < least_spread(n) { 0.0 } else { 1.0 / spread.sqrt() };
            }
        }
        Self { sum, inverse_deviation }
    }
}

fn window_area(radius: usize) -> f32 {
    ((2 * radius + 1) * (2 * radius + 1)) as f32
}

fn least_spread(n: f32) -> f32 {
    n * n * LEAST_SIGMA * LEAST_SIGMA
}

/// How pixels of the view move to a neighbour: `rotation (x, y, 1) + inverse depth * translation`, homogeneous.
struct Warp {
    rotation: DMat3,
    translation: DVec3,
}

impl Warp {
    fn new(view: &SweepView<'_>, other: &SweepView<'_>) -> Self {
        let (from, to) = (view.station.pose(), other.station.pose());
        let relative = DMat3::from_quat((to.rotation * from.rotation.conjugate()).normalize());
        let translation = to.translation - relative * from.translation;
        let (k, o) = (&view.intrinsics, &other.intrinsics);
        let project =
            DMat3::from_cols(DVec3::new(o.fx, 0.0, 0.0), DVec3::new(0.0, o.fy, 0.0), DVec3::new(o.cx, o.cy, 1.0));
        let ray = DMat3::from_cols(
            DVec3::new(1.0 / k.fx, 0.0, 0.0),
            DVec3::new(0.0, 1.0 / k.fy, 0.0),
            DVec3::new(-k.cx / k.fx, -k.cy / k.fy, 1.0),
        );
        Self { rotation: project * relative * ray, translation: project * translation }
    }
}

/// Buffers for scoring one neighbour on one plane.
struct Sweeper {
    radius: usize,
    warped: Vec<f32>,
    /// The columns of each row that the neighbour sees: a convex set, as an image's preimage under a homography is.
    seen: Vec<(usize, usize)>,
    ones: Vec<f32>,
    sums: BoxSum,
    squares: BoxSum,
    products: BoxSum,
}

impl Sweeper {
    fn new(width: usize, height: usize, radius: usize) -> Self {
        let sum = || BoxSum::new(width, radius);
        Self {
            radius,
            warped: vec![0.0; width * height],
            seen: vec![(0, 0); height],
            ones: vec![1.0; width],
            sums: sum(),
            squares: sum(),
            products: sum(),
        }
    }

    /// Puts the correlation of each window with the neighbour, warped onto the plane, into the three best so far.
    fn score(
        &mut self,
        reference: &Reference,
        own: &Grey,
        other: &Grey,
        warp: &Warp,
        inverse_depth: f64,
        top: &mut [Vec<f32>; 3],
    ) {
        let (width, height, radius) = (own.width, own.height, self.radius);
        for y in 0..height {
            let row = &mut self.warped[y * width..(y + 1) * width];
            self.seen[y] = warp_row(row, y, other, warp, inverse_depth);
        }
        let n = window_area(radius);
        let Self { warped, seen, ones, sums, squares, products, .. } = self;
        [&mut *sums, &mut *squares, &mut *products].into_iter().for_each(BoxSum::clear);
        for y in 0..height {
            let (own_row, row) = (own.row(y), &warped[y * width..(y + 1) * width]);
            sums.enter(row, ones);
            squares.enter(row, row);
            products.enter(row, own_row);
            if y > 2 * radius {
                let old = y - 2 * radius - 1;
                let (own_row, row) = (own.row(old), &warped[old * width..(old + 1) * width]);
                sums.leave(row, ones);
                squares.leave(row, row);
                products.leave(row, own_row);
            }
            if y < 2 * radius {
                continue;
            }
            // The window is seen if its corners are.
            let (top_row, bottom_row) = (seen[y - 2 * radius], seen[y]);
            let from = top_row.0.max(bottom_row.0) + radius;
            let to = top_row.1.min(bottom_row.1).saturating_sub(radius);
            if from >= to {
                continue;
            }
            let at = (y - radius) * width;
            let (s, ss, sr) = (&sums.row()[from..to], &squares.row()[from..to], &products.row()[from..to]);
            let own_sum = &reference.sum[at + from..at + to];
            let own_inverse = &reference.inverse_deviation[at + from..at + to];
            let [first, second, third] = top;
            let best = first[at + from..at + to]
                .iter_mut()
                .zip(&mut second[at + from..at + to])
                .zip(&mut third[at + from..at + to]);
            for (index, ((first, second), third)) in best.enumerate() {
                let spread = n * ss[index] - s[index] * s[index];
                let correlation = (n * sr[index] - s[index] * own_sum[index]) * own_inverse[index] / spread.sqrt();
                let good = spread >= least_spread(n) && own_inverse[index] > 0.0;
                let score = if good { correlation } else { UNKNOWN };
                let low = first.min(score);
                *first = first.max(score);
                let lower = second.min(low);
                *second = second.max(low);
                *third = third.max(lower);
            }
        }
    }
}

/// Fills a row with the neighbour's grey levels, rounded; 0 where it sees nothing. Returns the columns that it sees.
fn warp_row(row: &mut [f32], y: usize, other: &Grey, warp: &Warp, inverse_depth: f64) -> (usize, usize) {
    let start = warp.rotation * DVec3::new(0.5, y as f64 + 0.5, 1.0) + warp.translation * inverse_depth;
    let (start, step) = (start.as_vec3(), warp.rotation.x_axis.as_vec3());
    let (limit_x, limit_y) = (other.width as f32 - 1.0, other.height as f32 - 1.0);
    let (mut first, mut last) = (usize::MAX, 0);
    for (x, out) in row.iter_mut().enumerate() {
        let p = start + step * x as f32;
        let scale = 1.0 / p.z;
        let (u, v) = (p.x * scale - 0.5, p.y * scale - 0.5);
        // Phrased so that NaN and infinity are outside.
        if !(p.z > 0.0 && u >= 0.0 && v >= 0.0 && u < limit_x && v < limit_y) {
            *out = 0.0;
            continue;
        }
        let (left, up) = (u as usize, v as usize);
        let (fx, fy) = (u - left as f32, v - up as f32);
        let at = up * other.width + left;
        let upper = &other.data[at..at + 2];
        let lower = &other.data[at + other.width..at + other.width + 2];
        let a = upper[0] + (upper[1] - upper[0]) * fx;
        let b = lower[0] + (lower[1] - lower[0]) * fx;
        *out = (a + (b - a) * fy + 0.5) as u8 as f32;
        first = first.min(x);
        last = x + 1;
    }
    if first == usize::MAX { (0, 0) } else { (first, last) }
}
