//! Arrays of one axis that are read piece by piece, as they may be larger than memory.

use std::io::{self, Read};

use super::{Descr, Header, NpyArray, NpyError, plain, split};

/// NumPy's headers are a hundred bytes long.
const LONGEST_HEADER: usize = 1 << 16;

/// Why a piece of an array cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum NpyReadError {
    /// What the array lies in cannot be read.
    #[error(transparent)]
    Read(#[from] io::Error),
    /// The array is cut short, malformed, or holds something else than is wanted.
    #[error(transparent)]
    Array(#[from] NpyError),
}

/// An array of integers on one axis, of which the next piece is read when it is asked for.
#[derive(Debug)]
pub struct NpyColumn<R> {
    reader: R,
    order: u8,
    kind: u8,
    size: usize,
    length: u64,
    taken: u64,
}

impl<R: Read> NpyColumn<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// If it is cut short or malformed, or tells of something else than numbers on one axis.
    pub fn begin(mut reader: R) -> Result<Self, NpyReadError> {
        let mut head = [0; 8];
        fill(&mut reader, &mut head)?;
        let mut head = head.to_vec();
        let mut length = [0; 4];
        let digits = if head[6] == 1 { 2 } else { 4 };
        fill(&mut reader, &mut length[..digits])?;
        head.extend_from_slice(&length[..digits]);
        let length = u32::from_le_bytes(length) as usize;
        if length > LONGEST_HEADER {
            return Err(NpyError::Header("it is longer than any that NumPy writes").into());
        }
        let start = head.len();
        head.resize(start + length, 0);
        fill(&mut reader, &mut head[start..])?;
        let (Header { descr, shape, .. }, _) = split(&head)?;
        let Descr::Plain(descr) = descr else {
            return Err(NpyError::Header("`descr` is no string: records are not supported here").into());
        };
        let (order, kind, size) = plain(&descr)?;
        let &[length] = &shape[..] else {
            return Err(NpyError::Header("its values lie on other than one axis").into());
        };
        if length.checked_mul(size as u64).is_none() {
            return Err(NpyError::Length { found: 0, needed: u64::MAX, shape }.into());
        }
        Ok(Self { reader, order, kind, size, length, taken: 0 })
    }

    /// How many values there are, by the header.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.length
    }

    /// The bytes of all values, by the header.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.length * self.size as u64
    }

    /// The next values, `most` of them or as many as are left, each checked to fit `T`; `wanted` names the range in the message.
    ///
    /// # Errors
    /// If there are fewer or more than the header says, they are no integers, or one does not fit.
    pub fn next<T: TryFrom<i128>>(&mut self, most: usize, wanted: &'static str) -> Result<Vec<T>, NpyReadError> {
        let count = (self.length - self.taken).min(most as u64);
        let (before, needed) = (self.taken * self.size as u64, count * self.size as u64);
        let mut bytes = Vec::new();
        let mut found = before + (&mut self.reader).take(needed).read_to_end(&mut bytes)? as u64;
        let whole = found == before + needed;
        self.taken += count;
        if whole && self.taken == self.length {
            // An archive compares its checksum only where it is asked for what follows the last byte.
            found += (&mut self.reader).take(1).read_to_end(&mut Vec::new())? as u64;
        }
        if found != before + needed {
            let shape = vec![self.length];
            return Err(NpyError::Length { found: found as usize, needed: self.bytes(), shape }.into());
        }
        if self.order == b'>' {
            bytes.chunks_exact_mut(self.size).for_each(<[u8]>::reverse);
        }
        let array = NpyArray { kind: self.kind, size: self.size, shape: vec![count as usize], bytes };
        let first = (self.taken - count) as usize;
        Ok(array.integers(wanted).map_err(|error| match error {
            NpyError::Range { value, index, wanted } => NpyError::Range { value, index: first + index, wanted },
            other => other,
        })?)
    }
}

/// Fills a part of the header.
fn fill(reader: &mut impl Read, part: &mut [u8]) -> Result<(), NpyReadError> {
    match reader.read_exact(part) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Err(NpyError::Truncated.into()),
        read => Ok(read?),
    }
}

#[cfg(test)]
mod tests {
    use super::{super::encode, *};

    fn all<T: TryFrom<i128>>(bytes: &[u8], most: usize) -> Result<Vec<T>, NpyReadError> {
        let mut column = NpyColumn::begin(bytes)?;
        let mut values = Vec::new();
        loop {
            let piece = column.next(most, "the range")?;
            values.extend(piece);
            if values.len() as u64 >= column.length() {
                return Ok(values);
            }
        }
    }

    #[test]
    fn pieces_of_any_length_are_the_array() {
        let values = [i64::MIN, -1, 0, 7, i64::MAX];
        let bytes = encode(&[5], values.into_iter());
        for most in 1..7 {
            assert_eq!(all::<i64>(&bytes, most).unwrap(), values, "{most}");
        }
        let text = b"{'descr': '>u2', 'fortran_order': False, 'shape': (2,), }\n";
        let big = [b"\x93NUMPY\x02\x00", &(text.len() as u32).to_le_bytes()[..], text, &[1, 2, 3, 4]].concat();
        assert_eq!(all::<u16>(&big, 1).unwrap(), [0x102, 0x304]);
        assert!(all::<u16>(&encode::<u16>(&[0], std::iter::empty()), 3).unwrap().is_empty());
    }

    #[test]
    fn every_cut_and_every_byte_too_many_is_an_error() {
        let mut bytes = encode(&[5], [1_u16, 2, 3, 4, 5].into_iter());
        for length in 0..bytes.len() {
            assert!(all::<u16>(&bytes[..length], 2).is_err(), "{length} of {}", bytes.len());
        }
        bytes.push(0);
        let error = all::<u16>(&bytes, 2).unwrap_err().to_string();
        assert_eq!(error, "holds 11 bytes of values, but its shape [5] needs 10; it is cut short or damaged");
    }

    #[test]
    fn a_value_that_does_not_fit_is_told_with_its_place_in_the_whole() {
        let error = all::<u16>(&encode(&[4], [1_i64, 2, 3, 70_000].into_iter()), 3).unwrap_err();
        let NpyReadError::Array(error) = error else { panic!("{error}") };
        assert_eq!(error, NpyError::Range { value: 70_000, index: 3, wanted: "the range" });
    }

    #[test]
    fn what_is_no_column_of_numbers_is_refused() {
        for shape in ["(2, 3)", "()", "(18446744073709551615,)", "(-1,)"] {
            let text = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
            let bytes =
                [b"\x93NUMPY\x01\x00", &(text.len() as u16).to_le_bytes()[..], text.as_bytes(), &[0; 64]].concat();
            assert!(NpyColumn::begin(&bytes[..]).is_err(), "{shape}");
        }
        let long = [&b"\x93NUMPY\x02\x00\xff\xff\xff\xff"[..], &[b' '; 64]].concat();
        assert!(NpyColumn::begin(&long[..]).is_err());
        assert!(matches!(
            all::<i64>(&encode(&[1], [0.5_f64].into_iter()), 1),
            Err(NpyReadError::Array(NpyError::Type { .. }))
        ));
    }
}
