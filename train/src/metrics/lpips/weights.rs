//! The weights that a user supplies: a reader of `.safetensors` files.
//!
//! Layout of the file: u64 little-endian length of the header, the header (JSON: name to `dtype`, `shape`,
//! `data_offsets`), then the data that the offsets count from.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use serde::Deserialize;

/// What can be wrong with LPIPS weights.
#[derive(Debug, thiserror::Error)]
pub enum LpipsError {
    /// The file could not be read.
    #[error("could not read LPIPS weights '{}': {source}; docs/reference/run.md says how to make the file", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not a .safetensors file.
    #[error("'{}' is not a .safetensors file: {message}; docs/reference/run.md says how to make one", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        message: String,
    },
    /// A tensor is not in the file.
    #[error("'{}' has no tensor '{name}'; docs/reference/run.md lists the names that LPIPS needs", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
    },
    /// A tensor has the wrong shape.
    #[error(
        "tensor '{name}' in '{}' has shape {found:?}, but LPIPS needs {expected:?}; is it for another network?", path.display()
    )]
    Shape {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// The shape that is needed.
        expected: Vec<usize>,
    },
}

/// The tensors of a `.safetensors` file. All are float32.
#[derive(Debug)]
pub struct LpipsWeights {
    path: PathBuf,
    header: BTreeMap<String, Entry>,
    data: Vec<u8>,
}

#[derive(Debug, Deserialize)]
struct Entry {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

impl LpipsWeights {
    /// Reads a file.
    ///
    /// # Errors
    /// [`LpipsError::Read`] and [`LpipsError::Format`].
    pub fn read(path: &Path) -> Result<Self, LpipsError> {
        let bytes = fs::read(path).map_err(|source| LpipsError::Read { path: path.to_owned(), source })?;
        Self::parse(path, &bytes).map_err(|message| LpipsError::Format { path: path.to_owned(), message })
    }

    fn parse(path: &Path, bytes: &[u8]) -> Result<Self, String> {
        let (length, rest) = bytes.split_first_chunk::<8>().ok_or("it is shorter than 8 bytes")?;
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|error| error.to_string())?;
        let (header, data) =
            rest.split_at_checked(length).ok_or_else(|| format!("its header of {length} bytes is cut short"))?;
        let header: BTreeMap<String, serde_json::Value> =
            serde_json::from_slice(header).map_err(|error| format!("its header is not JSON: {error}"))?;
        let mut entries = BTreeMap::new();
        for (name, value) in header {
            if name == "__metadata__" {
                continue;
            }
            let entry: Entry = serde_json::from_value(value).map_err(|error| format!("tensor '{name}': {error}"))?;
            let [start, end] = entry.data_offsets;
            if start > end || end > data.len() {
                return Err(format!("tensor '{name}' lies at bytes {start}..{end}, but there are {}", data.len()));
            }
            entries.insert(name, entry);
        }
        Ok(Self { path: path.to_owned(), header: entries, data: data.to_owned() })
    }

    /// The shape of a tensor.
    pub(super) fn shape(&self, name: &str) -> Result<&[usize], LpipsError> {
        Ok(&self.entry(name)?.shape)
    }

    /// The values of a tensor, which must have shape `expected`.
    pub(super) fn tensor(&self, name: &str, expected: &[usize]) -> Result<Vec<f32>, LpipsError> {
        let entry = self.entry(name)?;
        if entry.shape != expected {
            return Err(LpipsError::Shape {
                path: self.path.clone(),
                name: name.into(),
                found: entry.shape.clone(),
                expected: expected.into(),
            });
        }
        let format = |message| LpipsError::Format { path: self.path.clone(), message };
        if entry.dtype != "F32" {
            return Err(format(format!("tensor '{name}' is {}, but must be F32; convert it", entry.dtype)));
        }
        let [start, end] = entry.data_offsets;
        let count: usize = expected.iter().product();
        if end - start != count * 4 {
            return Err(format(format!("tensor '{name}' has {} bytes instead of {}", end - start, count * 4)));
        }
        let values: Vec<f32> =
            self.data[start..end].as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        if values.iter().all(|value| value.is_finite()) {
            Ok(values)
        } else {
            Err(format(format!("tensor '{name}' has values that are not finite")))
        }
    }

    fn entry(&self, name: &str) -> Result<&Entry, LpipsError> {
        self.header.get(name).ok_or_else(|| LpipsError::Missing { path: self.path.clone(), name: name.into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
    }

    #[test]
    fn a_tensor_is_read_by_name_and_its_shape_and_type_are_checked() {
        let header = r#"{"__metadata__":{"a":"b"},"x":{"dtype":"F32","shape":[2],"data_offsets":[4,12]},"h":{"dtype":"F16","shape":[2],"data_offsets":[0,4]}}"#;
        let data: Vec<u8> = [9.0f32, 1.5, -2.0].iter().flat_map(|value| value.to_le_bytes()).collect();
        let weights = LpipsWeights::parse(Path::new("w"), &file(header, &data)).unwrap();
        assert_eq!(weights.tensor("x", &[2]).unwrap(), [1.5, -2.0]);
        assert!(matches!(weights.tensor("x", &[2, 1]), Err(LpipsError::Shape { .. })));
        assert!(matches!(weights.tensor("y", &[2]), Err(LpipsError::Missing { .. })));
        assert!(weights.tensor("h", &[2]).unwrap_err().to_string().contains("F16"));
    }

    #[test]
    fn a_file_that_is_cut_anywhere_is_an_error() {
        let header = r#"{"x":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}"#;
        let whole = file(header, &[0; 8]);
        assert!(LpipsWeights::parse(Path::new("w"), &whole).is_ok());
        for length in 0..whole.len() {
            assert!(LpipsWeights::parse(Path::new("w"), &whole[..length]).is_err(), "cut at {length}");
        }
    }

    proptest! {
        #[test]
        fn hostile_headers_never_panic(start in any::<u64>(), end in any::<u64>(), shape in any::<u32>(), length in any::<u64>()) {
            let header = format!(r#"{{"x":{{"dtype":"F32","shape":[{shape}],"data_offsets":[{start},{end}]}}}}"#);
            let mut bytes = file(&header, &[0; 64]);
            if let Ok(weights) = LpipsWeights::parse(Path::new("w"), &bytes) {
                let _ = weights.tensor("x", &[shape as usize]);
            }
            bytes[..8].copy_from_slice(&length.to_le_bytes());
            let _ = LpipsWeights::parse(Path::new("w"), &bytes);
        }
    }
}
