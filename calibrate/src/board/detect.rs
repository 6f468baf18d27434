//! Corners of a target in a frame.

use calib_targets_charuco::{CharucoDetector, CharucoParams};
use calib_targets_chessboard::{ChessboardDetector, ChessboardParams, GrayImageView};
use erfgs_scene::ImageRgb8;
use glam::{DMat3, DVec2};

use super::{
    Charuco, Target,
    aprilgrid::{aprilgrid, without_strays},
    codes::numbered,
    consistent::consistent,
    corner::{Window, refine},
    facing,
    features::features,
    fill::filled,
};
use crate::{
    geometry::homography::{apply, homography},
    statistics::median,
};

/// Corners that are nearer than this to where their neighbours say are kept.
const STRAY_PX: f64 = 0.3;
/// What is as strong is a place where edges cross, and so many of them may be a board.
const CROSSING: f32 = 60.0;
const MANY: usize = 12;
/// Two looks at a corner differ by less; the next corner is farther away.
const SAME_PX: f64 = 2.5;
/// Half of the window around a corner without neighbours, pixels.
const LONE_PX: f64 = 3.0;
/// How often corners are refined again, and by how much they must move, pixels.
const ROUNDS: usize = 4;
const MOVED_PX: f64 = 0.03;
/// So many corners, the nearest, say how the board lies at a place.
const NEAREST: usize = 10;
/// Fewer corners do not say how a board lies.
const FEW: usize = 6;

/// One corner of a target in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Its number on the target, see [`Target::point`].
    pub id: u32,
    /// Where it is, pixels, centres at half-integers.
    pub pixel: DVec2,
}

/// A grey picture.
pub(super) struct Grey {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<u8>,
}

impl Grey {
    fn of(image: &ImageRgb8) -> Self {
        Self { width: image.width as usize, height: image.height as usize, pixels: image.grey().data }
    }

    /// The picture at half the size: means of 2x2 pixels.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut pixels = Vec::with_capacity(width * height);
        for y in 0..height {
            let row = |y: usize| self.pixels[y * self.width..][..2 * width].as_chunks::<2>().0;
            let sum = |pair: &[u8; 2]| u16::from(pair[0]) + u16::from(pair[1]);
            let pairs = row(2 * y).iter().zip(row(2 * y + 1));
            pixels.extend(pairs.map(|(above, below)| ((sum(above) + sum(below) + 2) / 4) as u8));
        }
        Self { width, height, pixels }
    }

    /// The picture at twice the size, bilinear: each pixel lies a quarter of a pixel from the nearest one of the picture, in both
    /// directions.
    fn doubled(&self) -> Self {
        let mut pixels = Vec::with_capacity(4 * self.pixels.len());
        // One row between two, in quarters, with a pixel more at each end: what is beyond the edge is as the edge.
        let mut between = vec![0; self.width + 2];
        for y in 0..2 * self.height {
            let near = y / 2;
            let next = if y.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(self.height - 1) };
            let row = |at: usize| &self.pixels[at * self.width..][..self.width];
            for ((between, &near), &next) in between[1..].iter_mut().zip(row(near)).zip(row(next)) {
                *between = 3 * u16::from(near) + u16::from(next);
            }
            (between[0], between[self.width + 1]) = (between[1], between[self.width]);
            let sixteenths = |near: u16, next: u16| ((3 * near + next + 8) / 16) as u8;
            for around in between.windows(3) {
                pixels.extend_from_slice(&[sixteenths(around[1], around[0]), sixteenths(around[1], around[2])]);
            }
        }
        Self { width: 2 * self.width, height: 2 * self.height, pixels }
    }

    pub fn view(&self) -> GrayImageView<'_> {
        GrayImageView { width: self.width, height: self.height, data: &self.pixels }
    }

    /// The brightness at a place between pixels; `None` beyond the outermost centres.
    pub fn sample(&self, at: DVec2) -> Option<f64> {
        let (x, y) = (at.x - 0.5, at.y - 0.5);
        let inside = x >= 0.0 && y >= 0.0 && x < (self.width - 1) as f64 && y < (self.height - 1) as f64;
        if !inside {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (fx, fy) = (x.fract(), y.fract());
        let pixel = |dx: usize, dy: usize| f64::from(self.pixels[(row + dy) * self.width + column + dx]);
        let above = pixel(0, 0) * (1.0 - fx) + pixel(1, 0) * fx;
        Some(above * (1.0 - fy) + (pixel(0, 1) * (1.0 - fx) + pixel(1, 1) * fx) * fy)
    }
}

