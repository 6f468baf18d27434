//! Datasets: a manifest, image files and event files in one folder. This is what `train` reads.
//!
//! ```text
//! ds/dataset.json                 the manifest (see [`Manifest`])
//! ds/images/<camera>/<index>.png  frames (five digits, from 00000; see [`layout`])
//! ds/events/<camera>.npz          events: t (i64, µs), x (u16), y (u16), p (u8, 1 = ON)
//! ds/masks/<camera>/<index>.png   moving pixels (white), where given
//! ds/points.ply                   the initial point cloud, where made
//! ds/bodies.json                  what moves as bodies, where found (see [`Bodies`])
//! ```

mod bodies;
pub mod disturb;
mod error;
pub mod export;
mod files;
mod hashes;
pub mod import;
pub mod layout;
mod manifest;
mod replace;
pub mod undistort;
mod validate;

pub use bodies::{Bodies, BodiesFile, Body, BodyPose, SurfacePoint};
pub use error::{DatasetError, Problem};
pub use manifest::{
    Camera, CameraEvents, Dataset, Frame, Manifest, PointCloudFile, PointRun, PoseSigma, Provenance, Split, VariantStep,
};

#[cfg(test)]
mod tests;
