//! The header of a .ply file.

use std::io::{self, BufRead};

/// The vertices of a binary little-endian .ply file whose first element is `vertex`.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Header {
    /// Vertices.
    pub count: usize,
    /// Bytes a vertex.
    pub stride: usize,
    /// Name and byte offset of each property of type float.
    pub floats: Vec<(String, usize)>,
}

impl Header {
    /// The offset of a float property.
    pub fn offset(&self, name: &str) -> Option<usize> {
        self.floats.iter().find(|(property, _)| property == name).map(|(_, offset)| *offset)
    }
}

/// A line of a header, and the header as a whole, are at most this long.
const MAX_LINE: u64 = 4096;
const MAX_LINES: usize = 4096;

pub(super) fn read(reader: &mut impl BufRead) -> io::Result<Result<Header, String>> {
    if line(reader)? != b"ply" {
        return Ok(Err("it does not begin with 'ply'".into()));
    }
    let mut header = Header { count: 0, stride: 0, floats: Vec::new() };
    let mut element = None;
    let mut binary = false;
    for _ in 0..MAX_LINES {
        let bytes = line(reader)?;
        let Ok(text) = std::str::from_utf8(&bytes) else { return Ok(Err("its header is not text".into())) };
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words.as_slice() {
            ["format", "binary_little_endian", _] => binary = true,
            ["format", other, ..] => return Ok(Err(format!("its format is '{other}', not 'binary_little_endian'"))),
            ["element", name, count] => {
                if *name == "vertex" && element.is_some() {
                    return Ok(Err("vertices are not its first element".into()));
                }
                element = Some(*name == "vertex");
                if *name == "vertex" {
                    let Ok(count) = count.parse() else { return Ok(Err(format!("'{text}' has no valid count"))) };
                    header.count = count;
                }
            }
            ["property", kind, name] if element == Some(true) => {
                let size = match *kind {
                    "char" | "uchar" | "int8" | "uint8" => 1,
                    "short" | "ushort" | "int16" | "uint16" => 2,
                    "int" | "uint" | "float" | "int32" | "uint32" | "float32" => 4,
                    "double" | "float64" => 8,
                    other => return Ok(Err(format!("property '{name}' has unknown type '{other}'"))),
                };
                if matches!(*kind, "float" | "float32") {
                    header.floats.push(((*name).into(), header.stride));
                }
                header.stride += size;
            }
            ["property", "list", ..] if element == Some(true) => {
                return Ok(Err("its vertices have a list property".into()));
            }
            ["end_header"] if !binary => return Ok(Err("its header has no format line".into())),
            ["end_header"] if element != Some(true) && header.stride == 0 => {
                return Ok(Err("it has no vertices".into()));
            }
            ["end_header"] => return Ok(Ok(header)),
            // Comments, properties of later elements.
            [] | ["comment" | "obj_info" | "property", ..] => {}
            _ => return Ok(Err(format!("its header has an unknown line '{text}'"))),
        }
    }
    Ok(Err("its header does not end".into()))
}

/// A line without its end. At the end of the file it is empty.
fn line(reader: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    io::Read::take(reader, MAX_LINE).read_until(b'\n', &mut bytes)?;
    while matches!(bytes.last(), Some(b'\n' | b'\r')) {
        bytes.pop();
    }
    Ok(bytes)
}
