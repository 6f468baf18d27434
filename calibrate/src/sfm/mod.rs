//! A rig from images of its surroundings: structure from motion.
//!
//! 1. COLMAP arranges the cameras several times ([`Setting`]): with other features, matches and seeds each time.
//! 2. The arrangements are laid over each other ([`align`](align::align)). Where texture repeats, a run can place a camera
//!    metres off and report a small reprojection error; that two independent runs agree on it is unlikely.
//! 3. What runs agree on is made dense: matching along the now known epipolar lines finds many times more points, and the
//!    bundle adjusted to them gives the poses and their covariances.

pub mod align;
mod error;
mod options;
mod refine;
mod run;
mod tracks;
mod views;

use std::{fmt, path::Path};

pub use error::SfmError;
pub use options::{Setting, SfmOptions};
pub use views::{KnownIntrinsics, View, read_views};

/// What the calibration is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Enlarging and writing the images.
    Images,
    /// COLMAP extracts features.
    Features,
    /// Features are matched.
    Matching,
    /// COLMAP verifies the matches and builds models.
    Mapping,
    /// More points, and the bundle.
    Refining,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Images => "images",
            Self::Features => "features",
            Self::Matching => "matching",
            Self::Mapping => "mapping",
            Self::Refining => "refining",
        })
    }
}

/// Is told how many items of a stage are done, of how many.
pub type Progress<'a> = &'a (dyn Fn(Stage, usize, usize) + Sync);

/// debug
pub fn trial(
    views: &[View],
    options: &SfmOptions,
    work: &Path,
    report: &mut dyn FnMut(String, &[Option<erfgs_session::Pose>], &[Option<erfgs_session::Intrinsics>]),
) -> Result<(), SfmError> {
    let colmap = crate::colmap::Colmap::find(&options.colmap)?;
    let mut dense = None;
    for (n, setting) in options.settings.iter().enumerate() {
        let folder = work.join(format!("run{n}"));
        std::fs::create_dir_all(&folder).unwrap();
        let run = run::run(views, setting, &colmap, options.threads, &folder, &|_, _, _| {})?;
        let show = |c: &[Option<run::Placed>]| {
            (
                c.iter().map(|c| c.as_ref().map(|c| c.pose)).collect::<Vec<_>>(),
                c.iter().map(|c| c.as_ref().map(|c| c.intrinsics)).collect::<Vec<_>>(),
            )
        };
        let features: usize = run.features.iter().map(|f| f.positions.len()).sum();
        let (p, k) = show(&run.cameras);
        report(
            format!(
                "{} | features {features} points {} err {:.3} depths {:?} others {:?} {:.1}s min pts {:?}",
                run.name,
                run.points,
                run.error_px,
                run.depths,
                run.others,
                run.seconds,
                run.cameras.iter().flatten().map(|c| c.points).min()
            ),
            &p,
            &k,
        );
        if n == 0 {
            dense = Some(run.features.clone());
        }
        let mut cameras = run.cameras.clone();
        let reference = (0..views.len()).max_by_key(|&v| cameras[v].as_ref().map_or(0, |c| c.points)).unwrap();
        let centre = |v: usize| cameras[v].as_ref().map(|c: &run::Placed| c.pose.centre());
        let far = (0..views.len())
            .filter(|&v| centre(v).is_some())
            .max_by(|&a, &b| {
                let d = |v: usize| centre(v).unwrap().distance(centre(reference).unwrap());
                d(a).total_cmp(&d(b))
            })
            .unwrap();
        let gauge = refine::Gauge {
            reference,
            distance: ([reference, far], centre(far).unwrap().distance(centre(reference).unwrap())),
        };
        for (band, angle) in [(3.0, 40.0), (1.0, 40.0)] {
            let since = std::time::Instant::now();
            let pass = refine::Pass { band_px: band, ratio: 0.85, max_ray_angle_deg: angle, fewest: 3 };
            let depths = [run.depths[0] * 0.5, run.depths[1] * 1.5];
            let adjusted =
                refine::refine(views, &cameras, dense.as_ref().unwrap(), depths, &pass, &gauge, &|_, _, _| {})?;
            cameras = adjusted.cameras(views.len());
            let (p, k) = show(&cameras);
            let (rms, used) = adjusted.bundle.rms_px(None);
            report(
                format!(
                    "  dense {band} px: points {} obs {} used {used} rms {rms:.3} {:.1}s steps {:?}",
                    adjusted.bundle.placements.len(),
                    adjusted.bundle.observations.len(),
                    since.elapsed().as_secs_f64(),
                    adjusted.solutions.iter().map(|(_, s)| s.steps.len()).collect::<Vec<_>>()
                ),
                &p,
                &k,
            );
        }
    }
    Ok(())
}
