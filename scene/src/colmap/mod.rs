//! COLMAP's sparse models: `cameras`, `images` and `points3D` in binary and text.
//!
//! COLMAP's pixel convention is ours (the centre of the top-left pixel is (0.5, 0.5)) and so are its axes and its
//! world-to-camera poses, so that nothing is converted but the names of the camera models.
//!
//! The layouts are those of COLMAP's documentation ("Output Format") and hold for versions 3.8 to 4.x.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use erfgs_base::FileError;
use glam::{DQuat, DVec2, DVec3};

use crate::{Distortion, Intrinsics, Pose};

mod binary;
mod rigs;
mod text;

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
    /// fx, fy, cx, cy, omega; a pinhole where omega is zero
    Fov = 7,
    /// f, cx, cy, k1
    SimpleRadialFisheye = 8,
    /// f, cx, cy, k1, k2
    RadialFisheye = 9,
    /// fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1; a fisheye where all but k1 to k4 are zero
    ThinPrismFisheye = 10,
    /// fx, fy, cx, cy, k0 to k5, p0, p1, s0 to s3; a fisheye where all but k0 to k3 are zero
    RadTanThinPrismFisheye = 11,
    /// f, cx, cy
    SimpleFisheye = 14,
    /// fx, fy, cx, cy
    Fisheye = 15,
}

/// What to do about other camera models.
const REMEDY: &str = "register with OPENCV, FULL_OPENCV or OPENCV_FISHEYE, or undistort the images";

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
    #[error(transparent)]
    File(#[from] FileError),
    /// There is no model.
    #[error("{} holds no COLMAP model (cameras, images, points3D as .bin or .txt); name the folder that does, often `sparse/0`", path.display())]
    NoModel {
        /// The folder.
        path: PathBuf,
    },
    /// A file cannot be understood.
    #[error("COLMAP model file {}, {at}: {what}; export the model again", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// `byte 17` or `line 4`.
        at: String,
        /// What is wrong.
        what: String,
    },
    /// An id that is referred to does not exist.
    #[error("COLMAP model {}: {what}; the files do not belong together, export the model again", path.display())]
    Reference {
        /// The folder.
        path: PathBuf,
        /// Which reference is broken.
        what: String,
    },
    /// A camera cannot be used.
    #[error("a COLMAP camera of model {model} {what}")]
    Camera {
        /// The camera model's name.
        model: &'static str,
        /// What is wrong.
        what: String,
    },
}

impl CameraModel {
    const ALL: [Self; 14] = [
        Self::SimplePinhole,
        Self::Pinhole,
        Self::SimpleRadial,
        Self::Radial,
        Self::OpenCv,
        Self::OpenCvFisheye,
        Self::FullOpenCv,
        Self::Fov,
        Self::SimpleRadialFisheye,
        Self::RadialFisheye,
        Self::ThinPrismFisheye,
        Self::RadTanThinPrismFisheye,
        Self::SimpleFisheye,
        Self::Fisheye,
    ];

