//! Cameras added to a rig that stays as it is, from images of what its cameras see too.
//!
//! The rig's own images are matched along their known epipolar lines, which gives points; a new image is matched with those
//! blindly, which gives its pose by resection; then it too is matched along epipolar lines, and adjusted with everything else
//! fixed. Intrinsics stay.

use std::path::Path;

use erfgs_base::FileError;
use erfgs_scene::{Modality, Pose};

use super::{
    CameraView, Progress, Setting, SfmError,
    align::spread,
    place::{Known, Resected},
    refine::{Adjusted, FEWEST_VIEWS, Gauge, Pass, adjust, tracks},
    result::{names, pictures, uncertainty},
    run::{Placed, extract},
};
use crate::{
    colmap::{Colmap, ColmapProgram, database::Keypoints},
    evidence::{Evidence, Table},
    intensity::LogIntensity,
};
use erfgs_scene::rig_file::RigFile;

/// How cameras are added to a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisterOptions {
    /// The COLMAP whose features are used.
    pub colmap: ColmapProgram,
    /// Its features.
    pub setting: Setting,
    /// Threads; 0 = all.
    pub threads: usize,
    /// A camera that sees fewer of the rig's points is not registered.
    pub fewest_points: usize,
    /// The radius of the high-pass that pictures of events were made with, pixels: the rig's images are made alike before event
    /// cameras are registered in them.
    pub radius_px: u32,
}

impl Default for RegisterOptions {
    fn default() -> Self {
        let setting = Setting { enlarge: 2.0, peak_threshold: 0.02 / 3.0, edge_threshold: 10.0, ratio: 0.85, seed: 0 };
        Self { colmap: ColmapProgram::Auto, setting, threads: 0, fewest_points: 20, radius_px: 16 }
    }
}

/// Bands of the points between the rig's own cameras, and of the new ones.
const RIG: Pass = Pass { name: "rig", band_px: 2.0 };
const NEW: [Pass; 2] = [Pass { name: "wide", band_px: 4.0 }, Pass { name: "narrow", band_px: 2.0 }];
/// Nearest and farthest depth before points tell, as share of the rig's size.
pub(super) const DEPTHS: [f64; 2] = [0.1, 20.0];

