//! A rig from images of its surroundings: structure from motion.
//!
//! 1. COLMAP arranges the cameras several times ([`Setting`]): with other features, matches and seeds each time.
//! 2. The arrangements are laid over each other ([`align`](align::align)). Where texture repeats, a run can place a camera
//!    metres off and report a small reprojection error; that two independent runs agree on it is unlikely.
//! 3. What runs agree on is made dense: matching along the now known epipolar lines finds many times more points, and the
//!    bundle adjusted to them gives the poses and their covariances.

mod afford;
mod agree;
pub mod align;
mod error;
mod fit;
mod options;
mod place;
mod refine;
mod register;
mod result;
mod run;
mod tracks;
mod views;

use std::{fmt, fs, path::Path};

use erfgs_base::FileError;
use erfgs_scene::Pose;
use glam::{DQuat, DVec3};

pub use afford::{Reduced, reduced};
pub use error::SfmError;
pub use fit::{CameraFit, FitOptions, RigFit, fit};
pub use options::{Setting, SfmOptions};
pub use register::{RegisterOptions, register};
pub use views::{CameraView, KnownIntrinsics, read_model_views, read_still_views, read_views};

use self::{
    agree::{Agreement, Candidate, agree, alike},
    align::spread,
    place::Known,
    refine::{Adjusted, Gauge, Pass, adjust, tracks},
    run::{Placed, Run},
};
use crate::{
    colmap::{Colmap, database::Keypoints},
    evidence::Evidence,
    geometry::Similarity,
};
use erfgs_scene::rig_file::RigFile;

/// What the calibration is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SfmStep {
    /// Enlarging and writing the images.
    Images,
    /// COLMAP extracts features.
    Features,
    /// Features are matched.
    Matching,
    /// COLMAP verifies the matches, of all pairs at once.
    Verifying,
    /// COLMAP builds models.
    Mapping,
    /// More points, and the bundle.
    Refining,
}

impl fmt::Display for SfmStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Images => "images",
            Self::Features => "features",
            Self::Matching => "matching",
            Self::Verifying => "verifying matches",
            Self::Mapping => "mapping",
            Self::Refining => "refining",
        })
    }
}

/// Is told how many items of a stage are done, of how many.
pub type Progress<'a> = &'a (dyn Fn(SfmStep, usize, usize) + Sync);

/// Epipolar bands: the first catches what a run has placed some pixels off, the last keeps what fits.
const PASSES: [Pass; 2] = [Pass { name: "wide", band_px: 3.0 }, Pass { name: "narrow", band_px: 2.0 }];
/// Poses of two runs are alike within this share of the arrangement's size, with intrinsics known and unknown. Adjusted to
/// the same features, right runs of the Panoptic rig differ by up to 0.0014 and 0.021; a wrong one is off by tens of percent.
const ALIKE: [f64; 2] = [0.02, 0.05];
/// ... and within this angle, radians.
const ALIKE_ANGLE: f64 = 0.035;
/// A camera placed against the others' points needs so many of them.
const FEWEST_RESECTED: usize = 30;

/// How a doubtful camera was settled.
#[derive(Clone, Debug, PartialEq)]
enum Doubt {
    /// Placed against the points of the others, where this run has it too.
    Confirmed(usize, usize),
    /// Placed against so many points of the others, where no run has it.
    Alone(usize),
    /// Not placed.
    Open,
}

/// Everything between the runs and the result.
struct State<'a> {
    views: &'a [CameraView],
    options: &'a SfmOptions,
    runs: Vec<Run>,
    candidates: Vec<Candidate>,
    evidence: Evidence,
}

/// Calibrates a rig from one image of each camera, with intermediate files below `work_dir`.
///
/// # Errors
/// If COLMAP does not run, finds no model, or independent runs contradict each other.
pub fn sfm(
    views: &[CameraView],
    options: &SfmOptions,
    work_dir: &Path,
    progress: Progress<'_>,
) -> Result<(RigFile, Evidence), SfmError> {
    if views.len() < 3 {
        return Err(SfmError::TooFewViews { path: work_dir.into(), found: views.len() });
    }
    views.iter().try_for_each(CameraView::check)?;
    let scale = options.scale.as_ref().map(|scale| ends_of(views, scale)).transpose()?;
    let colmap = Colmap::find(&options.colmap)?;
    let io = FileError::when("make a folder in", work_dir);
    let work = tempfile::Builder::new().prefix("sfm-").tempdir_in(work_dir).map_err(&io)?;
    let mut state = State { views, options, runs: Vec::new(), candidates: Vec::new(), evidence: Evidence::default() };
    let mut agreement = None;
    for (number, setting) in options.settings.iter().enumerate() {
        let folder = work.path().join(number.to_string());
        fs::create_dir_all(&folder).map_err(&io)?;
        let run = run::run(views, setting, &colmap, options.threads, &folder, progress)?;
        state.add(run, progress)?;
        agreement = state.agreement();
        if agreement.as_ref().is_some_and(|found| found.verdicts.iter().all(agree::Verdict::agreed)) {
            break;
        }
    }
    let agreement = state.judge(agreement)?;
    state.finish(&agreement, scale, &colmap.version(), progress)
}

