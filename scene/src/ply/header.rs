//! The header of a PLY file whose first element is `vertex`.

use std::{
    fmt::{Display, Write as _},
    io::{self, BufRead, Read as _},
};

/// A number type of PLY.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn name(self) -> &'static str {
        match self {
            Self::I8 => "char",
            Self::U8 => "uchar",
            Self::I16 => "short",
            Self::U16 => "ushort",
            Self::I32 => "int",
            Self::U32 => "uint",
            Self::F32 => "float",
            Self::F64 => "double",
        }
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number at the beginning of `bytes`, which hold at least [`Scalar::size`] of them.
    pub fn decode(self, bytes: &[u8]) -> Option<f64> {
        Some(match self {
            Self::I8 => f64::from(*bytes.first()? as i8),
            Self::U8 => f64::from(*bytes.first()?),
            Self::I16 => i16::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::U16 => u16::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::I32 => i32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::U32 => u32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::F32 => f32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::F64 => f64::from_le_bytes(*bytes.first_chunk()?),
        })
    }
}

/// A property of the vertices, and where it lies in each.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub scalar: Scalar,
    /// Number of the column in ASCII.
    pub column: usize,
    /// Offset from the beginning of the vertex in binary.
    pub offset: usize,
}

/// What is known of the vertices once the header is read.
#[derive(Debug)]
pub(super) struct Header {
    /// Whether numbers are written out; binary little-endian where not.
    pub ascii: bool,
    pub vertices: usize,
    /// Bytes of one vertex in binary.
    pub stride: usize,
    pub properties: Vec<Property>,
    /// Number of header lines.
    pub lines: usize,
}

/// Why a header was not read.
#[derive(Debug)]
pub(super) enum HeaderError {
    Io(io::Error),
    /// Number of the line, from 1, and what is wrong with it.
    Line(usize, String),
}

/// A line, and the header as a whole, are at most this long.
const MAX_LINE: u64 = 1 << 16;
const MAX_LINES: usize = 4096;

impl Header {
    /// Reads up to the first vertex.
    pub fn read(reader: &mut impl BufRead) -> Result<Self, HeaderError> {
        let (mut ascii, mut vertices, mut elements) = (None, None, 0);
        let mut header = Self { ascii: false, vertices: 0, stride: 0, properties: Vec::new(), lines: 0 };
        let mut line = Vec::new();
        for number in 1..=MAX_LINES {
            line.clear();
            reader.by_ref().take(MAX_LINE).read_until(b'\n', &mut line).map_err(HeaderError::Io)?;
            let wrong = |what: &str| Err(HeaderError::Line(number, what.to_owned()));
            let Some(text) = std::str::from_utf8(&line).ok().filter(|text| text.ends_with('\n')) else {
                return wrong("not text, or the header does not end");
            };
            let words: Vec<&str> = text.split_whitespace().collect();
            match (number, words.as_slice()) {
                (1, ["ply"]) => {}
                (1, _) => return wrong("the file does not begin with `ply`"),
                (_, [] | ["comment" | "obj_info", ..]) => {}
                (_, ["format", "ascii", _]) => ascii = Some(true),
                (_, ["format", "binary_little_endian", _]) => ascii = Some(false),
                (_, ["format", ..]) => {
                    return wrong("only ascii and binary_little_endian can be read; convert the file");
                }
                (_, ["element", "vertex", count]) => {
                    if elements > 0 {
                        return wrong("vertices must be the first element");
                    }
                    let Ok(count) = count.parse::<usize>() else { return wrong("the count of vertices is no number") };
                    (vertices, elements) = (Some(count), 1);
                }
                (_, ["element", ..]) => elements += 1,
                (_, ["property", ..]) if elements != 1 || vertices.is_none() => {}
                (_, ["property", kind, name]) => {
                    let Some(scalar) = Scalar::parse(kind) else { return wrong("unknown type of a property") };
                    let (column, offset) = (header.properties.len(), header.stride);
                    header.properties.push(Property { name: (*name).to_owned(), scalar, column, offset });
                    header.stride += scalar.size();
                }
                (_, ["property", ..]) => return wrong("vertices with list properties cannot be read"),
                (_, ["end_header"]) => {
                    let Some(ascii) = ascii else { return wrong("the line `format` is missing") };
                    let Some(vertices) = vertices else { return wrong("there is no element vertex") };
                    return Ok(Self { ascii, vertices, lines: number, ..header });
                }
                _ => return wrong("unknown keyword"),
            }
        }
        Err(HeaderError::Line(MAX_LINES, "the header does not end".to_owned()))
    }

    /// The first property of this name.
    pub fn property(&self, name: &str) -> Option<&Property> {
        self.properties.iter().find(|property| property.name == name)
    }
}

/// The header of a binary little-endian file that holds nothing but vertices.
pub(super) fn write(vertices: usize, properties: impl IntoIterator<Item = (Scalar, impl Display)>) -> String {
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n");
    for (scalar, name) in properties {
        let _ = writeln!(header, "property {} {name}", scalar.name());
    }
    header + "end_header\n"
}
