//! How the numbers of a section are written: as they are, as halves, as whole numbers, or as codes of eight or sixteen bits in blocks of rows with
//! a range for each column.

use half::f16;
use serde::{Deserialize, Serialize};

/// How a section is written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Coding {
    /// f32.
    Exact,
    /// f16.
    Half,
    /// u16, of whole numbers.
    Whole,
    /// Codes in blocks of so many rows. First, for each block and column, the least value and the step (f32); then, column by
    /// column, the codes of all rows: the upper bytes of a column of two, then the lower ones.
    Blocks {
        /// Rows of a block; the last one may be shorter.
        rows: usize,
        /// Bytes of a code, for each column: 0 (the value is the least one), 1 or 2.
        columns: Vec<u8>,
    },
}

/// What a section takes that the file does not hold, or does not agree with.
pub(super) type Wrong = String;

impl Coding {
    /// Codes in blocks of the usual length.
    pub(super) fn blocks(columns: &[u8]) -> Self {
        Self::Blocks { rows: 256, columns: columns.to_vec() }
    }

    /// Bytes of a section of `floats` numbers.
    pub(super) fn size(&self, floats: usize) -> Result<usize, Wrong> {
        let too_many = || "a section is too long".to_owned();
        match self {
            Self::Exact => floats.checked_mul(4).ok_or_else(too_many),
            Self::Half | Self::Whole => floats.checked_mul(2).ok_or_else(too_many),
            Self::Blocks { rows, columns } => {
                if *rows == 0 || columns.is_empty() || columns.iter().any(|&bytes| bytes > 2) {
                    return Err("a section has blocks without rows or columns".into());
                }
                if !floats.is_multiple_of(columns.len()) {
                    return Err("a section has no whole number of rows".into());
                }
                let count = floats / columns.len();
                let ranges = count.div_ceil(*rows).checked_mul(8 * columns.len());
                let row: usize = columns.iter().map(|&bytes| usize::from(bytes)).sum();
                ranges.and_then(|ranges| count.checked_mul(row)?.checked_add(ranges)).ok_or_else(too_many)
            }
        }
    }

    /// The bytes of a section; finite numbers, in whole rows.
    pub(super) fn write(&self, values: &[f32]) -> Vec<u8> {
        match self {
            Self::Exact => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Half => values.iter().flat_map(|value| f16::from_f32(*value).to_le_bytes()).collect(),
            Self::Whole => values.iter().flat_map(|value| (*value as u16).to_le_bytes()).collect(),
            Self::Blocks { rows, columns } => write_blocks(values, *rows, columns),
        }
    }

    /// The `floats` numbers of a section of [`Self::size`] bytes.
    pub(super) fn read(&self, bytes: &[u8], floats: usize) -> Vec<f32> {
        match self {
            Self::Exact => bytes.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect(),
            Self::Half => bytes.as_chunks::<2>().0.iter().map(|two| f16::from_le_bytes(*two).to_f32()).collect(),
            Self::Whole => bytes.as_chunks::<2>().0.iter().map(|two| u16::from_le_bytes(*two).into()).collect(),
            Self::Blocks { rows, columns } => read_blocks(bytes, floats / columns.len(), *rows, columns),
        }
    }
}

fn most(bytes: u8) -> u16 {
    if bytes == 2 { u16::MAX } else { u16::from(u8::MAX) }
}

/// Larger numbers are written as this one: a range of twice it is still a number.
const LARGEST: f32 = 1e37;

fn write_blocks(values: &[f32], rows: usize, columns: &[u8]) -> Vec<u8> {
    let values: Vec<f32> = values.iter().map(|value| value.clamp(-LARGEST, LARGEST)).collect();
    let width = columns.len();
    let count = values.len() / width;
    let mut written = Vec::new();
    let mut ranges = Vec::new();
    for block in values.chunks(rows * width) {
        for (column, &bytes) in columns.iter().enumerate() {
            let of = || block.iter().skip(column).step_by(width);
            let low = of().copied().fold(f32::INFINITY, f32::min);
            let high = of().copied().fold(f32::NEG_INFINITY, f32::max);
            // A column of no bytes has one value: the middle.
            let (low, step) =
                if bytes == 0 { ((low + high) / 2.0, 0.0) } else { (low, (high - low) / f32::from(most(bytes))) };
            ranges.push((low, step));
            written.extend(low.to_le_bytes());
            written.extend(step.to_le_bytes());
        }
    }
    for (column, &bytes) in columns.iter().enumerate().filter(|(_, bytes)| **bytes > 0) {
        let codes = (0..count).map(|row| {
            let (low, step) = ranges[row / rows * width + column];
            let value = values[row * width + column];
            if step > 0.0 { ((value - low) / step).round().clamp(0.0, f32::from(most(bytes))) as u16 } else { 0 }
        });
        let codes: Vec<u16> = codes.collect();
        if bytes == 2 {
            written.extend(codes.iter().map(|code| (code >> 8) as u8));
        }
        written.extend(codes.iter().map(|code| (code & 0xff) as u8));
    }
    written
}

