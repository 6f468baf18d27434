//! `erfgs dataset import session`: what a calibrated rig recorded becomes a dataset.

use std::path::Path;

use anyhow::Context;
use erfgs_dataset::{
    Dataset,
    import::session::{Response, SessionNote, SessionOptions, import_recording, window_ns},
};
use erfgs_scene::{Distortion, rig_file::RigFile};
use erfgs_session::container::Session;

use super::import::scale;
use crate::{parse::Thresholds, sync, terminal::Terminal};

/// What comes on top of the importer's options.
#[derive(Debug, clap::Args)]
pub struct SessionArguments {
    /// Session: the calibrated rig. Cameras and streams belong together by name.
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<std::path::PathBuf>,
    /// Session: where to begin, seconds from the start of the recording.
    #[arg(long, value_name = "SECONDS", requires = "rig", value_parser = crate::parse::seconds)]
    pub from: Option<f64>,
    /// Session: how much to take, seconds.
    #[arg(long, value_name = "SECONDS", requires = "rig", value_parser = crate::parse::seconds)]
    pub seconds: Option<f64>,
    /// Session: import every N-th frame.
    #[arg(long, value_name = "N", requires = "rig", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: Option<u32>,
    /// Session: contrast thresholds of ON and OFF events, natural logarithm of intensity. Default: usual values of the
    /// camera model.
    #[arg(long, value_name = "ON,OFF", requires = "rig")]
    pub threshold: Option<Thresholds>,
    /// Session: the quantity whose change event cameras report.
    #[arg(long, value_enum, requires = "rig", default_value = "light")]
    pub response: ResponseName,
    /// Session: another --scale for this camera. May be given for several: sensors of a rig differ by far in their pixels.
    #[arg(long, value_name = "CAMERA=FACTOR", requires = "rig", value_parser = scale_of)]
    pub scale_of: Vec<(String, f64)>,
    /// Session: leave this camera out. May be given for several.
    #[arg(long, value_name = "CAMERA", requires = "rig")]
    pub without: Vec<String>,
    /// Session: take frames without colour, too, where other cameras see colours.
    #[arg(long, requires = "rig")]
    pub grey: bool,
    /// Session: take the events of hot pixels, too, which send events whatever they look at (see `erfgs info --hot-pixels`).
    #[arg(long, requires = "rig")]
    pub keep_hot_pixels: bool,
}

/// What event cameras answer to.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum ResponseName {
    /// The logarithm of light, as real ones do.
    Light,
    /// The logarithm of display values, linear in the dark: events that v2e's model simulated and that were played into the
    /// recording.
    Display,
}

fn scale_of(text: &str) -> Result<(String, f64), String> {
    let (camera, factor) = text.split_once('=').ok_or("write CAMERA=FACTOR, for example event-left=0.25")?;
    Ok((camera.to_owned(), scale(factor)?))
}

/// Imports and tells what was left out. An error besides the dataset says what is cut or damaged of the session.
pub fn run(
    path: &Path,
    out: &Path,
    mut options: SessionOptions,
    arguments: &SessionArguments,
    terminal: &Terminal,
) -> anyhow::Result<(Dataset, anyhow::Result<()>)> {
    let rig = arguments.rig.as_deref().context(
        "a session holds no camera poses: give the calibrated rig with --rig rig.json (erfgs calibrate makes it)",
    )?;
    let rig = RigFile::read(rig)?;
    let mut session = Session::open(path)?;
    let sync = sync::of_session(&mut session, terminal)?;
    options.window_ns = window_ns(&session, arguments.from, arguments.seconds);
    options.every = arguments.every.unwrap_or(1) as usize;
    options.thresholds = arguments.threshold.map(|given| given.0);
    options.response = match arguments.response {
        ResponseName::Light => Response::Light,
        ResponseName::Display => Response::Display,
    };
    options.grey = arguments.grey;
    options.hot_pixels = arguments.keep_hot_pixels;
    options.without.clone_from(&arguments.without);
    options.scales = arguments.scale_of.iter().cloned().collect();
    let summary = session.summary();
    if let (false, Some([_, last])) = (summary.complete, summary.span_ns()) {
        let ends_s = summary.start.session_ns(last) as f64 * 1e-9;
        terminal.note(format!("{} was cut off: it ends at {ends_s:.3} s", path.display()));
    }
    let progress = terminal.progress("importing");
    let mut notes: Vec<SessionNote> = Vec::new();
    let mut note = |note| notes.push(note);
    let faults =
        sync.streams.iter().flat_map(|stream| stream.faults.iter().map(|what| format!("{}: {what}", stream.id)));
    faults.for_each(|fault| terminal.note(fault));
    let imported = import_recording(&mut session, &sync, &rig, &options, out, &mut note, &mut |step| {
        progress.update(step.done, step.total, step.what);
    });
    drop(progress);
    // What was left out may be why nothing was imported.
    notes.iter().for_each(|note| terminal.note(note.to_string()));
    let damage: Vec<String> = notes
        .iter()
        .filter_map(|note| match note {
            SessionNote::Damage { what, .. } => Some(what.clone()),
            _ => None,
        })
        .collect();
    let faults = crate::export::complain_of("imported", path, session.summary(), &damage);
    let dataset = match (imported, session.summary().faults().first()) {
        (Err(error), Some(fault)) => return Err(error).context(format!("{}: {fault}", path.display())),
        (imported, _) => imported?,
    };
    if dataset.manifest.cameras.iter().any(|camera| camera.intrinsics.distortion != Distortion::None) {
        let ds = out.display();
        terminal.note(format!("before training: erfgs dataset undistort {ds} --out {ds}-pinhole"));
    }
    Ok((dataset, faults))
}
