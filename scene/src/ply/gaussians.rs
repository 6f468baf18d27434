//! Gaussians in the .ply layout of the original 3D Gaussian Splatting release.
//!
//! Float properties `x y z nx ny nz f_dc_0..2 f_rest_0.. opacity scale_0..2 rot_0..3`, binary little-endian. Values are
//! raw: log-scales, opacity logits, quaternions w, x, y, z. `f_dc` holds the first SH coefficient. `f_rest` holds the
//! others channel by channel: all of red, then green, then blue. Normals are zero.

use std::{
    fs::File,
    io::{self, BufReader, ErrorKind, Read, Write},
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, atomic};

use super::header::{self, Header, HeaderError, Scalar};

/// Gaussians, an entry each in every list.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaussianCloud {
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
    /// Means, metres.
    pub positions: Vec<[f32; 3]>,
    /// Natural logarithms of the standard deviations along the axes, metres.
    pub log_scales: Vec<[f32; 3]>,
    /// Quaternions w, x, y, z; of any length.
    pub rotations: Vec<[f32; 4]>,
    /// Logits of the opacities.
    pub opacity_logits: Vec<f32>,
    /// Coefficients of the spherical harmonics: [`GaussianCloud::sh_stride`] of each Gaussian, coefficient by coefficient,
    /// red, green, blue in each.
    pub sh: Vec<f32>,
}

/// What can go wrong with a file of Gaussians.
#[derive(Debug, thiserror::Error)]
pub enum GaussianCloudError {
    /// The lists do not fit together.
    #[error("{count} Gaussians of SH degree {sh_degree} need {expected} {what}, but {found} were given")]
    Length {
        /// Gaussians: how many positions there are.
        count: usize,
        /// SH degree.
        sh_degree: u32,
        /// Which list.
        what: &'static str,
        /// Values needed.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// The SH degree is not supported.
    #[error("SH degree {0} is not supported; use 0, 1, 2 or 3")]
    ShDegree(u32),
    /// The file could not be read.
    #[error("could not read point cloud '{}': {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The file is not a 3DGS point cloud.
    #[error("'{}' is not a 3DGS point cloud: {message}; export it as a binary little-endian 3DGS .ply", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A Gaussian holds what is no number.
    #[error("'{}': the property '{property}' of Gaussian {index} is {value}; export it again", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Which property.
        property: String,
        /// Number of the Gaussian, from 0.
        index: usize,
        /// What it is.
        value: f32,
    },
    /// The file ends early.
    #[error("'{}' is cut short: it holds {complete} of {count} Gaussians; export it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Gaussians that the header promises.
        count: usize,
        /// Gaussians that are there whole.
        complete: usize,
    },
}

/// SH coefficients a channel.
fn coefficients(degree: u32) -> usize {
    let side = degree as usize + 1;
    side * side
}

impl GaussianCloud {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Values of `sh` that belong to one Gaussian: 3, 12, 27 or 48.
    #[must_use]
    pub fn sh_stride(&self) -> usize {
        3 * coefficients(self.sh_degree)
    }

