//! Coloured point clouds in PLY files.

use std::path::{Path, PathBuf};

use erfgs_base::FileError;

/// Points with colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions, metres.
    pub positions: Vec<[f32; 3]>,
    /// Colours, red, green, blue, sRGB-encoded; as many as positions.
    pub colours: Vec<[u8; 3]>,
}

/// What can go wrong with a PLY file.
#[derive(Debug, thiserror::Error)]
pub enum PlyError {
    /// The file cannot be opened, read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The header cannot be used.
    #[error("point cloud {}: header line {line}: {what}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// The file ends before the vertices that the header announces.
    #[error("point cloud {} is cut short: it holds {found} of {named} vertices; make it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Whole vertices in the file.
        found: usize,
        /// Vertices that the header announces.
        named: usize,
    },
    /// A vertex cannot be used.
    #[error("point cloud {}: vertex {index} {what}", path.display())]
    Vertex {
        /// The file.
        path: PathBuf,
        /// Number of the vertex, from 0.
        index: usize,
        /// What is wrong.
        what: &'static str,
    },
}

/// A number type of PLY.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Scalar {
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

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number at the beginning of `bytes`, which hold at least [`Scalar::size`] of them.
    fn decode(self, bytes: &[u8]) -> Option<f64> {
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

/// Where a property of a vertex lies.
#[derive(Clone, Copy, Debug)]
struct Place {
    scalar: Scalar,
    /// Number of the column in ASCII.
    column: usize,
    /// Offset from the beginning of the vertex in binary.
    offset: usize,
}

/// What is known of the vertices once the header is read.
#[derive(Debug)]
struct Layout {
    ascii: bool,
    vertices: usize,
    /// Bytes of one vertex.
    stride: usize,
    position: [Place; 3],
    colour: Option<[Place; 3]>,
    /// Number of header lines, and bytes up to the first vertex.
    lines: usize,
    header: usize,
}

impl Layout {
    /// Reads the header; an error is a line number (from 1) and what is wrong with it.
    fn parse(bytes: &[u8]) -> Result<Self, (usize, String)> {
        let (mut ascii, mut vertices, mut elements) = (None, None, 0);
        let mut properties: Vec<(String, Place)> = Vec::new();
        let (mut header, mut stride, mut lines) = (0, 0, 0);
        for (index, line) in bytes.split_inclusive(|&byte| byte == b'\n').enumerate() {
            header += line.len();
            lines = index + 1;
            let wrong = |what: &str| Err((lines, what.to_owned()));
            let Some(text) = std::str::from_utf8(line).ok().filter(|_| line.ends_with(b"\n")) else {
                return wrong("not text, or the header does not end");
            };
            let words: Vec<&str> = text.split_whitespace().collect();
            match (index, words.as_slice()) {
                (0, ["ply"]) => {}
                (0, _) => return wrong("the file does not begin with `ply`"),
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
                    let place = Place { scalar, column: properties.len(), offset: stride };
                    properties.push(((*name).to_owned(), place));
                    stride += scalar.size();
                }
                (_, ["property", ..]) => return wrong("vertices with list properties cannot be read"),
                (_, ["end_header"]) => {
                    let find = |name: &str| properties.iter().find(|(n, _)| n == name).map(|(_, place)| *place);
                    let three = |names: [&str; 3]| match names.map(find) {
                        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
                        _ => None,
                    };
                    let Some(ascii) = ascii else { return wrong("the line `format` is missing") };
                    let Some(vertices) = vertices else { return wrong("there is no element vertex") };
                    let Some(position) = three(["x", "y", "z"]) else {
                        return wrong("the vertices have no properties x, y, z");
                    };
                    let colour = three(["red", "green", "blue"]).or_else(|| three(["r", "g", "b"]));
                    if colour.is_some_and(|places| places.iter().any(|place| place.scalar != Scalar::U8)) {
                        return wrong("colours must be of type uchar");
                    }
                    return Ok(Self { ascii, vertices, stride, position, colour, lines, header });
                }
                _ => return wrong("unknown keyword"),
            }
        }
        Err((lines.max(1), "the header does not end".to_owned()))
    }
}

impl PointCloud {
    /// How many points there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Reads vertices `x`, `y`, `z` and `red`, `green`, `blue` (mid-grey where absent) of an ASCII or binary
    /// little-endian PLY file. Other properties, and elements after the vertices, are skipped.
    ///
    /// # Errors
    /// If the file is missing, cut short, malformed, or a coordinate is not finite.
    pub fn read(path: &Path) -> Result<Self, PlyError> {
        let bytes = std::fs::read(path).map_err(FileError::when("read point cloud", path))?;
        Self::decode(path, &bytes)
    }

