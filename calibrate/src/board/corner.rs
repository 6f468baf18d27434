//! The exact place of a corner where two edges cross.
//!
//! Around a corner, the brightness changes across the edges only, so that at each pixel the direction to the corner is at
//! right angles to the gradient or the gradient is nil (Förstner and Gülch 1987). The corner is where that holds best in the
//! least squares; repeated around the place found last. From there a picture of two blurred edges that cross is fitted to the
//! pixels themselves, which uses all of them and interpolates none: it halves what noise and compression leave over.

use glam::{DMat2, DVec2, IVec2};
use nalgebra::{SMatrix, SVector};

use super::detect::Grey;

const ITERATIONS: usize = 40;
/// In a narrower window no picture of two edges can be fitted: half of its longer side, pixels.
const LEAST_RADIUS: f64 = 2.5;
/// Gradients are looked at in no larger a window: they only say where to begin.
const MOST_RADIUS: f64 = 7.0;
/// Half the sides of a window, pixels.
const SIDES: [f64; 2] = [2.0, 12.0];
/// Half the distance of its opposite sides, pixels at least: a window that is narrower holds no edge.
const LEAST_HEIGHT: f64 = 1.5;

/// Sides that meet at a smaller angle than this, by its sine, are those of a board that leans away along its diagonal.
const SHEARED: f64 = 0.75;
/// How often the window follows the corner there, how far, and when it has come to it, pixels.
const SHEARED_ROUNDS: usize = 8;
const SHEARED_PX: f64 = 2.0;
const SETTLED_PX: f64 = 0.02;

/// What is looked at around a corner: a parallelogram with the sides of the board's squares, so that a board that leans away is
/// looked at in a window that is as narrow as its squares are, and as long.
pub(super) struct Window {
    /// From its middle to the middle of two sides, pixels.
    half: [DVec2; 2],
}

impl Window {
    /// With these halves of its sides, pixels, as far as they are no shorter and no longer than is of use.
    pub fn of(half: [DVec2; 2]) -> Option<Self> {
        let mut half = half.map(|side| side * (side.length().clamp(SIDES[0], SIDES[1]) / side.length()));
        if !half.iter().all(|side| side.is_finite()) {
            return None;
        }
        // So flat that nothing would be left: as high as it must be.
        for (side, other) in [(0, 1), (1, 0)] {
            let along = half[other].normalize();
            let height = along.perp_dot(half[side]);
            if height.abs() < LEAST_HEIGHT {
                half[side] += along.perp() * (LEAST_HEIGHT.copysign(height) - height);
            }
        }
        Some(Self { half })
    }

    /// Whether its sides meet at an acute angle.
    fn is_sheared(&self) -> bool {
        self.half[0].normalize().perp_dot(self.half[1].normalize()).abs() < SHEARED
    }

    fn longest(&self) -> f64 {
        self.half[0].length().max(self.half[1].length())
    }

    /// The same window, no longer than this.
    fn within(&self, radius: f64) -> Self {
        Self { half: self.half.map(|side| side * (radius / side.length()).min(1.0)) }
    }

    fn frame(&self) -> Frame {
        // Of whole pixels, the outermost ones reach half a pixel beyond it.
        let most = DVec2::from_array(self.half.map(|side| 1.0 + 0.5 / side.length()));
        let reach = self.half[0].abs() * most.x + self.half[1].abs() * most.y;
        Frame { shares: DMat2::from_cols(self.half[0], self.half[1]).inverse(), most, reach }
    }
}

/// A window as pixels see it.
struct Frame {
    /// Takes a place to shares of the halves of the sides.
    shares: DMat2,
    /// The greatest shares of what is in it.
    most: DVec2,
    /// How far it reaches along rows and columns, pixels.
    reach: DVec2,
}

impl Frame {
    /// How much a pixel counts, by where it is from the middle; `None` beyond the window.
    fn weight(&self, offset: DVec2) -> Option<f64> {
        let at = self.shares * offset;
        at.abs().cmple(self.most).all().then(|| (-at.length_squared()).exp())
    }
}

