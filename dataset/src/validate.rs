//! The checks of a manifest.

use std::{collections::BTreeSet, path::Path};

use rayon::prelude::*;

use super::{Camera, CameraEvents, Dataset, DatasetError, Frame, Problem, files::check_size};
use erfgs_base::plausible::{
    EXPOSURE, INSTANT, Implausible, LIN_LOG, OVERHANG, OVERLAP, SIGMA_PLACE, SIGMA_TIME, SIGMA_TURN, SPAN, THRESHOLD,
    check_sensor,
};
use erfgs_scene::{Modality, image};

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
        check_span(manifest.span_ns).map_err(|error| wrong(error.into()))?;
        let (mut names, mut files) = (BTreeSet::new(), BTreeSet::new());
        for camera in &manifest.cameras {
            let new_name = |()| if names.insert(&camera.name) { Ok(()) } else { Err(Problem::NameTwice) };
            check_name(&camera.name)
                .and_then(new_name)
                .and_then(|()| check_camera(camera, manifest.span_ns))
                .and_then(|()| if manifest.is_blurred() { Ok(()) } else { check_overlaps(&camera.frames) })
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

fn check_span(span_ns: [i64; 2]) -> Result<(), Implausible> {
    INSTANT.check_all_ns(span_ns)?;
    SPAN.check_between_ns(span_ns)
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
    camera.world_to_camera.checked()?;
    if let Some(sigma) = &camera.pose_sigma {
        SIGMA_PLACE.check_all(sigma.centre_m)?;
        SIGMA_TURN.check_all(sigma.rotation_deg)?;
    }
    SIGMA_TIME.check_all(camera.clock_sigma_s)?;
    camera.intrinsics.checked()?;
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
        let before = index.checked_sub(1).map(|before| camera.frames[before].t_ns);
        check_frame(index, frame, before, span_ns)?;
    }
    let Some(events) = &camera.events else { return Ok(()) };
    check_sensor([camera.intrinsics.width, camera.intrinsics.height])?;
    check_events(events)
}

fn check_frame(index: usize, frame: &Frame, before: Option<i64>, span_ns: [i64; 2]) -> Result<(), Problem> {
    let (file, t_ns, exposure_ns) = (frame.file.clone(), frame.t_ns, frame.exposure_ns);
    if before.is_some_and(|before| t_ns <= before) {
        return Err(Problem::Order { index, file, t_ns });
    }
    if !(span_ns[0]..=span_ns[1]).contains(&t_ns) {
        return Err(Problem::OutsideSpan { index, file, t_ns, span_ns });
    }
    if !(exposure_ns[0]..=exposure_ns[1]).contains(&t_ns) {
        return Err(Problem::Exposure { index, file, t_ns, exposure_ns });
    }
    let [start, end] = exposure_ns;
    let checked = EXPOSURE
        .check_between_ns(exposure_ns)
        .and_then(|()| OVERHANG.check_between_ns([start, span_ns[0].max(start)]))
        .and_then(|()| OVERHANG.check_between_ns([span_ns[1].min(end), end]));
    checked.map_err(|wrong| Problem::Frame { index, file, wrong })
}

/// One sensor takes one picture after the other.
fn check_overlaps(frames: &[Frame]) -> Result<(), Problem> {
    for (index, pair) in frames.windows(2).enumerate() {
        let [before, frame] = [&pair[0], &pair[1]];
        let between = |from: i64, to: i64| (i128::from(to) - i128::from(from)) as f64;
        let shared_ns = between(frame.exposure_ns[0], before.exposure_ns[1]).max(0.0);
        let wrong = |wrong| Problem::Frame { index: index + 1, file: frame.file.clone(), wrong };
        let intervals = shared_ns / between(before.t_ns, frame.t_ns);
        OVERLAP.check((1e3 * intervals).round() * 1e-3).map_err(wrong)?;
    }
    Ok(())
}

fn check_events(events: &CameraEvents) -> Result<(), Problem> {
    let sensor = |wrong| Problem::Sensor { file: events.file.clone(), wrong };
    THRESHOLD.check_all([events.threshold_on, events.threshold_off]).map_err(sensor)?;
    LIN_LOG.check(events.lin_log_threshold).map_err(sensor)?;
    if events.covers_ns[0] > events.covers_ns[1] {
        return Err(Problem::CameraEvents {
            file: events.file.clone(),
            what: "the time covered ends before it starts",
        });
    }
    check_span(events.covers_ns).map_err(sensor)
}
