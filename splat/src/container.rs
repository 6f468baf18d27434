//! Files of a JSON header and named vectors of f32: checkpoints.
//!
//! A file holds the magic `ERFGSCKP`, the length of a JSON header (u64, little-endian), the header, vectors of
//! little-endian f32 in the order that the header lists, and the SHA-256 of all that.

use erfgs_base::plausible::POINT;
use sha2::{Digest, Sha256};

use crate::{field::NamedVector, gaussians::CORE};

const MAGIC: &[u8; 8] = b"ERFGSCKP";

/// Where a Gaussian has the logarithms of its sizes, and the largest of these: what is larger has no square in single precision.
const SCALES: std::ops::Range<usize> = 3..6;
const LARGEST: f32 = 44.0;

/// A whole file: its header, and the bytes of its vectors.
#[derive(Clone, Copy, Debug)]
pub struct Container<'a> {
    /// The JSON text of the header.
    pub header: &'a [u8],
    vectors: &'a [u8],
}

impl<'a> Container<'a> {
    /// Takes a file apart.
    ///
    /// # Errors
    /// What is wrong with it, in words.
    pub fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let (content, hash) = bytes.split_last_chunk::<32>().ok_or("it is too short")?;
        let rest = content.strip_prefix(MAGIC).ok_or("it does not begin like one")?;
        if Sha256::digest(content).as_slice() != hash {
            return Err("its checksum does not match; it was cut short or changed".into());
        }
        let (length, rest) = rest.split_first_chunk::<8>().ok_or("it is too short")?;
        let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| "its header is too long")?;
        let (header, vectors) = rest.split_at_checked(length).ok_or("its header is cut short")?;
        Ok(Self { header, vectors })
    }

    /// The vectors of these names and lengths, which the header lists.
    ///
    /// # Errors
    /// What is wrong with them, in words.
    pub fn vectors(&self, listed: Vec<(String, usize)>) -> Result<Vec<NamedVector>, String> {
        let mut rest = self.vectors;
        let read = |(name, count): (String, usize)| {
            let size = count.checked_mul(4).ok_or("a vector is too long")?;
            let (values, after) = rest.split_at_checked(size).ok_or("a vector is cut short")?;
            rest = after;
            let values = values.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect();
            Ok(NamedVector { name, values })
        };
        listed.into_iter().map(read).collect()
    }
}

/// The bytes of a file.
#[must_use]
pub fn to_bytes(header: &[u8], vectors: &[(String, &[f32])]) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend((header.len() as u64).to_le_bytes());
    bytes.extend(header);
    for (_, values) in vectors {
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }
    let hash = Sha256::digest(&bytes);
    bytes.extend_from_slice(&hash);
    bytes
}

/// The first number of the vector of this name that no training leaves behind, if there is one, and its place.
#[must_use]
pub fn implausible(name: &str, values: &[f32]) -> Option<(usize, f32)> {
    let is_good = |index: usize, value: f32| match (name, index % CORE) {
        ("core", at) if at < 3 => POINT.holds(value.into()),
        ("core", at) if SCALES.contains(&at) => value <= LARGEST,
        ("field box" | "points", _) => POINT.holds(value.into()),
        _ => true,
    };
    let mut all = values.iter().copied().enumerate();
    all.find(|&(index, value)| !(value.is_finite() && is_good(index, value)))
}