/// The corner near `start` (pixels, centres at half-integers). `None` where there is no corner within half a window.
pub(super) fn refine(image: &Grey, start: DVec2, window: &Window) -> Option<DVec2> {
    let met = meeting(image, start, &window.within(MOST_RADIUS))?;
    if window.longest() < LEAST_RADIUS {
        return Some(met);
    }
    if window.is_sheared() {
        // Between edges that meet at an acute angle gradients of what is beside them say least where the corner is.
        return sheared(image, start, window).or_else(|| sheared(image, met, window));
    }
    // A picture that does not fit leaves the corner where the gradients say.
    let fitted = crossing(image, met, window, None);
    Some(fitted.filter(|fitted| fitted.distance(met) < 1.0).unwrap_or(met))
}

/// Where edges in the directions of the window cross: it follows the corner, so that it holds it in its middle.
fn sheared(image: &Grey, start: DVec2, window: &Window) -> Option<DVec2> {
    let mut at = start;
    for _ in 0..SHEARED_ROUNDS {
        let directions = window.half.map(|side| side.y.atan2(side.x));
        let next = crossing(image, at, window, Some(directions))?;
        if next.distance(start) > SHEARED_PX {
            return None;
        }
        if next.distance(std::mem::replace(&mut at, next)) < SETTLED_PX {
            return Some(at);
        }
    }
    None
}

/// Where the gradients around meet.
fn meeting(image: &Grey, start: DVec2, window: &Window) -> Option<DVec2> {
    let mut at = start;
    let frame = window.frame();
    let reach = frame.reach.floor().as_ivec2();
    let offsets = (-reach.y..=reach.y).flat_map(|y| (-reach.x..=reach.x).map(move |x| IVec2::new(x, y).as_dvec2()));
    let weighed: Vec<(DVec2, f64)> = offsets.filter_map(|offset| Some((offset, frame.weight(offset)?))).collect();
    for _ in 0..ITERATIONS {
        let mut matrix = DMat2::ZERO;
        let mut right = DVec2::ZERO;
        for (offset, weight) in &weighed {
            let place = at + *offset;
            let slope = DVec2::new(
                image.sample(place + DVec2::X)? - image.sample(place - DVec2::X)?,
                image.sample(place + DVec2::Y)? - image.sample(place - DVec2::Y)?,
            );
            let outer = DMat2::from_cols(slope * slope.x, slope * slope.y) * *weight;
            matrix += outer;
            right += outer * *offset;
        }
        // Both edges must be there: the smaller eigenvalue of the sum is that of the fainter one.
        let (trace, determinant) = (matrix.x_axis.x + matrix.y_axis.y, matrix.determinant());
        if determinant <= 1e-4 * trace * trace {
            return None;
        }
        let step = matrix.inverse() * right;
        at += step;
        let moved = at - start;
        if (frame.shares * moved).abs().max_element() > 1.0 && moved.length() > SIDES[0] {
            return None;
        }
        if step.length() < 1e-4 {
            break;
        }
    }
    Some(at)
}

/// Parameters of two edges that cross: place (2), directions (2), width, brightness, contrast, slope of the brightness (2).
const PARAMETERS: usize = 9;

