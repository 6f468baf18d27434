//! One tag: what it says between four corners.

use std::ops::Range;

use calib_targets_charuco::resolve_dictionary;
use glam::{DMat3, DVec2};

use super::super::detect::Grey;
use crate::geometry::homography::homography;

/// Cells of black around the code, as Kalibr prints it; others leave one, which is read too.
pub(in super::super) const BORDER: usize = 2;
/// Cells of the code in a row.
pub(in super::super) const BITS: usize = 6;
/// The tags' family, as dictionaries are called.
pub(in super::super) const TAG_FAMILY: &str = "DICT_APRILTAG_36h11";
/// Two codes differ in 11 cells at least, however they are turned.
const MOST_WRONG: u32 = 4;
/// Black and white that are nearer to each other than this (of 255) are noise.
const LEAST_CONTRAST: f64 = 12.0;

/// A tag in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tag {
    /// Its number on the target, from 0.
    pub id: u32,
    /// Pixels: below left, below right, above right, above left on the sheet.
    pub corners: [DVec2; 4],
    /// Cells that had to be corrected.
    pub wrong: u32,
    /// White less black, of 255.
    pub contrast: f64,
}

/// Whether a cell of a tag's code is black; rows from the top of the sheet. `None` beyond the code or the family.
pub(in super::super) fn is_black(id: u32, row: usize, column: usize) -> Option<bool> {
    let dictionary = resolve_dictionary(TAG_FAMILY)?;
    let code = dictionary.codes().get(id as usize)?;
    // The dictionary counts from the upper left of OpenCV's drawing, which stands on its head against Kalibr's (and the
    // family's own).
    (row < BITS && column < BITS).then(|| (code >> (BITS * BITS - 1 - BITS * row - column)) & 1 == 1)
}

/// The tag between four corners (clockwise as seen), if it is one of `numbers` in the family.
pub(super) fn read(grey: &Grey, quad: [DVec2; 4], numbers: &Range<u32>) -> Option<Tag> {
    let unit = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    let map = homography(&unit, &quad)?;
    [BORDER, 1]
        .into_iter()
        .filter_map(|border| read_with(grey, &map, quad, border, numbers))
        .min_by_key(|tag| tag.wrong)
}

fn read_with(grey: &Grey, map: &DMat3, quad: [DVec2; 4], border: usize, numbers: &Range<u32>) -> Option<Tag> {
    let cells = BITS + 2 * border;
    let (mut frame, mut inside) = (Vec::new(), [[0.0; BITS]; BITS]);
    for row in 0..cells {
        for column in 0..cells {
            let value = brightness(grey, map, [column, row], cells)?;
            let within = |at: usize| (border..border + BITS).contains(&at);
            if within(row) && within(column) {
                inside[row - border][column - border] = value;
            } else {
                frame.push(value);
            }
        }
    }
    frame.sort_by(f64::total_cmp);
    let mut sorted: Vec<f64> = inside.iter().flatten().copied().collect();
    sorted.sort_by(f64::total_cmp);
    // The brightest sixth of the code is white; each code has as much.
    let white = sorted[sorted.len() - BITS..].iter().sum::<f64>() / BITS as f64;
    let black = frame[frame.len() / 2];
    let limit = 0.5 * (black + white);
    if white - black < LEAST_CONTRAST || frame[frame.len() * 9 / 10] > limit {
        return None;
    }
    let mut seen = inside.map(|row| row.map(|value| value < limit));
    let mut best: Option<(u32, u32, usize)> = None;
    for turn in 0..4 {
        let code = seen.iter().flatten().fold(0_u64, |code, &black| code << 1 | u64::from(black));
        if let Some((id, wrong)) = nearest(code, numbers)
            && best.is_none_or(|(least, ..)| wrong < least)
        {
            best = Some((wrong, id, turn));
        }
        let before = seen;
        for (row, cells) in seen.iter_mut().enumerate() {
            for (column, cell) in cells.iter_mut().enumerate() {
                *cell = before[column][BITS - 1 - row];
            }
        }
    }
    let (wrong, id, turn) = best?;
    // Above left on the sheet is where reading began; the others follow clockwise.
    let at = |step: usize| quad[(turn + step) % 4];
    Some(Tag { id, corners: [at(3), at(2), at(1), at(0)], wrong, contrast: white - black })
}