    /// Writes the file. It appears whole or not at all.
    ///
    /// # Errors
    /// [`GaussianCloudError::ShDegree`], [`GaussianCloudError::Length`], [`GaussianCloudError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), GaussianCloudError> {
        self.check()?;
        let coefficients = coefficients(self.sh_degree);
        let names = property_names(3 * (coefficients - 1)).map(|name| (Scalar::F32, name));
        let header = header::write(self.len(), names);
        let written = atomic::write_with(path, |file| {
            file.write_all(header.as_bytes())?;
            let mut row = Vec::with_capacity((14 + self.sh_stride()) * 4);
            for (index, sh) in self.sh.chunks_exact(self.sh_stride()).enumerate() {
                row.clear();
                let mut push = |values: &[f32]| row.extend(values.iter().flat_map(|value| value.to_le_bytes()));
                push(&self.positions[index]);
                push(&[0.0; 3]);
                push(&sh[..3]);
                for channel in 0..3 {
                    for coefficient in 1..coefficients {
                        push(&[sh[coefficient * 3 + channel]]);
                    }
                }
                push(&[self.opacity_logits[index]]);
                push(&self.log_scales[index]);
                push(&self.rotations[index]);
                file.write_all(&row)?;
            }
            Ok(())
        });
        Ok(written.map_err(FileError::when("write point cloud", path))?)
    }

    /// Whether the lists fit together.
    fn check(&self) -> Result<(), GaussianCloudError> {
        let (count, sh_degree) = (self.len(), self.sh_degree);
        if sh_degree > 3 {
            return Err(GaussianCloudError::ShDegree(sh_degree));
        }
        let lists = [
            ("log-scales", count, self.log_scales.len()),
            ("rotations", count, self.rotations.len()),
            ("opacity logits", count, self.opacity_logits.len()),
            ("SH values", count * self.sh_stride(), self.sh.len()),
        ];
        match lists.into_iter().find(|(_, expected, found)| expected != found) {
            Some((what, expected, found)) => {
                Err(GaussianCloudError::Length { count, sh_degree, what, expected, found })
            }
            None => Ok(()),
        }
    }

    /// Reads a file. Properties may stand in any order, others than those of the layout are skipped.
    ///
    /// # Errors
    /// [`GaussianCloudError::Read`], [`GaussianCloudError::Format`], [`GaussianCloudError::Truncated`],
    /// [`GaussianCloudError::NotFinite`].
    pub fn read(path: &Path) -> Result<Self, GaussianCloudError> {
        let failed = |source| GaussianCloudError::Read { path: path.to_owned(), source };
        let format = |message| GaussianCloudError::Format { path: path.to_owned(), message };
        let mut reader = BufReader::new(File::open(path).map_err(failed)?);
        let header = Header::read(&mut reader).map_err(|error| match error {
            HeaderError::Io(source) => failed(source),
            HeaderError::Line(line, what) => format(format!("header line {line}: {what}")),
        })?;
        let columns = Columns::find(&header).map_err(format)?;
        let mut cloud = Self { sh_degree: columns.sh_degree, ..Self::default() };
        let mut row = vec![0; header.stride];
        // The count is only a promise until the rows are there: no memory is set aside for it.
        for complete in 0..header.vertices {
            match reader.read_exact(&mut row) {
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => {
                    return Err(GaussianCloudError::Truncated {
                        path: path.to_owned(),
                        count: header.vertices,
                        complete,
                    });
                }
                read => read.map_err(failed)?,
            }
            let floats = header.properties.iter().filter(|property| property.scalar == Scalar::F32);
            let mut floats = floats.map(|property| (property, value_at(&row, property.offset)));
            if let Some((property, value)) = floats.find(|(_, value)| !value.is_finite()) {
                let (path, property) = (path.to_owned(), property.name.clone());
                return Err(GaussianCloudError::NotFinite { path, property, index: complete, value });
            }
            let value = |offset: usize| value_at(&row, offset);
            cloud.positions.push(columns.position.map(value));
            cloud.log_scales.push(columns.log_scale.map(value));
            cloud.rotations.push(columns.rotation.map(value));
            cloud.opacity_logits.push(value(columns.opacity_logit));
            cloud.sh.extend(columns.sh.iter().map(|&offset| value(offset)));
        }
        Ok(cloud)
    }
}

/// The number of a row at an offset, at which there is one.
fn value_at(row: &[u8], offset: usize) -> f32 {
    row[offset..].first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes))
}

fn property_names(rest: usize) -> impl Iterator<Item = String> {
    let numbered = |name: &'static str, count: usize| (0..count).map(move |i| format!("{name}_{i}"));
    let plain = ["x", "y", "z", "nx", "ny", "nz"].into_iter().map(String::from);
    plain
        .chain(numbered("f_dc", 3))
        .chain(numbered("f_rest", rest))
        .chain(["opacity".into()])
        .chain(numbered("scale", 3))
        .chain(numbered("rot", 4))
}

/// Byte offsets of what makes a Gaussian.
struct Columns {
    sh_degree: u32,
    position: [usize; 3],
    log_scale: [usize; 3],
    rotation: [usize; 4],
    opacity_logit: usize,
    /// Coefficient by coefficient, red, green, blue in each.
    sh: Vec<usize>,
}