    /// COLMAP's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SimplePinhole => "SIMPLE_PINHOLE",
            Self::Pinhole => "PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::OpenCv => "OPENCV",
            Self::OpenCvFisheye => "OPENCV_FISHEYE",
            Self::FullOpenCv => "FULL_OPENCV",
            Self::Fov => "FOV",
            Self::SimpleRadialFisheye => "SIMPLE_RADIAL_FISHEYE",
            Self::RadialFisheye => "RADIAL_FISHEYE",
            Self::ThinPrismFisheye => "THIN_PRISM_FISHEYE",
            Self::RadTanThinPrismFisheye => "RAD_TAN_THIN_PRISM_FISHEYE",
            Self::SimpleFisheye => "SIMPLE_FISHEYE",
            Self::Fisheye => "FISHEYE",
        }
    }

    /// COLMAP's number, as in `cameras.bin` and in its database.
    #[must_use]
    pub fn id(self) -> i32 {
        self as i32
    }

    /// How many parameters it has.
    #[must_use]
    pub fn parameters(self) -> usize {
        match self {
            Self::SimplePinhole | Self::SimpleFisheye => 3,
            Self::Pinhole | Self::Fisheye | Self::SimpleRadial | Self::SimpleRadialFisheye => 4,
            Self::Radial | Self::RadialFisheye | Self::Fov => 5,
            Self::OpenCv | Self::OpenCvFisheye => 8,
            Self::FullOpenCv | Self::ThinPrismFisheye => 12,
            Self::RadTanThinPrismFisheye => 16,
        }
    }

    /// Whether one focal length is that of both axes.
    fn has_one_focal_length(self) -> bool {
        matches!(
            self,
            Self::SimplePinhole
                | Self::SimpleRadial
                | Self::Radial
                | Self::SimpleRadialFisheye
                | Self::RadialFisheye
                | Self::SimpleFisheye
        )
    }

    /// The lens of the parameters behind the principal point. Coefficients that are all zero give no distortion, except those of
    /// a fisheye, which is the equidistant one then. `None` where a term is not zero that our lenses do not have.
    fn distortion(self, k: &[f64]) -> Option<Distortion> {
        let is_zero = |terms: &[f64]| terms.iter().all(|&term| term == 0.0);
        let fisheye = |k: [f64; 4]| Some(Distortion::KannalaBrandt(k));
        match (self, k) {
            (Self::SimpleFisheye | Self::Fisheye, _) => fisheye([0.0; 4]),
            (Self::SimpleRadialFisheye, &[k1]) => fisheye([k1, 0.0, 0.0, 0.0]),
            (Self::RadialFisheye, &[k1, k2]) => fisheye([k1, k2, 0.0, 0.0]),
            (Self::OpenCvFisheye, &[k1, k2, k3, k4]) => fisheye([k1, k2, k3, k4]),
            (Self::ThinPrismFisheye, &[k1, k2, p1, p2, k3, k4, sx1, sy1]) if is_zero(&[p1, p2, sx1, sy1]) => {
                fisheye([k1, k2, k3, k4])
            }
            (Self::RadTanThinPrismFisheye, &[k0, k1, k2, k3, ref rest @ ..]) if is_zero(rest) => {
                fisheye([k0, k1, k2, k3])
            }
            (Self::ThinPrismFisheye | Self::RadTanThinPrismFisheye, _) => None,
            _ if is_zero(k) => Some(Distortion::None),
            (Self::Fov, _) => None,
            // The shorter models are prefixes: (k1), (k1, k2), (k1, k2, p1, p2).
            _ => {
                let mut all = [0.0; 8];
                all.iter_mut().zip(k).for_each(|(to, from)| *to = *from);
                Some(Distortion::BrownConrady(all))
            }
        }
    }

    fn from_id(id: i32) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.id() == id)
    }

    fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.name() == name)
    }
}

impl ColmapCamera {
    /// The camera with these intrinsics: PINHOLE without distortion, else the smallest model that holds them exactly.
    #[must_use]
    pub fn from_intrinsics(intrinsics: &Intrinsics) -> Self {
        let Intrinsics { width, height, fx, fy, cx, cy, distortion } = *intrinsics;
        let mut parameters = vec![fx, fy, cx, cy];
        let model = match distortion {
            Distortion::None => CameraModel::Pinhole,
            Distortion::BrownConrady(k) if k[4..] == [0.0; 4] => {
                parameters.extend_from_slice(&k[..4]);
                CameraModel::OpenCv
            }
            Distortion::BrownConrady(k) => {
                parameters.extend_from_slice(&k);
                CameraModel::FullOpenCv
            }
            Distortion::KannalaBrandt(k) => {
                parameters.extend_from_slice(&k);
                CameraModel::OpenCvFisheye
            }
        };
        Self { model, width: width.into(), height: height.into(), parameters }
    }

    /// The intrinsics of the camera. Coefficients that are all zero give no distortion, except those of a fisheye.
    ///
    /// # Errors
    /// If the number of parameters is wrong, no camera has such a size or such parameters, or the lens has terms that ours do not.
    pub fn intrinsics(&self) -> Result<Intrinsics, ColmapError> {
        let error = |what| ColmapError::Camera { model: self.model.name(), what };
        let (Ok(width), Ok(height)) = (u32::try_from(self.width), u32::try_from(self.height)) else {
            return Err(error(format!("has images of {} x {} pixels", self.width, self.height)));
        };
        let (focal, rest) = match (self.model, self.parameters.as_slice()) {
            (model, all) if all.len() != model.parameters() => {
                return Err(error(format!("has {} parameters instead of {}", all.len(), model.parameters())));
            }
            (model, [f, rest @ ..]) if model.has_one_focal_length() => ([*f, *f], rest),
            (_, [fx, fy, rest @ ..]) => ([*fx, *fy], rest),
            _ => return Err(error("has no parameters".to_owned())),
        };
        let [cx, cy, k @ ..] = rest else { return Err(error("has no principal point".to_owned())) };
        let Some(distortion) = self.model.distortion(k) else {
            return Err(error(format!(
                "has terms that are not zero ({k:?}) and that our lenses do not have; {REMEDY}"
            )));
        };
        let intrinsics = Intrinsics { width, height, fx: focal[0], fy: focal[1], cx: *cx, cy: *cy, distortion };
        intrinsics.checked().map_err(|wrong| error(format!("cannot be used: {wrong}")))
    }
}

