//! Pictures in which a board is not seen from the side.
//!
//! From the side squares are narrow, and what looks for corners has no room between them. So once some corners are known, the
//! board is looked at again as if from before it; and where none is found, in pictures that are stretched in one direction, in
//! which a board that leans that way is broad.

use glam::{DMat3, DVec2, DVec3};

use super::{Corner, Target, detect::Grey};
use crate::geometry::homography::{apply, homography};

/// A square in a picture of a board from before it, pixels at least and at most.
const SQUARE_PX: [f64; 2] = [24.0, 56.0];
/// How far such a picture reaches beyond the corners, in squares or tags.
const MARGIN: f64 = 1.5;
/// No such picture has more pixels.
const MOST_PIXELS: f64 = 2e6;
/// By how much pictures are stretched.
const STRETCH: f64 = 2.5;

/// A picture, and the map from it to the one that it was made from.
pub(super) struct Warped {
    pub grey: Grey,
    to_original: DMat3,
}

impl Warped {
    /// Corners that were found in it, where they are in the original.
    pub fn in_original(&self, corners: Vec<Corner>) -> Vec<Corner> {
        let original = |corner: Corner| Some(Corner { pixel: apply(&self.to_original, corner.pixel)?, ..corner });
        corners.into_iter().filter_map(original).collect()
    }

    fn of(grey: &Grey, [width, height]: [usize; 2], to_original: DMat3) -> Self {
        let inside = DVec2::new(grey.width as f64 - 0.5, grey.height as f64 - 0.5) - 1e-6;
        let pixel = |index: usize| {
            let place = DVec2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
            // What is beyond the edge is as the edge.
            let at = apply(&to_original, place).map(|at| at.clamp(DVec2::splat(0.5), inside));
            at.and_then(|at| grey.sample(at)).unwrap_or(0.0).round() as u8
        };
        Self { grey: Grey { width, height, pixels: (0..width * height).map(pixel).collect() }, to_original }
    }
}

/// The board as seen from before it, by the corners that are known; `None` where they do not say how it lies, or where the picture
/// shows it so already.
pub(super) fn from_before(grey: &Grey, corners: &[Corner], target: &Target) -> Option<Warped> {
    let known = corners.iter().filter_map(|corner| Some((target.point(corner.id)?.truncate(), corner.pixel)));
    let (plane, pixels): (Vec<DVec2>, Vec<DVec2>) = known.unzip();
    let map = homography(&plane, &pixels)?;
    let (columns, rows) = target.corners();
    let (unit, far) = (target.square_m(), target.point(columns * rows - 1)?.truncate());
    // How long a square is along either axis of the board, in the middle of what is known.
    let middle = plane.iter().sum::<DVec2>() / plane.len() as f64;
    let at = apply(&map, middle)?;
    let length = |way: DVec2| Some(apply(&map, middle + way * (0.5 * unit))?.distance(at) * 2.0);
    let (along, across) = (length(DVec2::X)?, length(DVec2::Y)?);
    let square_px = along.max(across).clamp(SQUARE_PX[0], SQUARE_PX[1]);
    let margin = DVec2::splat(MARGIN * unit);
    let (low, high) = (-margin, far + margin);
    let size = (high - low) / unit * square_px;
    if !(size.is_finite() && size.x * size.y <= MOST_PIXELS) {
        return None;
    }
    // The y of AprilGrids points up on the sheet.
    let up = matches!(target, Target::AprilGrid { .. });
    let scale = unit / square_px;
    let (from, step) = if up { (DVec2::new(low.x, high.y), -scale) } else { (low, scale) };
    let to_plane = DMat3::from_cols(DVec3::X * scale, DVec3::Y * step, from.extend(1.0));
    let to_original = map * to_plane;
    // Beyond the plane's horizon there is no picture.
    let side = |x: f64, y: f64| (to_original * DVec3::new(x * size.x, y * size.y, 1.0)).z;
    let corners = [side(0.0, 0.0), side(1.0, 0.0), side(0.0, 1.0), side(1.0, 1.0)];
    let one_side = corners.iter().all(|z| *z > 0.0) || corners.iter().all(|z| *z < 0.0);
    one_side.then(|| Warped::of(grey, [size.x.ceil() as usize, size.y.ceil() as usize], to_original))
}