/// Pictures whose shorter side has so many pixels are looked at at half the size first: a quarter of the work, and corners are
/// made exact at full size.
const LARGE: usize = 600;
/// Smaller ones are looked at as they are alone.
const SMALL: usize = 200;

/// The sizes at which a picture is looked at in turn, as factors of its sides, and the share of the corners with which that is
/// enough. A board that is blurred by motion or focus has sharp corners at half the size, and one that is far away has room
/// between its corners at twice the size.
fn sizes(side: usize) -> &'static [(f64, f64)] {
    match side {
        ..SMALL => &[(1.0, 0.0)],
        SMALL..LARGE => &[(1.0, 0.5), (0.5, 0.5), (2.0, 0.5)],
        LARGE.. => &[(0.5, 0.9), (1.0, 0.5), (2.0, 0.5)],
    }
}

/// The corners of `target` in a frame; none where it is not seen. A chessboard must be seen with its whole outline, since a
/// part of it does not tell which part; a ChArUco board or an AprilGrid may be partly hidden.
#[must_use]
pub fn detect(image: &ImageRgb8, target: &Target) -> Vec<Corner> {
    if image.width < 16 || image.height < 16 {
        return Vec::new();
    }
    let mut grey = Grey::of(image);
    if let Target::Charuco { inverted: true, .. } = target {
        grey.pixels.iter_mut().for_each(|pixel| *pixel = 255 - *pixel);
    }
    let look = |grey: &Grey| match target {
        Target::Chessboard { columns, rows, .. } => chessboard(grey, *columns, *rows),
        Target::Charuco { .. } => charuco(grey, target),
        Target::AprilGrid { .. } => aprilgrid(grey, target),
    };
    let (columns, rows) = target.corners();
    let all = (columns * rows) as usize;
    let mut corners: Vec<Corner> = Vec::new();
    for &(scale, enough) in sizes(grey.width.min(grey.height)) {
        let found = match scale {
            0.5 => look(&grey.halved()),
            2.0 => look(&grey.doubled()),
            _ => look(&grey),
        };
        if found.len() > corners.len() {
            corners = found.into_iter().map(|corner| Corner { pixel: corner.pixel / scale, ..corner }).collect();
        }
        if corners.len() as f64 >= enough * all as f64 {
            break;
        }
    }
    if corners.len() < FEW {
        corners = leaning(&grey, target, &look).unwrap_or(corners);
    } else if corners.len() < all {
        let by_codes = || numbered(&grey, &corners, target);
        corners = confirmed(&grey, corners.clone(), target, &look).or_else(by_codes).unwrap_or(corners);
    }
    exact(&grey, &mut corners, target);
    settle(&grey, &mut corners, target);
    // What hides a corner in part pulls it aside, and so do edges that are too near to it.
    corners = without_strays(corners, target, STRAY_PX);
    if (FEW..all).contains(&corners.len()) && !matches!(target, Target::AprilGrid { .. }) {
        corners = without_strays(filled(&grey, &corners, target, share(target)), target, STRAY_PX);
    }
    if matches!(target, Target::Charuco { .. }) {
        corners = consistent(corners, target, DVec2::new(f64::from(image.width), f64::from(image.height)));
    }
    corners.sort_by_key(|corner| corner.id);
    corners
}

/// The corners of a board as they are read in a picture from before it, once two such pictures agree, the second by what was read in
/// the first; `None` where none does. Of what is read by `corners` themselves, the picture with more of them counts.
fn confirmed(
    grey: &Grey,
    mut corners: Vec<Corner>,
    target: &Target,
    look: &dyn Fn(&Grey) -> Vec<Corner>,
) -> Option<Vec<Corner>> {
    for _ in 0..3 {
        let facing = facing::from_before(grey, &corners, target)?;
        let found = facing.in_original(look(&facing.grey));
        if found.len() < FEW {
            return None;
        }
        if agree(&corners, &found) {
            return Some(if found.len() > corners.len() { found } else { corners });
        }
        corners = found;
    }
    None
}

/// Whether corners of the same numbers are at the same places.
fn agree(one: &[Corner], other: &[Corner]) -> bool {
    let place = |id: u32| one.iter().find(|corner| corner.id == id).map(|corner| corner.pixel);
    let apart = other.iter().filter_map(|corner| Some(place(corner.id)?.distance(corner.pixel)));
    median(apart).is_some_and(|apart| apart < SAME_PX)
}