fn read_blocks(bytes: &[u8], count: usize, rows: usize, columns: &[u8]) -> Vec<f32> {
    let width = columns.len();
    let (ranges, codes) = bytes.split_at(count.div_ceil(rows) * 8 * width);
    let ranges: Vec<f32> = ranges.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four)).collect();
    let mut values = vec![0.0; count * width];
    let mut at = 0;
    for (column, &bytes) in columns.iter().enumerate() {
        for row in 0..count {
            let range = 2 * (row / rows * width + column);
            let code = match bytes {
                0 => 0,
                1 => u16::from(codes[at + row]),
                _ => u16::from(codes[at + row]) << 8 | u16::from(codes[at + count + row]),
            };
            values[row * width + column] = ranges[range] + ranges[range + 1] * f32::from(code);
        }
        at += usize::from(bytes) * count;
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn there_and_back(coding: &Coding, values: &[f32]) -> Vec<f32> {
        let bytes = coding.write(values);
        assert_eq!(bytes.len(), coding.size(values.len()).unwrap());
        coding.read(&bytes, values.len())
    }

    #[test]
    fn codes_are_off_by_half_a_step_of_their_block_at_most() {
        let columns = [2, 1, 0];
        // 10 rows in blocks of 4: the last block has two.
        let values: Vec<f32> = (0..30).map(|i| (i as f32 * 0.37).sin() * 10f32.powi(i / 12) + 5.0).collect();
        let read = there_and_back(&Coding::Blocks { rows: 4, columns: columns.to_vec() }, &values);
        for block in 0..3 {
            for (column, bytes) in columns.iter().enumerate() {
                let rows: Vec<usize> = (4 * block..10.min(4 * block + 4)).map(|row| 3 * row + column).collect();
                let range = |f: fn(f32, f32) -> f32, from| rows.iter().map(|&at| values[at]).fold(from, f);
                let span = range(f32::max, f32::MIN) - range(f32::min, f32::MAX);
                let steps = [1.0, 255.0, 65535.0][usize::from(*bytes)];
                for &at in &rows {
                    let off = (read[at] - values[at]).abs();
                    assert!(off <= span / steps * 0.5001 + 1e-6, "{at}: {off} of {span}");
                }
            }
        }
    }

    #[test]
    fn ends_equal_values_and_the_largest_numbers_survive() {
        let coding = Coding::blocks(&[1, 2]);
        let values = [f32::MAX, 3.0, -f32::MAX, 3.0, 0.0, 3.0];
        let read = there_and_back(&coding, &values);
        assert!(read.iter().all(|value| value.is_finite()));
        assert_eq!([read[1], read[3], read[5]], [3.0; 3]);
        assert!(read[0] > 0.99 * LARGEST && read[2] == -LARGEST);
        assert!(there_and_back(&coding, &[]).is_empty());
        assert_eq!(there_and_back(&Coding::Exact, &values), values);
        assert_eq!(there_and_back(&Coding::Half, &[0.5, -2.0]), [0.5, -2.0]);
        assert_eq!(there_and_back(&Coding::Whole, &[0.0, 4097.0, 65535.0]), [0.0, 4097.0, 65535.0]);
    }

    #[test]
    fn sections_that_cannot_be_are_refused() {
        let blocks = |rows, columns: &[u8]| Coding::Blocks { rows, columns: columns.to_vec() };
        for coding in [blocks(0, &[1]), blocks(1, &[]), blocks(1, &[3]), blocks(1, &[1, 1]), Coding::Exact] {
            let floats = if coding == Coding::Exact { usize::MAX } else { 3 };
            assert!(coding.size(floats).is_err(), "{coding:?}");
        }
        assert!(blocks(1, &[2; 9]).size(usize::MAX / 9 * 9).is_err());
    }
}