    fn decode(path: &Path, bytes: &[u8]) -> Result<Self, PlyError> {
        let layout =
            Layout::parse(bytes).map_err(|(line, what)| PlyError::Header { path: path.to_owned(), line, what })?;
        let body = bytes.get(layout.header..).unwrap_or_default();
        let truncated = |found| PlyError::Truncated { path: path.to_owned(), found, named: layout.vertices };
        let vertex = |index, what| PlyError::Vertex { path: path.to_owned(), index, what };
        let mut cloud = Self::default();
        let mut push = |index, position: [Option<f64>; 3], colour: [Option<f64>; 3]| {
            let [Some(x), Some(y), Some(z)] = position else { return Err(vertex(index, "lacks a coordinate")) };
            let [Some(r), Some(g), Some(b)] = colour else { return Err(vertex(index, "lacks a colour")) };
            let position = [x, y, z].map(|value| value as f32);
            if !position.iter().all(|value| value.is_finite()) {
                return Err(vertex(index, "has a coordinate that is no finite number"));
            }
            if [r, g, b].iter().any(|value| !(0.0..=255.0).contains(value)) {
                return Err(vertex(index, "has a colour outside 0 to 255"));
            }
            cloud.positions.push(position);
            cloud.colours.push([r, g, b].map(|value| value as u8));
            Ok(())
        };
        let grey = [Some(128.0); 3];
        if layout.ascii {
            let text = std::str::from_utf8(body).map_err(|_| PlyError::Header {
                path: path.to_owned(),
                line: layout.lines,
                what: "the vertices of an ascii file are not text".to_owned(),
            })?;
            // A last line without its end may have lost digits.
            let whole = text.rfind('\n').map_or("", |end| &text[..end]);
            let mut lines = whole.lines().filter(|line| !line.trim().is_empty());
            for index in 0..layout.vertices {
                let line = lines.next().ok_or_else(|| truncated(index))?;
                let words: Vec<&str> = line.split_whitespace().collect();
                let number = |place: Place| words.get(place.column)?.parse::<f64>().ok();
                push(index, layout.position.map(number), layout.colour.map_or(grey, |places| places.map(number)))?;
            }
        } else {
            let mut rest = body;
            for index in 0..layout.vertices {
                let (bytes, after) = rest.split_at_checked(layout.stride).ok_or_else(|| truncated(index))?;
                let number = |place: Place| place.scalar.decode(bytes.get(place.offset..)?);
                push(index, layout.position.map(number), layout.colour.map_or(grey, |places| places.map(number)))?;
                rest = after;
            }
        }
        Ok(cloud)
    }

    /// Writes a binary little-endian PLY file with float positions and uchar colours. The file appears whole or not at
    /// all.
    ///
    /// # Errors
    /// If there are not as many colours as positions, or the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), PlyError> {
        let io = FileError::when("write point cloud", path);
        if self.colours.len() != self.positions.len() {
            let what = format!("{} positions, but {} colours", self.positions.len(), self.colours.len());
            return Err(io(std::io::Error::new(std::io::ErrorKind::InvalidInput, what)).into());
        }
        let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", self.len()).into_bytes();
        for name in ["x", "y", "z"] {
            bytes.extend_from_slice(format!("property float {name}\n").as_bytes());
        }
        for name in ["red", "green", "blue"] {
            bytes.extend_from_slice(format!("property uchar {name}\n").as_bytes());
        }
        bytes.extend_from_slice(b"end_header\n");
        for (position, colour) in self.positions.iter().zip(&self.colours) {
            position.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            bytes.extend_from_slice(colour);
        }
        Ok(erfgs_base::atomic::write(path, &bytes).map_err(io)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_points() -> PointCloud {
        PointCloud {
            positions: vec![[0.0, -1.5, 3.25], [1e-20, 2e20, -0.1], [7.0, 8.0, 9.0]],
            colours: vec![[0, 1, 2], [255, 128, 127], [10, 13, 26]],
        }
    }

    fn decode(bytes: &[u8]) -> Result<PointCloud, PlyError> {
        PointCloud::decode(Path::new("cloud.ply"), bytes)
    }

    const ASCII: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 2\nproperty double x\n\
        property double y\nproperty double z\nproperty float nx\nproperty uchar red\nproperty uchar green\n\
        property uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        1 2 3 0.5 10 20 30\n-1e-3 0 4.5 0 255 0 0\n3 0 1 1\n";

    #[test]
    fn points_come_back_as_they_were() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        for cloud in [some_points(), PointCloud::default()] {
            cloud.write(&path).unwrap();
            assert_eq!(PointCloud::read(&path).unwrap(), cloud);
        }
    }

    #[test]
    fn ascii_is_read_and_what_is_not_needed_is_skipped() {
        let cloud = decode(ASCII.as_bytes()).unwrap();
        assert_eq!(cloud.positions, [[1.0, 2.0, 3.0], [-1e-3, 0.0, 4.5]]);
        assert_eq!(cloud.colours, [[10, 20, 30], [255, 0, 0]]);
        let windows = ASCII.replace('\n', "\r\n");
        assert_eq!(decode(windows.as_bytes()).unwrap(), cloud);
    }

    #[test]
    fn points_without_colour_are_grey() {
        let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
            end_header\n1 2 3\n";
        assert_eq!(decode(text.as_bytes()).unwrap().colours, [[128; 3]]);
    }

    #[test]
    fn a_file_cut_short_anywhere_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        some_points().write(&path).unwrap();
        let binary = std::fs::read(&path).unwrap();
        let vertices_end = ASCII.len() - "3 0 1 1\n".len();
        for whole in [&binary[..], &ASCII.as_bytes()[..vertices_end]] {
            for length in 0..whole.len() {
                assert!(decode(&whole[..length]).is_err(), "{length} of {}", whole.len());
            }
        }
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let message = |from: &str, to: &str| decode(ASCII.replacen(from, to, 1).as_bytes()).unwrap_err().to_string();
        assert!(message("1 2 3 0.5", "1 nan 3 0.5").contains("vertex 0 has a coordinate that is no finite number"));
        assert!(message("255 0 0", "256 0 0").contains("vertex 1 has a colour outside 0 to 255"));
        assert!(message("1 2 3 0.5 10 20 30", "1 2").contains("vertex 0 lacks a coordinate"));
        assert!(message("format ascii", "format binary_big_endian").contains("line 2"));
        assert!(message("property double y\n", "").contains("no properties x, y, z"));
        assert!(message("vertex 2", "vertex 99999999999999999999").contains("no number"));
        assert!(
            message("vertex 2", "vertex 9999999999999").contains("lacks"),
            "faces are read as vertices, then refused"
        );
    }
}
