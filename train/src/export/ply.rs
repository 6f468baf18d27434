//! The .ply layout of the original 3D Gaussian Splatting release.
//!
//! Float properties `x y z nx ny nz f_dc_0..2 f_rest_0.. opacity scale_0..2 rot_0..3`, binary little-endian. Values are
//! raw: log-scales, opacity logits, quaternions w, x, y, z. `f_dc` holds the first SH coefficient. `f_rest` holds the
//! others channel by channel: all of red, then green, then blue. Normals are zero.

use std::{
    fs::File,
    io::{BufReader, ErrorKind, Read, Write},
    path::Path,
};

use super::{ExportError, header};
use crate::gaussians::{CORE, Gaussians, sh_stride};
use erfgs_base::atomic;

/// SH coefficients a channel.
fn coefficients(degree: u32) -> usize {
    let side = degree as usize + 1;
    side * side
}

/// Writes Gaussians, in one step.
///
/// # Errors
/// [`ExportError::Write`], [`ExportError::Length`], [`ExportError::ShDegree`].
pub fn write_ply(path: &Path, gaussians: &Gaussians) -> Result<(), ExportError> {
    let Gaussians { sh_degree, ref core, ref sh, .. } = *gaussians;
    if sh_degree > 3 {
        return Err(ExportError::ShDegree(sh_degree));
    }
    let (count, stride) = (gaussians.len(), sh_stride(sh_degree));
    if sh.len() != count * stride {
        return Err(ExportError::Length { count, sh_degree, expected: count * stride, found: sh.len() });
    }
    let coefficients = coefficients(sh_degree);
    let rest = 3 * (coefficients - 1);
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n");
    for name in property_names(rest) {
        header.push_str(&format!("property float {name}\n"));
    }
    header.push_str("end_header\n");
    let written = atomic::write_with(path, |file| {
        file.write_all(header.as_bytes())?;
        let mut row = Vec::with_capacity((17 + rest) * 4);
        for (core, sh) in core.as_chunks::<CORE>().0.iter().zip(sh.chunks_exact(stride)) {
            row.clear();
            let mut push = |values: &[f32]| row.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            push(&core[..3]);
            push(&[0.0; 3]);
            push(&sh[..3]);
            for channel in 0..3 {
                for coefficient in 1..coefficients {
                    push(&[sh[coefficient * 3 + channel]]);
                }
            }
            push(&core[10..11]);
            push(&core[3..10]);
            file.write_all(&row)?;
        }
        Ok(())
    });
    written.map_err(|source| ExportError::Write { path: path.to_owned(), source })
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

/// Reads Gaussians. Properties may stand in any order, others than those of the layout are skipped. The file does not
/// say which Gaussians move: all are dynamic.
///
/// # Errors
/// [`ExportError::Read`], [`ExportError::Format`], [`ExportError::Truncated`].
pub fn read_ply(path: &Path) -> Result<Gaussians, ExportError> {
    let failed = |source| ExportError::Read { path: path.to_owned(), source };
    let mut reader = BufReader::new(File::open(path).map_err(failed)?);
    let format = |message| ExportError::Format { path: path.to_owned(), message };
    let header = header::read(&mut reader).map_err(failed)?.map_err(format)?;
    let columns = Columns::find(&header).map_err(format)?;

    let mut gaussians = Gaussians { sh_degree: columns.sh_degree, ..Gaussians::default() };
    let padding = sh_stride(columns.sh_degree) - columns.sh.len();
    let mut row = vec![0; header.stride];
    // The count is only a promise until the rows are there: no memory is set aside for it.
    for complete in 0..header.count {
        match reader.read_exact(&mut row) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => {
                return Err(ExportError::Truncated { path: path.to_owned(), count: header.count, complete });
            }
            read => read.map_err(failed)?,
        }
        let value = |offset: usize| row[offset..].first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
        gaussians.core.extend(columns.core.iter().map(|&offset| value(offset)).chain([0.0]));
        gaussians.sh.extend(columns.sh.iter().map(|&offset| value(offset)).chain(std::iter::repeat_n(0.0, padding)));
    }
    gaussians.dynamic = gaussians.len();
    Ok(gaussians)
}

/// Byte offsets of what makes a Gaussian.
struct Columns {
    sh_degree: u32,
    /// In the order of a core row, without its padding.
    core: Vec<usize>,
    /// Coefficient by coefficient, red, green, blue in each.
    sh: Vec<usize>,
}

