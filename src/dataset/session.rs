//! `erfgs dataset import session`: what a calibrated rig recorded becomes a dataset.

use std::path::Path;

use anyhow::Context;
use erfgs_dataset::import::{
    Imported,
    session::{SessionOptions, Timing, Viewpoint, import},
};
use erfgs_scene::rig_file::{RigCamera, RigFile};
use erfgs_session::container::{Session, Stream};
use erfgs_sync::StreamSync;

use crate::{parse::Thresholds, sync, terminal::Terminal};

/// What comes on top of the importer's options.
#[derive(Debug, clap::Args)]
pub struct SessionArguments {
    /// Session: the calibrated rig. Cameras and streams belong together by name.
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<std::path::PathBuf>,
    /// Session: where to begin, seconds from the start of the recording.
    #[arg(long, value_name = "SECONDS", requires = "rig")]
    pub from: Option<f64>,
    /// Session: how much to take, seconds.
    #[arg(long, value_name = "SECONDS", requires = "rig")]
    pub seconds: Option<f64>,
    /// Session: take each N-th frame.
    #[arg(long, value_name = "N", requires = "rig", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: Option<u32>,
    /// Session: contrast thresholds of ON and OFF events, natural logarithm of intensity; what is usual for the model
    /// without it.
    #[arg(long, value_name = "ON,OFF", requires = "rig")]
    pub threshold: Option<Thresholds>,
    /// Session: take frames without colour, too, where other cameras see colours.
    #[arg(long, requires = "rig")]
    pub grey: bool,
}

/// Contrast thresholds at the makers' default biases, ON and OFF: the IMX636's are told as 25 % (Prophesee, EVK4), the DAVIS346's
/// as 14.3 % and 22.5 % (iniVation's sheet). Natural logarithm of intensity.
fn usual_thresholds(model: &str) -> [f64; 2] {
    if model.to_ascii_uppercase().contains("DAVIS") { [0.134, 0.203] } else { [0.223, 0.223] }
}

fn timing(camera: &RigCamera, stream: &Stream, sync: Option<&StreamSync>) -> Timing {
    let exposures = sync.and_then(|sync| sync.exposures.as_ref());
    let set_us = stream.description.settings.get("exposure_us").and_then(serde_json::Value::as_f64);
    let set_ns = set_us.map(|exposure| (exposure * 1000.0) as i64);
    Timing {
        epochs: sync
            .filter(|_| stream.description.encoding.is_events())
            .map(|sync| sync.epochs.clone())
            .unwrap_or_default(),
        mids_ns: sync.map(StreamSync::exposure_mids).unwrap_or_default(),
        exposure_ns: exposures.and_then(|exposures| exposures.exposure_ns).or(set_ns).unwrap_or(0),
        offset_ns: (1e9 * camera.time_offset_s).round() as i64,
    }
}

/// Imports and tells what was left out.
pub fn run(
    path: &Path,
    out: &Path,
    mut options: SessionOptions,
    arguments: &SessionArguments,
    terminal: &Terminal,
) -> anyhow::Result<Imported> {
    let rig = arguments.rig.as_deref().context(
        "a session says nothing of where its cameras stood: give the calibrated rig with --rig rig.json (erfgs calibrate \
         makes it)",
    )?;
    let rig = RigFile::read(rig)?;
    let mut session = Session::open(path)?;
    let sync = sync::of_session(&mut session, terminal)?;
    let span_s = session.summary().span_ns().map_or(0.0, |[first, last]| 1e-9 * last.saturating_sub(first) as f64);
    options.window_ns = (arguments.from.is_some() || arguments.seconds.is_some()).then(|| {
        let from = arguments.from.unwrap_or(0.0);
        // Exposures and events of the last packets lie before their arrival.
        let to = arguments.seconds.map_or(from.max(0.0) + span_s + 1.0, |seconds| from + seconds);
        [from, to].map(|t| (1e9 * t) as i64)
    });
    options.every = arguments.every.unwrap_or(1) as usize;
    options.grey = arguments.grey;
    let mut views = Vec::new();
    for stream in &session.summary().streams {
        let d = &stream.description;
        if !(d.encoding.is_events() || d.encoding.is_frames()) {
            continue;
        }
        match rig.camera(&d.id).map(|camera| (camera, camera.pose)) {
            Some((camera, Some(pose))) => views.push(Viewpoint {
                stream: d.id.clone(),
                intrinsics: camera.intrinsics,
                pose,
                timing: timing(camera, stream, sync.stream(&d.id)),
                thresholds: arguments.threshold.map_or_else(|| usual_thresholds(&d.model), |given| given.0),
            }),
            Some(_) => terminal.note(format!("{}: left out, the rig file has no pose of it", d.id)),
            None => terminal.note(format!("{}: left out, the rig file has no camera of this name", d.id)),
        }
    }
    if views.is_empty() {
        let names = |names: Vec<&str>| names.join(", ");
        anyhow::bail!(
            "no camera of the rig file recorded a stream of {}: the rig has {}, the session {}",
            path.display(),
            names(rig.cameras.iter().map(|camera| camera.name.as_str()).collect()),
            names(session.summary().streams.iter().map(|stream| stream.description.id.as_str()).collect())
        );
    }
    for camera in rig.cameras.iter().filter(|camera| session.summary().stream(&camera.name).is_none()) {
        terminal.note(format!("{}: the session has no stream of this camera", camera.name));
    }
    let progress = terminal.progress("importing");
    let imported =
        import(&mut session, &views, &options, out, &mut |step| progress.update(step.done, step.total, step.what))?;
    drop(progress);
    for note in &imported.notes {
        terminal.note(note);
    }
    if imported
        .dataset
        .manifest
        .cameras
        .iter()
        .any(|camera| camera.intrinsics.distortion != erfgs_scene::Distortion::None)
    {
        let ds = out.display();
        terminal.note(format!("before training: erfgs dataset undistort {ds} --out {ds}-pinhole"));
    }
    Ok(imported)
}
