//! What can be chosen about the initial point cloud.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

use erfgs_calibrate::colmap::ColmapProgram;

/// How the points are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Method {
    /// SIFT features and triangulation by COLMAP, matching along the known epipolar lines by erfgs.
    #[default]
    #[serde(rename = "colmap")]
    Colmap,
    /// Dense plane sweep. Needs no COLMAP.
    #[serde(rename = "sweep")]
    Sweep,
    /// Both: COLMAP's points, filled up with the plane sweep's.
    #[serde(rename = "colmap+sweep")]
    ColmapSweep,
    /// Uniform in the box that the cameras see.
    #[serde(rename = "random")]
    Random,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 4] = [Self::Colmap, Self::Sweep, Self::ColmapSweep, Self::Random];

    /// The name, as in manifests and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "colmap",
            Self::Sweep => "sweep",
            Self::ColmapSweep => "colmap+sweep",
            Self::Random => "random",
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|method| method.name() == text).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|method| method.name()).collect();
            format!("unknown point cloud method '{text}': it is one of {}", names.join(", "))
        })
    }
}

/// Which instants of the recording are used. An instant is a time at which at least three training cameras have a frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameChoice {
    /// So many, spread evenly from the first to the last; 3 = first, middle, last; 1 = the middle one.
    Spread(usize),
    /// Those whose image files have these names, without folder and extension.
    Named(Vec<String>),
}

impl Default for FrameChoice {
    fn default() -> Self {
        Self::Spread(3)
    }
}

/// Which keypoints of two images may belong together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MatchOptions {
    /// Greatest distance of a keypoint from the other's epipolar line, pixels of the dataset's images.
    pub band_px: f64,
    /// The nearest descriptor must be closer (as an angle) than this share of the second nearest.
    pub ratio: f64,
    /// Greatest angle between two matching descriptors, radians.
    pub max_descriptor_angle: f64,
    /// Greatest angle between the two rays, degrees: SIFT does not survive more.
    pub max_ray_angle_deg: f64,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self { band_px: 1.0, ratio: 0.85, max_descriptor_angle: 0.7, max_ray_angle_deg: 40.0 }
    }
}

/// Options of [`Method::Colmap`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ColmapOptions {
    /// Which COLMAP.
    pub program: ColmapProgram,
    /// The images are enlarged by this factor (Lanczos) before features are extracted.
    pub enlarge: u32,
    /// SIFT's limit of features per image.
    pub max_features: u32,
    /// SIFT's threshold on the difference of Gaussians.
    pub peak_threshold: f64,
    /// SIFT's threshold on edge-like features.
    pub edge_threshold: f64,
    /// When two features of different images are taken for one point.
    pub matching: MatchOptions,
    /// Points observed by fewer views are dropped.
    pub min_track: u32,
    /// COLMAP's greatest reprojection error of an observation, pixels of the enlarged images.
    pub max_error_px: f64,
    /// COLMAP's smallest angle between two rays of a point, degrees.
    pub min_ray_angle_deg: f64,
    /// Points of different instants that fall into one cell of this size are one point, metres; 0 keeps all.
    pub merge_m: f64,
}

impl Default for ColmapOptions {
    fn default() -> Self {
        Self {
            program: ColmapProgram::Auto,
            enlarge: 2,
            max_features: 8192,
            peak_threshold: 0.02 / 3.0,
            edge_threshold: 10.0,
            matching: MatchOptions::default(),
            min_track: 3,
            max_error_px: 4.0,
            min_ray_angle_deg: 1.5,
            merge_m: 0.01,
        }
    }
}

/// Options of [`Method::Sweep`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SweepOptions {
    /// Images are shrunk by a whole factor until they are at most this wide, pixels.
    pub max_width: u32,
    /// Distance of the depth planes, which are evenly spaced in inverse depth: how far a point moves in the middle one of
    /// the neighbours from plane to plane, pixels of the shrunk images.
    pub plane_step_px: f64,
    /// How many cameras each depth map is compared with.
    pub neighbours: u32,
    /// Side of the correlation window, pixels; odd.
    pub window: u32,
    /// Least correlation (ZNCC, mean of the better half of the neighbours, three at most) of a depth.
    pub min_score: f64,
    /// How many other depth maps must agree.
    pub min_consistent: u32,
    /// Greatest relative difference of two depths that agree.
    pub depth_tolerance: f64,
    /// How many instants get depth maps, spread over those chosen; 1 = the middle one.
    pub instants: u32,
    /// Points that fall into one cell of this size are one point, metres.
    pub voxel_m: f64,
}

impl Default for SweepOptions {
    fn default() -> Self {
        Self {
            max_width: 480,
            plane_step_px: 1.5,
            neighbours: 4,
            window: 9,
            min_score: 0.8,
            min_consistent: 2,
            depth_tolerance: 0.015,
            instants: 1,
            voxel_m: 0.015,
        }
    }
}

/// Options of the points of what moves, from the silhouettes of what differs from a camera's usual look.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HullOptions {
    /// At how many instants, spread over the recording; 0 leaves these points out. There are none either where a camera
    /// has fewer than four frames.
    pub instants: u32,
    /// How much a pixel must differ from its usual look; 1 is white against black.
    pub threshold: f64,
    /// Fewer views cannot say where something is.
    pub min_views: u32,
    /// Size of the cells of space, pixels where the cameras look at.
    pub cell_px: f64,
    /// Greatest number of points, over all instants.
    pub max_points: u32,
}

impl Default for HullOptions {
    fn default() -> Self {
        Self { instants: 12, threshold: 0.08, min_views: 4, cell_px: 2.0, max_points: 18_000 }
    }
}

/// Options of the initial point cloud.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CloudOptions {
    /// How the points are found.
    pub method: Method,
    /// Which instants are used.
    pub frames: FrameChoice,
    /// `[nearest, farthest]` depth of a point in the cameras that see it, metres; without it, taken from how the cameras
    /// stand.
    pub depth_m: Option<[f64; 2]>,
    /// `[lower, upper]` corner of the box that points must lie in, metres.
    pub bounds_m: Option<[[f64; 3]; 2]>,
    /// Greatest number of points; thinned on a voxel grid if there are more. COLMAP's points stay before the sweep's.
    /// The points of what moves and random points do not count.
    pub max_points: Option<usize>,
    /// How many points [`Method::Random`] makes.
    pub random_points: usize,
    /// Seed of [`Method::Random`].
    pub seed: u64,
    /// Threads that COLMAP may use; 0 = all.
    pub threads: usize,
    /// Options of COLMAP and the matching.
    pub colmap: ColmapOptions,
    /// Options of the plane sweep.
    pub sweep: SweepOptions,
    /// Options of the points of what moves.
    pub hull: HullOptions,
}

impl Default for CloudOptions {
    fn default() -> Self {
        Self {
            method: Method::default(),
            frames: FrameChoice::default(),
            depth_m: None,
            bounds_m: None,
            max_points: Some(60_000),
            random_points: 10_000,
            seed: 0,
            threads: 0,
            colmap: ColmapOptions::default(),
            sweep: SweepOptions::default(),
            hull: HullOptions::default(),
        }
    }
}
