//! The Python module `erfgs`: thin over the rooms that read sessions, rigs and datasets, draw reconstructions, and
//! simulate event cameras.
//!
//! What is here turns arguments into those of a library, lets go of the interpreter's lock while the library works, and hands arrays
//! over. Every time is in microseconds, as event cameras' are; those of libraries are in nanoseconds (`times.rs`).

mod arrays;
mod clock;
mod dataset;
mod errors;
mod lens;
mod reading;
mod recording;
mod rig;
mod scene;
mod simulator;
mod times;

use pyo3::prelude::*;

/// Sessions of several cameras on one clock, rigs, datasets and reconstructions; see the package `erfgs`.
#[pymodule]
mod _erfgs {
    #[pymodule_export]
    use super::clock::{Clock, ClockPart};
    #[pymodule_export]
    use super::dataset::{Dataset, DatasetCamera};
    #[pymodule_export]
    use super::errors::{DamageWarning, Error};
    #[pymodule_export]
    use super::lens::Camera;
    #[pymodule_export]
    use super::reading::{FrameIterator, SliceIterator};
    #[pymodule_export]
    use super::recording::{Recording, Stream, open};
    #[pymodule_export]
    use super::rig::Rig;
    #[pymodule_export]
    use super::scene::Scene;
    #[pymodule_export]
    use super::simulator::Simulator;
    use super::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
