//! Whether a rig's cameras stand where its calibration has them, by what they see.
//!
//! What stands still in a room is at one place for all cameras. Features of it that three cameras and more agree on are points
//! in space, and a camera that had no share in them is held against these: where it should see them by its calibration, and
//! from where it would see them as it does (three-point resection of blind matches). A camera of a later day, one that was
//! knocked or one that hangs upside down is far from where it would have to be; the camera without which the others fit each
//! other best is set aside, and the rest are held against each other again.

use std::{fmt, path::Path};

use erfgs_base::FileError;
use erfgs_scene::{Pose, image::Resample};

use super::{
    CameraView, Progress, Setting, SfmError,
    align::spread,
    place::Known,
    refine::{FEWEST_VIEWS, Pass, matches},
    register::{DEPTHS, RegisterOptions},
    run::{Placed, extract},
    tracks::{PairMatches, Track, components, triangulate},
};
use crate::{
    colmap::{Colmap, ColmapProgram, database::Keypoints},
    statistics::median,
};

/// How a rig is held against what it sees.
#[derive(Clone, Debug, PartialEq)]
pub struct FitOptions {
    /// The COLMAP whose features are used.
    pub colmap: ColmapProgram,
    /// Threads; 0 = all.
    pub threads: usize,
    /// A camera that sees fewer points of the others cannot be judged.
    pub fewest_points: usize,
    /// Points that a camera sees farther than this from where it should, in the median, speak against its pose, pixels.
    pub limit_px: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { colmap: ColmapProgram::Auto, threads: 0, fewest_points: 20, limit_px: 1.5 }
    }
}

/// Where a camera stands by what it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraFit {
    /// How many points of the other cameras it sees.
    pub points: usize,
    /// How many points it shares with them if it stands where its calibration has it.
    pub shared: usize,
    /// How far it sees them from where its calibration has them: the median, pixels.
    pub off_px: f64,
    /// The same from where it would have to stand: root mean square, pixels.
    pub left_px: f64,
    /// From where its calibration has it to where it would have to stand, in the rig's unit of length.
    pub moved: f64,
    /// From how its calibration has it turned to how it would have to be turned, degrees.
    pub turned_deg: f64,
}

/// A rig held against what it sees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RigFit {
    /// Of each view; `None` where it shares too few points with the others to tell.
    pub cameras: Vec<Option<CameraFit>>,
    /// The views that do not fit the others, the worst first.
    pub wrong: Vec<usize>,
    /// The views that fit each other.
    pub right: Vec<usize>,
}

impl RigFit {
    /// Whether enough cameras fit each other to say of another that it is the one that does not.
    #[must_use]
    pub fn has_majority(&self) -> bool {
        self.right.len() >= FEWEST_VIEWS && self.right.len() > self.wrong.len()
    }

    /// How many cameras could be judged.
    #[must_use]
    pub fn judged(&self) -> usize {
        self.cameras.iter().flatten().count()
    }

    /// What speaks against the poses of `names`, cameras in the order of the views; `None` where nothing does.
    #[must_use]
    pub fn complaint(&self, names: &[&str]) -> Option<String> {
        let name = |view: &usize| names.get(*view).copied().unwrap_or_default();
        let of = |view: &usize| Some(format!("{} {}", name(view), self.cameras.get(*view)?.as_ref()?));
        let list: Vec<String> = self.wrong.iter().filter_map(of).collect();
        let list = list.join("; ");
        if self.wrong.is_empty() {
            None
        } else if self.has_majority() {
            let cameras = if self.wrong.len() == 1 { "a camera does" } else { "some cameras do" };
            let right: Vec<&str> = self.right.iter().map(name).collect();
            Some(format!(
                "{cameras} not stand where the calibration says, while {} fit each other: {list}",
                right.join(", ")
            ))
        } else {
            Some(format!(
                "the cameras do not stand as the calibration says, and too few fit each other to say which moved: {list}"
            ))
        }
    }
}

impl fmt::Display for CameraFit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { points, off_px, left_px, moved, turned_deg, .. } = self;
        write!(f, "sees {points} points of the others {off_px:.1} px beside where it should")?;
        write!(f, " (and {left_px:.1} px if it stands {moved:.3} m away and is turned by {turned_deg:.1}°")?;
        f.write_str(if *turned_deg > UPSIDE_DOWN_DEG { ": upside down)" } else { ")" })
    }
}

