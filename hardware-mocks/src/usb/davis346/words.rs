//! The 16-bit words of the DAVIS: bit 15 set is a time stamp; otherwise bits 12 to 14 are a code and the rest its data.

/// Special words (code 0).
pub mod special {
    /// The time starts again from zero.
    pub const TIMESTAMP_RESET: u16 = 1;
    /// The external input fell.
    pub const INPUT_FALLING: u16 = 2;
    /// The external input rose.
    pub const INPUT_RISING: u16 = 3;
    /// An inertial sample begins.
    pub const IMU_START: u16 = 5;
    /// An inertial sample is complete.
    pub const IMU_END: u16 = 7;
    /// A frame of the global shutter begins; one more: of the rolling shutter.
    pub const FRAME_START: u16 = 8;
    /// A frame is complete.
    pub const FRAME_END: u16 = 10;
    /// A column of reset levels begins; one more: of signal levels.
    pub const COLUMN_START: u16 = 11;
    /// A column is complete.
    pub const COLUMN_END: u16 = 13;
    /// The exposure begins; one more: ends.
    pub const EXPOSURE_START: u16 = 14;
}

/// Row of the events that follow.
pub const ROW: u16 = 1 << 12;
/// Column of an OFF event; one code more: of an ON event.
pub const COLUMN: u16 = 2 << 12;
/// A level of a frame's pixel.
pub const LEVEL: u16 = 4 << 12;
/// A byte of an inertial sample.
pub const IMU_BYTE: u16 = 5 << 12;
/// What an inertial sample holds, and its scales.
pub const IMU_TYPE: u16 = 5 << 12 | 3 << 8;
/// The 15-bit time has rolled over this many times.
pub const WRAP: u16 = 7 << 12;
/// The low 15 bits of the time.
pub const TIME: u16 = 1 << 15;

/// Words that belong to one time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Chunk {
    pub t_us: u64,
    pub words: Vec<u16>,
}

/// Writes chunks with the time stamps and wraps that they need.
#[derive(Clone, Debug, Default)]
pub(super) struct Writer {
    wraps: u64,
    last: Option<u64>,
}

impl Writer {
    /// The time starts again from zero.
    pub(super) fn reset(&mut self, out: &mut Vec<u8>) {
        *self = Self::default();
        out.extend(special::TIMESTAMP_RESET.to_le_bytes());
    }

    /// Appends the words of a chunk.
    pub(super) fn write(&mut self, chunk: &Chunk, out: &mut Vec<u8>) {
        self.wrap(chunk.t_us, out);
        if self.last != Some(chunk.t_us) {
            out.extend((TIME | (chunk.t_us & 0x7fff) as u16).to_le_bytes());
            self.last = Some(chunk.t_us);
        }
        out.extend(chunk.words.iter().flat_map(|word| word.to_le_bytes()));
    }

    /// Tells how often the 15-bit time has rolled over up to `t_us`.
    pub(super) fn wrap(&mut self, t_us: u64, out: &mut Vec<u8>) {
        while self.wraps < t_us >> 15 {
            let count = ((t_us >> 15) - self.wraps).min(0xfff);
            out.extend((WRAP | count as u16).to_le_bytes());
            self.wraps += count;
            self.last = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_told_when_it_changes_and_wraps_are_counted() {
        let mut writer = Writer::default();
        let mut out = Vec::new();
        writer.write(&Chunk { t_us: 5, words: vec![0x1001] }, &mut out);
        writer.write(&Chunk { t_us: 5, words: vec![0x1002] }, &mut out);
        writer.write(&Chunk { t_us: 3 * 0x8000 + 5, words: vec![0x1003] }, &mut out);
        let words: Vec<u16> = out.chunks(2).map(|word| u16::from_le_bytes([word[0], word[1]])).collect();
        assert_eq!(words, [0x8005, 0x1001, 0x1002, 0x7003, 0x8005, 0x1003]);
    }
}
