//! The numbers of a ChArUco board's corners, by the codes of its markers.
//!
//! A marker that is seen from the side is too narrow for its edges to be found and its code to be read for itself. Where corners say how the
//! board lies it need not be: the place of each cell of each marker is known then, and all markers together say whether the codes are
//! those that must be there, or those of the board turned or a square aside.

use glam::{DMat3, DVec2};

use super::{
    Corner, Target,
    detect::{Grey, map_by_nearest},
};
use crate::geometry::homography::apply;

/// So many corners, the nearest, say where a marker is: a lens bends what is farther away.
const NEAREST: usize = 8;
/// Markers farther from all corners than this many squares are not looked at.
const NEAR: f64 = 1.1;
/// Numbers may be off by so many squares in either direction.
const ASIDE: i32 = 2;
/// Fewer markers prove nothing.
const FEW: usize = 5;
/// How alike codes are to what is seen, from -1 to 1 (correlation, the mean of all markers): so much where they are the right ones...
const RIGHT: f64 = 0.5;
/// ...and less than the right ones by this where they are others, which are alike by chance.
const APART: f64 = 0.25;

/// The corners with the numbers that the codes give them; `None` where these do not tell, or for a board without markers.
pub(super) fn numbered(grey: &Grey, corners: &[Corner], target: &Target) -> Option<Vec<Corner>> {
    let board = Board::of(target)?;
    let maps = board.maps(corners);
    let mut turns: Vec<(f64, Turn)> = Turn::all().map(|turn| (board.likeness(grey, &maps, turn), turn)).collect();
    turns.sort_by(|a, b| b.0.total_cmp(&a.0));
    let [(best, turn), (second, _), ..] = turns[..] else { return None };
    (best >= RIGHT && best - second >= APART).then(|| board.renumbered(corners, turn))
}

/// From where a square is taken to be to where it is: turned about the first corner by quarters, then moved, in squares.
#[derive(Clone, Copy)]
struct Turn {
    quarters: u32,
    by: DVec2,
}

impl Turn {
    fn all() -> impl Iterator<Item = Self> {
        let aside =
            move |at: i32| DVec2::new(f64::from(at % (2 * ASIDE + 1) - ASIDE), f64::from(at / (2 * ASIDE + 1) - ASIDE));
        (0..4).flat_map(move |quarters| (0..(2 * ASIDE + 1).pow(2)).map(move |at| Self { quarters, by: aside(at) }))
    }

    /// Where what is at `place` of the board is taken to be. Turns are about the middle of the `size` of the board's squares.
    fn taken(self, place: DVec2, size: DVec2) -> DVec2 {
        let about = 0.5 * size;
        let mut at = place - self.by - about;
        for _ in 0..self.quarters {
            at = at.perp();
        }
        // On its side a board that is not square has its middle elsewhere on the grid of its squares.
        let half = if self.quarters % 2 == 1 { (0.5 * (size.x - size.y)).fract() } else { 0.0 };
        at + about + half
    }
}

struct Board {
    /// Columns and rows of squares.
    size: DVec2,
    columns: u32,
    rows: u32,
    markers: Vec<Marker>,
}

/// The cells of a marker's code, and whether each is white.
struct Marker {
    middle: DVec2,
    cells: Vec<(DVec2, f64)>,
}

impl Board {
    fn of(target: &Target) -> Option<Self> {
        let Target::Charuco { columns, rows, square_m, marker_m, first, .. } = target else { return None };
        let dictionary = target.dictionary()?;
        let (bits, begins_white) = (dictionary.marker_size(), u32::from(target.begins_white()));
        let cell = marker_m / square_m / (bits + 2) as f64;
        let squares = (0..*rows).flat_map(|row| (0..*columns).map(move |column| (column, row)));
        let white = squares.filter(|(column, row)| (row + column) % 2 != begins_white);
        let marker = |((column, row), &code): ((u32, u32), &u64)| {
            let middle = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
            let at = |index: usize| (index as f64 - 0.5 * (bits - 1) as f64) * cell;
            let cells = (0..bits * bits).map(|bit| {
                let place = middle + DVec2::new(at(bit % bits), at(bit / bits));
                (place, if (code >> bit) & 1 == 1 { -1.0 } else { 1.0 })
            });
            Marker { middle, cells: cells.collect() }
        };
        let codes = dictionary.codes().get(*first as usize..)?;
        let markers = white.zip(codes).map(marker).collect();
        let size = DVec2::new(f64::from(*columns), f64::from(*rows));
        Some(Self { size, columns: *columns, rows: *rows, markers })
    }

    /// Where a corner is taken to be, in squares.
    fn place(&self, corner: &Corner) -> DVec2 {
        let inner = self.columns - 1;
        DVec2::new(f64::from(corner.id % inner + 1), f64::from(corner.id / inner + 1))
    }

    /// The corners by where they are taken to be.
    fn maps(&self, corners: &[Corner]) -> Vec<(DVec2, DVec2)> {
        corners.iter().map(|corner| (self.place(corner), corner.pixel)).collect()
    }

