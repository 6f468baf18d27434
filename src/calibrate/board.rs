//! `erfgs calibrate board`: cameras from a chessboard, ChArUco board or AprilGrid.

use std::path::{Path, PathBuf};

use erfgs_calibrate::{
    board::{
        BoardDetections, BoardError, BoardOptions, CalibrationFolder, EventBoard, LensModel, Plate, Target, TwoParts,
        calibrate, look, look_session, pictures,
    },
    evidence::Evidence,
    report::telling,
};
use erfgs_scene::rig_file::RigFile;
use erfgs_session::container::{Session, recording_file};
use erfgs_sync::Synchronisation;

use super::summary::finish;
use crate::{errors::Usage, sync, terminal::Terminal};

/// Calibrate with a chessboard, ChArUco board or AprilGrid that was held before the cameras.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
INPUT is a session (S.mcap), or a folder that holds, for each camera, a folder of images, or a video, or images whose names begin with the camera's \
(left01.png, right01.png). Images of the same name or number are one instant; so are the n-th frames of videos, unless a file \
timestamps.csv (columns sync_index, cam_id, frame_time in seconds) gives their times. A folder with intrinsics (or intrinsic) and extrinsics (or extrinsic) in it, as \
caliscope and pose2sim write it, gives lenses from the first and poses from the second. For an event camera: a file of events \
(RAW, DAT, AEDAT) of a board that blinks on a screen (`erfgs calibrate target ... --out board.html`), held still at each place for half a second or longer; or, \
with --moving, of a printed board that was waved. In a session frames within half a frame interval are one instant; run \
`erfgs sync` first.

Targets:
  chessboard:9x6:0.025                    inner corners, side of a square in metres
  charuco:5x4:0.054:0.0405:DICT_4X4_50    squares, side of a square and of a marker; add :inverted for a white-on-black print, :legacy for what OpenCV drew before 4.6
  aprilgrid:6x6:0.088:0.3                 Kalibr's grid of tags: tags, side of a tag, the space between two as a share of it
  With :first=N behind it, the markers or tags count from N, so that two boards can be told apart.

A session's folder with videos of something else and a folder calibration_images (calib..., checkerboard..., chessboard..., charuco..., \
aprilgrid...) is looked for boards in that.

A clear board with markers can be used from both sides (--clear), which connects cameras that face each other: its mirror \
image is searched, too. Boards that are found only as mirror images without --clear are reported.

A board that is waved between cameras that face each other may have a target on either side (--back): a ChArUco board or an AprilGrid, with other markers than the front. The \
position of the back is estimated and reported: thickness, offset of the centres, and rotation between the sides. If some \
cameras see only the front and the others only the back, rotate the board about both its axes, or give its thickness \
(--back-thickness).

One camera gives intrinsics. Several are connected by boards that two of them see at once; the world is the first camera, or \
the board of --origin. A result that contradicts the cameras' single calibrations is refused or marked with a warning. If the \
residual grows with the speed of the board, the cameras are not synchronized: time offsets are then estimated, if frames have \
times. An error lists what was tried (offsets, --keep-intrinsics, --untie, finally --without) and which of it helps.

Examples:
  erfgs calibrate board images --target chessboard:9x6:0.025
  erfgs calibrate board take1.mcap --target chessboard:9x6:0.025
  erfgs calibrate board videos --target charuco:5x4:0.054:0.0405:DICT_4X4_50 --out rig.json
  erfgs calibrate board images --target aprilgrid:6x6:0.088:0.3
  erfgs calibrate board ring --target aprilgrid:6x6:0.088:0.3 --back aprilgrid:6x6:0.088:0.3:first=36
  erfgs calibrate board fisheyes --target chessboard:9x6:0.025 --lens fisheye
  erfgs calibrate board events --target chessboard:9x6:0.02 --blink 15
  erfgs calibrate board events --target chessboard:9x6:0.025 --moving
  erfgs calibrate board videos --target chessboard:9x6:0.025 --rig intrinsics.json
  erfgs calibrate board calibration/intrinsics --target chessboard:9x6:0.025 --intrinsics-only --out intrinsics.json
  erfgs calibrate board calibration/extrinsics --target chessboard:9x6:0.025 --rig intrinsics.json --origin 01")]
