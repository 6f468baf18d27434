//! `erfgs calibrate wand`: cameras of both kinds from an LED wand that was waved before them.

use std::path::PathBuf;

use erfgs_calibrate::wand::{
    KnownRig, Matching, Scale, Stick, WandCamera, WandError, WandOptions, calibrate, detect::BlinkOptions,
    look_session, pictures, read_points,
};
use erfgs_scene::rig_file::RigFile;
use erfgs_session::container::Session;
use erfgs_sync::Synchronisation;

use super::summary::finish;
use crate::{errors::Usage, progress::Progress, sync, terminal::Terminal};

/// Calibrate with a wand of three LEDs that was waved before the cameras.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
INPUT is a recorded session, or a folder or a file of LED positions:
  a session (S.mcap): blinking LEDs are looked for in events, bright spots in frames; --rig must have the cameras' intrinsics
  a folder in eWand's layout: frame_0.csv, event_1.csv, ... with rows t_ns;x1;y1;x2;y2;x3;y3 (-1 where nothing was seen), and
  beside each a YAML file of OpenCV intrinsics (frame_0.yaml); pixel centres are whole numbers there
  a wand.json, or a folder that holds one (docs/guide/wand.md describes it): cameras with intrinsics and standard
  deviations, and for each a CSV file t_ns,x1,y1,x2,y2,x3,y3; pixel centres are half-integers

No initial poses are needed. The gaps give the scale; if they differ, LEDs in the wrong order are corrected. A fifth of the \
placements is held out of a first solution, which measures their lengths as a test.

With --keep-poses the cameras that have a pose in the rig file stay where they are, with their intrinsics, and the others are \
placed among them, in the rig's own frame. Lengths are the rig's where it is metric, and the wand's otherwise; --scale-from \
chooses. The report says by how much the two differ.

Examples:
  erfgs calibrate wand points --wand 0.13+0.26
  erfgs calibrate wand S.mcap --wand 0.13+0.26 --led-hz 400,500,640 --rig intrinsics.json
  erfgs calibrate wand points --wand 0.13+0.26 --rig intrinsics.json --out rig.json
  erfgs calibrate wand points --wand 0.13+0.26 --rig rgb-rig.json --keep-poses    event cameras added to a rig
  erfgs calibrate wand points --wand 0.13+0.26 --fix-focal --no-time-offsets      fixed lenses on one trigger
  erfgs calibrate wand points --wand 0.13+0.26 --without cam3 --json | jq .quality.measures")]
pub struct Arguments {
    /// A session, or LED positions.
    input: PathBuf,
    /// The gaps between the first and the second, and the second and the third LED, metres.
    #[arg(long, value_name = "GAP+GAP")]
    wand: Stick,
    /// A rig file whose intrinsics are taken for the cameras that it names.
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Cameras with a pose in the rig file keep it, and the others are placed among them.
    #[arg(long, requires = "rig")]
    keep_poses: bool,
    /// Whose lengths are kept with --keep-poses. Default: the rig's if it is metric, else the wand's.
    #[arg(long, value_enum, value_name = "WHICH", requires = "keep_poses")]
    scale_from: Option<ScaleFrom>,
    /// At which frequency the LEDs blink before event cameras, hertz: one that all share, or three in the order of the gaps.
    #[arg(long, value_name = "HZ", value_delimiter = ',', default_value = "500", value_parser = crate::parse::within(1e-3, 1e5))]
    led_hz: Vec<f64>,
    /// Over how long events are gathered into one place of a LED, milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 10.0, value_parser = crate::parse::within(1e-3, 1e6))]
    window: f64,
    /// Keep focal lengths as they are.
    #[arg(long)]
    fix_focal: bool,
    /// How well focal lengths are known beforehand, in per cent.
    #[arg(long, value_name = "PERCENT", default_value_t = 1.0, conflicts_with = "fix_focal", value_parser = crate::parse::within(1e-6, 1e4))]
    focal_sigma: f64,
    /// Take all stamps to be of one clock.
    #[arg(long)]
    no_time_offsets: bool,
    /// Stamps of different cameras this near to each other may be taken for one instant, milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 2.0, value_parser = crate::parse::within(0.0, 1e6))]
    tolerance: f64,
    /// Standard deviation of an LED's position in all cameras, pixels. Default: that of the point files, or from the
    /// residuals.
    #[arg(long, value_name = "PX", value_parser = crate::parse::within(1e-6, 1e4))]
    sigma: Option<f64>,
    /// The camera in whose space the world lies, and to whose clock times are given; the first without it. With --keep-poses
    /// the world is the rig's.
    #[arg(long, value_name = "CAMERA")]
    reference: Option<String>,
    /// Cameras to leave out, separated by commas.
    #[arg(long, value_name = "CAMERAS", value_delimiter = ',')]
    without: Vec<String>,
    /// The share of placements that takes no part in the first solution, in per cent.
    #[arg(long, value_name = "PERCENT", default_value_t = 20.0, value_parser = crate::parse::within(0.0, 100.0))]
    hold_out: f64,
    /// Greatest number of placements; a longer recording is thinned.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    most: usize,
    /// Seed of random choices.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The rig file to write; the report goes beside it, with the extension html.
    #[arg(long, value_name = "FILE", default_value = "rig.json")]
    out: PathBuf,
}