/// Adds the cameras of `new` (with intrinsics) to `rig`, of whose cameras `model` has images.
///
/// # Errors
/// If COLMAP does not run, a view has no intrinsics, or none of the new cameras can be registered.
pub fn register(
    rig: &RigFile,
    model: &[CameraView],
    new: &[CameraView],
    options: &RegisterOptions,
    work_dir: &Path,
    progress: Progress<'_>,
) -> Result<(RigFile, Evidence), SfmError> {
    let posed: Vec<(&CameraView, Pose)> =
        model.iter().filter_map(|view| Some((view, rig.camera(&view.name)?.pose?))).collect();
    if posed.len() < 3 {
        return Err(SfmError::TooFewViews { path: "the rig's images".into(), found: posed.len() });
    }
    for view in model.iter().chain(new) {
        view.check()?;
    }
    let missing = |view: &CameraView| SfmError::NoIntrinsics { camera: view.name.clone(), path: "the rig file".into() };
    // Pictures of events are matched with pictures made alike.
    let events = new.iter().any(|view| !view.modality.has_frames());
    let alike = |view: &CameraView| match (events, view.modality) {
        (true, Modality::Rgb | Modality::Both) => {
            CameraView { image: LogIntensity::of_image(&view.image).picture(options.radius_px), ..view.clone() }
        }
        _ => view.clone(),
    };
    let views: Vec<CameraView> = posed.iter().map(|(view, _)| *view).chain(new).map(alike).collect();
    let colmap = Colmap::find(&options.colmap)?;
    let work = tempfile::Builder::new().prefix("register-").tempdir_in(work_dir);
    let work = work.map_err(FileError::when("make a folder in", work_dir))?;
    let extracted = extract(&views, &options.setting, &colmap, options.threads, work.path(), progress)?;
    let features = extracted.features(&views, options.setting.enlarge);

    let mut cameras: Vec<Option<Placed>> = vec![None; views.len()];
    for (slot, (view, pose)) in cameras.iter_mut().zip(&posed) {
        let intrinsics = view.intrinsics.ok_or_else(|| missing(view))?;
        *slot = Some(Placed { intrinsics, pose: *pose, points: 0 });
    }
    let fixed: Vec<usize> = (0..posed.len()).collect();
    let gauge = Gauge { fixed, distance: None };
    let poses: Vec<Option<Pose>> = posed.iter().map(|(_, pose)| Some(*pose)).collect();
    let size = spread(&poses);
    let mut depths = DEPTHS.map(|share| share * size);
    let mut evidence = Evidence::default();
    let mut pass = |cameras: &[Option<Placed>], depths: [f64; 2], pass: &Pass| -> Result<Adjusted, SfmError> {
        let found = tracks(cameras, &features, depths, pass, progress);
        let adjusted = adjust(&views, cameras, &features, found, &gauge)?;
        for (step, solution) in &adjusted.solutions {
            evidence.pass(format!("{}, {step}", pass.name), solution);
        }
        Ok(adjusted)
    };
    let mut adjusted = pass(&cameras, depths, &RIG)?;
    depths = adjusted.depths().unwrap_or(depths);
    let points = adjusted.points();
    let found = place_all(&views, posed.len(), &Known::new(&points, &features), &features)?;
    let mut table = Table {
        title: "Registered cameras".into(),
        note: "Unguided matches with the rig's points, those that support the pose, and observations after adjustment."
            .into(),
        head: ["camera", "matches", "points", "px", "observations"].map(String::from).to_vec(),
        rows: Vec::new(),
    };
    let mut failed = Vec::new();
    for (view, found) in (posed.len()..views.len()).zip(&found) {
        match found {
            Some(found) if found.placed.points >= options.fewest_points => cameras[view] = Some(found.placed),
            other => failed.push((view, other.as_ref().map_or(0, |found| found.placed.points))),
        }
    }
    if failed.len() == new.len() {
        let counts: Vec<String> =
            failed.iter().map(|(view, count)| format!("{}: {count}", views[*view].name)).collect();
        return Err(SfmError::Unregistered {
            cameras: names(&views, failed.iter().map(|(view, _)| *view)),
            needed: options.fewest_points,
            points: points.len(),
            found: counts.join(", "),
        });
    }
    for step in &NEW {
        adjusted = pass(&cameras, depths, step)?;
        cameras = adjusted.cameras(views.len());
    }
    let uncertainty = uncertainty(&adjusted.bundle)?;
    let modalities: Vec<Modality> = adjusted.views.iter().map(|&view| views[view].modality).collect();
    let solved = adjusted.bundle.rig("register", &uncertainty, &modalities);
    let neighbours = adjusted.neighbours();
    let mut result = rig.clone();
    result.method = "register".into();
    result.quality = solved.quality;
    for (index, &view) in adjusted.views.iter().enumerate().filter(|(_, view)| **view >= posed.len()) {
        let mut camera = solved.cameras[index].clone();
        if neighbours[index] < FEWEST_VIEWS {
            camera.warnings.push(format!("it shares points with only {} other cameras", neighbours[index]));
        }
        if camera.observations < 3 * options.fewest_points {
            camera.warnings.push(format!("it is determined by only {} points", camera.observations));
        }
        if let Some(Some(found)) = found.get(view - posed.len()) {
            table.rows.push(vec![
                camera.name.clone(),
                found.tried.to_string(),
                found.placed.points.to_string(),
                format!("{:.2}", found.rms_px),
                camera.observations.to_string(),
            ]);
        }
        result.cameras.retain(|other| other.name != camera.name);
        result.cameras.push(camera);
    }
    for (view, count) in failed {
        result.warnings.push(format!("{} is not registered: it sees {count} of the rig's points", views[view].name));
    }
    evidence.tables.push(table);
    evidence.observe(&adjusted.bundle);
    let place = |view: usize| result.cameras.iter().position(|camera| camera.name == views[view].name).unwrap_or(0);
    for residual in &mut evidence.residuals {
        residual.camera = place(adjusted.views[residual.camera]);
    }
    evidence.pictures = pictures(&result, model.iter().chain(new));
    Ok((result, evidence))
}

fn place_all(
    views: &[CameraView],
    first: usize,
    known: &Known<'_>,
    features: &[Keypoints],
) -> Result<Vec<Option<Resected>>, SfmError> {
    (first..views.len())
        .map(|view| {
            let missing = || SfmError::NoIntrinsics { camera: views[view].name.clone(), path: "the rig file".into() };
            let intrinsics = views[view].intrinsics.ok_or_else(missing)?;
            Ok(known.place(&intrinsics, &features[view], view as u64))
        })
        .collect()
}