impl Columns {
    fn find(header: &header::Header) -> Result<Self, String> {
        let offset = |name: &str| header.offset(name).ok_or_else(|| format!("it has no float property '{name}'"));
        let rest = header.floats.iter().filter(|(name, _)| name.starts_with("f_rest_")).count();
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
        let names = ["x", "y", "z", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "opacity"];
        let core = names.into_iter().map(offset).collect::<Result<_, _>>()?;
        Ok(Self { sh_degree, core, sh })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use proptest::prelude::*;

    use super::*;

    /// Gaussians of distinct values, padding zero.
    fn gaussians(sh_degree: u32, count: usize) -> Gaussians {
        let rows = |used: usize, stride: usize| {
            let value = move |i: usize| if i % stride < used { (i * 37 + used) as f32 / 8.0 } else { 0.0 };
            (0..count * stride).map(value).collect()
        };
        let stride = sh_stride(sh_degree);
        Gaussians { sh_degree, dynamic: count, core: rows(11, CORE), sh: rows(coefficients(sh_degree) * 3, stride) }
    }

    fn file() -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        (folder, path)
    }

    #[test]
    fn the_layout_is_the_one_of_the_original_release() {
        let (_folder, path) = file();
        let values = |count: usize| (0..count).map(|i| i as f32).collect();
        write_ply(&path, &Gaussians { sh_degree: 1, dynamic: 0, core: values(12), sh: values(12) }).unwrap();
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
    fn a_file_that_is_cut_anywhere_is_an_error() {
        let (_folder, path) = file();
        write_ply(&path, &gaussians(1, 3)).unwrap();
        let whole = fs::read(&path).unwrap();
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).unwrap();
            let error = read_ply(&path).unwrap_err();
            assert!(matches!(error, ExportError::Format { .. } | ExportError::Truncated { .. }), "{length}: {error}");
        }
        fs::write(&path, &whole[..whole.len() - 1]).unwrap();
        assert!(matches!(read_ply(&path), Err(ExportError::Truncated { count: 3, complete: 2, .. })));
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
        let read = read_ply(&path).unwrap();
        assert_eq!((read.sh_degree, read.dynamic, read.len()), (0, 1, 1));
        assert_eq!(read.core, [4.0, 5.0, 6.0, 11.0, 12.0, 13.0, 3.0, 2.0, 1.0, 0.0, 10.0, 0.0]);
        assert_eq!(read.sh, [9.0, 8.0, 7.0, 0.0]);
    }

    #[test]
    fn rows_that_do_not_fit_are_refused() {
        let (_folder, path) = file();
        let wrong = Gaussians { sh_degree: 1, ..gaussians(0, 2) };
        assert!(matches!(write_ply(&path, &wrong), Err(ExportError::Length { count: 2, expected: 24, found: 8, .. })));
        assert!(matches!(write_ply(&path, &Gaussians { sh_degree: 4, ..wrong }), Err(ExportError::ShDegree(4))));
    }

    #[test]
    fn a_count_that_cannot_be_is_an_error_and_no_allocation() {
        let (_folder, path) = file();
        write_ply(&path, &gaussians(0, 1)).unwrap();
        let text = fs::read(&path).unwrap();
        let at = text.windows(8).position(|window| window == b"vertex 1").unwrap() + 7;
        let mut bytes = text[..at].to_vec();
        bytes.extend(usize::MAX.to_string().bytes());
        bytes.extend(&text[at + 1..]);
        fs::write(&path, bytes).unwrap();
        assert!(matches!(read_ply(&path), Err(ExportError::Truncated { complete: 1, .. })));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_bit_by_bit(
            degree in 0u32..=3,
            rows in proptest::collection::vec(proptest::array::uniform32(any::<f32>().prop_filter("nan", |v| !v.is_nan())), 0..20),
        ) {
            let (_folder, path) = file();
            let mut written = gaussians(degree, rows.len());
            let (used, stride) = (coefficients(degree) * 3, sh_stride(degree));
            for (i, row) in rows.iter().enumerate() {
                written.core[i * CORE..][..CORE - 1].copy_from_slice(&row[..CORE - 1]);
                for (at, value) in written.sh[i * stride..][..used].iter_mut().enumerate() {
                    *value = row[at % row.len()];
                }
            }
            write_ply(&path, &written).unwrap();
            prop_assert_eq!(read_ply(&path).unwrap(), written);
        }

        #[test]
        fn arbitrary_headers_never_panic(lines in proptest::collection::vec("(property|element|format|comment|end_header)( (float|uchar|vertex|list|x|[0-9]{1,20}|binary_little_endian)){0,3}", 0..20)) {
            let (_folder, path) = file();
            fs::write(&path, format!("ply\n{}\nend_header\nxxxx", lines.join("\n"))).unwrap();
            let _ = read_ply(&path);
        }
    }
}