/// The corners of a board that leans so much that none are found in the picture as it is: in pictures that are stretched, of half
/// the size first, since all of a picture takes ten times as long so as the picture itself. What is read in a picture that is narrow
/// or blurred may be another place of the board, so that a picture from before it must confirm it.
fn leaning(grey: &Grey, target: &Target, look: &dyn Fn(&Grey) -> Vec<Corner>) -> Option<Vec<Corner>> {
    let found = |part: &Grey, scale: f64| {
        facing::stretched(part).find_map(|warped| {
            let corners = warped.in_original(look(&warped.grey)).into_iter();
            let corners = corners.map(|corner| Corner { pixel: corner.pixel * scale, ..corner }).collect();
            let corners: Vec<Corner> = corners;
            confirmed(grey, corners.clone(), target, look).or_else(|| numbered(grey, &corners, target))
        })
    };
    if grey.width.min(grey.height) < LARGE {
        return found(grey, 1.0);
    }
    found(&grey.halved(), 2.0).or_else(|| {
        let crossings = features(grey, CROSSING).iter().filter(|feature| feature.strength >= CROSSING).count();
        if crossings >= MANY { found(grey, 1.0) } else { None }
    })
}

/// Detectors put the centre of the first pixel at 0.
pub(super) fn to_ours(x: f32, y: f32) -> DVec2 {
    DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)
}

/// A corner's column and row on the grid that was found, and where it is, pixels.
type OnGrid = (i32, i32, DVec2);

fn chessboard(grey: &Grey, columns: u32, rows: u32) -> Vec<Corner> {
    let found = features(grey, ChessboardParams::default().min_corner_strength);
    let configurations = ChessboardParams::sweep_default();
    let detections = configurations.into_iter().filter_map(|parameters| ChessboardDetector::new(parameters).ok());
    let (columns, rows) = (columns as i32, rows as i32);
    for detection in detections.filter_map(|detector| detector.detect(&found)) {
        let grid: Vec<OnGrid> = detection
            .corners
            .iter()
            .map(|corner| (corner.grid.u, corner.grid.v, to_ours(corner.position.x, corner.position.y)))
            .collect();
        let Some((mut grid, size)) = trimmed(grid, [columns, rows]) else { continue };
        if size != [columns, rows] {
            // Lying on its side: a quarter turn, no reflection.
            for corner in &mut grid {
                (corner.0, corner.1) = (corner.1, rows - 1 - corner.0);
            }
        }
        if 10 * grid.len() < 9 * (columns * rows) as usize {
            continue;
        }
        // Of a board with an odd number of squares in one direction, half a turn exchanges black and white.
        if upside_down(grey, &grid) {
            for corner in &mut grid {
                (corner.0, corner.1) = (columns - 1 - corner.0, rows - 1 - corner.1);
            }
        }
        return grid.into_iter().map(|(u, v, pixel)| Corner { id: (v * columns + u) as u32, pixel }).collect();
    }
    Vec::new()
}

/// The grid without stray corners beyond the board's outline, such as where a black square meets the margin; its columns and
/// rows, which are the board's or, on its side, the other way round. `None` of another size.
fn trimmed(mut grid: Vec<OnGrid>, board: [i32; 2]) -> Option<(Vec<OnGrid>, [i32; 2])> {
    loop {
        let (low, high) = grid.iter().fold(([i32::MAX; 2], [i32::MIN; 2]), |(low, high), &(u, v, _)| {
            ([low[0].min(u), low[1].min(v)], [high[0].max(u), high[1].max(v)])
        });
        if grid.is_empty() {
            return None;
        }
        let size = [high[0] - low[0] + 1, high[1] - low[1] + 1];
        if size == board || size == [board[1], board[0]] {
            grid.iter_mut().for_each(|corner| (corner.0, corner.1) = (corner.0 - low[0], corner.1 - low[1]));
            return Some((grid, size));
        }
        // The emptiest of the four outer lines, if less than half of it is there.
        let on = |corner: &OnGrid, axis: usize, at: i32| [corner.0, corner.1][axis] == at;
        let lines = [(0, low[0]), (0, high[0]), (1, low[1]), (1, high[1])].map(|(axis, at)| {
            let count = grid.iter().filter(|corner| on(corner, axis, at)).count();
            (count as f64 / f64::from(size[1 - axis]), axis, at)
        });
        let (share, axis, at) = lines.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        if share >= 0.5 {
            return None;
        }
        grid.retain(|corner| !on(corner, axis, at));
    }
}

