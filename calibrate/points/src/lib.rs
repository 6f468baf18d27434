//! The initial point cloud of a dataset whose poses are known.
//!
//! Training cameras with frames take part; held-out and event-only cameras do not.

mod bodies;
mod colmap;
mod error;
mod event_fit;
mod hull;
mod options;
mod photo;
mod random;
mod rig;
mod sweep;
mod thin;

use std::{collections::BTreeMap, fmt, path::Path};

use erfgs_dataset::{Dataset, PointCloudFile, PointRun};
use erfgs_scene::ply::PointCloud;
use glam::DVec3;
use serde_json::{Value, json};

pub use erfgs_calibrate::colmap::{Colmap, ColmapProgram};

pub use bodies::{
    BodyEdits, BodyOptions, BodyProgress, BodyStep, FoundBodies, SplitBody, TurnBody, attach_bodies, find_bodies,
    noted_rate,
};
pub use error::CloudError;
pub use event_fit::{EventFit, event_fit};
pub use options::{CloudOptions, ColmapOptions, FrameChoice, HullOptions, MatchOptions, Method, SweepOptions};

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
    /// Whether it is known to lie on something that moves (from the silhouettes of what does).
    pub moving: bool,
}

/// The initial point cloud and how it was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// The points, ordered by time; of one time, those first that were found again at others.
    pub points: Vec<CloudPoint>,
    /// How the points were found.
    pub method: Method,
    /// The method's parameters and what it counted on the way: images, features, matches, points before merging, and as
    /// [`PointCloudFile::RUNS`] which points in a row share an instant ([`PointRun`]).
    pub parameters: BTreeMap<String, serde_json::Value>,
}

/// What the making of a cloud is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CloudStep {
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
    /// Silhouettes of what moves.
    Silhouettes,
}

impl fmt::Display for CloudStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Images => "images",
            Self::Features => "features",
            Self::Matching => "matching",
            Self::Triangulation => "triangulation",
            Self::Sweep => "plane sweep",
            Self::Fusion => "fusion",
            Self::Silhouettes => "silhouettes",
        })
    }
}

/// Is told how far the making of a cloud has come: the stage, and how many of its items are done. May be called from
/// several threads.
pub type Progress<'a> = &'a (dyn Fn(CloudStep, usize, usize) + Sync);

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
    let rig = rig::Rig::new(dataset, &options.frames)?;
    let bounds = random::check_bounds(options.bounds_m)?;
    let reach = rig::reach(&rig.stations, options.depth_m, bounds)?;
    let mut parameters = describe(&rig, options, &reach);
    let photos = (0..rig.instants.len()).map(|instant| rig.photos(instant)).collect::<Result<Vec<_>, _>>()?;
    let colmap = |parameters: &mut Counts| -> Result<Vec<CloudPoint>, CloudError> {
        let found = colmap::points(&rig, &photos, options, &reach, work_dir, progress, parameters)?;
        let found = inside(found, bounds);
        parameters.insert("points_before_merging".into(), found.len().into());
        Ok(thin::merge_instants(found, options.colmap.merge_m))
    };
    let sweep = |parameters: &mut Counts| -> Result<Vec<CloudPoint>, CloudError> {
        Ok(inside(sweep::points(&rig, &photos, options, &reach, progress, parameters)?, bounds))
    };
    let (mut points, first) = match options.method {
        Method::Colmap => (colmap(&mut parameters)?, 0),
        Method::Sweep => (sweep(&mut parameters)?, 0),
        Method::ColmapSweep => {
            let mut points = colmap(&mut parameters)?;
            let first = points.len();
            points.extend(sweep(&mut parameters)?);
            (points, first)
        }
        Method::Random => {
            let middle = rig.instants.len() / 2;
            (random::points(&rig, middle, &photos[middle], &reach, bounds, options.random_points, options.seed), 0)
        }
    };
    if points.len() < FEWEST_POINTS {
        let (method, found) = (options.method.name(), points.len());
        return Err(CloudError::TooFewPoints { method, found, needed: FEWEST_POINTS });
    }
    if let Some(most) = options.max_points {
        points = thin::limit(points, first, most);
    }
    if options.hull.instants > 0 {
        points.extend(inside(hull::points(&rig, options, &reach, progress, &mut parameters)?, bounds));
    }
    points.sort_by_key(|point| (point.t_ns, point.moving, point.instants == 1));
    parameters.insert(PointCloudFile::RUNS.into(), json!(runs(&points)));
    Ok(Cloud { points, method: options.method, parameters })
}

/// The points in a row that share an instant. With it the time of each point in `points.ply` is known.
fn runs(points: &[CloudPoint]) -> Vec<PointRun> {
    let kind = |point: &CloudPoint| (point.t_ns, point.instants > 1, point.moving);
    points
        .chunk_by(|a, b| kind(a) == kind(b))
        .map(|run| {
            let (t_ns, found_again, moving) = kind(&run[0]);
            PointRun { t_ns, found_again, moving, count: run.len() as u64 }
        })
        .collect()
}

/// What is counted on the way, and the parameters, as they go into the manifest.
type Counts = BTreeMap<String, Value>;

/// Fewer points cannot start a reconstruction.
const FEWEST_POINTS: usize = 10;

fn describe(rig: &rig::Rig<'_>, options: &CloudOptions, reach: &rig::Reach) -> Counts {
    let mut parameters = Counts::from([
        ("cameras".into(), json!(rig.stations.iter().map(|station| &station.camera.name).collect::<Vec<_>>())),
        ("instants_ns".into(), json!(rig.instants.iter().map(|instant| instant.t_ns).collect::<Vec<_>>())),
        ("depth_m".into(), json!(reach.depth_m)),
        ("bounds_m".into(), json!(options.bounds_m)),
        ("max_points".into(), json!(options.max_points)),
    ]);
    if matches!(options.method, Method::Colmap | Method::ColmapSweep) {
        parameters.insert("colmap".into(), json!(options.colmap));
    }
    if matches!(options.method, Method::Sweep | Method::ColmapSweep) {
        parameters.insert("sweep".into(), json!(options.sweep));
    }
    if options.hull.instants > 0 {
        parameters.insert("hull".into(), json!(options.hull));
    }
    if options.method == Method::Random {
        parameters.insert("seed".into(), json!(options.seed));
    }
    parameters
}

fn inside(mut points: Vec<CloudPoint>, bounds: Option<[DVec3; 2]>) -> Vec<CloudPoint> {
    if let Some([low, high]) = bounds {
        points.retain(|point| point.position.cmpge(low).all() && point.position.cmple(high).all());
    }
    points
}

/// Writes `points.ply` into the dataset's folder and names it, with the method and its parameters, in the manifest,
/// which is saved.
///
/// # Errors
/// When a file cannot be written.
pub fn attach(dataset: &mut Dataset, cloud: &Cloud) -> Result<PointCloudFile, CloudError> {
    let ply = PointCloud {
        positions: cloud.points.iter().map(|point| point.position.as_vec3().to_array()).collect(),
        colours: cloud.points.iter().map(|point| point.colour).collect(),
    };
    Ok(dataset.replace_points(&ply, cloud.method.name(), cloud.parameters.clone())?)
}
