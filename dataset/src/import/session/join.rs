//! Which stream of a session is which camera of a rig, and how its times go over to the session's clock.

use std::path::Path;

use super::{ImportError, SessionNote, SessionOptions, Timing, Viewpoint, import};
use crate::{Dataset, PoseSigma};
use erfgs_base::{names::FileNames, progress::Progress};
use erfgs_scene::rig_file::{RigCamera, RigFile};
use erfgs_session::container::{Session, Stream};
use erfgs_sync::{StreamSync, Synchronisation};

/// Makes the dataset `out` of what the cameras of `rig` recorded in `session`, whose clocks are those of `sync`. Cameras and
/// streams belong together by name; `note` is told of those without a partner, and of what else is left out.
///
/// # Errors
/// If no camera with a pose recorded a stream, and as [`import`].
pub fn import_recording(
    session: &mut Session,
    sync: &Synchronisation,
    rig: &RigFile,
    options: &SessionOptions,
    out: &Path,
    note: &mut dyn FnMut(SessionNote),
    progress: &mut dyn FnMut(Progress),
) -> Result<Dataset, ImportError> {
    let views = views(session, sync, rig, options, note)?;
    import(session, &views, options, out, note, progress)
}

/// A window of a session that begins `from_s` seconds after its start and is `seconds` long, as [`SessionOptions`] take it.
/// Without a beginning it begins at the start, without a length it has all that follows; `None` without either.
#[must_use]
pub fn window_ns(session: &Session, from_s: Option<f64>, seconds: Option<f64>) -> Option<[i64; 2]> {
    if from_s.is_none() && seconds.is_none() {
        return None;
    }
    let span_ns = session.summary().span_ns().map_or(0, |[first, last]| last.saturating_sub(first));
    let from_s = from_s.unwrap_or(0.0);
    // Exposures and events of the last packets lie before their arrival.
    let to_s = seconds.map_or(from_s.max(0.0) + 1e-9 * span_ns as f64 + 1.0, |seconds| from_s + seconds);
    Some([from_s, to_s].map(|t_s| (1e9 * t_s) as i64))
}

/// The cameras with a pose that recorded a stream.
fn views(
    session: &Session,
    sync: &Synchronisation,
    rig: &RigFile,
    options: &SessionOptions,
    note: &mut dyn FnMut(SessionNote),
) -> Result<Vec<Viewpoint>, ImportError> {
    let summary = session.summary();
    let mut views = Vec::new();
    if let Some(unknown) = options.without.iter().find(|name| summary.stream(name).is_none()) {
        let known: Vec<&str> = summary.streams.iter().map(|stream| stream.description.id.as_str()).collect();
        let what =
            format!("--without {unknown}: the session has no stream of this name; there are {}", known.join(", "));
        return Err(ImportError::Options(what));
    }
    let mut names = FileNames::default();
    for recorded in &summary.streams {
        let d = &recorded.description;
        if !(d.encoding.is_events() || d.encoding.is_frames()) {
            continue;
        }
        let stream = d.id.clone();
        if options.without.contains(&stream) {
            continue;
        }
        match rig.camera(&stream).map(|camera| (camera, camera.pose)) {
            Some((camera, Some(pose))) => views.push(Viewpoint {
                camera: names.give(&stream),
                intrinsics: camera.intrinsics,
                pose,
                pose_sigma: camera.sigma.as_ref().and_then(PoseSigma::calibrated),
                clock_sigma_s: clock_sigma_s(camera, sync.stream(&stream)),
                timing: timing(camera, recorded, sync.stream(&stream)),
                thresholds: options.thresholds.unwrap_or_else(|| d.contrast_thresholds()),
                stream,
            }),
            Some(_) => note(SessionNote::NoPose { stream }),
            None => note(SessionNote::NoCamera { stream }),
        }
    }
    if views.is_empty() {
        return Err(ImportError::NoViewpoint {
            path: session.path().to_owned(),
            cameras: rig.cameras.iter().map(|camera| camera.name.clone()).collect(),
            streams: summary.streams.iter().map(|stream| stream.description.id.clone()).collect(),
        });
    }
    for camera in rig.cameras.iter().filter(|camera| summary.stream(&camera.name).is_none()) {
        note(SessionNote::NoStream { camera: camera.name.clone() });
    }
    Ok(views)
}

/// How sure the times of a camera's frames are as a whole, where its calibration found by how much they are late. What a camera without
/// a trigger is late by differs from take to take, by no more than its stamps scatter.
fn clock_sigma_s(camera: &RigCamera, sync: Option<&StreamSync>) -> Option<f64> {
    let calibrated = camera.sigma.as_ref()?.time_offset_s?;
    let exposures = sync?.exposures.as_ref()?;
    let scatter = if exposures.pulse.is_empty() { 1e-9 * exposures.residuals.p95_ns / 2.0 } else { 0.0 };
    Some(calibrated.hypot(scatter))
}

fn timing(camera: &RigCamera, stream: &Stream, sync: Option<&StreamSync>) -> Timing {
    let mut frames = sync.map(StreamSync::frames).unwrap_or_default();
    let set_ns = stream.description.exposure_ns();
    for exposure in frames.values_mut() {
        exposure.length_ns = exposure.length_ns.or(set_ns);
    }
    Timing {
        epochs: sync
            .filter(|_| stream.description.encoding.is_events())
            .map(|sync| sync.epochs.clone())
            .unwrap_or_default(),
        frames,
        offset_ns: (1e9 * camera.time_offset_s).round() as i64,
    }
}
