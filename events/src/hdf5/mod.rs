//! Events in HDF5 files: DSEC's layout, read and written, and Metavision's, read.
//!
//! HDF5 itself is read by the library libhdf5, which is linked with the feature `hdf5` alone; without it, [`open`] and
//! [`create`] say how to get it. The filters that it lacks are here: [`blosc`] and [`ecf`].
//!
//! | Layout | Datasets |
//! |---|---|
//! | DSEC | `/events/t` (microseconds after `/t_offset`), `/events/x`, `/events/y`, `/events/p` (1 is ON); `/ms_to_idx`: the first event of each millisecond |
//! | Metavision | `/CD/events` of `x`, `y`, `p`, `t`; `/EXT_TRIGGER/events` of `p`, `t`, `id`; the attributes of a RAW header |

#[cfg(feature = "compressions")]
pub mod blosc;
#[cfg(feature = "hdf5")]
mod checks;
pub mod ecf;
mod error;
#[cfg(feature = "hdf5")]
mod read;
#[cfg(all(test, feature = "hdf5"))]
mod variants;
#[cfg(any(test, not(feature = "hdf5")))]
mod without;
#[cfg(feature = "hdf5")]
mod write;

pub use error::Hdf5Error;
#[cfg(feature = "hdf5")]
pub use read::{Hdf5File, open};
#[cfg(not(feature = "hdf5"))]
pub use without::{Hdf5File, Hdf5Writer, create, open};
#[cfg(feature = "hdf5")]
pub use write::{Hdf5Writer, create};

/// How a file lays its events out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hdf5Layout {
    /// A dataset for each field.
    Dsec,
    /// One dataset of compound elements.
    Metavision,
}

impl Hdf5Layout {
    /// A short name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Dsec => "hdf5-dsec",
            Self::Metavision => "hdf5-metavision",
        }
    }
}
