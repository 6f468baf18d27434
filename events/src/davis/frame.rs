//! A frame that is being read out, column by column: first levels after the reset, then levels after the exposure.

use super::{super::sink::ApsFrame, DavisLayout};

/// A pixel whose reset level did not come.
const NO_LEVEL: u16 = u16::MAX;
/// Reset levels below this are those of a saturated pixel.
const SATURATED_RESET: u16 = 384;
/// Pixels have 10 bits.
const MAX_LEVEL: u16 = 1023;
/// Addresses have 12 bits: a sensor with longer sides is none.
const MAX_SIDE: u16 = 4096;

/// Which levels come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Levels {
    Reset,
    Signal,
}

/// A frame that is being read out.
#[derive(Clone, Debug)]
pub(super) struct Readout {
    start_us: u64,
    exposure_start_us: Option<u64>,
    exposure_end_us: Option<u64>,
    /// Levels as they come, column by column, up to the last that came: memory grows with the stream, and not with the size
    /// that a file claims.
    levels: Vec<u16>,
    /// Columns of each kind that began.
    columns: [u16; 2],
    /// The column under way and its next row.
    column: Option<(Levels, u16)>,
    /// Signal levels that came.
    complete: usize,
}

impl Readout {
    pub fn begin(start_us: u64) -> Self {
        Self {
            start_us,
            exposure_start_us: None,
            exposure_end_us: None,
            levels: Vec::new(),
            columns: [0; 2],
            column: None,
            complete: 0,
        }
    }

    pub fn expose(&mut self, begins: bool, t_us: u64) {
        let time = if begins { &mut self.exposure_start_us } else { &mut self.exposure_end_us };
        *time = Some(t_us);
    }

    pub fn begin_column(&mut self, levels: Levels) {
        self.columns[levels as usize] = self.columns[levels as usize].saturating_add(1);
        self.column = Some((levels, 0));
    }

    pub fn end_column(&mut self) {
        self.column = None;
    }

    /// Takes the next level; `false` if it has no place.
    pub fn level(&mut self, layout: &DavisLayout, level: u16) -> bool {
        let Some((levels, row)) = self.column else { return false };
        let column = self.columns[levels as usize] - 1;
        self.column = Some((levels, row.saturating_add(1)));
        let (width, height) = read_out(layout);
        if column >= width || row >= height {
            return false;
        }
        let at = usize::from(column) * usize::from(height) + usize::from(row);
        if at >= self.levels.len() {
            self.levels.resize(at + 1, NO_LEVEL);
        }
        let pixel = &mut self.levels[at];
        match levels {
            Levels::Reset => *pixel = level,
            Levels::Signal if *pixel == NO_LEVEL => return false,
            Levels::Signal => {
                *pixel = if *pixel < SATURATED_RESET || level == 0 {
                    MAX_LEVEL
                } else {
                    pixel.saturating_sub(level).min(MAX_LEVEL)
                };
                self.complete += 1;
            }
        }
        true
    }

    /// The frame, if all of its pixels came.
    pub fn end(self, layout: &DavisLayout) -> Option<ApsFrame> {
        let exposure_start_us = self.exposure_start_us.unwrap_or(self.start_us);
        let (width, height) = (layout.size.width, layout.size.height);
        let count = usize::from(width) * usize::from(height);
        (self.complete == count && self.levels.len() == count).then(|| ApsFrame {
            exposure_start_us,
            exposure_end_us: self.exposure_end_us.unwrap_or(exposure_start_us),
            width,
            height,
            channels: 1,
            pixels: (0..height)
                .flat_map(|y| (0..width).map(move |x| (x, y)))
                .map(|at| self.pixel(layout, at))
                .collect(),
            bits: 10,
        })
    }

    /// The level of a pixel of the image.
    fn pixel(&self, layout: &DavisLayout, (x, y): (u16, u16)) -> u16 {
        let (width, height) = read_out(layout);
        let (column, row) = if layout.frames_transposed { (y, x) } else { (x, y) };
        let column = if layout.frames_flip_x { width - 1 - column } else { column };
        let row = if layout.frames_flip_y { height - 1 - row } else { row };
        self.levels[usize::from(column) * usize::from(height) + usize::from(row)]
    }
}

/// Columns and rows as they are read out, as far as a sensor can have them.
fn read_out(layout: &DavisLayout) -> (u16, u16) {
    let (width, height) = (layout.size.width.min(MAX_SIDE), layout.size.height.min(MAX_SIDE));
    if layout.frames_transposed { (height, width) } else { (width, height) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorSize;

    #[test]
    fn a_frame_takes_the_memory_of_what_came_and_not_of_what_is_claimed() {
        let layout = DavisLayout { size: SensorSize { width: u16::MAX, height: u16::MAX }, ..DavisLayout::default() };
        let mut frame = Readout::begin(7);
        assert_eq!(frame.levels.capacity(), 0);
        for column in 1..5000 {
            frame.begin_column(Levels::Reset);
            assert_eq!(frame.level(&layout, 500), column <= usize::from(MAX_SIDE));
            assert!(frame.levels.len() <= usize::from(MAX_SIDE) * column.min(MAX_SIDE.into()));
        }
        assert!(frame.end(&layout).is_none());
    }
}