pub struct Arguments {
    /// A session, or a folder of images or videos of the board.
    input: PathBuf,
    /// The pattern on the board.
    #[arg(long, value_name = "TARGET")]
    target: Target,
    #[command(flatten)]
    sides: Sides,
    /// Lens model: pinhole, k1k2p1p2 (Kalibr's radtan), brown (k1, k2, p1, p2, k3), brown8 (rational) or fisheye.
    #[arg(long, value_name = "MODEL", default_value = "brown", value_parser = lens_model)]
    lens: LensModel,
    /// Hold fy/fx at 1.
    #[arg(long)]
    square_pixels: bool,
    /// A rig file whose intrinsics are kept for the cameras that it names.
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Keep the intrinsics that each camera alone gives while the poses are adjusted.
    #[arg(long)]
    keep_intrinsics: bool,
    /// Calibrate each camera by itself, and write no poses.
    #[arg(long, conflicts_with_all = ["keep_intrinsics", "time_offsets", "origin"])]
    intrinsics_only: bool,
    /// A camera to leave out; may be given several times.
    #[arg(long, value_name = "CAMERA")]
    without: Vec<String>,
    /// An instant whose pictures were not simultaneous: they are used for the lenses and not to connect cameras. May be
    /// given several times; an error names the instants for which it helps.
    #[arg(long, value_name = "INSTANT")]
    untie: Vec<String>,
    /// The picture or instant whose board is the world: origin at its first corner, x along its rows, z out of the sheet.
    #[arg(long, value_name = "INSTANT")]
    origin: Option<String>,
    /// Blink rate of the board on the screen, hertz, for event cameras. Excludes --back.
    #[arg(long, value_name = "HZ", value_parser = blink_rate, conflicts_with = "back")]
    blink: Option<f64>,
    /// Event cameras saw a printed board that moved.
    #[arg(long, conflicts_with = "blink")]
    moving: bool,
    /// Estimate each camera's time offset in any case; needs frame times and a board that moves.
    #[arg(long)]
    time_offsets: bool,
    /// The rig file to write; the report goes beside it, with the extension html.
    #[arg(long, value_name = "FILE", default_value = "rig.json")]
    out: PathBuf,
}

/// What is seen of a board beside its front.
#[derive(Debug, clap::Args)]
pub struct Sides {
    /// The board is clear (glass, acrylic), and cameras that see it from behind see its mirror image; it needs markers.
    #[arg(long, requires = "target", conflicts_with = "back")]
    clear: bool,
    /// The pattern on the back of a two-sided board, with other markers than the front.
    #[arg(long, value_name = "TARGET", requires = "target")]
    back: Option<Target>,
    /// How far the back is behind the front, millimetres; the sides are parallel, their middles and edges one behind the
    /// other. It is the initial value, and is kept if the views do not determine it.
    #[arg(long, value_name = "MM", value_parser = thickness, requires = "back")]
    back_thickness: Option<f64>,
}

impl Sides {
    /// The board with `front` on its front.
    pub fn plate(&self, front: &Target) -> Result<Plate, Usage> {
        match &self.back {
            Some(back) => Plate::two_sided(front.clone(), back.clone()).map_err(|error| Usage(error.to_string())),
            None if self.clear => Plate::clear(front.clone()).map_err(|error| Usage(error.to_string())),
            None => Ok(front.into()),
        }
    }

    /// The thickness that was stated, metres.
    pub fn thickness_m(&self) -> Option<f64> {
        self.back_thickness.map(|mm| 1e-3 * mm)
    }
}

/// How thick a board is, millimetres.
fn thickness(text: &str) -> Result<f64, String> {
    let mm = text.parse::<f64>().ok().filter(|mm| (0.0..=200.0).contains(mm));
    mm.ok_or_else(|| "write millimetres from 0 to 200".into())
}

/// How often a board blinks in a second.
pub fn blink_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().ok().filter(|rate| *rate > 0.0 && *rate <= 10_000.0);
    rate.ok_or_else(|| "write a rate between 0 and 10000 Hz".into())
}

/// A lens model by its name.
pub fn lens_model(text: &str) -> Result<LensModel, String> {
    match text {
        "pinhole" => Ok(LensModel::Pinhole),
        "k1k2p1p2" | "radtan" => Ok(LensModel::Brown4),
        "brown" => Ok(LensModel::Brown5),
        "brown8" => Ok(LensModel::Brown8),
        "fisheye" => Ok(LensModel::Fisheye),
        _ => Err("the lens models are pinhole, k1k2p1p2, brown, brown8 and fisheye".into()),
    }
}

/// The folder of a session in which its calibration was recorded, where there is one beside other recordings; else what was given.
pub fn recorded(input: &Path, terminal: &Terminal) -> anyhow::Result<PathBuf> {
    let input = &*recording_file(input)?;
    if !input.is_dir() {
        return Ok(input.to_owned());
    }
    let Some(CalibrationFolder { folder, passed_over }) = CalibrationFolder::of(input)? else {
        return Ok(input.to_owned());
    };
    terminal.note(format!("looking for the board in {}", folder.display()));
    if !passed_over.is_empty() {
        let shown = passed_over.iter().take(5).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = passed_over.len().saturating_sub(5);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        terminal.note(format!(
            "ignored, because they lie beside the calibration folder: {shown}{more} (give their folder to use them)"
        ));
    }
    Ok(folder)
}

