//! Streams of a recording as files that other programs read: events as RAW, DAT, AEDAT 4, CSV, NPZ and HDF5, frames as PNG, EXR
//! and MP4.
//!
//! The way back, from event files to sessions, is [`import_events`](crate::container::import_events). Frames are here and not
//! with the datasets, because nothing is joined: a frame goes out as the camera gave it, at its own size, and the clocks of
//! the stream, where the caller has them, only date it.

mod anew;
mod depth;
mod event_video;
mod events;
mod frames;
mod sensor_frames;

use std::{
    io,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use erfgs_events::{EncodeError, hdf5::Hdf5Error, npz::NpzError};
use erfgs_scene::{image::ImageError, video::VideoError};

pub use depth::of as sample_bits;
pub use event_video::{EventVideo, WrittenVideo, write_event_video};
pub use events::{EventsFormat, WrittenEvents, write_events};
pub use frames::{Exposures, FramesChoice, FramesFormat, PICTURE_DIGITS, WrittenFrames, write_frames};
pub use sensor_frames::samples as sensor_samples;

use crate::container::ContainerError;

/// Why a stream is not written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ContainerError),
    /// The file system refuses.
    #[error(transparent)]
    File(#[from] FileError),
    /// The format has no room for an event.
    #[error("{} cannot be written: {source}", path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// The event, and why.
        source: EncodeError,
    },
    /// The samples of a stream's frames have 16 bits of which the upper ones may not count.
    #[error(
        "the frames of stream '{id}' have samples of 16 bits, and the largest is {largest}: either fewer bits count, or all frames are \
         nearly black; say how many with --bits (10 as jAER writes a DAVIS's, 16 if all count)"
    )]
    FewBits {
        /// The stream.
        id: String,
        /// The largest sample.
        largest: u16,
    },
    /// A sample has more bits than are said to count.
    #[error(
        "a sample of the frames of stream '{id}' is {largest}, which is more than {bits} bits hold; give --bits as many as count"
    )]
    MoreBits {
        /// The stream.
        id: String,
        /// The largest sample.
        largest: u16,
        /// The bits that are said to count.
        bits: u8,
    },
    /// The stream has no events.
    #[error("stream '{id}' has no events that can be written")]
    NoEvents {
        /// The stream.
        id: String,
    },
    /// NumPy's archive cannot be written.
    #[error(transparent)]
    Npz(#[from] NpzError),
    /// The HDF5 file cannot be written.
    #[error(transparent)]
    Hdf5(#[from] Hdf5Error),
    /// A picture cannot be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A video cannot be written.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// A picture in linear light cannot be written.
    #[cfg(feature = "exr")]
    #[error(transparent)]
    Exr(#[from] erfgs_scene::exr::ExrError),
}

impl ExportError {
    fn writing(path: &Path) -> impl Fn(io::Error) -> Self {
        |source| FileError::when("write", path)(source).into()
    }
}

/// Whether reading goes on behind the place of an error.
fn is_passed_over(error: &ContainerError) -> bool {
    matches!(error, ContainerError::Damaged { .. })
}