impl Model {
    /// Reads the model in `folder`: binary files where there are any, else text. The files `rigs` and `frames` of newer
    /// versions are not needed, for the images carry their poses too.
    ///
    /// # Errors
    /// If a file is missing, cut short or malformed, or an id that is referred to does not exist.
    pub fn read(folder: &Path) -> Result<Self, ColmapError> {
        let model = if folder.join("cameras.bin").is_file() {
            binary::read(folder)?
        } else if folder.join("cameras.txt").is_file() {
            text::read(folder)?
        } else {
            return Err(ColmapError::NoModel { path: folder.to_owned() });
        };
        model.check_references(folder)?;
        Ok(model)
    }

    /// Writes `cameras.bin`, `images.bin` and `points3D.bin` into `folder`, making it where needed. Removes stale
    /// `rigs` and `frames` files, whose poses COLMAP 4 would trust over those of the images, and files of the other
    /// form.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_binary(&self, folder: &Path) -> Result<(), ColmapError> {
        write_files(folder, "bin", [binary::cameras(self), binary::images(self), binary::points(self)])
    }

    /// Writes `cameras.txt`, `images.txt` and `points3D.txt`; else as [`Model::write_binary`].
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write_text(&self, folder: &Path) -> Result<(), ColmapError> {
        write_files(folder, "txt", [text::cameras(self), text::images(self), text::points(self)])
    }

    fn check_references(&self, folder: &Path) -> Result<(), ColmapError> {
        let broken = |what| Err(ColmapError::Reference { path: folder.to_owned(), what });
        for (id, image) in &self.images {
            if !self.cameras.contains_key(&image.camera) {
                return broken(format!(
                    "image {id} ({}) has the camera {}, which does not exist",
                    image.name, image.camera
                ));
            }
            let missing = image.points.iter().filter_map(|p| p.point3d).find(|id| !self.points.contains_key(id));
            if let Some(point) = missing {
                return broken(format!("image {id} ({}) sees the point {point}, which does not exist", image.name));
            }
        }
        for (id, point) in &self.points {
            for seen in &point.track {
                let keypoints = self.images.get(&seen.image).map(|image| image.points.len());
                if keypoints.is_none_or(|count| seen.point2d as usize >= count) {
                    let (image, keypoint) = (seen.image, seen.point2d);
                    return broken(format!(
                        "point {id} is seen as keypoint {keypoint} of image {image}, which does not exist"
                    ));
                }
            }
        }
        Ok(())
    }
}

const NAMES: [&str; 3] = ["cameras", "images", "points3D"];

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), ColmapError> {
    Ok(erfgs_base::atomic::write(path, bytes).map_err(FileError::when("write COLMAP model file", path))?)
}

fn write_files(folder: &Path, extension: &str, files: [Vec<u8>; 3]) -> Result<(), ColmapError> {
    for (name, bytes) in NAMES.iter().zip(files) {
        write_file(&folder.join(name).with_extension(extension), &bytes)?;
    }
    let other = if extension == "bin" { "txt" } else { "bin" };
    let stale = NAMES.iter().map(|name| (*name, other));
    let stale = stale.chain(["rigs", "frames"].into_iter().flat_map(|name| [(name, "bin"), (name, "txt")]));
    for (name, extension) in stale {
        let path = folder.join(name).with_extension(extension);
        match std::fs::remove_file(&path) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                return Err(FileError { doing: "remove COLMAP model file", path, source }.into());
            }
            _ => {}
        }
    }
    Ok(())
}

/// The pose of a quaternion as stored, normalised where it is not a unit already; `None` if it is no rotation.
fn pose(wxyz: [f64; 4], translation: [f64; 3]) -> Option<Pose> {
    let [w, x, y, z] = wxyz;
    let stored = DQuat::from_xyzw(x, y, z, w);
    let length = stored.length();
    let usable = length.is_finite() && length > 1e-6 && translation.iter().all(|t| t.is_finite());
    let rotation = if (length - 1.0).abs() < 1e-9 { stored } else { stored * (1.0 / length) };
    usable.then_some(Pose { rotation, translation: translation.into() })
}

#[cfg(test)]
mod tests;