/// Where two blurred edges cross, of which a picture is fitted to the pixels around `start` (Gauss and Newton, damped).
/// Edges have the `directions` at first, or those that the pixels say.
fn crossing(image: &Grey, start: DVec2, window: &Window, directions: Option<[f64; 2]>) -> Option<DVec2> {
    let pixels = pixels(image, start, window)?;
    let mut state = match directions {
        Some(directions) => Some(guess_along(&pixels, directions)),
        None => first_guess(&pixels),
    }?;
    let (mut around, mut damping) = (Linear::at(&pixels, &state), 1e-3);
    for _ in 0..20 {
        let mut normal = around.normal();
        for i in 0..PARAMETERS {
            normal[(i, i)] *= 1.0 + damping;
        }
        let step: SVector<f64, PARAMETERS> = normal.cholesky()?.solve(&SVector::from(around.right));
        let next = state + step;
        let tried = Linear::at(&pixels, &next);
        if tried.cost.is_finite() && tried.cost < around.cost && next[4] > 0.1 {
            let settled = step[0].hypot(step[1]) < 1e-3;
            (state, around, damping) = (next, tried, damping * 0.2);
            if settled {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    let at = DVec2::new(state[0], state[1]);
    at.is_finite().then_some(start + at)
}

/// A pixel of a window: where it is from the start, its brightness, and its weight.
type Weighed = (DVec2, f64, f64);

fn pixels(image: &Grey, start: DVec2, window: &Window) -> Option<Vec<Weighed>> {
    let frame = window.frame();
    let reach = frame.reach;
    let (low, high) = ((start - reach).floor().as_ivec2(), (start + reach).floor().as_ivec2());
    let mut pixels = Vec::with_capacity(((high.x - low.x + 1) * (high.y - low.y + 1)) as usize);
    for y in low.y..=high.y {
        for x in low.x..=high.x {
            let offset = IVec2::new(x, y).as_dvec2() + 0.5 - start;
            let Some(weight) = frame.weight(offset) else { continue };
            let (Ok(at_x), Ok(at_y)) = (usize::try_from(x), usize::try_from(y)) else { return None };
            if at_x >= image.width || at_y >= image.height {
                return None;
            }
            pixels.push((offset, f64::from(image.pixels[at_y * image.width + at_x]), weight));
        }
    }
    (pixels.len() > 2 * PARAMETERS).then_some(pixels)
}

/// Directions and contrast of the edges from the parabola that fits the window best: along an edge, a saddle is level.
fn first_guess(pixels: &[Weighed]) -> Option<SVector<f64, PARAMETERS>> {
    let (mut normal, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for (at, brightness, weight) in pixels {
        let row = SVector::<f64, 6>::from([1.0, at.x, at.y, at.x * at.x, at.x * at.y, at.y * at.y]);
        normal += row * row.transpose() * *weight;
        right += row * (weight * brightness);
    }
    let fitted = normal.cholesky()?.solve(&right);
    let (a, b, c) = (fitted[3], 0.5 * fitted[4], fitted[5]);
    if b * b <= a * c {
        return None;
    }
    // a cos² + 2 b cos sin + c sin² = 0: the mean of both directions is that of the greatest slope, turned by 45 degrees and more.
    let (mean, swing) = (0.5 * (a + c), (0.5 * (a - c)).hypot(b));
    let (turned, half) = (b.atan2(0.5 * (a - c)), (-mean / swing).clamp(-1.0, 1.0).acos());
    let directions = [0.5 * (turned + half), 0.5 * (turned - half)];
    let weights: f64 = pixels.iter().map(|pixel| pixel.2).sum();
    Some(guess(directions, fitted[0], lit(pixels, directions) / weights))
}

/// Edges in these directions through the middle of the window.
fn guess_along(pixels: &[Weighed], directions: [f64; 2]) -> SVector<f64, PARAMETERS> {
    let weights: f64 = pixels.iter().map(|pixel| pixel.2).sum();
    let mean = pixels.iter().map(|(_, brightness, weight)| weight * brightness).sum::<f64>() / weights;
    let lit = pixels.iter().map(|(at, brightness, weight)| {
        weight * (brightness - mean) * side(*at, directions[0]) * side(*at, directions[1])
    });
    guess(directions, mean, lit.sum::<f64>() / weights)
}

fn guess([one, other]: [f64; 2], brightness: f64, contrast: f64) -> SVector<f64, PARAMETERS> {
    SVector::from([0.0, 0.0, one, other, 1.0, brightness, contrast, 0.0, 0.0])
}

/// How much brighter one pair of opposite quarters is than the other, weighed.
fn lit(pixels: &[Weighed], [one, other]: [f64; 2]) -> f64 {
    pixels.iter().map(|(at, brightness, weight)| weight * brightness * side(*at, one) * side(*at, other)).sum()
}

/// On which side of the line through the origin in this direction a place lies: -1 or 1.
fn side(at: DVec2, direction: f64) -> f64 {
    DVec2::from_angle(direction).perp_dot(at).signum()
}

/// The fit about a state: the weighed sum of squares, and the lower triangle and right side of its normal equations.
struct Linear {
    cost: f64,
    normal: [[f64; PARAMETERS]; PARAMETERS],
    right: [f64; PARAMETERS],
}

impl Linear {
    fn at(pixels: &[Weighed], state: &SVector<f64, PARAMETERS>) -> Self {
        let place = DVec2::new(state[0], state[1]);
        let edges = [DVec2::from_angle(state[2]), DVec2::from_angle(state[3])];
        let (width, contrast, slope) = (state[4], state[6], DVec2::new(state[7], state[8]));
        let mut sums = Self { cost: 0.0, normal: [[0.0; PARAMETERS]; PARAMETERS], right: [0.0; PARAMETERS] };
        for (at, brightness, weight) in pixels {
            let from = *at - place;
            let across = edges.map(|edge| edge.perp_dot(from));
            let level = across.map(|across| tanh(across / width));
            let error = brightness - (state[5] + contrast * level[0] * level[1] + slope.dot(from));
            sums.cost += weight * error * error;
            // How the picture changes with the distance from each edge.
            let by = [0, 1].map(|i: usize| contrast * level[1 - i] * (1.0 - level[i] * level[i]) / width);
            let by_place = -(edges[0].perp() * by[0] + edges[1].perp() * by[1]) - slope;
            let row = [
                by_place.x,
                by_place.y,
                -by[0] * edges[0].dot(from),
                -by[1] * edges[1].dot(from),
                -(by[0] * across[0] + by[1] * across[1]) / width,
                1.0,
                level[0] * level[1],
                from.x,
                from.y,
            ];
            for (i, of) in row.iter().enumerate() {
                let weighed = weight * of;
                sums.right[i] += weighed * error;
                for (sum, other) in sums.normal[i][..=i].iter_mut().zip(&row) {
                    *sum += weighed * other;
                }
            }
        }
        sums
    }

    /// The matrix, whole.
    fn normal(&self) -> SMatrix<f64, PARAMETERS, PARAMETERS> {
        SMatrix::from_fn(|i, j| self.normal[i.max(j)][i.min(j)])
    }
}

/// As exact as is needed where numbers of about 1 are added to it, in a third of the time of the standard library's, which keeps all
/// digits of results near 0.
fn tanh(x: f64) -> f64 {
    1.0 - 2.0 / ((2.0 * x).exp() + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(radius: f64) -> Window {
        Window::of([DVec2::X * radius, DVec2::Y * radius]).unwrap()
    }

    /// A corner of a slanted chessboard at `corner`, through a lens that spreads a point over two pixels.
    fn picture(corner: DVec2) -> Grey {
        let (a, b) = (DVec2::from_angle(0.2), DVec2::from_angle(1.5));
        let mut pixels = Vec::new();
        for y in 0..40 {
            for x in 0..40 {
                let mut bright = 0;
                for sub in 0..256 {
                    let place = DVec2::new(
                        f64::from(x) - 0.5 + (f64::from(sub % 16) + 0.5) / 8.0,
                        f64::from(y) - 0.5 + (f64::from(sub / 16) + 0.5) / 8.0,
                    );
                    bright += i32::from((a.perp_dot(place - corner) > 0.0) == (b.perp_dot(place - corner) > 0.0));
                }
                pixels.push((30 + bright * 200 / 256) as u8);
            }
        }
        Grey { width: 40, height: 40, pixels }
    }

    #[test]
    fn a_corner_is_found_to_a_twentieth_of_a_pixel() {
        for corner in [DVec2::new(20.0, 20.0), DVec2::new(19.3, 20.8), DVec2::new(20.47, 19.61)] {
            let found = refine(&picture(corner), DVec2::new(21.0, 19.0), &window(5.0)).unwrap();
            assert!((found - corner).length() < 0.05, "{found} {corner}");
        }
    }

    #[test]
    fn flat_places_and_edges_are_no_corners() {
        let flat = Grey { width: 40, height: 40, pixels: vec![90; 1600] };
        assert_eq!(refine(&flat, DVec2::splat(20.0), &window(5.0)), None);
        let edge = (0..1600).map(|i| if i % 40 < 20 { 20 } else { 220 }).collect();
        assert_eq!(refine(&Grey { width: 40, height: 40, pixels: edge }, DVec2::splat(20.0), &window(5.0)), None);
        assert_eq!(refine(&flat, DVec2::splat(1.0), &window(5.0)), None, "too near to the border");
    }
}
