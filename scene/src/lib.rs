//! What a scene is described with: cameras, poses, lenses, images, points, `rig.json`.
//!
//! Poses are world-to-camera, in metres, with OpenCV axes (x right, y down, z forward). Pixel centres lie at
//! half-integers: the centre of the top-left pixel is (0.5, 0.5).
//!
//! A calibrated rig from its file, and what its cameras see:
//!
//! ```
//! use erfgs_scene::{
//!     Distortion, Intrinsics, Modality, Pose,
//!     rig_file::{RigCamera, RigFile},
//! };
//! use glam::{DVec2, DVec3};
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("rig.json");
//! # let distortion = Distortion::BrownConrady([-0.1, 0.02, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]);
//! # let intrinsics = Intrinsics { width: 1280, height: 720, fx: 900.0, fy: 900.0, cx: 640.0, cy: 360.0, distortion };
//! # let pose = Pose::look_at(DVec3::new(2.0, -1.0, 0.0), DVec3::ZERO, DVec3::Y);
//! # RigFile::new("board", true, vec![RigCamera::new("left", Modality::Both, intrinsics, Some(pose))]).write(&path)?;
//! let rig = RigFile::read(&path)?;
//! let camera = rig.camera("left").ok_or("no camera is called left")?;
//! let pose = camera.pose.ok_or("nobody knows where it stands")?;
//!
//! // From the world (metres) to the pixel that sees it, through the lens; and back, to a ray of length 1.
//! let point = DVec3::new(0.1, 0.2, 0.3);
//! let seen = pose.transform(point);
//! let pixel: DVec2 = camera.intrinsics.project(seen).ok_or("the point is behind the camera")?;
//! let ray = camera.intrinsics.unproject(pixel)?;
//! let again = pose.inverse().transform(ray * seen.length());
//! assert!((again - point).length() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! - [`Intrinsics`], [`lens`] and [`Pose`]: a camera. [`undistort`] makes pinhole images of what it filmed.
//! - [`rig_file`]: `rig.json`. [`exchange`], [`colmap`] and [`ply`]: what other programs read and write.
//! - [`mod@image`] and [`video`]: pictures. [`pixel`]: frames as cameras send them.
//!
//! # Features
//!
//! The default is all but `exr`; without any there are the names and sizes of pixel layouts ([`pixel`]).
//!
//! - `cameras`: cameras, lenses, poses, `rig.json`.
//! - `images`: pictures, their files, and frames decoded into them.
//! - `formats`: COLMAP, PLY, and the calibrations of other programs.
//! - `exr`: pictures in OpenEXR files; not among the default.

#[cfg(feature = "cameras")]
pub mod camera;
#[cfg(feature = "cameras")]
pub mod camera_path;
#[cfg(feature = "formats")]
pub mod colmap;
#[cfg(feature = "formats")]
pub mod exchange;
#[cfg(feature = "exr")]
pub mod exr;
#[cfg(feature = "images")]
pub mod image;
#[cfg(feature = "cameras")]
pub mod lens;
pub mod pixel;
#[cfg(feature = "formats")]
pub mod ply;
#[cfg(feature = "cameras")]
pub mod pose;
#[cfg(feature = "cameras")]
pub mod rig_file;
pub mod srgb;
#[cfg(all(feature = "cameras", feature = "images"))]
pub mod undistort;
#[cfg(feature = "images")]
pub mod video;

#[cfg(feature = "cameras")]
pub use camera::{Distortion, Intrinsics, Modality};
#[cfg(feature = "images")]
pub use image::{ImageGrey8, ImageRgb8, ImageRgb16};
#[cfg(feature = "formats")]
pub use ply::PointCloud;
#[cfg(feature = "cameras")]
pub use pose::Pose;

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
