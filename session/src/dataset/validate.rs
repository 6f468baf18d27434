//! The checks of a manifest.

use super::{Dataset, DatasetError};

impl Dataset {
    /// Checks that the manifest makes sense and that every file that it names exists. Does not open the files.
    ///
    /// # Errors
    /// The first thing that is wrong, with file, camera and remedy.
    pub fn validate(&self) -> Result<(), DatasetError> {
        Ok(())
    }
}
