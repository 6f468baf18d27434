//! Biases: offsets from the values that the unit was trimmed to at the factory.
//!
//! Source: OpenEB 5.1.1, `imx636_ll_biases.cpp`, `imx636_bias_settings.h` and `imx636_bias_settings_iterator.h`.

use std::ops::RangeInclusive;

use serde_json::{Value, json};

use super::{board::Board, config::BiasOffsets};
use crate::{event::EventError, not_applied::NotApplied};

/// Bits beside the value in a bias register: single transfer and reserved fields.
const WRITE: u32 = 0x11A1_0000;

/// Name, register, allowed offsets.
const BIASES: [(&str, u32, RangeInclusive<i32>); 6] = [
    ("fo", 0x1004, -150..=200),
    ("hpf", 0x100C, 0..=255),
    ("diff_on", 0x1010, -150..=200),
    ("diff", 0x1014, -150..=200),
    ("diff_off", 0x1018, -150..=200),
    ("refr", 0x1020, -50..=255),
];

impl BiasOffsets {
    fn values(&self) -> [i32; 6] {
        [self.fo, self.hpf, self.diff_on, self.diff, self.diff_off, self.refr]
    }

    /// Name, offset and allowed range of every bias.
    pub(super) fn entries(&self) -> impl Iterator<Item = (&'static str, i32, &'static RangeInclusive<i32>)> {
        const { &BIASES }.iter().zip(self.values()).map(|((name, _, allowed), value)| (*name, value, allowed))
    }
}

/// The values that the unit was trimmed to, in the order of [`BIASES`]. They are read once after the reset of the
/// opening sequence, before anything is written over them.
pub(super) fn read_trim(board: &Board) -> Result<[u8; 6], EventError> {
    let mut trim = [0; 6];
    for (value, (_, register, _)) in trim.iter_mut().zip(&BIASES) {
        *value = (board.read(*register)? & 0xFF) as u8;
    }
    Ok(trim)
}

/// The value for an offset: the DAC has 8 bits, so that it stops at 0 and 255.
fn value(trim: u8, offset: i32) -> u8 {
    (i32::from(trim) + offset).clamp(0, 255) as u8
}

/// Writes the biases that differ from the trim, or from the offsets that they were written with before, and tells what the
/// sensor has now.
pub(super) fn write(
    board: &Board,
    trim: &[u8; 6],
    [before, offsets]: [&BiasOffsets; 2],
    missed: &mut NotApplied,
) -> Result<Value, EventError> {
    let mut settings = serde_json::Map::new();
    let wanted = before.values().into_iter().zip(offsets.values());
    for (((name, register, _), &trim), (before, offset)) in BIASES.iter().zip(trim).zip(wanted) {
        if offset != before {
            board.write(*register, WRITE | u32::from(value(trim, offset)))?;
        }
        let now = board.read(*register)? & 0xFF;
        missed.compare(&format!("biases.{name}"), offset, now.cast_signed() - i32::from(trim));
        settings.insert((*name).into(), json!({ "trim": trim, "offset": offset, "value": now }));
    }
    Ok(settings.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stop_at_the_ends_of_the_dac() {
        assert_eq!(value(0x66, 0), 0x66);
        assert_eq!(value(0x66, -150), 0);
        assert_eq!(value(0x66, 200), 255);
        assert_eq!(value(0x4D, 23), 100);
    }
}
