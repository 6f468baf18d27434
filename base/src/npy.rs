//! NumPy's `.npy` arrays (versions 1 to 3), also inside `.npz` archives.
//!
//! ```text
//! bytes 0..6   0x93 "NUMPY"
//! bytes 6..8   major and minor version
//! then         header length, little-endian: u16 (version 1), u32 (versions 2 and 3)
//! then         header: a Python literal {'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }, newline
//! then         the values
//! ```
//! Numbers are read (`b`, `i`, `u`, `f` of 1 to 8 bytes, both byte orders), and records of them ([`decode_records`]); pickled
//! objects are refused.
//! The length of the data is compared with the shape before anything is allocated for it. [`NpyColumn`] reads piece by piece what is
//! larger than memory.

mod column;

pub use column::{NpyColumn, NpyReadError};

/// What is wrong with an array.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NpyError {
    /// It does not begin as an `.npy` array does.
    #[error("is no .npy array")]
    Magic,
    /// It ends inside the header.
    #[error("is cut short in its header")]
    Truncated,
    /// The header cannot be understood.
    #[error("has a header that cannot be understood: {0}")]
    Header(&'static str),
    /// The element type is not supported.
    #[error("has the element type `{found}`, but {wanted} is needed")]
    Type {
        /// NumPy's name of the type.
        found: String,
        /// What would do.
        wanted: &'static str,
    },
    /// The values are fewer or more than the shape says.
    #[error("holds {found} bytes of values, but its shape {shape:?} needs {needed}; it is cut short or damaged")]
    Length {
        /// Bytes present.
        found: usize,
        /// Bytes needed (`u64::MAX` where that overflows).
        needed: u64,
        /// Its header's length of each axis.
        shape: Vec<u64>,
    },
    /// A value does not fit the type that is wanted.
    #[error("holds the value {value} at index {index}, outside {wanted}")]
    Range {
        /// The first value that does not fit.
        value: i128,
        /// Its position.
        index: usize,
        /// The range that is wanted.
        wanted: &'static str,
    },
}

/// An array: values in C order (the last axis fastest), little-endian.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NpyArray {
    /// `b`, `i`, `u` or `f`.
    kind: u8,
    /// Bytes per value: 1, 2, 4 or 8.
    size: usize,
    /// Length of each axis.
    pub shape: Vec<usize>,
    bytes: Vec<u8>,
}

/// A number type that arrays are written from.
pub trait Element: Copy {
    /// NumPy's name of the type.
    const DESCR: &str;
    /// Appends the value's bytes, little-endian.
    fn append(self, bytes: &mut Vec<u8>);
}