    /// How alike the codes are to what is seen, if the corners are to be turned so.
    fn likeness(&self, grey: &Grey, corners: &[(DVec2, DVec2)], turn: Turn) -> f64 {
        let alike = self.markers.iter().filter_map(|marker| {
            let map = near(corners, turn.taken(marker.middle, self.size))?;
            let seen: Option<Vec<f64>> = marker
                .cells
                .iter()
                .map(|(place, _)| grey.sample(apply(&map, turn.taken(*place, self.size))?))
                .collect();
            Some(correlation(&seen?, marker.cells.iter().map(|(_, white)| *white)))
        });
        let alike: Vec<f64> = alike.collect();
        if alike.len() < FEW { -1.0 } else { alike.iter().sum::<f64>() / alike.len() as f64 }
    }

    fn renumbered(&self, corners: &[Corner], turn: Turn) -> Vec<Corner> {
        let inner = self.columns - 1;
        let numbers = 0..inner * (self.rows - 1);
        let renumbered = numbers.filter_map(|id| {
            let taken = turn.taken(self.place(&Corner { id, pixel: DVec2::ZERO }), self.size);
            let corner = corners.iter().find(|corner| self.place(corner).distance(taken) < 0.25)?;
            Some(Corner { id, ..*corner })
        });
        renumbered.collect()
    }
}

/// The map around a place by the corners next to it; `None` where there are none.
fn near(corners: &[(DVec2, DVec2)], place: DVec2) -> Option<DMat3> {
    let is_near = corners.iter().any(|(plane, _)| plane.distance(place) <= NEAR);
    if is_near { map_by_nearest(corners.iter().copied(), place, NEAREST) } else { None }
}

/// The correlation of levels with what they must be; 0 where either does not vary.
fn correlation(seen: &[f64], expected: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = seen.len() as f64;
    let mean = seen.iter().sum::<f64>() / count;
    let expected_mean = expected.clone().sum::<f64>() / count;
    let (mut both, mut of_seen, mut of_expected) = (0.0, 0.0, 0.0);
    for (seen, expected) in seen.iter().zip(expected) {
        let (seen, expected) = (seen - mean, expected - expected_mean);
        both += seen * expected;
        of_seen += seen * seen;
        of_expected += expected * expected;
    }
    let both_vary = of_seen * of_expected > 0.0;
    if both_vary { both / (of_seen * of_expected).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;

    use super::*;
    use crate::board::print::{MARGIN, draw};

    /// From the board's plane, metres, to a picture in which it leans.
    fn map() -> DMat3 {
        let columns = [DVec2::new(2600.0, 300.0), DVec2::new(-500.0, 900.0), DVec2::new(120.0, 60.0)];
        let [x, y, at] = columns.map(|column| column.extend(0.0));
        DMat3::from_cols(x.with_z(0.9), y.with_z(-0.6), at.with_z(1.0))
    }

    /// A picture of the board as it is printed, with noise.
    fn picture(target: &Target) -> Grey {
        let (drawing, square_mm) = (draw(target), 1e3 * target.square_m());
        let (width, height, back) = (800, 400, map().inverse());
        let pixel = |index: usize| {
            let at = DVec2::new((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
            let place = apply(&back, at).unwrap() * 1e3 + MARGIN * square_mm;
            let inside = |[x, y, w, h]: &[f64; 4]| (*x..x + w).contains(&place.x) && (*y..y + h).contains(&place.y);
            let noise = random::range(random::key(5, &[index as u64]), -20.0, 20.0);
            (if drawing.filled.iter().any(inside) { 60.0 } else { 190.0 } + noise) as u8
        };
        Grey { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    #[test]
    fn numbers_that_are_a_square_aside_or_turned_are_put_right_by_the_codes() {
        for text in ["charuco:7x5:0.04:0.03:DICT_4X4_50", "charuco:5x4:0.05:0.04:DICT_4X4_100:first=9:legacy"] {
            let target: Target = text.parse().unwrap();
            let (grey, (columns, rows)) = (picture(&target), target.corners());
            let pixel = |id: u32| apply(&map(), target.point(id).unwrap().truncate()).unwrap();
            let all: Vec<Corner> = (0..columns * rows).map(|id| Corner { id, pixel: pixel(id) }).collect();
            let aside = |by: u32| {
                all.iter()
                    .filter(move |corner| corner.id % columns >= by)
                    .map(move |corner| Corner { id: corner.id - by, ..*corner })
            };
            let turned = all.iter().map(|corner| Corner { id: columns * rows - 1 - corner.id, ..*corner });
            for wrong in [all.clone(), aside(1).collect(), aside(2).collect(), turned.collect()] {
                let right = numbered(&grey, &wrong, &target).unwrap();
                assert_eq!(right.len(), wrong.len(), "{text}");
                assert!(right.iter().all(|corner| corner.pixel == pixel(corner.id)), "{text}: {right:?}");
            }
            // Another board, a picture of nothing, and corners that tell nothing.
            let other: Target = text.replace("DICT_4X4", "DICT_5X5").parse().unwrap();
            assert_eq!(numbered(&grey, &all, &other), None);
            let nothing =
                Grey { width: 800, height: 400, pixels: (0..320_000).map(|i| (i * 37 % 251) as u8).collect() };
            assert_eq!(numbered(&nothing, &all, &target), None);
            assert_eq!(numbered(&grey, &all[..3], &target), None);
        }
        assert_eq!(
            numbered(&picture(&"chessboard:8x5:0.04".parse().unwrap()), &[], &"chessboard:8x5:0.04".parse().unwrap()),
            None
        );
    }
}
