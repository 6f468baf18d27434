//! A frame that is being read out, column by column: first levels after the reset, then levels after the exposure.

use super::{super::sink::ApsFrame, DavisLayout};

/// A pixel whose reset level did not come.
const NO_LEVEL: u16 = u16::MAX;
/// Reset levels below this are those of a saturated pixel.
const SATURATED_RESET: u16 = 384;
/// Pixels have 10 bits.
const MAX_LEVEL: u16 = 1023;

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
    pixels: Vec<u16>,
    /// Columns of each kind that began.
    columns: [u16; 2],
    /// The column under way and its next row.
    column: Option<(Levels, u16)>,
    /// Signal levels that came.
    complete: usize,
}

impl Readout {
    pub fn begin(layout: &DavisLayout, start_us: u64) -> Self {
        let pixels = usize::from(layout.size.width) * usize::from(layout.size.height);
        Self {
            start_us,
            exposure_start_us: None,
            exposure_end_us: None,
            pixels: vec![NO_LEVEL; pixels],
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
        let (mut width, mut height) = (layout.size.width, layout.size.height);
        if layout.frames_transposed {
            (width, height) = (height, width);
        }
        if column >= width || row >= height {
            return false;
        }
        let x = if layout.frames_flip_x { width - 1 - column } else { column };
        let y = if layout.frames_flip_y { height - 1 - row } else { row };
        let (x, y) = if layout.frames_transposed { (y, x) } else { (x, y) };
        let pixel = &mut self.pixels[usize::from(y) * usize::from(layout.size.width) + usize::from(x)];
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
        (self.complete == self.pixels.len()).then(|| ApsFrame {
            exposure_start_us,
            exposure_end_us: self.exposure_end_us.unwrap_or(exposure_start_us),
            width: layout.size.width,
            height: layout.size.height,
            channels: 1,
            pixels: self.pixels,
            bits: 10,
        })
    }
}