/// Whether the square right below the first corner is bright: on a board, it has the colour of the square at its outer corner,
/// which is black.
fn upside_down(grey: &Grey, grid: &[OnGrid]) -> bool {
    let at = |u: i32, v: i32| grid.iter().find(|c| (c.0, c.1) == (u, v)).map(|c| c.2);
    let mut difference = 0.0;
    for &(u, v, pixel) in grid {
        let others = (at(u + 1, v), at(u, v + 1), at(u + 1, v + 1));
        if let (Some(right), Some(below), Some(across)) = others
            && let Some(brightness) = grey.sample((pixel + right + below + across) / 4.0)
        {
            difference += if (u + v) % 2 == 0 { brightness } else { -brightness };
        }
    }
    difference > 0.0
}

fn charuco(grey: &Grey, target: &Target) -> Vec<Corner> {
    let Some(Charuco { board, first }) = target.charuco() else { return Vec::new() };
    let mut best = Vec::new();
    // What looks like a corner is the same for all configurations.
    let found = features(grey, CharucoParams::for_board(board).chessboard.min_corner_strength);
    for parameters in CharucoParams::sweep_for_board(&board) {
        let Ok(detector) = CharucoDetector::new(parameters) else { continue };
        let Ok(detection) = detector.detect_with_corners(&grey.view(), &found) else { continue };
        let enough = 2 * detection.corners.len() >= ((board.rows - 1) * (board.cols - 1)) as usize;
        if detection.corners.len() > best.len() {
            best = detection
                .corners
                .iter()
                .filter_map(|corner| {
                    let id = corner.id.checked_sub(first)?;
                    Some(Corner { id, pixel: to_ours(corner.position.x, corner.position.y) })
                })
                .collect();
        }
        // The configurations after the first are for what it cannot see.
        if enough {
            break;
        }
    }
    best
}

/// How near the next edge is to a corner, as a share of a square or a tag: on a ChArUco board a marker begins an eighth of a square away
/// from the corner, or less; on an AprilGrid the small square ends, or a tag's code begins.
fn share(target: &Target) -> f64 {
    match target {
        Target::Chessboard { .. } => 0.42,
        Target::Charuco { .. } => 0.12,
        Target::AprilGrid { spacing, .. } => 0.5 * spacing.min(0.3),
    }
}

/// Refines each corner in a window that no other edge enters, and leaves out what is no corner.
fn exact(grey: &Grey, corners: &mut Vec<Corner>, target: &Target) {
    let share = share(target);
    let refined = corners.iter().filter_map(|corner| {
        // One that has no neighbours does not say how large squares are.
        let lone = [DVec2::X * LONE_PX, DVec2::Y * LONE_PX];
        let sides = around(corners, corner, target).map_or(lone, |sides| sides.map(|side| side * share));
        let window = Window::of(sides)?;
        Some(Corner { pixel: refine(grey, corner.pixel, &window)?, ..*corner })
    });
    let refined: Vec<Corner> = refined.collect();
    *corners = refined;
}

/// Refines corners again from where the others say that they are, as long as that brings them nearer to it: what was found in a picture that is
/// narrow, or stretched, may have been too far from the corner to come to it.
fn settle(grey: &Grey, corners: &mut [Corner], target: &Target) {
    if corners.len() < FEW {
        return;
    }
    for _ in 0..ROUNDS {
        let before = corners.to_vec();
        let nearer = |corner: &Corner| {
            let place = target.point(corner.id)?.truncate();
            let others: Vec<Corner> = before.iter().filter(|other| other.id != corner.id).copied().collect();
            let map = local_map(&others, place, target)?;
            let at = apply(&map, place)?;
            let window = Window::of(sides_at(&map, place, target)?.map(|side| side * share(target)))?;
            let again = refine(grey, at, &window)?;
            (again.distance(at) + MOVED_PX < corner.pixel.distance(at)).then_some(again)
        };
        let moves: Vec<Option<DVec2>> = corners.iter().map(nearer).collect();
        if moves.iter().all(Option::is_none) {
            return;
        }
        for (corner, moved) in corners.iter_mut().zip(moves) {
            corner.pixel = moved.unwrap_or(corner.pixel);
        }
    }
}