/// The picture stretched along its rows, its columns and both diagonals.
pub(super) fn stretched(grey: &Grey) -> impl Iterator<Item = Warped> + '_ {
    let size = DVec2::new(grey.width as f64, grey.height as f64);
    (0..4).map(move |eighth| {
        let way = DVec2::from_angle(std::f64::consts::FRAC_PI_4 * f64::from(eighth));
        // Narrower along `way` by the factor, from the stretched picture to the original.
        let narrow = |at: DVec2| at - way * (at.dot(way) * (1.0 - 1.0 / STRETCH));
        let wide = |at: DVec2| at + way * (at.dot(way) * (STRETCH - 1.0));
        let outline = [DVec2::ZERO, size.with_y(0.0), size.with_x(0.0), size].map(wide);
        let low = outline.iter().fold(DVec2::INFINITY, |low, at| low.min(*at));
        let high = outline.iter().fold(DVec2::NEG_INFINITY, |high, at| high.max(*at));
        let to_original =
            DMat3::from_cols(narrow(DVec2::X).extend(0.0), narrow(DVec2::Y).extend(0.0), narrow(low).extend(1.0));
        let size = high - low;
        Warped::of(grey, [size.x.ceil() as usize, size.y.ceil() as usize], to_original)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Grey {
        let (width, height) = (120, 90);
        let lit =
            |i: usize| (120.0 + 60.0 * (i as f64 % 120.0 / 9.0).sin() + 40.0 * (i as f64 / 120.0 / 7.0).cos()) as u8;
        Grey { width, height, pixels: (0..width * height).map(lit).collect() }
    }

    #[test]
    fn stretched_pictures_show_everything_and_lead_back() {
        let original = picture();
        for warped in stretched(&original) {
            assert!(warped.grey.width >= 120 && warped.grey.height >= 90);
            let corner = |at: DVec2| Corner { id: 0, pixel: at };
            let back = DMat3::inverse(&warped.to_original);
            for at in [DVec2::new(2.0, 3.0), DVec2::new(118.0, 4.0), DVec2::new(60.0, 88.0)] {
                let there = apply(&back, at).unwrap();
                let inside = there.cmpge(DVec2::ZERO).all()
                    && there.x <= warped.grey.width as f64
                    && there.y <= warped.grey.height as f64;
                assert!(inside, "{there}");
                assert!(warped.in_original(vec![corner(there)])[0].pixel.distance(at) < 1e-9);
            }
            let there = apply(&back, DVec2::new(60.0, 45.0)).unwrap().floor() + 0.5;
            let at = warped.in_original(vec![corner(there)])[0].pixel;
            assert!((warped.grey.sample(there).unwrap() - original.sample(at).unwrap()).abs() < 0.51);
        }
    }

    #[test]
    fn a_board_from_the_side_is_seen_from_before_it_with_its_squares_in_order() {
        let original = picture();
        let map = |at: DVec2| DVec2::new(20.0 + 300.0 * at.x + 40.0 * at.y, 30.0 + 10.0 * at.x + 90.0 * at.y);
        for (text, up) in [("chessboard:5x4:0.04", false), ("aprilgrid:3x2:0.05:0.3", true)] {
            let target: Target = text.parse().unwrap();
            let on_sheet = |id| {
                let at: DVec2 = target.point(id).unwrap().truncate();
                if up { at.with_y(-at.y) } else { at }
            };
            let (columns, rows) = target.corners();
            let corners: Vec<Corner> = (0..columns * rows).map(|id| Corner { id, pixel: map(on_sheet(id)) }).collect();
            let warped = from_before(&original, &corners, &target).unwrap();
            let back = DMat3::inverse(&warped.to_original);
            let at = |id: u32| apply(&back, corners[id as usize].pixel).unwrap();
            let (right, next_row) = (at(1) - at(0), at(columns) - at(0));
            assert!(right.x > 20.0 && right.y.abs() < 1e-6, "{right}");
            // Rows of an AprilGrid count from below.
            assert!(next_row.x.abs() < 1e-6 && (next_row.y < 0.0) == up, "{next_row}");
        }
        let line: Vec<Corner> = (0..5).map(|id| Corner { id, pixel: DVec2::splat(f64::from(id)) }).collect();
        assert!(from_before(&original, &line, &"chessboard:5x4:0.04".parse().unwrap()).is_none());
    }
}