macro_rules! element {
    ($($type:ty: $descr:literal),*) => {$(
        impl Element for $type {
            const DESCR: &str = $descr;
            fn append(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}
element!(u8: "|u1", u16: "<u2", u32: "<u4", i64: "<i8", f32: "<f4", f64: "<f8");

/// The bytes of an `.npy` file (version 1) with `values` in C order. The product of `shape` is the number of values.
#[must_use]
pub fn encode<T: Element>(shape: &[usize], values: impl ExactSizeIterator<Item = T>) -> Vec<u8> {
    let axes: String = shape.iter().map(|length| format!("{length}, ")).collect();
    let axes = if shape.len() == 1 { axes.trim_end() } else { axes.trim_end_matches(", ") };
    let header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({axes}), }}", T::DESCR);
    // The values begin at a multiple of 64 bytes.
    let padding = 63 - (10 + header.len()) % 64;
    let mut bytes = Vec::with_capacity(10 + header.len() + padding + 1 + values.len() * size_of::<T>());
    bytes.extend_from_slice(b"\x93NUMPY\x01\x00");
    bytes.extend_from_slice(&((header.len() + padding + 1) as u16).to_le_bytes());
    bytes.extend_from_slice(header.as_bytes());
    bytes.resize(bytes.len() + padding, b' ');
    bytes.push(b'\n');
    values.for_each(|value| value.append(&mut bytes));
    bytes
}

impl NpyArray {
    /// Decodes the bytes of an `.npy` file.
    ///
    /// # Errors
    /// If they are cut short, malformed, or hold something else than numbers.
    pub fn decode(bytes: &[u8]) -> Result<Self, NpyError> {
        let (Header { descr, fortran, shape }, values) = split(bytes)?;
        let Descr::Plain(descr) = descr else {
            return Err(NpyError::Header("`descr` is no string: records are not supported here"));
        };
        let (order, kind, size) = plain(&descr)?;
        let needed = shape.iter().try_fold(size as u64, |total, &length| total.checked_mul(length));
        if needed != Some(values.len() as u64) {
            return Err(NpyError::Length { found: values.len(), needed: needed.unwrap_or(u64::MAX), shape });
        }
        // Now every length is at most that of the data, unless the array is empty.
        let shape: Vec<usize> = shape.iter().map(|&length| length.try_into().unwrap_or(usize::MAX)).collect();
        let mut bytes = if fortran && shape.len() > 1 { to_c_order(values, &shape, size) } else { values.to_vec() };
        if order == b'>' {
            bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        Ok(Self { kind, size, shape, bytes })
    }

    /// How many values there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bytes.len() / self.size
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// NumPy's name of the element type, in little-endian.
    #[must_use]
    pub fn descr(&self) -> String {
        format!("{}{}{}", if self.size == 1 { '|' } else { '<' }, self.kind as char, self.size)
    }

    /// All values of an array of integers or booleans, each checked to fit `T`.
    ///
    /// # Errors
    /// If the array holds floats, or a value does not fit; `wanted` names the range in the message.
    pub fn integers<T: TryFrom<i128>>(&self, wanted: &'static str) -> Result<Vec<T>, NpyError> {
        fn widen<T: TryFrom<i128>, const S: usize>(
            bytes: &[u8],
            wanted: &'static str,
            value: impl Fn([u8; S]) -> i128,
        ) -> Result<Vec<T>, NpyError> {
            let convert = |(index, bytes): (usize, &[u8; S])| {
                let value = value(*bytes);
                T::try_from(value).map_err(|_| NpyError::Range { value, index, wanted })
            };
            bytes.as_chunks::<S>().0.iter().enumerate().map(convert).collect()
        }
        let bytes = &self.bytes;
        match (self.kind, self.size) {
            (b'b' | b'u', 1) => widen(bytes, wanted, |b: [u8; 1]| b[0].into()),
            (b'u', 2) => widen(bytes, wanted, |b| u16::from_le_bytes(b).into()),
            (b'u', 4) => widen(bytes, wanted, |b| u32::from_le_bytes(b).into()),
            (b'u', 8) => widen(bytes, wanted, |b| u64::from_le_bytes(b).into()),
            (b'i', 1) => widen(bytes, wanted, |b| i8::from_le_bytes(b).into()),
            (b'i', 2) => widen(bytes, wanted, |b| i16::from_le_bytes(b).into()),
            (b'i', 4) => widen(bytes, wanted, |b| i32::from_le_bytes(b).into()),
            (b'i', 8) => widen(bytes, wanted, |b| i64::from_le_bytes(b).into()),
            _ => Err(NpyError::Type { found: self.descr(), wanted: "an integer type" }),
        }
    }

    /// As [`NpyArray::integers`], also of floats that are whole numbers.
    ///
    /// # Errors
    /// If a value is not whole or does not fit; `wanted` names the range in the message.
    pub fn whole<T: TryFrom<i128>>(&self, wanted: &'static str) -> Result<Vec<T>, NpyError> {
        let Ok(values) = self.floats() else { return self.integers(wanted) };
        let convert = |(index, value): (usize, f64)| {
            let whole = (value.fract() == 0.0).then_some(value as i128).and_then(|value| T::try_from(value).ok());
            whole.ok_or(NpyError::Range { value: value as i128, index, wanted })
        };
        values.into_iter().enumerate().map(convert).collect()
    }

    /// All values of an array of floats.
    ///
    /// # Errors
    /// If the array holds something else.
    pub fn floats(&self) -> Result<Vec<f64>, NpyError> {
        match (self.kind, self.size) {
            (b'f', 8) => Ok(self.bytes.as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect()),
            (b'f', 4) => Ok(self.bytes.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b).into()).collect()),
            _ => Err(NpyError::Type { found: self.descr(), wanted: "a float type" }),
        }
    }

    /// All values of an array of type u8, without a copy.
    ///
    /// # Errors
    /// If the array holds something else.
    pub fn into_bytes(self) -> Result<Vec<u8>, NpyError> {
        match (self.kind, self.size) {
            (b'u', 1) => Ok(self.bytes),
            _ => Err(NpyError::Type { found: self.descr(), wanted: "`|u1`" }),
        }
    }
}

/// The columns of an `.npy` file of records on one axis, each with its names (a field may have a title besides).
///
/// # Errors
/// If the file is cut short or malformed, or holds something else than records of numbers.
pub fn decode_records(bytes: &[u8]) -> Result<Vec<(Vec<String>, NpyArray)>, NpyError> {
    let (Header { descr, shape, .. }, values) = split(bytes)?;
    let Descr::Records(fields) = descr else {
        return Err(NpyError::Header("it holds one number each, and no records"));
    };
    let &[length] = &shape[..] else { return Err(NpyError::Header("its records lie on other than one axis")) };
    let mut columns = Vec::new();
    let mut stride = 0_usize;
    for (names, descr) in fields {
        // Room between fields that lie at multiples of their size.
        let room = descr.strip_prefix("|V").and_then(|room| room.parse::<usize>().ok());
        let size = match room {
            Some(room) => room,
            None => {
                let (order, kind, size) = plain(&descr)?;
                columns.push((names, order, kind, size, stride));
                size
            }
        };
        stride = stride.checked_add(size).ok_or(NpyError::Header("its records are too long"))?;
    }
    let needed = length.checked_mul(stride as u64);
    if stride == 0 || needed != Some(values.len() as u64) {
        return Err(NpyError::Length { found: values.len(), needed: needed.unwrap_or(u64::MAX), shape });
    }
    let column = |(names, order, kind, size, at): (Vec<String>, u8, u8, usize, usize)| {
        let mut bytes = Vec::with_capacity(values.len() / stride * size);
        for record in values.chunks_exact(stride) {
            bytes.extend_from_slice(record.get(at..at + size).unwrap_or_default());
        }
        if order == b'>' {
            bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        (names, NpyArray { kind, size, shape: vec![values.len() / stride], bytes })
    };
    Ok(columns.into_iter().map(column).collect())
}

/// The header of an `.npy` file, and its values.
fn split(bytes: &[u8]) -> Result<(Header, &[u8]), NpyError> {
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or(NpyError::Magic)?;
    let (&[major, _minor], rest) = rest.split_first_chunk().ok_or(NpyError::Truncated)?;
    let (length, rest) = match major {
        1 => rest.split_first_chunk().map(|(b, rest)| (u16::from_le_bytes(*b) as usize, rest)),
        2 | 3 => rest.split_first_chunk().map(|(b, rest)| (u32::from_le_bytes(*b) as usize, rest)),
        _ => return Err(NpyError::Header("unknown version")),
    }
    .ok_or(NpyError::Truncated)?;
    let (header, values) = rest.split_at_checked(length).ok_or(NpyError::Truncated)?;
    let header = std::str::from_utf8(header).map_err(|_| NpyError::Header("not text"))?;
    Ok((Header::parse(header).map_err(NpyError::Header)?, values))
}

/// Byte order, kind and size of a number's type.
fn plain(descr: &str) -> Result<(u8, u8, usize), NpyError> {
    let unsupported = || NpyError::Type { found: descr.to_owned(), wanted: "a plain number type" };
    let &[order, kind, digit] = descr.as_bytes() else { return Err(unsupported()) };
    let size = usize::from(digit.wrapping_sub(b'0'));
    let known = matches!((kind, size), (b'b', 1) | (b'i' | b'u', 1 | 2 | 4 | 8) | (b'f', 4 | 8));
    let known = known && matches!(order, b'<' | b'>' | b'|');
    known.then_some((order, kind, size)).ok_or_else(unsupported)
}

/// Values in Fortran order (the first axis fastest) brought into C order.
fn to_c_order(values: &[u8], shape: &[usize], size: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(values.len());
    let mut index = vec![0; shape.len()];
    for _ in 0..values.len() / size {
        let at = index.iter().zip(shape).rev().fold(0, |at, (i, length)| at * length + i) * size;
        out.extend_from_slice(values.get(at..at + size).unwrap_or_default());
        for (i, length) in index.iter_mut().zip(shape).rev() {
            *i += 1;
            if *i < *length {
                break;
            }
            *i = 0;
        }
    }
    out
}

/// The names of a field of records, and its type.
type Field = (Vec<String>, String);

/// What an array's values are.
enum Descr {
    Plain(String),
    Records(Vec<Field>),
}

struct Header {
    descr: Descr,
    fortran: bool,
    shape: Vec<u64>,
}

impl Header {
    /// Parses the one kind of Python literal that NumPy writes here.
    fn parse(text: &str) -> Result<Self, &'static str> {
        let (mut descr, mut fortran, mut shape) = (None, None, None);
        let mut rest = text.trim().strip_prefix('{').and_then(|t| t.strip_suffix('}')).ok_or("no dictionary")?.trim();
        while !rest.is_empty() {
            let (key, after) = quoted(rest).ok_or("no quoted key")?;
            rest = after.trim_start().strip_prefix(':').ok_or("no colon after a key")?.trim_start();
            rest = match key {
                "descr" => {
                    if let Some(list) = rest.strip_prefix('[') {
                        let (fields, after) = records(list).ok_or("`descr` is no list of fields")?;
                        descr = Some(Descr::Records(fields));
                        after
                    } else {
                        let (value, after) = quoted(rest).ok_or("`descr` is neither a string nor a list")?;
                        descr = Some(Descr::Plain(value.to_owned()));
                        after
                    }
                }
                "fortran_order" => {
                    let (value, after) = match (rest.strip_prefix("False"), rest.strip_prefix("True")) {
                        (Some(after), _) => (false, after),
                        (_, Some(after)) => (true, after),
                        _ => return Err("`fortran_order` is neither True nor False"),
                    };
                    fortran = Some(value);
                    after
                }
                "shape" => {
                    let inner = rest.strip_prefix('(').ok_or("`shape` is no tuple")?;
                    let (inner, after) = inner.split_once(')').ok_or("`shape` is no tuple")?;
                    let axes = inner.split(',').map(str::trim).filter(|axis| !axis.is_empty());
                    let axes: Result<_, _> = axes.map(str::parse).collect();
                    shape = Some(axes.map_err(|_| "`shape` holds something else than lengths")?);
                    after
                }
                _ => return Err("unknown key"),
            };
            rest = rest.trim_start();
            rest = rest.strip_prefix(',').map_or(rest, str::trim_start);
        }
        match (descr, fortran, shape) {
            (Some(descr), Some(fortran), Some(shape)) => Ok(Self { descr, fortran, shape }),
            _ => Err("`descr`, `fortran_order` or `shape` is missing"),
        }
    }
}

/// The fields of records, `('t', '<i8'), (('title', 'x'), '<u2'), ]`, and what follows the bracket.
fn records(mut text: &str) -> Option<(Vec<Field>, &str)> {
    let skip = |text: &'_ str| -> usize { text.len() - text.trim_start_matches([' ', ',']).len() };
    let mut fields = Vec::new();
    loop {
        text = &text[skip(text)..];
        if let Some(after) = text.strip_prefix(']') {
            return Some((fields, after));
        }
        text = text.strip_prefix('(')?.trim_start();
        let mut names = Vec::new();
        if let Some(titled) = text.strip_prefix('(') {
            let (title, after) = quoted(titled.trim_start())?;
            let (name, after) = quoted(after.trim_start().strip_prefix(',')?.trim_start())?;
            names.extend([title.to_owned(), name.to_owned()]);
            text = after.trim_start().strip_prefix(')')?;
        } else {
            let (name, after) = quoted(text)?;
            names.push(name.to_owned());
            text = after;
        }
        let (descr, after) = quoted(text.trim_start().strip_prefix(',')?.trim_start())?;
        fields.push((names, descr.to_owned()));
        text = after.trim_start().strip_prefix(')')?;
    }
}

/// A string literal at the beginning of `text` and what follows it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    match text.strip_prefix('\'') {
        Some(rest) => rest.split_once('\''),
        None => text.strip_prefix('"')?.split_once('"'),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_header(header: &str, values: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
        bytes.extend_from_slice(header.as_bytes());
        bytes.extend_from_slice(values);
        bytes
    }

    #[test]
    fn arrays_come_back_as_they_were() {
        let bytes = encode(&[2, 3], [1.5_f64, -2.0, 0.0, f64::MAX, 1e-300, 7.0].into_iter());
        assert_eq!((bytes.len() - 48) % 64, 0, "values are aligned to 64 bytes");
        let array = NpyArray::decode(&bytes).unwrap();
        assert_eq!((array.shape.as_slice(), array.len()), (&[2, 3][..], 6));
        assert_eq!(array.floats().unwrap(), [1.5, -2.0, 0.0, f64::MAX, 1e-300, 7.0]);

        let array = NpyArray::decode(&encode(&[3], [i64::MIN, 0, i64::MAX].into_iter())).unwrap();
        assert_eq!(array.integers::<i64>("i64").unwrap(), [i64::MIN, 0, i64::MAX]);
        let scalar = NpyArray::decode(&encode(&[], [346_u32].into_iter())).unwrap();
        assert_eq!((scalar.shape.len(), scalar.integers::<u32>("u32").unwrap()), (0, vec![346]));
        let empty = NpyArray::decode(&encode::<u16>(&[0], std::iter::empty())).unwrap();
        assert!(empty.is_empty() && empty.integers::<u16>("u16").unwrap().is_empty());
    }

    #[test]
    fn numpys_own_spelling_is_understood() {
        let array =
            NpyArray::decode(&with_header("{'descr': '>i2', 'fortran_order': True, 'shape': (2, 3), }  \n", &{
                let mut values = Vec::new();
                [11_i16, 21, 12, 22, 13, 23].iter().for_each(|v| values.extend_from_slice(&v.to_be_bytes()));
                values
            }))
            .unwrap();
        assert_eq!(array.integers::<i64>("i64").unwrap(), [11, 12, 13, 21, 22, 23]);
    }

    #[test]
    fn every_cut_is_an_error() {
        let bytes = encode(&[5], [1_u16, 2, 3, 4, 5].into_iter());
        for length in 0..bytes.len() {
            assert!(NpyArray::decode(&bytes[..length]).is_err(), "{length} of {}", bytes.len());
        }
    }

    #[test]
    fn a_shape_that_overflows_or_lies_is_refused_before_allocation() {
        for shape in ["(18446744073709551615, 18446744073709551615)", "(1099511627776,)", "(3, 3)", "(-1,)", "(2.0,)"] {
            let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}");
            assert!(NpyArray::decode(&with_header(&header, &[0; 64])).is_err(), "{shape}");
        }
    }

    #[test]
    fn records_become_columns_by_their_names() {
        let header = "{'descr': [('x', '<u2'), ('', '|V1'), (('p', 'on'), '|b1'), ('t', '>i8')], \
                      'fortran_order': False, 'shape': (2,), }";
        let record = |x: u16, on: u8, t: i64| [&x.to_le_bytes()[..], &[9, on], &t.to_be_bytes()].concat();
        let bytes = with_header(header, &[record(7, 1, -3), record(8, 0, 500)].concat());
        let columns = decode_records(&bytes).unwrap();
        let names: Vec<_> = columns.iter().map(|(names, _)| names.join("/")).collect();
        assert_eq!(names, ["x", "p/on", "t"]);
        let values: Vec<Vec<i64>> = columns.iter().map(|(_, column)| column.integers("i64").unwrap()).collect();
        assert_eq!(values, [vec![7, 8], vec![1, 0], vec![-3, 500]]);
        for cut in 0..bytes.len() {
            assert!(decode_records(&bytes[..cut]).is_err(), "{cut}");
        }
        for descr in ["[('x', '<u2', (3,))]", "[('x', '|O')]", "[]", "[('x', '<u2')", "'<u2'"] {
            let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (1,), }}");
            assert!(decode_records(&with_header(&header, &[0; 2])).is_err(), "{descr}");
        }
    }

    #[test]
    fn objects_records_and_wrong_types_are_refused() {
        for descr in ["'|O'", "[('a', '<f8')]", "'<c16'", "'<U3'", "'<f2'", "'é'", "''"] {
            let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (1,), }}");
            assert!(NpyArray::decode(&with_header(&header, &[0; 8])).is_err(), "{descr}");
        }
        let floats = NpyArray::decode(&encode(&[1], [1.0_f64].into_iter())).unwrap();
        assert!(matches!(floats.integers::<i64>("i64"), Err(NpyError::Type { .. })));
        let large = NpyArray::decode(&encode(&[2], [1_i64, 70_000].into_iter())).unwrap();
        let error = large.integers::<u16>("0..=65535").unwrap_err();
        assert_eq!(error, NpyError::Range { value: 70_000, index: 1, wanted: "0..=65535" });
    }

    proptest::proptest! {
        #[test]
        fn damaged_bytes_never_panic(at in 0_usize..128, value in 0_u8.., cut in 0_usize..200) {
            let mut bytes = encode(&[2, 2], [1.0_f64, 2.0, 3.0, 4.0].into_iter());
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.truncate(cut);
            let _ = NpyArray::decode(&bytes).map(|array| (array.floats(), array.integers::<u8>("u8")));
        }
    }
}
