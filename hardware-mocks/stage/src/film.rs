//! Films the stage into a dataset: what `erfgs train` reads.
//!
//! RGB cameras record at a low rate with a true exposure integral (in linear light, then sRGB-encoded to 8 bits); event
//! cameras record events alone; held-out cameras record sharp frames at a high rate, with exact masks of what moves.
//! A frame is labelled with the middle of its exposure. The dataset has no initial point cloud, as a recording has
//! none; `truth_points.ply`, which the manifest does not name, holds points of the true surfaces for tests, and `truth`
//! what is true of what moves ([`crate::truth`]).

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use erfgs_base::Progress;
use erfgs_dataset::{Camera, CameraEvents, Dataset, Frame, Manifest, Provenance, Split};
use erfgs_events::npz;
use erfgs_scene::{ImageGrey8, ImageRgb8, Modality, PointCloud};
use glam::DVec3;
use rayon::prelude::*;

use super::{
    EventOptions, Flicker, RigCamera, RigOptions, Role, Stage, StageError, StageOptions, StageView,
    colour::to_u8,
    events,
    truth::{self, TRUTH},
    truth_points,
};

/// What to film, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmOptions {
    /// The scene. Its seed is [`FilmOptions::seed`].
    pub stage: StageOptions,
    /// The cameras.
    pub rig: RigOptions,
    /// The event sensors.
    pub events: EventOptions,
    /// Seed of the textures, the cameras' places and the sensors' noise.
    pub seed: u64,
    /// Length of the take, nanoseconds; it starts at 0.
    pub duration_ns: i64,
    /// Frame rate of the RGB cameras, hertz.
    pub rgb_fps: f64,
    /// Exposure of the RGB cameras, nanoseconds; 0 for instants.
    pub exposure_ns: i64,
    /// Frame rate of the held-out cameras, hertz. Their frames are instants.
    pub test_fps: f64,
    /// How many points of the true surfaces to put into `truth_points.ply`; 0 for no such file.
    pub truth_points: usize,
    /// Whether to write what is true of what moves into the folder `truth` (see [`crate::truth`]). With acts it is written anyway.
    pub truth: bool,
    /// Names of the cameras of the rig that film; all of them without it.
    pub cameras: Option<Vec<String>>,
    /// Name of the dataset in reports.
    pub name: String,
}

impl Default for FilmOptions {
    fn default() -> Self {
        Self {
            stage: StageOptions::default(),
            rig: RigOptions::default(),
            events: EventOptions::default(),
            seed: 1,
            duration_ns: 500_000_000,
            rgb_fps: 10.0,
            exposure_ns: 33_000_000,
            test_fps: 60.0,
            truth_points: 20_000,
            truth: false,
            cameras: None,
            name: "stage".to_owned(),
        }
    }
}

/// How many times faster than the RGB cameras the ideal rig is.
pub const CEILING: f64 = 8.0;
/// The most frames of one camera.
const MOST_FRAMES: f64 = 100_000.0;
/// Between two instants of an exposure nothing moves farther than this, pixels.
const EXPOSURE_STEP_PX: f64 = 0.35;
/// Progress of an event camera counts in this many parts.
const EVENT_PARTS: u64 = 10;

impl FilmOptions {
    fn check(&self) -> Result<(), StageError> {
        let seconds = |ns: i64| ns as f64 * 1e-9;
        let check = StageError::check;
        let duration = seconds(self.duration_ns);
        check("the duration, seconds,", duration, (0.001..=3600.0).contains(&duration), "0.001 to 3600")?;
        let exposure = seconds(self.exposure_ns);
        check("the exposure, seconds,", exposure, (0.0..=1.0).contains(&exposure), "0 to 1")?;
        if let Some(Flicker { hz, depth }) = self.stage.flicker {
            check("the lamp's flicker, hertz,", hz, (1.0..=20_000.0).contains(&hz), "1 to 20000")?;
            check("the depth of the lamp's flicker", depth, (0.0..=1.0).contains(&depth), "0 to 1")?;
        }
        for (what, fps) in
            [("the RGB frame rate, hertz,", self.rgb_fps), ("the test frame rate, hertz,", self.test_fps)]
        {
            check(
                what,
                fps,
                fps > 0.0 && fps * duration <= MOST_FRAMES,
                "above 0, and at most 100000 frames a camera",
            )?;
        }
        check(
            "the exposure in frame intervals (exposure times RGB frame rate)",
            exposure * self.rgb_fps,
            exposure * self.rgb_fps <= 1.0 + 1e-6,
            "at most 1: one sensor exposes one frame after the other",
        )?;
        Ok(())
    }

