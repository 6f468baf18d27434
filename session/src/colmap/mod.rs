//! COLMAP's sparse models: `cameras`, `images` and `points3D` in binary and text.
//!
//! COLMAP's pixel convention is ours (the centre of the top-left pixel is (0.5, 0.5)) and so are its axes and its
//! world-to-camera poses, so that nothing is converted but the names of the camera models.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use glam::{DVec2, DVec3};

use crate::{Intrinsics, Pose};

/// Camera models that are read and written, with COLMAP's numbers and parameter orders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum CameraModel {
    /// f, cx, cy
    SimplePinhole = 0,
    /// fx, fy, cx, cy
    Pinhole = 1,
    /// f, cx, cy, k1
    SimpleRadial = 2,
    /// f, cx, cy, k1, k2
    Radial = 3,
    /// fx, fy, cx, cy, k1, k2, p1, p2
    OpenCv = 4,
    /// fx, fy, cx, cy, k1, k2, k3, k4
    OpenCvFisheye = 5,
    /// fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6
    FullOpenCv = 6,
}

/// One camera of a model: a lens and a sensor, shared by any number of images.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapCamera {
    /// Camera model.
    pub model: CameraModel,
    /// Image width, pixels.
    pub width: u64,
    /// Image height, pixels.
    pub height: u64,
    /// The model's parameters in COLMAP's order.
    pub parameters: Vec<f64>,
}

/// A keypoint of an image and the 3D point that it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point2d {
    /// Position, pixels.
    pub position: DVec2,
    /// The point's id, where it has one.
    pub point3d: Option<u64>,
}

/// One posed image of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapImage {
    /// World-to-camera pose.
    pub pose: Pose,
    /// Its camera's id.
    pub camera: u32,
    /// File name relative to the image folder.
    pub name: String,
    /// Keypoints.
    pub points: Vec<Point2d>,
}

/// One observation of a 3D point: image id and index into [`ColmapImage::points`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observation {
    /// Image id.
    pub image: u32,
    /// Index of the keypoint in the image.
    pub point2d: u32,
}

/// One triangulated point.
#[derive(Clone, Debug, PartialEq)]
pub struct Point3d {
    /// Position in the world.
    pub position: DVec3,
    /// Colour, red, green, blue.
    pub colour: [u8; 3],
    /// Mean reprojection error, pixels.
    pub error: f64,
    /// The images that see it.
    pub track: Vec<Observation>,
}

/// A sparse model. Maps are ordered by id, so that the same model is written as the same bytes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// Cameras by id.
    pub cameras: BTreeMap<u32, ColmapCamera>,
    /// Images by id.
    pub images: BTreeMap<u32, ColmapImage>,
    /// Points by id.
    pub points: BTreeMap<u64, Point3d>,
}

/// What can go wrong with a model's files.
#[derive(Debug, thiserror::Error)]
pub enum ColmapError {
    /// A file cannot be opened, read or written.
    #[error("cannot {doing} COLMAP model file {}: {source}", path.display())]
    Io {
        /// `read` or `write`.
        doing: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

impl ColmapCamera {
    /// The camera with these intrinsics, in the smallest model that holds them exactly.
    #[must_use]
    pub fn from_intrinsics(intrinsics: &Intrinsics) -> Self {
        todo!("{intrinsics:?}")
    }

    /// The intrinsics of the camera.
    ///
    /// # Errors
    /// If the number of parameters is wrong or the size does not fit.
    pub fn intrinsics(&self) -> Result<Intrinsics, ColmapError> {
        todo!()
    }
}

impl Model {
    /// Reads the model in `folder`: binary files where there are any, else text. `rigs` and `frames` are not needed and
    /// not read, for the images carry the poses too.
    ///
    /// # Errors
    /// If a file is missing, cut short or malformed, or an id that is referred to does not exist.
    pub fn read(folder: &Path) -> Result<Self, ColmapError> {
        todo!("{folder:?}")
    }

    /// Writes `cameras.bin`, `images.bin` and `points3D.bin` into `folder`, making it where needed, and removes stale
    /// `rigs.bin` and `frames.bin`, whose poses COLMAP 4 would trust over those of the images.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_binary(&self, folder: &Path) -> Result<(), ColmapError> {
        todo!("{folder:?}")
    }

    /// Writes `cameras.txt`, `images.txt` and `points3D.txt`; else as [`Model::write_binary`].
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_text(&self, folder: &Path) -> Result<(), ColmapError> {
        todo!("{folder:?}")
    }
}