/// What [`Arguments::scale_from`] can be.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum ScaleFrom {
    /// The rig's lengths.
    Rig,
    /// The wand's; the rig is made larger or smaller as a whole.
    Wand,
}

impl Arguments {
    fn blinks(&self) -> anyhow::Result<BlinkOptions> {
        let window_us = (self.window * 1e3).round() as i64;
        let blinks = BlinkOptions { led_hz: self.led_hz.clone(), window_us, ..BlinkOptions::default() };
        blinks.check().map_err(Usage)?;
        Ok(blinks)
    }

    fn options(&self) -> anyhow::Result<WandOptions> {
        if !(self.tolerance >= 0.0 && self.tolerance < 1e3) {
            return Err(Usage("--tolerance must lie between 0 and 1000 ms".into()).into());
        }
        if self.sigma.is_some_and(|sigma| !(sigma > 0.0 && sigma.is_finite())) {
            return Err(Usage("--sigma must be positive".into()).into());
        }
        let matching = Matching { tolerance_ns: (self.tolerance * 1e6).round() as i64, ..Matching::default() };
        Ok(WandOptions {
            matching,
            reference: self.reference.clone(),
            without: self.without.clone(),
            fix_focal: self.fix_focal,
            focal_sigma: self.focal_sigma / 100.0,
            time_offsets: !self.no_time_offsets,
            hold_out: self.hold_out / 100.0,
            most: self.most,
            seed: self.seed,
            ..WandOptions::new(self.wand)
        })
    }
}

/// Reads or looks for points, and calibrates.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut options = arguments.options()?;
    let rig = arguments.rig.as_deref().map(RigFile::read).transpose()?;
    let is_session = arguments.input.extension().is_some_and(|extension| extension == "mcap");
    let mut recording = match is_session {
        true => {
            let mut session = Session::open(&arguments.input)?;
            let sync = sync::of_session(&mut session, terminal)?;
            Some((session, sync))
        }
        false => None,
    };
    let mut cameras = match &mut recording {
        Some((session, sync)) => look(session, sync, rig.as_ref(), arguments, terminal)?,
        None => read_points(&arguments.input)?,
    };
    if let Some(rig) = &rig {
        let mut named = 0;
        for camera in &mut cameras {
            if let Some(known) = rig.camera(&camera.name) {
                camera.intrinsics = known.intrinsics;
                named += 1;
            }
        }
        if named == 0 {
            let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
            return Err(Usage(format!("the rig file names none of the cameras {}", names.join(", "))).into());
        }
    }
    if let Some(rig) = rig.filter(|_| arguments.keep_poses) {
        let mut known_rig = KnownRig::new(rig);
        match arguments.scale_from {
            Some(ScaleFrom::Rig) => known_rig.scale = Scale::Rig,
            Some(ScaleFrom::Wand) => known_rig.scale = Scale::Wand,
            None => {}
        }
        options.known = Some(known_rig);
    }
    if arguments.sigma.is_some() {
        cameras.iter_mut().for_each(|camera| camera.sigma_px = arguments.sigma);
    }
    let (rig, mut evidence) = calibrate(&cameras, &options)?;
    if let Some((session, sync)) = &mut recording {
        match pictures(session, sync, &rig, &evidence) {
            Ok(pictures) => evidence.pictures = pictures,
            Err(error) => terminal.note(format!("the report has no pictures: {error}")),
        }
    }
    finish(&rig, &evidence, &arguments.out, terminal)
}

/// Looks for the wand in a session, and tells what was found.
fn look(
    session: &mut Session,
    sync: &Synchronisation,
    rig: Option<&RigFile>,
    arguments: &Arguments,
    terminal: &Terminal,
) -> anyhow::Result<Vec<WandCamera>> {
    let mut of_stream: Option<(String, Progress)> = None;
    let found = look_session(session, sync, rig, &arguments.wand, &arguments.blinks()?, &mut |stream, step| {
        if of_stream.as_ref().is_none_or(|(of, _)| of != stream) {
            of_stream = Some((stream.to_owned(), terminal.progress(stream)));
        }
        if let Some((_, progress)) = &of_stream {
            progress.update(step.done, step.total, step.what);
        }
    });
    drop(of_stream);
    let found = found.map_err(|error| match error {
        WandError::NoIntrinsics { .. } => Usage(error.to_string()).into(),
        error => anyhow::Error::from(error),
    })?;
    for (camera, lit) in found.cameras.iter().zip(&found.lit) {
        let wands = camera.sightings.len();
        terminal.note(format!("{}: lights at {lit} instants, the wand at {wands}", camera.name));
    }
    if !found.without.is_empty() {
        terminal.note(format!("left out, as the rig file has no intrinsics for them: {}", found.without.join(", ")));
    }
    Ok(found.cameras)
}
