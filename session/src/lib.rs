//! The ground floor of erfgs: what was recorded.
//!
//! Times are `i64` nanoseconds on the session clock. Poses are world-to-camera, in metres, with OpenCV axes (x right,
//! y down, z forward). Pixel centres lie at half-integers: the centre of the top-left pixel is (0.5, 0.5).

pub mod atomic;
pub mod camera;
pub mod clock;
pub mod codec;
pub mod colmap;
pub mod container;
pub mod dataset;
mod encoding;
pub mod event;
pub mod hdf5;
pub mod image;
pub mod import;
pub mod lens;
pub mod npy;
pub mod npz;
pub mod page;
pub mod pixel;
pub mod ply;
pub mod pose;
pub mod progress;
pub mod random;
pub mod source;
pub mod srgb;
pub mod undistort;
pub mod video;

pub use camera::{Distortion, Intrinsics};
pub use dataset::{Camera, Dataset, EventFile, Frame, Manifest, Modality, Split};
pub use event::{Event, Events};
pub use image::{ImageGrey8, ImageRgb8, ImageRgb16};
pub use ply::PointCloud;
pub use pose::Pose;
pub use progress::Progress;
