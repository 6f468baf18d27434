//! What stands in for HDF5 where the program was built without it.
#![cfg_attr(feature = "hdf5", expect(dead_code, reason = "the tests see it in any case"))]

use std::{convert::Infallible, path::Path};

use super::{Hdf5Error, Hdf5Layout};
use crate::{Anomalies, CdEvent, SensorSize, Sink};

/// A file that is open for reading: there is none.
#[derive(Debug)]
pub struct Hdf5File(Infallible);

/// Looks at a file and finds out how its events are laid out.
///
/// # Errors
/// Always: the program was built without the feature `hdf5`.
pub fn open(path: &Path) -> Result<Hdf5File, Hdf5Error> {
    Err(Hdf5Error::NotBuilt { doing: "read", path: path.to_owned() })
}

impl Hdf5File {
    /// How its events are laid out.
    #[must_use]
    pub fn layout(&self) -> Hdf5Layout {
        match self.0 {}
    }

    /// Size of the sensor, where the file says it.
    #[must_use]
    pub fn size(&self) -> Option<SensorSize> {
        match self.0 {}
    }

    /// Decodes all events and edges.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn decode(&self, _size: Option<SensorSize>, _sink: &mut impl Sink) -> Result<Anomalies, Hdf5Error> {
        match self.0 {}
    }
}

/// A file that is being written: there is none.
#[derive(Debug)]
pub struct Hdf5Writer(Infallible);

/// Begins a file in DSEC's layout.
///
/// # Errors
/// Always: the program was built without the feature `hdf5`.
pub fn create(path: &Path, _size: Option<SensorSize>) -> Result<Hdf5Writer, Hdf5Error> {
    Err(Hdf5Error::NotBuilt { doing: "write", path: path.to_owned() })
}

impl Hdf5Writer {
    /// Ends the file.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> Result<u64, Hdf5Error> {
        match self.0 {}
    }
}

impl Sink for Hdf5Writer {
    fn event(&mut self, _event: CdEvent) {
        match self.0 {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_hdf5_it_is_said_how_to_get_it() {
        let path = Path::new("e.h5");
        for error in [open(path).unwrap_err(), create(path, None).unwrap_err()] {
            let message = error.to_string();
            for word in ["e.h5", "--features hdf5", "libhdf5-dev"] {
                assert!(message.contains(word), "{message}");
            }
        }
    }
}
