//! Where events come from: the region of interest as row and column masks, and the mask of single pixels.
//!
//! Source: OpenEB 5.1.1, `psee_roi.cpp`, `gen41_roi_command.cpp`, `gen41_digital_event_mask.cpp` and
//! `imx636_registermap.h`. A pixel is silent if the bit of its column or of its row is set, or, in the mode that OpenEB
//! calls RONI, if both are. OpenEB counts rows from the top; the neuromorphic-drivers crate counts them from the bottom,
//! here and in the mask of pixels. We follow the maker unless [`MaskRows`] says otherwise.

use super::{
    HEIGHT, WIDTH,
    board::Board,
    config::{MaskRows, Region, RegionMode},
};
use crate::event::EventError;

const COLUMNS: u32 = 0x2000;
const ROWS: u32 = 0x4000;
const CONTROL: u32 = 0x0004;
const WINDOW_CONTROL: u32 = 0x0034;
const PIXELS: u32 = 0x9100;
/// Slots of the pixel mask.
pub(super) const SLOTS: usize = 64;

/// Bits of [`CONTROL`].
const ENABLE: u32 = 1 << 1;
const APPLY: u32 = 1 << 5;
const EITHER: u32 = 1 << 6;

/// Mask words of `length` rows or columns: a bit for each that `set` names.
fn mask(length: u16, set: impl Fn(u16) -> bool) -> Vec<u32> {
    (0..length.div_ceil(32))
        .map(|word| {
            // Bits past the last row stay set: OpenEB writes them so.
            (0..32).fold(0, |bits, bit| {
                let index = word * 32 + bit;
                bits | u32::from(index >= length || set(index)) << bit
            })
        })
        .collect()
}

fn within(index: u16, mut spans: impl Iterator<Item = (u16, u16)>) -> bool {
    spans.any(|(start, count)| index >= start && index - start < count)
}

/// The register's number of a row.
fn register_row(rows: MaskRows, y: u16) -> u16 {
    match rows {
        MaskRows::FromTop => y,
        MaskRows::FromBottom => HEIGHT - 1 - y,
    }
}

/// Masks of columns and rows for a region; no region is the whole image.
fn masks(region: Option<&Region>, rows: MaskRows) -> (Vec<u32>, Vec<u32>) {
    let Some(Region { mode, windows }) = region else {
        return (mask(WIDTH, |_| false), mask(HEIGHT, |_| false));
    };
    // Kept is what is inside of both, silenced what is inside of both.
    let set = |inside: bool| inside == (*mode == RegionMode::Silence);
    let columns = mask(WIDTH, |x| set(within(x, windows.iter().map(|window| (window.x, window.width)))));
    let rows = mask(HEIGHT, |index| {
        set(within(register_row(rows, index), windows.iter().map(|window| (window.y, window.height))))
    });
    (columns, rows)
}

/// Writes the region, or opens the whole image. The masks are in force from the opening sequence on (bit 1), whatever
/// they hold.
pub(super) fn write(board: &Board, region: Option<&Region>, rows: MaskRows) -> Result<(), EventError> {
    let (columns, rows) = masks(region, rows);
    board.write_table(COLUMNS, &columns)?;
    board.write_table(ROWS, &rows)?;
    let either = region.is_none_or(|region| region.mode == RegionMode::Keep);
    board.change(CONTROL, ENABLE | APPLY | EITHER, ENABLE | APPLY | if either { EITHER } else { 0 })?;
    board.change(WINDOW_CONTROL, 0b11, 0)
}

/// Writes the mask of single pixels; slots that are not needed are switched off.
pub(super) fn write_pixels(board: &Board, pixels: &[[u16; 2]], rows: MaskRows) -> Result<(), EventError> {
    let mut slots = [0; SLOTS];
    for (slot, &[x, y]) in slots.iter_mut().zip(pixels) {
        *slot = u32::from(x) | u32::from(register_row(rows, y)) << 16 | 1 << 31;
    }
    board.write_table(PIXELS, &slots)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Window;

    #[test]
    fn the_whole_image_has_no_bit_but_those_past_the_last_row() {
        let (columns, rows) = masks(None, MaskRows::FromTop);
        assert_eq!((columns.len(), columns.iter().all(|&word| word == 0)), (40, true));
        assert_eq!((rows.len(), rows[0], rows[21], rows[22]), (23, 0, 0, 0xFFFF_0000));
    }

    #[test]
    fn a_kept_window_sets_the_bits_outside_of_it_a_silenced_one_those_inside() {
        let windows = vec![Window { x: 33, y: 0, width: 31, height: 1 }];
        let region = Region { mode: RegionMode::Keep, windows };
        let (columns, rows) = masks(Some(&region), MaskRows::FromTop);
        assert_eq!((columns[0], columns[1], columns[2]), (u32::MAX, 1, u32::MAX));
        assert_eq!((rows[0], rows[1]), (!1, u32::MAX));
        let (_, rows) = masks(Some(&region), MaskRows::FromBottom);
        assert_eq!((rows[0], rows[22]), (u32::MAX, 0xFFFF_7FFF));
        let region = Region { mode: RegionMode::Silence, ..region };
        let (columns, rows) = masks(Some(&region), MaskRows::FromTop);
        assert_eq!((columns[0], columns[1], rows[0], rows[1]), (0, !1, 1, 0));
    }
}