/// Looks for the board in a session, or in a folder; of a session also its clocks, if `erfgs sync` has fitted them.
pub fn boards(
    input: &Path,
    plate: &Plate,
    events: Option<EventBoard>,
    terminal: &Terminal,
) -> anyhow::Result<(Vec<BoardDetections>, Option<Synchronisation>)> {
    let progress = terminal.progress("looking for the board");
    let tell = |done: usize, total: Option<usize>| match total {
        Some(total) => progress.update(done as u64, total as u64, "frames"),
        None => progress.share(0.0, || format!("{done} frames")),
    };
    let (seen, sync) = if input.is_file() {
        let mut session = Session::open(input)?;
        let sync = sync::kept(input, session.summary(), terminal)?;
        (look_session(&mut session, plate, events, sync.as_ref(), &tell)?, sync)
    } else {
        (look(input, plate, events, &tell)?, None)
    };
    drop(progress);
    for seen in &seen {
        let (views, frames, source) = (seen.views.len(), seen.frames, seen.source.display());
        terminal.note(format!("{}: the board is seen in {views} of {frames} frames of {source}", seen.camera));
        if let Some(hint) = seen.mirror_hint(plate) {
            terminal.note(format!("{}: {hint}", seen.camera));
        }
        if let Some((count, first)) = &seen.unreadable {
            terminal.note(format!("{}: {count} pictures could not be read: {first}", seen.camera));
        }
    }
    Ok((seen, sync))
}

/// Looks for boards and calibrates.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut options = BoardOptions {
        model: arguments.lens,
        square_pixels: arguments.square_pixels,
        time_offsets: arguments.time_offsets,
        back_thickness_m: arguments.sides.thickness_m(),
        keep_intrinsics: arguments.keep_intrinsics,
        intrinsics_only: arguments.intrinsics_only,
        without: arguments.without.iter().cloned().collect(),
        untied: arguments.untie.iter().cloned().collect(),
        origin: arguments.origin.clone(),
        ..BoardOptions::default()
    };
    if let Some(path) = &arguments.rig {
        let rig = RigFile::read(path)?;
        options.known = rig.cameras.into_iter().map(|camera| (camera.name, camera.intrinsics)).collect();
    }
    let blinking = arguments.blink.map(|hz| EventBoard::Blinking { hz });
    let events = blinking.or(arguments.moving.then_some(EventBoard::Moving));
    let mut input = recorded(&arguments.input, terminal)?;
    let mut lenses: Option<Found> = None;
    if let Some(parts) = TwoParts::of(&input) {
        if let Some(folder) = parts.lenses {
            terminal.note(format!("lenses from {}", folder.display()));
            let alone = BoardOptions { intrinsics_only: true, ..options.clone() };
            let found = calibrated(&folder, arguments, events, &alone, terminal)?;
            options.known.extend(found.rig.cameras.iter().map(|camera| (camera.name.clone(), camera.intrinsics)));
            lenses = Some(found);
        }
        match (parts.places, &lenses) {
            (Some(folder), _) => {
                terminal.note(format!("places from {}", folder.display()));
                input = folder;
            }
            (None, Some(found)) => return finish(&found.rig, &found.evidence, &arguments.out, terminal),
            (None, None) => {}
        }
    }
    match calibrated(&input, arguments, events, &options, terminal) {
        Ok(found) => {
            finish(&found.rig, &found.evidence, &arguments.out, terminal)?;
            match found.apart {
                Some(error) => {
                    Err(error.context(format!("{} holds the intrinsics alone, without poses", arguments.out.display())))
                }
                None => Ok(()),
            }
        }
        Err(error) => {
            // The lenses are sound, and hours of waving are not thrown away.
            let Some(found) = lenses else { return Err(error) };
            finish(&found.rig, &found.evidence, &arguments.out, terminal)?;
            Err(error.context(format!("{} holds the intrinsics alone, without poses", arguments.out.display())))
        }
    }
}

/// A rig that is to be written.
struct Found {
    rig: RigFile,
    evidence: Evidence,
    /// Why it has no poses, though they were asked for.
    apart: Option<anyhow::Error>,
}

/// Looks for boards in `input` and calibrates.
fn calibrated(
    input: &Path,
    arguments: &Arguments,
    events: Option<EventBoard>,
    options: &BoardOptions,
    terminal: &Terminal,
) -> anyhow::Result<Found> {
    let plate = &arguments.sides.plate(&arguments.target)?;
    let (seen, sync) = boards(input, plate, events, terminal)?;
    let progress = terminal.progress("calibrating");
    let result = calibrate(&seen, plate, options, &|done, total, what| {
        progress.update(done as u64, total as u64, what);
    });
    drop(progress);
    let ((rig, mut evidence), apart) = match result {
        Ok(calibrated) => (calibrated, None),
        Err(error) => match &error {
            BoardError::Apart { alone, .. } | BoardError::BackOpen { alone, .. } => {
                ((**alone).clone(), Some(error.into()))
            }
            _ => return Err(error.into()),
        },
    };
    for table in &evidence.tables {
        terminal.note(&table.note);
    }
    // In the rig's order, and without the cameras that are not in it.
    let of_rig = |name: &str| seen.iter().find(|seen| seen.camera == name).cloned();
    let seen: Vec<BoardDetections> = rig.cameras.iter().filter_map(|camera| of_rig(&camera.name)).collect();
    match pictures(&seen, plate, events, &evidence, &telling(&rig, &evidence), sync.as_ref()) {
        Ok(pictures) => evidence.pictures = pictures,
        Err(error) => terminal.note(format!("the report has no pictures: {error}")),
    }
    Ok(Found { rig, evidence, apart })
}