    /// What an ideal rig would record of the same take: the same RGB cameras, sharp and [`CEILING`] times as fast, and no event
    /// cameras. Held-out cameras stay as they are.
    #[must_use]
    pub fn ceiling(self) -> Self {
        Self { rig: RigOptions { event: 0, ..self.rig }, rgb_fps: CEILING * self.rgb_fps, exposure_ns: 0, ..self }
    }

    fn tells_truth(&self) -> bool {
        self.truth || !self.stage.acts.is_empty()
    }

    /// The times of the frames of a camera at `fps` hertz, nanoseconds: 0, 1/fps, ... up to the end of the take.
    fn times(&self, fps: f64) -> Vec<i64> {
        (0..)
            .map(|index| (f64::from(index) * 1e9 / fps).round() as i64)
            .take_while(|&t| t <= self.duration_ns)
            .collect()
    }

    /// The scene and the cameras that these options describe, filming or not.
    ///
    /// # Errors
    /// If the rig is impossible, or has no camera of a name.
    pub fn set_up(&self) -> Result<(Stage, Vec<RigCamera>), StageError> {
        let seconds = self.duration_ns as f64 * 1e-9;
        let stage = Stage::new(StageOptions { seed: self.seed, seconds, ..self.stage.clone() });
        let rig = self.rig.cameras(self.seed)?;
        let unknown = |name: &&String| rig.iter().all(|camera| camera.name != **name);
        if let Some(name) = self.cameras.iter().flatten().find(unknown) {
            return Err(StageError::unknown(name, &rig));
        }
        Ok((stage, rig))
    }

    fn films(&self, camera: &RigCamera) -> bool {
        self.cameras.as_ref().is_none_or(|names| names.contains(&camera.name))
    }
}

/// What was filmed, and how long it took.
#[derive(Clone, Debug)]
pub struct FilmReport {
    /// What was written, as it can be read again.
    pub dataset: Dataset,
    /// Frames of the RGB cameras, in all.
    pub rgb_frames: u64,
    /// Frames of the held-out cameras, in all.
    pub test_frames: u64,
    /// Events, in all.
    pub events: u64,
    /// Time spent on tracing the empty room from every viewpoint.
    pub room_time: Duration,
    /// Time spent on frames of the RGB cameras.
    pub rgb_time: Duration,
    /// Time spent on frames and masks of the held-out cameras.
    pub test_time: Duration,
    /// Time spent on events.
    pub event_time: Duration,
    /// Time spent on everything.
    pub total_time: Duration,
}