/// A camera that is turned by more than this hangs upside down.
const UPSIDE_DOWN_DEG: f64 = 150.0;

/// Bands of the points between cameras, pixels. Where no camera can be judged in the first, so many are off that hardly a point
/// is left; a wider one finds some.
const BANDS_PX: [f64; 3] = [2.0, 6.0, 16.0];
/// So many of the cameras that are farthest off are tried as the one to set aside.
const TRIED: usize = 4;
/// A pose speaks against another if it explains what is seen so many times better.
const BETTER: f64 = 2.0;
/// What repeats itself, tiles or the panels of a dome, looks alike from places that are far apart. A pose that is farther off than
/// this must be borne out by more points than that of the calibration, pixels.
const FAR_PX: f64 = 8.0;
/// Pictures that are wider or higher are made smaller, pixels; smaller ones are enlarged, but no more than twice.
const SIDE_PX: f64 = 640.0;

/// Holds `poses` (world to camera) of `views` with intrinsics against what the views show; all views of what stands still.
///
/// # Errors
/// If COLMAP does not run, or a view has no intrinsics.
pub fn fit(
    views: &[CameraView],
    poses: &[Pose],
    options: &FitOptions,
    work_dir: &Path,
    progress: Progress<'_>,
) -> Result<RigFit, SfmError> {
    let (mut cameras, mut small, mut shrunk) = (Vec::new(), Vec::new(), Vec::new());
    for (view, pose) in std::iter::zip(views, poses) {
        view.check()?;
        let missing = || SfmError::NoIntrinsics { camera: view.name.clone(), path: "the dataset".into() };
        let intrinsics = view.intrinsics.ok_or_else(missing)?;
        let by = (f64::from(view.image.width.max(view.image.height)) / SIDE_PX).max(1.0);
        let side = |side: u32| ((f64::from(side) / by).round() as u32).max(1);
        let [width, height] = [side(view.image.width), side(view.image.height)];
        let intrinsics = intrinsics.resized(width, height);
        let image = if by > 1.0 { view.image.resized(width, height, Resample::Area) } else { view.image.clone() };
        cameras.push(Some(Placed { intrinsics, pose: *pose, points: 0 }));
        small.push(CameraView { image, intrinsics: Some(intrinsics), ..view.clone() });
        shrunk.push(by);
    }
    let views = &small;
    let widest = views.iter().map(|view| view.image.width.max(view.image.height)).max().unwrap_or(1);
    let setting =
        Setting { enlarge: (SIDE_PX / f64::from(widest)).clamp(1.0, 2.0), ..RegisterOptions::default().setting };
    let colmap = Colmap::find(&options.colmap)?;
    let work = tempfile::Builder::new().prefix("fit-").tempdir_in(work_dir);
    let work = work.map_err(FileError::when("make a folder in", work_dir))?;
    let extracted = extract(views, &setting, &colmap, options.threads, work.path(), progress)?;
    let features = extracted.features(views, setting.enlarge);
    let size = spread(&poses.iter().copied().map(Some).collect::<Vec<_>>());
    let depths = DEPTHS.map(|share| share * size);
    let mut fit = RigFit::default();
    for band_px in BANDS_PX {
        let found = matches(&cameras, &features, depths, &Pass { name: "fit", band_px }, progress);
        fit = Room { cameras: &cameras, features: &features, matches: &found, band_px, options }.judge();
        if fit.cameras.iter().flatten().count() >= FEWEST_VIEWS {
            break;
        }
    }
    // In the pixels of the pictures that were given.
    for (found, by) in std::iter::zip(&mut fit.cameras, shrunk) {
        if let Some(found) = found {
            (found.off_px, found.left_px) = (by * found.off_px, by * found.left_px);
        }
    }
    Ok(fit)
}

/// What the cameras see.
struct Room<'a> {
    cameras: &'a [Option<Placed>],
    features: &'a [Keypoints],
    matches: &'a [PairMatches],
    band_px: f64,
    options: &'a FitOptions,
}