/// The sides of a square (or a tag) at a corner in the picture, along the board's rows and columns, from the corners next to it;
/// where there are none in a direction, as long as in the other one and at right angles to it.
fn around(corners: &[Corner], corner: &Corner, target: &Target) -> Option<[DVec2; 2]> {
    let (columns, _) = target.corners();
    let here = target.point(corner.id)?.truncate();
    let mut sides: [Option<DVec2>; 2] = [None; 2];
    for other in corners {
        let steps =
            [(other.id % columns).abs_diff(corner.id % columns), (other.id / columns).abs_diff(corner.id / columns)];
        let axis = match steps {
            [1, 0] => 0,
            [0, 1] => 1,
            _ => continue,
        };
        let way = target.point(other.id)?.truncate() - here;
        let side = (other.pixel - corner.pixel) * (target.square_m() / way[axis]);
        // The shorter one of two: nothing else may enter the window.
        sides[axis] = sides[axis].filter(|known| known.length() <= side.length()).or(Some(side));
    }
    // A board that leans away has squares of other sides along the other direction.
    let map = || local_map(corners, here, target);
    match sides {
        [Some(along), Some(across)] => Some([along, across]),
        [Some(one), None] | [None, Some(one)] => Some([one, one.perp()]).map(|turned| {
            let [along, across] = map().and_then(|map| sides_at(&map, here, target)).unwrap_or(turned);
            [sides[0].unwrap_or(along), sides[1].unwrap_or(across)]
        }),
        [None, None] => map().and_then(|map| sides_at(&map, here, target)),
    }
}

/// From the board's plane to the picture around a place, by the corners that are nearest to it; a lens bends what is farther away.
pub(super) fn local_map(corners: &[Corner], place: DVec2, target: &Target) -> Option<DMat3> {
    let seen = corners.iter().filter_map(|corner| Some((target.point(corner.id)?.truncate(), corner.pixel)));
    map_by_nearest(seen, place, NEAREST)
}

/// From a plane to the picture around a place, by the `most` places of the plane that are nearest to it and where they are seen.
pub(super) fn map_by_nearest(seen: impl Iterator<Item = (DVec2, DVec2)>, place: DVec2, most: usize) -> Option<DMat3> {
    let mut nearest: Vec<(f64, (DVec2, DVec2))> =
        seen.map(|(plane, pixel)| (plane.distance(place), (plane, pixel))).collect();
    nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (plane, pixels): (Vec<DVec2>, Vec<DVec2>) = nearest.into_iter().take(most).map(|(_, seen)| seen).unzip();
    homography(&plane, &pixels)
}

/// The sides of a square (or a tag) in the picture at a place of the board.
pub(super) fn sides_at(map: &DMat3, place: DVec2, target: &Target) -> Option<[DVec2; 2]> {
    let unit = target.square_m();
    let side = |way: DVec2| Some(apply(map, place + 0.5 * unit * way)? - apply(map, place - 0.5 * unit * way)?);
    Some([side(DVec2::X)?, side(DVec2::Y)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_at_twice_the_size_is_the_picture_between_its_pixels() {
        let (width, height) = (7, 5);
        let grey = Grey { width, height, pixels: (0..width * height).map(|i| (i * i * 37 % 256) as u8).collect() };
        let twice = grey.doubled();
        assert_eq!((twice.width, twice.height), (14, 10));
        for (i, &pixel) in twice.pixels.iter().enumerate() {
            let place = DVec2::new((i % 14) as f64 + 0.5, (i / 14) as f64 + 0.5) / 2.0;
            // What is beyond the outermost centres is as they are.
            let inside = |at: f64, size: usize| at.clamp(0.5, size as f64 - 0.5 - 1e-6);
            let between = grey.sample(DVec2::new(inside(place.x, width), inside(place.y, height))).unwrap();
            assert!((f64::from(pixel) - between).abs() < 0.501, "{pixel} is not {between}");
        }
    }

    #[test]
    fn stray_corners_beyond_the_outline_do_not_hide_a_board() {
        let corner = |u: i32, v: i32| (u, v, DVec2::new(f64::from(u), f64::from(v)));
        let board: Vec<_> = (0..54).map(|i| corner(1 + i % 6, i / 6)).collect();
        let strays = [board.clone(), vec![corner(0, 8), corner(7, 2), corner(7, 3)]].concat();
        let (grid, size) = trimmed(strays, [9, 6]).unwrap();
        assert_eq!((grid.len(), size), (54, [6, 9]));
        assert!(grid.iter().all(|&(u, v, at)| (0..6).contains(&u) && at == DVec2::new(f64::from(u + 1), f64::from(v))));
        // A line of which half is there belongs to a larger board.
        let larger = [board.clone(), (0..5).map(|v| corner(0, v)).collect()].concat();
        assert_eq!(trimmed(larger, [9, 6]), None);
        assert_eq!(trimmed(board, [9, 7]), None);
        assert_eq!(trimmed(Vec::new(), [9, 6]), None);
    }
}
