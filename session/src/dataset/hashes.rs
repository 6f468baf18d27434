//! Hashes of the files that a manifest names.

use super::{Dataset, DatasetError};

impl Dataset {
    /// Computes the SHA-256 of every file that the manifest names into [`super::Manifest::sha256`]. Call before
    /// [`Dataset::save`].
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn hash_files(&mut self) -> Result<(), DatasetError> {
        todo!()
    }

    /// Recomputes the hashes and compares them with those of the manifest.
    ///
    /// # Errors
    /// The first file that is missing, changed, or has no hash.
    pub fn verify(&self) -> Result<(), DatasetError> {
        todo!()
    }
}