impl Room<'_> {
    /// Sets cameras aside until all that are left fit each other.
    fn judge(&self) -> RigFit {
        let mut wrong = Vec::new();
        let mut left: Vec<usize> = (0..self.cameras.len()).collect();
        let mut found = self.each(&left, &left, &vec![None; self.cameras.len()]);
        loop {
            let mut off: Vec<usize> = left.iter().copied().filter(|&view| self.off_px(found[view]) > 0.0).collect();
            if off.is_empty() || left.len() <= FEWEST_VIEWS {
                break;
            }
            off.sort_by(|&a, &b| self.off_px(found[b]).total_cmp(&self.off_px(found[a])));
            let rest =
                |of: &[usize], view: usize| of.iter().copied().filter(|&other| other != view).collect::<Vec<_>>();
            // Without one of them, how far off are the others that were?
            let without = |view: usize| -> f64 {
                let others = rest(&off, view);
                let found = self.each(&others, &rest(&left, view), &found);
                others.into_iter().map(|other| self.off_px(found[other])).sum()
            };
            let tried = off.iter().take(TRIED).map(|&view| (without(view), view));
            let Some((_, view)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            wrong.push(view);
            left = rest(&left, view);
            found = self.each(&left, &left, &found);
        }
        let fits = |view: &usize| found[*view].is_some() && self.off_px(found[*view]) == 0.0;
        let right = left.iter().copied().filter(fits).collect();
        wrong.extend(left.into_iter().filter(|&view| self.off_px(found[view]) > 0.0));
        RigFit { cameras: found, wrong, right }
    }

    /// Each of some cameras `among` others against these; of the rest, what was found before.
    fn each(&self, some: &[usize], among: &[usize], before: &[Option<CameraFit>]) -> Vec<Option<CameraFit>> {
        let mut found = before.to_vec();
        if some.is_empty() {
            return found;
        }
        let mut shared = vec![0; found.len()];
        for (view, _) in self.points(among, BANDS_PX[0]).iter().flat_map(|point| &point.seen) {
            shared[*view] += 1;
        }
        for &view in some {
            let others: Vec<usize> = among.iter().copied().filter(|&other| other != view).collect();
            found[view] = self.against_others(view, &others, shared[view]);
        }
        found
    }

    /// How far a camera is off, pixels; 0 where nothing speaks against its pose.
    fn off_px(&self, found: Option<CameraFit>) -> f64 {
        let speaks = |found: &CameraFit| {
            found.off_px > self.options.limit_px
                && found.off_px > BETTER * found.left_px
                && (found.off_px < FAR_PX || found.points > found.shared)
        };
        found.filter(speaks).map_or(0.0, |found| found.off_px)
    }

    /// The points that three of some cameras and more agree on.
    fn points(&self, some: &[usize], limit_px: f64) -> Vec<Track> {
        let takes_part = |view: usize| some.contains(&view);
        let matches: Vec<PairMatches> =
            self.matches.iter().filter(|((a, b), _)| takes_part(*a) && takes_part(*b)).cloned().collect();
        let joined = components(self.features, &matches, FEWEST_VIEWS);
        triangulate(self.features, self.cameras, &joined, FEWEST_VIEWS, limit_px)
    }

    /// A camera against the points of the `others`.
    fn against_others(&self, view: usize, others: &[usize], shared: usize) -> Option<CameraFit> {
        let points = self.points(others, self.band_px);
        let own = self.cameras[view].as_ref()?;
        let known = Known::new(&points, self.features);
        let resected = known.place(&own.intrinsics, &self.features[view], view as u64)?;
        if resected.placed.points < self.options.fewest_points {
            return None;
        }
        let pose = &resected.placed.pose;
        let off = resected.seen.iter().map(|(point, pixel)| {
            let seen = own.intrinsics.project(own.pose.transform(*point));
            seen.map_or(f64::INFINITY, |seen| seen.distance(*pixel))
        });
        Some(CameraFit {
            points: resected.placed.points,
            shared,
            off_px: median(off)?,
            left_px: resected.rms_px,
            moved: pose.centre().distance(own.pose.centre()),
            turned_deg: pose.rotation.angle_between(own.pose.rotation).to_degrees(),
        })
    }
}