/// The code that differs least, counted from the first of `numbers`, and in how many cells.
fn nearest(code: u64, numbers: &Range<u32>) -> Option<(u32, u32)> {
    let dictionary = resolve_dictionary(TAG_FAMILY)?;
    let codes = dictionary.codes().get(numbers.start as usize..numbers.end as usize)?.iter().zip(0..);
    let (wrong, id) = codes.map(|(known, id)| ((known ^ code).count_ones(), id)).min()?;
    (wrong <= MOST_WRONG).then_some((id, wrong))
}

/// The mean over the middle of a cell.
fn brightness(grey: &Grey, map: &DMat3, [column, row]: [usize; 2], cells: usize) -> Option<f64> {
    const OFFSETS: [(f64, f64); 5] = [(0.5, 0.5), (0.3, 0.5), (0.7, 0.5), (0.5, 0.3), (0.5, 0.7)];
    let mut sum = 0.0;
    for (x, y) in OFFSETS {
        let place = *map * (DVec2::new(column as f64 + x, row as f64 + y) / cells as f64).extend(1.0);
        sum += grey.sample(place.truncate() / place.z)?;
    }
    Some(sum / OFFSETS.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tag of cells of 8 pixels, its upper left at (20, 20), turned by `turn` quarters clockwise.
    fn picture(id: u32, border: usize, turn: usize, flipped: &[usize]) -> (Grey, [DVec2; 4]) {
        let cells = BITS + 2 * border;
        let side = 8 * cells;
        let size = side + 40;
        let black = |mut row: usize, mut column: usize| {
            for _ in 0..turn {
                (row, column) = (cells - 1 - column, row);
            }
            let within = |at: usize| (border..border + BITS).contains(&at);
            if !within(row) || !within(column) {
                return true;
            }
            let (row, column) = (row - border, column - border);
            is_black(id, row, column).unwrap() ^ flipped.contains(&(row * BITS + column))
        };
        let pixel = |i: usize| {
            let (x, y) = ((i % size).wrapping_sub(20), (i / size).wrapping_sub(20));
            if x < side && y < side && black(y / 8, x / 8) { 40 } else { 190 }
        };
        let (low, high) = (20.0, 20.0 + side as f64);
        let quad = [(low, low), (high, low), (high, high), (low, high)].map(|(x, y)| DVec2::new(x, y));
        (Grey { width: size, height: size, pixels: (0..size * size).map(pixel).collect() }, quad)
    }

    #[test]
    fn tags_are_read_however_they_lie_and_however_wide_their_border_is() {
        for (id, border, turn) in [(0, 2, 0), (17, 2, 1), (35, 1, 2), (8, 1, 3)] {
            let (grey, quad) = picture(id, border, turn, &[3, 20]);
            let tag = read(&grey, quad, &(0..36)).unwrap();
            assert_eq!((tag.id, tag.wrong), (id, 2));
            assert_eq!(read(&grey, quad, &(id..36)).unwrap().id, 0, "counted from the grid's first tag");
            // A quarter clockwise takes what is above left to above right.
            assert_eq!(tag.corners[3], quad[turn]);
            assert_eq!(tag.corners[1], quad[(turn + 2) % 4]);
        }
    }

    #[test]
    fn tags_of_other_boards_and_damaged_ones_are_not_read() {
        let (grey, quad) = picture(100, 2, 0, &[]);
        assert_eq!(read(&grey, quad, &(0..36)), None);
        let (grey, quad) = picture(5, 2, 0, &[0, 7, 14, 21, 28]);
        assert_eq!(read(&grey, quad, &(0..36)), None);
        let white = Grey { width: 100, height: 100, pixels: vec![200; 10_000] };
        assert_eq!(read(&white, quad, &(0..36)), None);
    }
}