impl Columns {
    fn find(header: &Header) -> Result<Self, String> {
        if header.ascii {
            return Err("its format is ascii".into());
        }
        let floats = || header.properties.iter().filter(|property| property.scalar == Scalar::F32);
        let offset = |name: &str| {
            let found = floats().find(|property| property.name == name);
            found.map(|property| property.offset).ok_or_else(|| format!("it has no float property '{name}'"))
        };
        let rest = floats().filter(|property| property.name.starts_with("f_rest_")).count();
        let sh_degree = (0..=3)
            .find(|&degree| rest == 3 * (coefficients(degree) - 1))
            .ok_or_else(|| format!("it has {rest} 'f_rest' properties instead of 0, 9, 24 or 45"))?;
        let others = coefficients(sh_degree) - 1;
        let mut sh = Vec::with_capacity(3 + rest);
        for channel in 0..3 {
            sh.push(offset(&format!("f_dc_{channel}"))?);
        }
        for coefficient in 0..others {
            for channel in 0..3 {
                sh.push(offset(&format!("f_rest_{}", channel * others + coefficient))?);
            }
        }
        Ok(Self {
            sh_degree,
            position: [offset("x")?, offset("y")?, offset("z")?],
            log_scale: [offset("scale_0")?, offset("scale_1")?, offset("scale_2")?],
            rotation: [offset("rot_0")?, offset("rot_1")?, offset("rot_2")?, offset("rot_3")?],
            opacity_logit: offset("opacity")?,
            sh,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use proptest::prelude::*;

    use super::*;

    /// Gaussians of distinct values.
    fn gaussians(sh_degree: u32, count: usize) -> GaussianCloud {
        let value = |i: usize, of: usize| (i * 37 + of) as f32 / 8.0;
        fn rows<const N: usize>(count: usize, value: impl Fn(usize) -> f32) -> Vec<[f32; N]> {
            (0..count).map(|row| std::array::from_fn(|at| value(row * N + at))).collect()
        }
        GaussianCloud {
            sh_degree,
            positions: rows(count, |i| value(i, 1)),
            log_scales: rows(count, |i| value(i, 2)),
            rotations: rows(count, |i| value(i, 3)),
            opacity_logits: (0..count).map(|i| value(i, 4)).collect(),
            sh: (0..count * coefficients(sh_degree) * 3).map(|i| value(i, 5)).collect(),
        }
    }

    fn file() -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        (folder, path)
    }

    #[test]
    fn the_layout_is_the_one_of_the_original_release() {
        let (_folder, path) = file();
        let cloud = GaussianCloud {
            sh_degree: 1,
            positions: vec![[0.0, 1.0, 2.0]],
            log_scales: vec![[3.0, 4.0, 5.0]],
            rotations: vec![[6.0, 7.0, 8.0, 9.0]],
            opacity_logits: vec![10.0],
            sh: (0..12).map(|i| i as f32).collect(),
        };
        cloud.write(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        let names: Vec<&str> = header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
        assert_eq!(
            names.join(" "),
            "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 \
             f_rest_7 f_rest_8 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"
        );
        let values: Vec<f32> = bytes[end..].as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect();
        assert_eq!(values.len(), names.len());
        assert_eq!(values[3..9], [0.0, 0.0, 0.0, 0.0, 1.0, 2.0]);
        assert_eq!(values[9..18], [3.0, 6.0, 9.0, 4.0, 7.0, 10.0, 5.0, 8.0, 11.0], "channel by channel");
        assert_eq!(values[18], 10.0, "opacity");
        assert_eq!(values[22..], [6.0, 7.0, 8.0, 9.0], "w first");
    }

    #[test]
    fn a_gaussian_with_a_number_that_is_none_is_named() {
        let (_folder, path) = file();
        for (spoil, property) in [
            ((|cloud, value| cloud.positions[1][2] = value) as fn(&mut GaussianCloud, f32), "'z'"),
            (|cloud, value| cloud.log_scales[1][0] = value, "'scale_0'"),
            (|cloud, value| cloud.rotations[1][3] = value, "'rot_3'"),
            (|cloud, value| cloud.opacity_logits[1] = value, "'opacity'"),
            (|cloud, value| cloud.sh[12] = value, "'f_dc_0'"),
        ] {
            for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut cloud = gaussians(1, 3);
                spoil(&mut cloud, value);
                cloud.write(&path).unwrap();
                let message = GaussianCloud::read(&path).unwrap_err().to_string();
                assert!(
                    message.contains(property) && message.contains("Gaussian 1") && message.contains("cloud.ply"),
                    "{message}"
                );
            }
        }
    }

    #[test]
    fn a_file_that_is_cut_anywhere_is_an_error() {
        let (_folder, path) = file();
        gaussians(1, 3).write(&path).unwrap();
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            let error = GaussianCloud::read(&path).unwrap_err();
            assert!(
                matches!(error, GaussianCloudError::Format { .. } | GaussianCloudError::Truncated { .. }),
                "{length}: {error}"
            );
        }
        fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        assert!(matches!(GaussianCloud::read(&path), Err(GaussianCloudError::Truncated { count: 3, complete: 2, .. })));
    }

    #[test]
    fn foreign_properties_and_comments_are_skipped() {
        let (_folder, path) = file();
        let names = "rot_3 rot_2 rot_1 rot_0 x y z f_dc_2 f_dc_1 f_dc_0 opacity scale_0 scale_1 scale_2";
        let mut bytes = b"ply\r\nformat binary_little_endian 1.0\ncomment by hand\nelement vertex 1\nproperty uchar red\nproperty double time\n".to_vec();
        for name in names.split(' ') {
            bytes.extend(format!("property float {name}\n").bytes());
        }
        bytes.extend(b"element face 0\nproperty list uchar int vertex_indices\nend_header\n");
        bytes.push(200);
        bytes.extend(7f64.to_le_bytes());
        bytes.extend((0..14).flat_map(|i| (i as f32).to_le_bytes()));
        fs::write(&path, bytes).unwrap();
        let read = GaussianCloud::read(&path).unwrap();
        assert_eq!((read.sh_degree, read.len()), (0, 1));
        assert_eq!((&read.positions[..], &read.log_scales[..]), (&[[4.0, 5.0, 6.0]][..], &[[11.0, 12.0, 13.0]][..]));
        assert_eq!((&read.rotations[..], &read.opacity_logits[..]), (&[[3.0, 2.0, 1.0, 0.0]][..], &[10.0][..]));
        assert_eq!(read.sh, [9.0, 8.0, 7.0]);
    }

    #[test]
    fn lists_that_do_not_fit_are_refused() {
        let (_folder, path) = file();
        let wrong = GaussianCloud { sh_degree: 1, sh: vec![0.0; 8], ..gaussians(0, 2) };
        let error = wrong.write(&path).unwrap_err();
        assert!(matches!(error, GaussianCloudError::Length { count: 2, expected: 24, found: 8, .. }), "{error}");
        let wrong = GaussianCloud { rotations: vec![[0.0; 4]], ..gaussians(1, 2) };
        let error = wrong.write(&path).unwrap_err();
        assert!(
            matches!(error, GaussianCloudError::Length { what: "rotations", expected: 2, found: 1, .. }),
            "{error}"
        );
        let wrong = GaussianCloud { sh_degree: 4, ..wrong };
        assert!(matches!(wrong.write(&path), Err(GaussianCloudError::ShDegree(4))));
        assert!(!path.exists());
    }

    #[test]
    fn other_files_are_refused_with_what_is_wrong() {
        let (_folder, path) = file();
        let message = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            GaussianCloud::read(&path).unwrap_err().to_string()
        };
        assert!(message(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n").contains("its format is ascii"));
        assert!(message(b"ply\nformat binary_big_endian 1.0\n").contains("header line 2: only ascii"));
        let points = "ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty double x\nend_header\n";
        assert!(message(points.as_bytes()).contains("no float property 'f_dc_0'"));
        let endless = [b"ply\ncomment ".as_slice(), &[b'x'; 1 << 17]].concat();
        assert!(message(&endless).contains("header line 2: not text, or the header does not end"));
        assert!(message(&[b"ply\n".as_slice(), &[b'\n'; 5000]].concat()).contains("the header does not end"));
    }

    #[test]
    fn a_count_that_cannot_be_is_an_error_and_no_allocation() {
        let (_folder, path) = file();
        gaussians(0, 1).write(&path).unwrap();
        let text = fs::read(&path).unwrap();
        let at = text.windows(8).position(|window| window == b"vertex 1").unwrap() + 7;
        let mut bytes = text[..at].to_vec();
        bytes.extend(usize::MAX.to_string().bytes());
        bytes.extend(&text[at + 1..]);
        fs::write(&path, bytes).unwrap();
        assert!(matches!(GaussianCloud::read(&path), Err(GaussianCloudError::Truncated { complete: 1, .. })));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_bit_by_bit(
            degree in 0u32..=3,
            rows in proptest::collection::vec(proptest::array::uniform32(any::<f32>().prop_filter("nan", |v| !v.is_nan())), 0..20),
        ) {
            let (_folder, path) = file();
            let mut written = gaussians(degree, rows.len());
            let stride = written.sh_stride();
            for (i, row) in rows.iter().enumerate() {
                written.positions[i] = *row.first_chunk().unwrap();
                written.log_scales[i] = *row[3..].first_chunk().unwrap();
                written.rotations[i] = *row[6..].first_chunk().unwrap();
                written.opacity_logits[i] = row[10];
                for (at, value) in written.sh[i * stride..][..stride].iter_mut().enumerate() {
                    *value = row[at % row.len()];
                }
            }
            written.write(&path).unwrap();
            prop_assert_eq!(GaussianCloud::read(&path).unwrap(), written);
        }

        #[test]
        fn arbitrary_headers_never_panic(lines in proptest::collection::vec("(property|element|format|comment|end_header)( (float|uchar|vertex|list|x|[0-9]{1,20}|binary_little_endian)){0,3}", 0..20)) {
            let (_folder, path) = file();
            fs::write(&path, format!("ply\n{}\nend_header\nxxxx", lines.join("\n"))).unwrap();
            let _ = GaussianCloud::read(&path);
        }
    }
}
