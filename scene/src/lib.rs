//! What a scene is described with: cameras, poses, lenses, images, points, `rig.json`.
//!
//! Poses are world-to-camera, in metres, with OpenCV axes (x right, y down, z forward). Pixel centres lie at
//! half-integers: the centre of the top-left pixel is (0.5, 0.5).

pub mod camera;
pub mod camera_path;
pub mod colmap;
pub mod exchange;
#[cfg(feature = "exr")]
pub mod exr;
pub mod image;
pub mod lens;
pub mod pixel;
pub mod ply;
pub mod pose;
pub mod rig_file;
pub mod srgb;
pub mod undistort;
pub mod video;

pub use camera::{Distortion, Intrinsics, Modality};
pub use image::{ImageGrey8, ImageRgb8, ImageRgb16};
pub use ply::PointCloud;
pub use pose::Pose;
