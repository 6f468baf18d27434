//! The checks of a manifest.

use std::{collections::BTreeSet, path::Path};

use rayon::prelude::*;

use super::{Camera, CameraEvents, Dataset, DatasetError, PoseSigma, Problem, files::check_size};
use erfgs_scene::{Distortion, Intrinsics, Modality, Pose, image};

impl Dataset {
    /// Checks that the manifest makes sense, that every file that it names exists, and that frames and masks have the
    /// size of the intrinsics (of the images, only the headers are read).
    ///
    /// # Errors
    /// The first thing that is wrong, with file, camera and remedy.
    pub fn validate(&self) -> Result<(), DatasetError> {
        let manifest = &self.manifest;
        let wrong =
            |problem| DatasetError::Manifest { path: self.root.join(Self::MANIFEST), problem: Box::new(problem) };
        if manifest.cameras.is_empty() {
            return Err(wrong(Problem::NoCameras));
        }
        if manifest.span_ns[0] >= manifest.span_ns[1] {
            return Err(wrong(Problem::Span(manifest.span_ns)));
        }
        let (mut names, mut files) = (BTreeSet::new(), BTreeSet::new());
        for camera in &manifest.cameras {
            let new_name = |()| if names.insert(&camera.name) { Ok(()) } else { Err(Problem::NameTwice) };
            check_name(&camera.name)
                .and_then(new_name)
                .and_then(|()| check_camera(camera, manifest.span_ns))
                .and_then(|()| check_unique(camera, &mut files))
                .map_err(|problem| self.in_camera(camera, problem))?;
        }
        let points = manifest.points.iter().map(|points| &points.file);
        for file in points.chain(manifest.bodies.iter().map(|bodies| &bodies.file)) {
            let path = self.path(file)?;
            if !path.is_file() {
                return Err(wrong(Problem::MissingFile(path)));
            }
        }
        let checks: Vec<_> = manifest.cameras.par_iter().map(|camera| self.check_files(camera)).collect();
        checks.into_iter().collect()
    }

    pub(crate) fn in_camera(&self, camera: &Camera, problem: Problem) -> DatasetError {
        DatasetError::Camera {
            path: self.root.join(Self::MANIFEST),
            camera: camera.name.clone(),
            problem: Box::new(problem),
        }
    }

    fn check_files(&self, camera: &Camera) -> Result<(), DatasetError> {
        let existing = |file: &Path| {
            let path = self.path(file)?;
            if path.is_file() { Ok(path) } else { Err(self.in_camera(camera, Problem::MissingFile(path))) }
        };
        for file in camera.frames.iter().flat_map(|frame| std::iter::once(&frame.file).chain(&frame.mask)) {
            let path = existing(file)?;
            let size =
                image::size(&path).map_err(|source| DatasetError::Image { camera: camera.name.clone(), source })?;
            check_size(camera, &path, size)?;
        }
        camera.events.iter().try_for_each(|events| existing(&events.file).map(drop))
    }
}

fn check_name(name: &str) -> Result<(), Problem> {
    let usable = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.is_empty() || name.starts_with('.') || !name.chars().all(usable) { Err(Problem::Name) } else { Ok(()) }
}

/// Frames and event files must be files of their own; frames may share a mask.
fn check_unique<'a>(camera: &'a Camera, files: &mut BTreeSet<&'a Path>) -> Result<(), Problem> {
    let named = camera.frames.iter().map(|frame| &frame.file).chain(camera.events.iter().map(|events| &events.file));
    for file in named {
        if !files.insert(file) {
            return Err(Problem::FileTwice(file.clone()));
        }
    }
    Ok(())
}

fn check_camera(camera: &Camera, span_ns: [i64; 2]) -> Result<(), Problem> {
    check_pose(&camera.world_to_camera)?;
    camera.pose_sigma.as_ref().map_or(Ok(()), check_sigma)?;
    if let Some(wrong) = camera.clock_sigma_s.filter(|sigma| !is_sigma(*sigma)) {
        return Err(Problem::ClockSigma(wrong));
    }
    check_intrinsics(&camera.intrinsics)?;
    let (frames, events) = (camera.frames.len(), camera.events.is_some());
    if (frames > 0, events) != (camera.modality.has_frames(), camera.modality.has_events()) {
        let modality = match camera.modality {
            Modality::Rgb => "rgb",
            Modality::Event => "event",
            Modality::Both => "both",
        };
        return Err(Problem::Modality { modality, frames, events });
    }
    for (index, frame) in camera.frames.iter().enumerate() {
        let (file, t_ns, exposure_ns) = (frame.file.clone(), frame.t_ns, frame.exposure_ns);
        if index > 0 && t_ns <= camera.frames[index - 1].t_ns {
            return Err(Problem::Order { index, file, t_ns });
        }
        if !(span_ns[0]..=span_ns[1]).contains(&t_ns) {
            return Err(Problem::OutsideSpan { index, file, t_ns, span_ns });
        }
        if !(exposure_ns[0]..=exposure_ns[1]).contains(&t_ns) {
            return Err(Problem::Exposure { index, file, t_ns, exposure_ns });
        }
    }
    camera.events.as_ref().map_or(Ok(()), check_events)
}

fn check_pose(pose: &Pose) -> Result<(), Problem> {
    let length = pose.rotation.length();
    match pose.is_finite() {
        false => Err(Problem::PoseNotFinite),
        true if (length - 1.0).abs() > 1e-6 => Err(Problem::PoseNotUnit(length)),
        true => Ok(()),
    }
}

fn is_sigma(value: f64) -> bool {
    value.is_finite() && value >= 0.0
}

fn check_sigma(sigma: &PoseSigma) -> Result<(), Problem> {
    let all = sigma.centre_m.iter().chain(&sigma.rotation_deg);
    match all.copied().find(|sigma| !is_sigma(*sigma)) {
        Some(wrong) => Err(Problem::PoseSigma(wrong)),
        None => Ok(()),
    }
}

fn check_intrinsics(intrinsics: &Intrinsics) -> Result<(), Problem> {
    let Intrinsics { width, height, fx, fy, cx, cy, distortion } = *intrinsics;
    if width == 0 || height == 0 {
        return Err(Problem::NoSize);
    }
    if !(fx > 0.0 && fy > 0.0 && fx.is_finite() && fy.is_finite()) {
        return Err(Problem::Focal(fx, fy));
    }
    let coefficients = match &distortion {
        Distortion::None => &[][..],
        Distortion::BrownConrady(k) => k,
        Distortion::KannalaBrandt(k) => k,
    };
    let finite = cx.is_finite() && cy.is_finite() && coefficients.iter().all(|k| k.is_finite());
    if finite { Ok(()) } else { Err(Problem::IntrinsicsNotFinite) }
}

fn check_events(events: &CameraEvents) -> Result<(), Problem> {
    let wrong = |what| Err(Problem::CameraEvents { file: events.file.clone(), what });
    let positive = |threshold: f64| threshold > 0.0 && threshold.is_finite();
    if !positive(events.threshold_on) || !positive(events.threshold_off) {
        return wrong("the contrast thresholds must be positive");
    }
    // At or below 1 the straight line through zero, whose slope is its logarithm, is flat or falls.
    if !(events.lin_log_threshold > 1.0 && events.lin_log_threshold.is_finite()) {
        return wrong("the lin-log threshold must be above 1 grey level of 255 (v2e: 20)");
    }
    if events.covers_ns[0] > events.covers_ns[1] {
        return wrong("the time covered ends before it starts");
    }
    Ok(())
}
