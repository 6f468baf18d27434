//! Corners that nothing was read beside, where the others say that they are.
//!
//! A corner of a ChArUco board is known by the markers next to it, and one whose markers are too narrow to be read is lost, however
//! clear it is. Where the others say how the board lies, it is looked for where it must be, and is one where bright and dark squares
//! meet there as they must.

use glam::DVec2;

use super::{
    Corner, Target,
    corner::{Window, refine},
    detect::{Grey, local_map, sides_at},
};
use crate::geometry::homography::apply;

/// A corner is no farther from where the others say than this share of a square's shorter side...
const NEAR: f64 = 0.1;
/// ...or this many pixels, where that is more.
const NEAR_PX: f64 = 1.0;
/// How far into the squares it is looked which are bright, as a share of a side: a marker begins behind that.
const INTO: f64 = 0.09;
/// Bright squares are brighter by so many levels at least.
const BRIGHTER: f64 = 12.0;

/// The corners with those that are missing among them, refined in windows of `share` of a square; from what is known outwards.
pub(super) fn filled(grey: &Grey, known: &[Corner], target: &Target, share: f64) -> Vec<Corner> {
    let (columns, rows) = target.corners();
    let mut corners = known.to_vec();
    let Some(parity) = parity(grey, known, target) else { return corners };
    loop {
        let is_known = |id: u32| corners.iter().any(|corner| corner.id == id);
        let beside = |id: u32| {
            let (u, v) = (id % columns, id / columns);
            let count = corners
                .iter()
                .filter(|corner| (corner.id % columns).abs_diff(u).max((corner.id / columns).abs_diff(v)) == 1);
            count.count() >= 2
        };
        let missing = (0..columns * rows).filter(|id| !is_known(*id) && beside(*id));
        let more: Vec<Corner> = missing.filter_map(|id| found(grey, &corners, id, target, share, parity)).collect();
        if more.is_empty() {
            return corners;
        }
        corners.extend(more);
    }
}

/// The corner of this number, if it is where the others say.
fn found(grey: &Grey, corners: &[Corner], id: u32, target: &Target, share: f64, parity: bool) -> Option<Corner> {
    let place = target.point(id)?.truncate();
    let map = local_map(corners, place, target)?;
    let at = apply(&map, place)?;
    let sides = sides_at(&map, place, target)?;
    let pixel = refine(grey, at, &Window::of(sides.map(|side| side * share))?)?;
    let near = (NEAR * sides[0].length().min(sides[1].length())).max(NEAR_PX);
    (pixel.distance(at) <= near && first_is_bright(grey, pixel, sides)? == (parity == is_even(id, target)))
        .then_some(Corner { id, pixel })
}

fn is_even(id: u32, target: &Target) -> bool {
    let (columns, _) = target.corners();
    (id % columns + id / columns).is_multiple_of(2)
}

/// Whether the square right below a corner of an even number is bright, as most of the known ones say.
fn parity(grey: &Grey, corners: &[Corner], target: &Target) -> Option<bool> {
    let at = |id: u32| corners.iter().find(|corner| corner.id == id).map(|corner| corner.pixel);
    let (columns, _) = target.corners();
    let mut votes = 0_i32;
    for corner in corners {
        let (right, below) = (at(corner.id + 1), at(corner.id + columns));
        let (Some(right), Some(below)) = (right.filter(|_| (corner.id + 1) % columns != 0), below) else { continue };
        let sides = [right - corner.pixel, below - corner.pixel];
        if let Some(bright) = first_is_bright(grey, corner.pixel, sides) {
            votes += if bright == is_even(corner.id, target) { 1 } else { -1 };
        }
    }
    (votes != 0).then_some(votes > 0)
}

/// Whether the square between both sides, and the one across, are brighter than the two others; `None` where neither pair is.
fn first_is_bright(grey: &Grey, at: DVec2, [along, across]: [DVec2; 2]) -> Option<bool> {
    let level = |a: f64, b: f64| grey.sample(at + INTO * (a * along + b * across));
    let [one, two] = [[level(1.0, 1.0)?, level(-1.0, -1.0)?], [level(1.0, -1.0)?, level(-1.0, 1.0)?]];
    let least = |pair: [f64; 2]| pair[0].min(pair[1]);
    let most = |pair: [f64; 2]| pair[0].max(pair[1]);
    if least(one) > most(two) + BRIGHTER {
        Some(true)
    } else if least(two) > most(one) + BRIGHTER {
        Some(false)
    } else {
        None
    }
}
