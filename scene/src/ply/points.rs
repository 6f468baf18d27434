//! Coloured point clouds in PLY files.

use std::path::{Path, PathBuf};

use erfgs_base::FileError;

use super::header::{self, Header, HeaderError, Property, Scalar};

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

/// Where what makes a point lies in a vertex.
struct Places<'a> {
    position: [&'a Property; 3],
    colour: Option<[&'a Property; 3]>,
}

impl<'a> Places<'a> {
    fn find(header: &'a Header) -> Result<Self, &'static str> {
        let three = |names: [&str; 3]| match names.map(|name| header.property(name)) {
            [Some(a), Some(b), Some(c)] => Some([a, b, c]),
            _ => None,
        };
        let position = three(["x", "y", "z"]).ok_or("the vertices have no properties x, y, z")?;
        let colour = three(["red", "green", "blue"]).or_else(|| three(["r", "g", "b"]));
        if colour.is_some_and(|places| places.iter().any(|place| place.scalar != Scalar::U8)) {
            return Err("colours must be of type uchar");
        }
        Ok(Self { position, colour })
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
        let wrong = |line, what| PlyError::Header { path: path.to_owned(), line, what };
        let mut body = bytes;
        let header = Header::read(&mut body).map_err(|error| match error {
            HeaderError::Io(source) => FileError::when("read point cloud", path)(source).into(),
            HeaderError::Line(line, what) => wrong(line, what),
        })?;
        let places = Places::find(&header).map_err(|what| wrong(header.lines, what.to_owned()))?;
        let truncated = |found| PlyError::Truncated { path: path.to_owned(), found, named: header.vertices };
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
        if header.ascii {
            let text = std::str::from_utf8(body)
                .map_err(|_| wrong(header.lines, "the vertices of an ascii file are not text".to_owned()))?;
            let mut lines = text.lines().filter(|line| !line.trim().is_empty());
            for index in 0..header.vertices {
                let line = lines.next().ok_or_else(|| truncated(index))?;
                let words: Vec<&str> = line.split_whitespace().collect();
                // The last line may lack its end, as editors leave it, and no number.
                let is_last = line.as_bytes().as_ptr_range().end == text.as_bytes().as_ptr_range().end;
                if is_last && words.len() < header.properties.len() {
                    return Err(truncated(index));
                }
                let number = |place: &Property| words.get(place.column)?.parse::<f64>().ok();
                push(index, places.position.map(number), places.colour.map_or(grey, |places| places.map(number)))?;
            }
        } else {
            for index in 0..header.vertices {
                let (bytes, after) = body.split_at_checked(header.stride).ok_or_else(|| truncated(index))?;
                let number = |place: &Property| place.scalar.decode(bytes.get(place.offset..)?);
                push(index, places.position.map(number), places.colour.map_or(grey, |places| places.map(number)))?;
                body = after;
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
        let bytes = self.encode().map_err(&io)?;
        Ok(erfgs_base::atomic::write(path, &bytes).map_err(io)?)
    }

    /// The bytes of such a file.
    ///
    /// # Errors
    /// If there are not as many colours as positions.
    pub fn encode(&self) -> std::io::Result<Vec<u8>> {
        if self.colours.len() != self.positions.len() {
            let what = format!("{} positions, but {} colours", self.positions.len(), self.colours.len());
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, what));
        }
        let positions = ["x", "y", "z"].map(|name| (Scalar::F32, name));
        let colours = ["red", "green", "blue"].map(|name| (Scalar::U8, name));
        let mut bytes = header::write(self.len(), positions.into_iter().chain(colours)).into_bytes();
        for (position, colour) in self.positions.iter().zip(&self.colours) {
            position.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
            bytes.extend_from_slice(colour);
        }
        Ok(bytes)
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
                // Text may lack its last end, and nothing else.
                let is_whole = whole.is_ascii() && length + 1 == whole.len();
                assert_eq!(decode(&whole[..length]).is_ok(), is_whole, "{length} of {}", whole.len());
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