fn ends_of(views: &[CameraView], (a, b, metres): &(String, String, f64)) -> Result<([usize; 2], f64), SfmError> {
    let find = |name: &String| {
        views.iter().position(|view| view.name == *name).ok_or_else(|| SfmError::NoCamera {
            camera: name.clone(),
            what: "as an end of the known distance",
            has: result::names(views, 0..views.len()),
        })
    };
    Ok(([find(a)?, find(b)?], *metres))
}

impl State<'_> {
    fn features(&self) -> &[Keypoints] {
        self.runs.first().map_or(&[], |run| &run.features)
    }

    /// Adjusts a run's model to the features of the first run, and keeps both.
    fn add(&mut self, run: Run, progress: Progress<'_>) -> Result<(), SfmError> {
        let name = run.name.clone();
        let (mut cameras, depths) = (run.cameras.clone(), run.depths);
        self.runs.push(run);
        if cameras.iter().flatten().count() >= 3 {
            let mut room = [0.5 * depths[0], 1.5 * depths[1]];
            for _ in 0..PASSES.len() {
                let adjusted = self.pass(&cameras, room, &PASSES[0], &self_gauge(&cameras), progress)?;
                cameras = adjusted.cameras(self.views.len());
                room = adjusted.depths().unwrap_or(room);
                self.keep(&format!("{name}, {}", PASSES[0].name), &adjusted);
            }
        }
        self.candidates.push(Candidate { name, cameras });
        Ok(())
    }

    fn pass(
        &self,
        cameras: &[Option<Placed>],
        depths: [f64; 2],
        pass: &Pass,
        gauge: &Gauge,
        progress: Progress<'_>,
    ) -> Result<Adjusted, SfmError> {
        let found = tracks(cameras, self.features(), depths, pass, progress);
        adjust(self.views, cameras, self.features(), found, gauge)
    }

    fn keep(&mut self, name: &str, adjusted: &Adjusted) {
        for (step, solution) in &adjusted.solutions {
            self.evidence.pass(format!("{name}, {step}"), solution);
        }
    }

    fn agreement(&self) -> Option<Agreement> {
        let unknown = self.views.iter().any(|view| view.intrinsics.is_none());
        agree(&self.candidates, ALIKE[usize::from(unknown)], ALIKE_ANGLE)
    }

    /// Refuses what cannot be believed.
    fn judge(&self, agreement: Option<Agreement>) -> Result<Agreement, SfmError> {
        let count = self.views.len();
        let runs = result::runs_in_words(&self.runs);
        let placed = |run: &Run| run.cameras.iter().flatten().count();
        if self.runs.iter().all(|run| placed(run) < 3) {
            return Err(SfmError::NoModel { views: count, runs });
        }
        let Some(agreement) = agreement else {
            let doubtful = result::names(self.views, 0..count);
            return Err(SfmError::Disagreement { agree: 0, views: count, runs, doubtful });
        };
        let nowhere = |view: &usize| agreement.verdicts[*view].placed.is_none();
        if let Some(group) =
            self.runs.iter().flat_map(|run| &run.others).find(|g| g.len() >= 3 && g.iter().all(nowhere))
        {
            let first = result::names(self.views, (0..count).filter(|view| !nowhere(view)));
            let second = result::names(self.views, group.iter().copied());
            return Err(SfmError::Disconnected { first, second });
        }
        let agreed = agreement.verdicts.iter().filter(|verdict| verdict.agreed()).count();
        if agreed < 3.max(count.div_ceil(2)) {
            let doubtful = (0..count).filter(|view| !agreement.verdicts[*view].agreed());
            let doubtful = result::names(self.views, doubtful);
            return Err(SfmError::Disagreement { agree: agreed, views: count, runs, doubtful });
        }
        Ok(agreement)
    }

    /// Adjusts what is agreed on, settles what is not, and adjusts again.
    fn finish(
        mut self,
        agreement: &Agreement,
        scale: Option<([usize; 2], f64)>,
        version: &str,
        progress: Progress<'_>,
    ) -> Result<(RigFile, Evidence), SfmError> {
        let verdicts = &agreement.verdicts;
        let mut cameras: Vec<Option<Placed>> =
            verdicts.iter().map(|verdict| verdict.placed.filter(|_| verdict.agreed())).collect();
        let reference = self.runs[agreement.reference].depths;
        let mut depths = [0.5 * reference[0], 1.5 * reference[1]];
        let mut adjusted = self.pass(&cameras, depths, &PASSES[0], &self_gauge(&cameras), progress)?;
        self.keep("agreed cameras", &adjusted);
        cameras = adjusted.cameras(self.views.len());
        depths = adjusted.depths().unwrap_or(depths);
        let doubts = self.settle(agreement, &mut cameras, &adjusted);
        for pass in &PASSES {
            let gauge = self.scaled(&mut cameras, &mut depths, scale)?;
            adjusted = self.pass(&cameras, depths, pass, &gauge, progress)?;
            self.keep(&format!("all cameras, {}", pass.name), &adjusted);
            cameras = adjusted.cameras(self.views.len());
            depths = adjusted.depths().unwrap_or(depths);
        }
        result::result(self, agreement, &doubts, &adjusted, scale.is_some(), version)
    }

    /// Places the cameras that runs do not agree on against the points of the others.
    fn settle(&self, agreement: &Agreement, cameras: &mut [Option<Placed>], adjusted: &Adjusted) -> Vec<Option<Doubt>> {
        let mut doubts = vec![None; self.views.len()];
        if cameras.iter().all(Option::is_some) {
            return doubts;
        }
        let points = adjusted.points();
        let known = Known::new(&points, self.features());
        for view in (0..self.views.len()).filter(|&view| !agreement.verdicts[view].agreed()) {
            let verdict = &agreement.verdicts[view];
            let entries: Vec<(usize, Placed)> = verdict
                .placed
                .map(|placed| (verdict.alike[0], placed))
                .into_iter()
                .chain(verdict.others.clone())
                .collect();
            doubts[view] = Some(Doubt::Open);
            let given = self.views[view].intrinsics;
            // Without intrinsics, those of a run that may be wrong are all there is to try.
            let tried = given.into_iter().chain(entries.iter().map(|(_, placed)| placed.intrinsics));
            let found = tried.filter_map(|k| known.place(&k, &self.features()[view], view as u64));
            let Some(found) = found.max_by_key(|found| found.placed.points) else { continue };
            tracing::debug!(
                "{}: {} of {} correspondences' points, {:.2} px",
                self.views[view].name,
                found.placed.points,
                found.tried,
                found.rms_px
            );
            if found.placed.points < FEWEST_RESECTED {
                continue;
            }
            let same = entries.iter().find(|(_, entry)| alike(&entry.pose, &found.placed.pose, agreement.tolerance));
            let points = found.placed.points;
            doubts[view] = Some(same.map_or(Doubt::Alone(points), |(run, _)| Doubt::Confirmed(*run, points)));
            cameras[view] = Some(found.placed);
        }
        doubts
    }

    /// Puts the world into the camera that sees most, and scales it: to metres, or to the size 1.
    fn scaled(
        &self,
        cameras: &mut [Option<Placed>],
        depths: &mut [f64; 2],
        scale: Option<([usize; 2], f64)>,
    ) -> Result<Gauge, SfmError> {
        let mut gauge = self_gauge(cameras);
        let Some((own_ends, _)) = gauge.distance else { return Ok(gauge) };
        let Some(first) = cameras[own_ends[0]] else { return Ok(gauge) };
        let centre = |view: usize| cameras[view].as_ref().map(|camera| camera.pose.centre());
        let (ends, factor) = match scale {
            Some((ends, metres)) => {
                let missing = |view: usize| SfmError::NoCamera {
                    camera: self.views[view].name.clone(),
                    what: "as an end of the known distance",
                    has: result::names(self.views, (0..cameras.len()).filter(|view| cameras[*view].is_some())),
                };
                let [a, b] = ends.map(|view| centre(view).ok_or_else(|| missing(view)));
                (ends, metres / a?.distance(b?))
            }
            None => {
                let poses: Vec<Option<Pose>> = cameras.iter().map(|camera| camera.as_ref().map(|c| c.pose)).collect();
                (own_ends, 1.0 / spread(&poses))
            }
        };
        let rotation: DQuat = first.pose.rotation;
        let pose = Pose { rotation, translation: -(rotation * first.pose.centre() * factor) };
        let to = Similarity { scale: factor, pose };
        for camera in cameras.iter_mut().flatten() {
            camera.pose = to.of_camera(&camera.pose);
        }
        *depths = depths.map(|depth| depth * factor);
        let centre = |view: usize| cameras[view].as_ref().map_or(DVec3::ZERO, |camera| camera.pose.centre());
        let length = scale.map_or_else(|| centre(ends[0]).distance(centre(ends[1])), |(_, metres)| metres);
        gauge.distance = Some((ends, length));
        Ok(gauge)
    }
}

/// The camera that sees most stays, and so does its distance from the one farthest from it.
fn self_gauge(cameras: &[Option<Placed>]) -> Gauge {
    let points = |view: usize| cameras[view].as_ref().map_or(0, |camera| camera.points);
    let reference = (0..cameras.len()).max_by_key(|&view| (points(view), std::cmp::Reverse(view))).unwrap_or(0);
    let centre = cameras[reference].as_ref().map_or(DVec3::ZERO, |camera| camera.pose.centre());
    let distance = |view: usize| cameras[view].as_ref().map_or(0.0, |camera| camera.pose.centre().distance(centre));
    let far = (0..cameras.len()).max_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap_or(0);
    Gauge { fixed: vec![reference], distance: Some(([reference, far], distance(far))) }
}