/// Films a dataset into the folder `out`, which must be absent, empty, or left by a film that was interrupted.
///
/// # Errors
/// If an option is out of its range, `out` is in use, or a file cannot be written.
pub fn film(out: &Path, options: &FilmOptions, progress: &(dyn Fn(Progress) + Sync)) -> Result<FilmReport, StageError> {
    let begun = Instant::now();
    options.check()?;
    let (stage, rig) = options.set_up()?;
    if in_use(out) {
        return Err(StageError::NotEmpty { path: out.to_owned() });
    }
    let (rgb_times, test_times) = (options.times(options.rgb_fps), options.times(options.test_fps));
    let work = |role| match role {
        Role::Rgb => rgb_times.len() as u64,
        Role::Event => EVENT_PARTS,
        Role::Test => test_times.len() as u64,
    };
    // A camera's number is that in the rig, so that its noise is the same whichever others film.
    let filming = || rig.iter().enumerate().filter(|(_, camera)| options.films(camera));
    let total = filming().map(|(_, camera)| work(camera.role)).sum();
    let done = AtomicU64::new(0);
    // One lock around the callback, so that it sees the count grow.
    let gate = Mutex::new(());
    let advance = |parts: u64| {
        let _held = gate.lock().unwrap_or_else(PoisonError::into_inner);
        progress(Progress {
            what: "frames and slices of events",
            done: done.fetch_add(parts, Ordering::Relaxed) + parts,
            total,
        });
    };
    let mut report = FilmReport {
        dataset: Dataset::new(out, empty_manifest(options)),
        rgb_frames: 0,
        test_frames: 0,
        events: 0,
        room_time: Duration::ZERO,
        rgb_time: Duration::ZERO,
        test_time: Duration::ZERO,
        event_time: Duration::ZERO,
        total_time: Duration::ZERO,
    };
    let mut points = PointCloud::default();
    for (number, camera) in filming() {
        let start = Instant::now();
        let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera)?;
        report.room_time += start.elapsed();
        let start = Instant::now();
        let mut entry = Camera {
            name: camera.name.clone(),
            modality: Modality::Rgb,
            split: Split::Train,
            intrinsics: camera.intrinsics,
            world_to_camera: camera.world_to_camera,
            pose_sigma: None,
            clock_sigma_s: None,
            frames: Vec::new(),
            events: None,
        };
        match camera.role {
            Role::Rgb => {
                entry.frames = rgb_frames(out, &view, &camera.name, &rgb_times, options.exposure_ns, &|| advance(1))?;
                report.rgb_frames += entry.frames.len() as u64;
                report.rgb_time += start.elapsed();
                let count = options.truth_points / options.rig.rgb.max(1);
                let seen = truth_points(&view, 0, count, options.seed.wrapping_add(number as u64));
                points.positions.extend(seen.positions);
                points.colours.extend(seen.colours);
            }
            Role::Event => {
                entry.modality = Modality::Event;
                let file = event_file(out, &view, &camera.name, options, number as u64, &advance)?;
                report.events += file.count;
                entry.events = Some(file);
                report.event_time += start.elapsed();
            }
            Role::Test => {
                entry.split = Split::Test;
                let labelled = options.tells_truth();
                entry.frames = test_frames(out, &view, &camera.name, &test_times, labelled, &|| advance(1))?;
                report.test_frames += entry.frames.len() as u64;
                report.test_time += start.elapsed();
            }
        }
        report.dataset.manifest.cameras.push(entry);
    }
    if !points.is_empty() {
        let path = out.join("truth_points.ply");
        points.write(&path).map_err(|source| StageError::Write { path, source: Box::new(source) })?;
    }
    if options.tells_truth() {
        truth::write(out, &stage, [0, options.duration_ns], &test_times)?;
    }
    let failed = |source| StageError::Write { path: out.join(Dataset::MANIFEST), source: Box::new(source) };
    report.dataset.hash_files().map_err(failed)?;
    report.dataset.save().map_err(failed)?;
    report.total_time = begun.elapsed();
    Ok(report)
}

/// Whether a folder holds anything but what an interrupted film leaves: the manifest comes last.
fn in_use(out: &Path) -> bool {
    let ours = ["images", "masks", "events", "truth_points.ply", TRUTH];
    let Ok(entries) = std::fs::read_dir(out) else { return false };
    entries.flatten().any(|entry| !ours.iter().any(|name| entry.file_name() == *name))
}

fn empty_manifest(options: &FilmOptions) -> Manifest {
    let mut given = BTreeMap::new();
    let rig = &options.rig;
    let mut note = |name: &str, value: serde_json::Value| given.insert(name.to_owned(), value);
    note("size", serde_json::json!([rig.width, rig.height]));
    note("cameras", serde_json::json!({ "rgb": rig.rgb, "event": rig.event, "test": rig.test }));
    note("arc_degrees", rig.arc_degrees.into());
    note("distance_m", rig.distance.into());
    note("rgb_fps", options.rgb_fps.into());
    note("exposure_ns", options.exposure_ns.into());
    note("test_fps", options.test_fps.into());
    note("shadows", options.stage.shadows.into());
    if !options.stage.acts.is_empty() {
        note("acts", options.stage.acts.iter().map(|act| act.name()).collect::<Vec<_>>().into());
    }
    if let Some(Flicker { hz, depth }) = options.stage.flicker {
        note("flicker", serde_json::json!({ "hz": hz, "depth": depth }));
    }
    note("samples_per_axis", options.stage.samples_per_axis.into());
    Manifest {
        format: Manifest::FORMAT.to_owned(),
        version: Manifest::VERSION,
        name: options.name.clone(),
        provenance: Provenance {
            importer: "stage".to_owned(),
            name: "stage".to_owned(),
            options: given,
            zero_ns: None,
            erfgs: env!("CARGO_PKG_VERSION").to_owned(),
        },
        span_ns: [0, options.duration_ns],
        seed: options.seed,
        variant: Vec::new(),
        linear_exposure: true,
        points: None,
        bodies: None,
        cameras: Vec::new(),
        sha256: BTreeMap::new(),
    }
}

