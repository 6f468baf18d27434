//! Rows of EVT 3 vectors, as sensors send them that see much at once: a base and three vectors for each 32 columns in which something
//! happened, and the row before them where it is another. They are decoded as far as they go, without a look at other words.

use super::super::{Sink, stage::Stage};

/// Columns that a base and three vectors speak of.
const COLUMNS: u16 = 32;
/// Bytes of a base and three vectors.
pub(super) const GROUP: usize = 8;

/// The content of a base, and the bits of the three vectors after it.
#[inline(always)]
pub(super) fn group(bytes: &[u8]) -> Option<(u16, u32)> {
    let words = u64::from_le_bytes(*bytes.first_chunk()?);
    if words & 0xF000_F000_F000_F000 != 0x5000_4000_4000_3000 {
        return None;
    }
    let bits = |from: u32, mask: u64| (words >> from & mask) as u32;
    Some((words as u16 & 0xFFF, bits(16, 0xFFF) | bits(32, 0xFFF) << 12 | bits(48, 0xFF) << 24))
}

/// Where and when the events of vectors happened.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    /// Columns of the sensor.
    pub width: u16,
    /// Rows of the sensor.
    pub height: u16,
    /// Microseconds.
    pub t_us: u64,
    /// The row of what comes.
    pub row: u16,
    /// The column after the last vector.
    pub base: u16,
    /// The polarity of the last vector.
    pub on: bool,
}

impl Rows {
    /// Decodes rows of vectors up to the first word that belongs to none, or whose events do not all lie on the sensor; says how many
    /// bytes they were.
    #[inline(always)]
    pub fn decode(&mut self, bytes: &[u8], stage: &mut Stage, sink: &mut impl Sink) -> usize {
        // Most words of a sparse stream are no vectors.
        let [_, first, ..] = bytes else { return 0 };
        match first >> 4 {
            0 | 3 => self.follow(bytes, stage, sink),
            _ => 0,
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[expect(
        unsafe_code,
        reason = "a function with target features is called from one without, which the language cannot check"
    )]
    fn follow(&mut self, bytes: &[u8], stage: &mut Stage, sink: &mut impl Sink) -> usize {
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt") {
            // SAFETY: the processor has just said that it has both.
            unsafe { self.follow_wide(bytes, stage, sink) }
        } else {
            self.follow_any(bytes, stage, sink)
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn follow(&mut self, bytes: &[u8], stage: &mut Stage, sink: &mut impl Sink) -> usize {
        self.follow_any(bytes, stage, sink)
    }

    /// [`Rows::follow_any`] for registers of 32 bytes.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,popcnt")]
    fn follow_wide(&mut self, bytes: &[u8], stage: &mut Stage, sink: &mut impl Sink) -> usize {
        self.follow_any(bytes, stage, sink)
    }

    #[inline(always)]
    fn follow_any(&mut self, bytes: &[u8], stage: &mut Stage, sink: &mut impl Sink) -> usize {
        let mut at = 0;
        loop {
            let rest = &bytes[at..];
            if let Some(group) = group(rest) {
                if !self.group(group, stage, sink) {
                    return at;
                }
                at += GROUP;
            } else if let [low, high @ 0..0x10, next @ ..] = rest
                && group(next).is_some()
            {
                self.row = u16::from_le_bytes([*low, *high]) & 0x7FF;
                at += 2;
            } else {
                return at;
            }
        }
    }

    /// Decodes a base and three vectors if all of their columns lie on the sensor; `false` if they are to be taken one by one.
    #[inline(always)]
    pub fn group(&mut self, (base, mask): (u16, u32), stage: &mut Stage, sink: &mut impl Sink) -> bool {
        let (first, on) = (base & 0x7FF, base & 0x800 != 0);
        if self.row >= self.height || first + COLUMNS > self.width {
            return false;
        }
        (self.base, self.on) = (first + COLUMNS, on);
        stage.push_columns(self.t_us, first, self.row, on, mask, sink);
        true
    }
}
