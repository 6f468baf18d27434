//! The initial point cloud of a dataset whose poses are known.
//!
//! Training cameras with frames take part; held-out and event-only cameras do not.

mod error;
mod options;

use std::{collections::BTreeMap, fmt, path::Path};

use erfgs_session::{Dataset, dataset::PointCloudFile};
use glam::DVec3;

pub use error::CloudError;
pub use options::{CloudOptions, ColmapOptions, ColmapProgram, FrameChoice, MatchOptions, Method, SweepOptions};

/// One point of the cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// World position, metres.
    pub position: DVec3,
    /// Median colour of the views that observe it, sRGB.
    pub colour: [u8; 3],
    /// How many views observe it; 0 for a random point.
    pub track: u32,
    /// Mean reprojection error over those views, pixels of the dataset's images; 0 where no error is defined.
    pub reprojection_error_px: f32,
    /// The instant it was seen at, nanoseconds on the session clock: the first of them, if it was found at several.
    pub t_ns: i64,
    /// At how many of the instants used a point was found at this place: more than one means that it stands still.
    pub instants: u32,
}

/// The initial point cloud and how it was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// The points.
    pub points: Vec<CloudPoint>,
    /// The method.
    pub method: Method,
    /// The method's parameters and what it counted on the way (images, features, matches, points before merging).
    pub parameters: BTreeMap<String, serde_json::Value>,
}

/// What the making of a cloud is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Reading, enlarging and writing the images.
    Images,
    /// COLMAP's feature extraction.
    Features,
    /// Matching along epipolar lines.
    Matching,
    /// COLMAP's triangulation.
    Triangulation,
    /// Depth maps by plane sweep.
    Sweep,
    /// Merging depth maps or points.
    Fusion,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Images => "images",
            Self::Features => "features",
            Self::Matching => "matching",
            Self::Triangulation => "triangulation",
            Self::Sweep => "plane sweep",
            Self::Fusion => "fusion",
        })
    }
}

/// Is told how far the making of a cloud has come: the stage, and how many of its items are done. May be called from
/// several threads.
pub type Progress<'a> = &'a (dyn Fn(Stage, usize, usize) + Sync);

/// Makes the initial point cloud of `dataset`.
///
/// Intermediate files (enlarged images, COLMAP's database and models) go to a fresh folder inside `work_dir`, which is
/// removed before the function returns.
///
/// # Errors
/// Fewer than three training cameras with frames, a degenerate pose, an unreadable image, a missing or failing COLMAP,
/// too few features or points: see [`CloudError`].
pub fn initial_cloud(
    dataset: &Dataset,
    options: &CloudOptions,
    work_dir: &Path,
    progress: Progress<'_>,
) -> Result<Cloud, CloudError> {
    let _ = (dataset, options, work_dir, progress);
    todo!()
}

/// Writes `points.ply` into the dataset's folder and names it, with the method and its parameters, in the manifest,
/// which is saved.
///
/// # Errors
/// When a file cannot be written.
pub fn attach(dataset: &mut Dataset, cloud: &Cloud) -> Result<PointCloudFile, CloudError> {
    let _ = (dataset, cloud);
    todo!()
}