fn rgb_frames(
    out: &Path,
    view: &StageView<'_>,
    name: &str,
    times: &[i64],
    exposure: i64,
    advance: &(dyn Fn() + Sync),
) -> Result<Vec<Frame>, StageError> {
    let one = |(index, &t): (usize, &i64)| {
        let open = t - exposure / 2;
        let exposure_ns = [open, open + exposure];
        let samples = view.exposure_samples(exposure_ns, EXPOSURE_STEP_PX);
        let file = PathBuf::from(format!("images/{name}/{index:05}.png"));
        write_image(out, &file, &image(view, &view.exposure(exposure_ns, samples)))?;
        advance();
        Ok(Frame { file, t_ns: t, exposure_ns, mask: None })
    };
    times.par_iter().enumerate().map(one).collect()
}

fn test_frames(
    out: &Path,
    view: &StageView<'_>,
    name: &str,
    times: &[i64],
    labelled: bool,
    advance: &(dyn Fn() + Sync),
) -> Result<Vec<Frame>, StageError> {
    let one = |(index, &t): (usize, &i64)| {
        let file = PathBuf::from(format!("images/{name}/{index:05}.png"));
        write_image(out, &file, &image(view, &view.frame(t)))?;
        if labelled {
            let file = PathBuf::from(format!("{TRUTH}/labels/{name}/{index:05}.png"));
            let (width, height) = (view.intrinsics.width, view.intrinsics.height);
            write_mask(out, &file, &ImageGrey8 { width, height, data: view.labels(t) })?;
        }
        let mask = PathBuf::from(format!("masks/{name}/{index:05}.png"));
        write_mask(out, &mask, &mask_image(view, &view.mask(t)))?;
        advance();
        Ok(Frame { file, t_ns: t, exposure_ns: [t, t], mask: Some(mask) })
    };
    times.par_iter().enumerate().map(one).collect()
}

fn event_file(
    out: &Path,
    view: &StageView<'_>,
    name: &str,
    options: &FilmOptions,
    stream: u64,
    advance: &(dyn Fn(u64) + Sync),
) -> Result<CameraEvents, StageError> {
    let covers_ns = [0, options.duration_ns];
    let done = AtomicU64::new(0);
    let tell = |share: f64| {
        let parts = (share * EVENT_PARTS as f64) as u64;
        advance(parts - done.swap(parts, Ordering::Relaxed));
    };
    let recorded = events::record(view, covers_ns, &options.events, options.seed, stream, &tell)?;
    let file = PathBuf::from(format!("events/{name}.npz"));
    let path = out.join(&file);
    let failed = |source: Box<dyn std::error::Error + Send + Sync>| StageError::Write { path: path.clone(), source };
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|error| failed(Box::new(error)))?;
    }
    npz::write_events(&path, &recorded).map_err(|error| failed(Box::new(error)))?;
    Ok(CameraEvents {
        file,
        count: recorded.len() as u64,
        threshold_on: options.events.threshold_on,
        threshold_off: options.events.threshold_off,
        lin_log_threshold: options.events.lin_log_threshold,
        linear_light: options.events.linear_light,
        covers_ns,
        simulator: serde_json::to_value(&options.events).ok(),
    })
}

/// Linear light as an 8-bit image.
#[must_use]
pub fn image(view: &StageView<'_>, linear: &[[f32; 3]]) -> ImageRgb8 {
    let data = linear.iter().flat_map(|pixel| to_u8(DVec3::from(pixel.map(f64::from)))).collect();
    ImageRgb8 { width: view.intrinsics.width, height: view.intrinsics.height, data }
}

/// A mask as an image: 255 where it is true.
#[must_use]
pub fn mask_image(view: &StageView<'_>, mask: &[bool]) -> ImageGrey8 {
    let data = mask.iter().map(|&moving| if moving { 255 } else { 0 }).collect();
    ImageGrey8 { width: view.intrinsics.width, height: view.intrinsics.height, data }
}

fn write_image(out: &Path, file: &Path, image: &ImageRgb8) -> Result<(), StageError> {
    let path = out.join(file);
    image.write_png(&path).map_err(|source| StageError::Write { path, source: Box::new(source) })
}

fn write_mask(out: &Path, file: &Path, mask: &ImageGrey8) -> Result<(), StageError> {
    let path = out.join(file);
    mask.write_png(&path).map_err(|source| StageError::Write { path, source: Box::new(source) })
}
