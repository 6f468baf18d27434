//! `erfgs train`: from a dataset to a run.

mod begin;
mod live;
mod trial;

use std::{
    net::SocketAddr,
    path::{Path, PathBuf},
    sync::atomic::AtomicBool,
};

use anyhow::Context;
use clap::Parser as _;
use erfgs_dataset::{Dataset, Split};
use erfgs_points::{CloudOptions, Method as CloudMethod};
use erfgs_run::{CameraPose, CameraTime, CurveRow, LeftOut, RunFolder};
use erfgs_scene::Modality;
use erfgs_splat::{gpu::Gpu, ply::write_ply};
use erfgs_train::{
    checkpoint::Checkpoint,
    config::{Config, Method, MotionModel, Preset},
    scene::{Flicker, Scene},
    schedule::{Budget, Clock},
    static_set::StaticSet,
    trainer::{Outcome, Progress, TrainError, TrainOptions, Trainer, Watch},
    trial::Setting,
};
use serde::Serialize;

use self::live::Live;
use crate::{
    dataset::points,
    device::Adapter,
    errors::{Stopped, Usage},
    interrupt::stop_flag,
    parse::Iterations,
    progress::{Progress as Bar, duration},
    terminal::{Terminal, bytes, table, thousands},
};

const GIBIBYTE: f64 = (1_u64 << 30) as f64;

/// Train a dynamic scene from a dataset.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Methods:
  erf-gs  event-RGB fusion: 4DGS with the event loss (EARL) and event-guided densification (EDS)
  4dgs    the baseline: frames alone

Presets (config.toml of a run lists every field, and --set changes any):
  paper          ERF-GS as the paper writes it, with the sizes of its Neu3D configuration
  released-code  ERF-GS as its released code does it
  default        the best quality of moving pixels for the processor time

Motion:
  hexplane   a deformation field that all Gaussians share (4DGS)
  free-time  each Gaussian is born at an instant with a velocity and fades (after FreeTimeGS); starts from the moving points \
  of `erfgs dataset points`
  still      nothing moves: no motion is learned, and events are not used
  bodies     a few rigid bodies move, and the Gaussians of each share one path for the whole recording; starts from `erfgs \
  dataset bodies`
  auto       the choice of the default preset: bodies if the dataset has some and the method is erf-gs, free-time if it has \
  moving points, still if neither frames nor events show motion, else hexplane

Not everything that moves is rigid or was tracked correctly. Before a training with bodies, two short trainings with and \
without them are compared on cameras that take no part. A body that explains these worse is replaced by free-time Gaussians; \
trial.json in the run has the figures. --set bodies.trial=0 skips the trial, and --set 'bodies.free=[\"body3\"]' names bodies \
to replace.

A dataset may be larger than memory. Frames that do not fit in --memory are read again by a thread for each processor while \
others are trained on. Events that would take more than half of it, at 8 bytes each, are kept in temporary files in the run's \
folder. The result is the same. On a GPU reading may limit the speed; JPEG reads faster than PNG.

On the device frames and events stay, as far as --device-memory has room: events take at most half of it, frames the rest, the \
least recently used of which make way for others. If all fit, an iteration transfers nothing of the size of an image. The result is \
the same.

A long take is trained in windows. Static Gaussians are learned once: train one window, and the others with --static and that \
run. They reuse its static Gaussians, camera poses and camera colours, skip the coarse stage, and train only what moves and \
what looks different in their frames. `erfgs sweep` does this for all windows of a take.

With --live a page shows the scene during the training (as `erfgs view` does afterwards), the curves, and buttons that save a \
checkpoint and stop. For a training on another machine run `ssh -L 8200:localhost:8200 HOST` here, and open the link that was \
printed there.

A dataset without initial points gets them first (see `erfgs dataset points`). Ctrl-C saves a checkpoint; the same command \
with --resume goes on from there. With --resume the same command starts the training and restarts it wherever it was killed: \
it starts without a checkpoint, continues from one, and ends at once if nothing is left to do. A dataset or settings other \
than those of the run are refused.

Examples:
  erfgs train ds-dv --method erf-gs --preset paper --iterations 3000+14000 --seed 1 --out run
  erfgs train ds-dv --method 4dgs --minutes 10 --out run-4dgs
  erfgs train ds-dv --cpu-minutes 14 --out run-14
  erfgs train ds-dv --motion free-time --out run
  erfgs dataset bodies ds-dv && erfgs train ds-dv --out run
  erfgs train ds-dv --out run --set earl.quantise=none --set density.max_gaussians=100000
  erfgs train ds-dv --out run --live
  erfgs train ds-long --out run --memory 4
  erfgs train ds-w1 --static run-w0 --out run-w1
  erfgs train ds-dv --out run --resume")]
pub struct Arguments {
    /// The dataset.
    dataset: PathBuf,
    /// The run folder to write.
    #[arg(long, value_name = "RUN")]
    out: PathBuf,
    /// The method to train. Default: erf-gs.
    #[arg(long, value_enum)]
    method: Option<MethodName>,
    /// The preset that settings start from. Default: default.
    #[arg(long, value_enum)]
    preset: Option<PresetName>,
    /// Settings from a file (config.toml of another run); --method, --preset and what they imply are then taken from it.
    #[arg(long, value_name = "CONFIG.toml", conflicts_with_all = ["method", "preset"])]
    config: Option<PathBuf>,
    /// The motion model. Default: that of the preset.
    #[arg(long, value_enum)]
    motion: Option<MotionName>,
    /// Iterations of the coarse and the fine stage; one number alone is of the fine stage.
    #[arg(long, value_name = "COARSE+FINE")]
    iterations: Option<Iterations>,
    /// Minutes of training; learning rates and densification then follow the clock where it is ahead of the iterations.
    #[arg(long, value_name = "M", value_parser = minutes)]
    minutes: Option<f64>,
    /// Minutes of CPU time of training, over all threads: the same amount of work on a busy machine.
    #[arg(long, value_name = "M", value_parser = minutes)]
    cpu_minutes: Option<f64>,
    /// Seed of everything random.
    #[arg(long)]
    seed: Option<u64>,
    /// Change a setting; may be given again.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Continue from the checkpoint of the run folder, if there is one, with its settings where none are given here.
    #[arg(long)]
    resume: bool,
    /// With --resume: continue with the settings given here, though the run was started with others.
    #[arg(long, requires = "resume")]
    change: bool,
    /// Give the same bytes for the same command on the same adapter: wall time has no influence.
    #[arg(long, conflicts_with_all = ["minutes", "cpu_minutes"])]
    deterministic: bool,
    /// Do not look at held-out cameras during training.
    #[arg(long)]
    no_evaluation: bool,
    /// Show the scene in a browser while it is trained, at this address; port 0 takes any free one.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "127.0.0.1:8200")]
    live: Option<SocketAddr>,
    /// Memory for frames and events, GiB. Default: half of the free memory. Frames that do not fit are read from the dataset
    /// again, in parallel with training; events that do not fit are kept in files.
    #[arg(long, value_name = "GIB", value_parser = gibibytes)]
    memory: Option<f64>,
    /// Memory of the device for frames and events, GiB. Default: a quarter of the device's memory, or of the free memory if it shares the
    /// processor's. What does not fit is uploaded when it is used.
    #[arg(long, value_name = "GIB", value_parser = gibibytes)]
    device_memory: Option<f64>,
    /// Reuse the static Gaussians of this run, which is another window of the same take; skips the coarse stage.
    #[arg(long = "static", value_name = "RUN")]
    static_set: Option<PathBuf>,
    /// Method for the initial points, if the dataset has none: colmap, sweep, colmap+sweep or random.
    #[arg(long, value_name = "METHOD")]
    init: Option<CloudMethod>,
    #[command(flatten)]
    adapter: Adapter,
}

/// A method, as the command line spells it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum MethodName {
    /// The baseline.
    #[value(name = "4dgs")]
    FourDgs,
    /// Event-RGB fusion.
    ErfGs,
}

impl MethodName {
    /// Its spelling.
    pub fn name(self) -> &'static str {
        match self {
            Self::FourDgs => "4dgs",
            Self::ErfGs => "erf-gs",
        }
    }
}

/// A motion model, as the command line spells it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum MotionName {
    /// A deformation field of planes and a network.
    #[value(name = "hexplane")]
    HexPlane,
    /// A trajectory and a life for each Gaussian.
    FreeTime,
    /// Bodies whose Gaussians share paths, found by `erfgs dataset bodies`
    Bodies,
    /// Nothing moves.
    Still,
    /// Chosen by what the dataset contains.
    Auto,
}

impl From<MotionName> for MotionModel {
    fn from(name: MotionName) -> Self {
        match name {
            MotionName::HexPlane => Self::HexPlane,
            MotionName::FreeTime => Self::FreeTime,
            MotionName::Bodies => Self::Bodies,
            MotionName::Still => Self::Still,
            MotionName::Auto => Self::Auto,
        }
    }
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::FourDgs => Self::FourDgs,
            MethodName::ErfGs => Self::ErfGs,
        }
    }
}

/// A preset, as the command line spells it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum PresetName {
    /// The paper.
    Paper,
    /// Its released code.
    ReleasedCode,
    /// Ours.
    Default,
}

impl PresetName {
    /// Its spelling.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::ReleasedCode => "released-code",
            Self::Default => "default",
        }
    }
}

impl From<PresetName> for Preset {
    fn from(name: PresetName) -> Self {
        match name {
            PresetName::Paper => Self::Paper,
            PresetName::ReleasedCode => Self::ReleasedCode,
            PresetName::Default => Self::Default,
        }
    }
}

fn minutes(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(minutes) if minutes > 0.0 && minutes <= 1e6 => Ok(minutes),
        _ => Err("a positive number of minutes is needed".into()),
    }
}

fn bytes_of(gibibytes: f64) -> u64 {
    (gibibytes * GIBIBYTE) as u64
}

fn gibibytes(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(size) if (0.0..=1e6).contains(&size) => Ok(size),
        _ => Err("a number of GiB is needed, such as 4; 0 keeps nothing".into()),
    }
}

impl Arguments {
    /// The settings of a new run.
    fn settings(&self) -> anyhow::Result<Config> {
        let config = match &self.config {
            Some(path) => {
                let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
                Config::from_toml(&text).with_context(|| format!("{} cannot be used", path.display()))?
            }
            None => {
                let method = self.method.unwrap_or(MethodName::ErfGs);
                Config::preset(method.into(), self.preset.unwrap_or(PresetName::Default).into())
            }
        };
        self.changed(config)
    }

    /// The settings with which a run is gone on with that has settings already.
    fn settings_after(&self, begun: &Config) -> anyhow::Result<Config> {
        let anew = self.config.is_some() || self.method.is_some() || self.preset.is_some();
        if anew { self.settings() } else { self.changed(begun.clone()) }
    }

    /// `config` with what the command line says of single settings.
    fn changed(&self, mut config: Config) -> anyhow::Result<Config> {
        if let Some(iterations) = self.iterations {
            config.coarse_iterations = iterations.coarse.unwrap_or(config.coarse_iterations);
            config.fine_iterations = iterations.fine;
        }
        if let Some(motion) = self.motion {
            config.motion = motion.into();
        }
        if let Some(seed) = self.seed {
            config.seed = seed;
        }
        for assignment in &self.set {
            config.set(assignment).map_err(|error| Usage(error.to_string()))?;
        }
        config.validate().map_err(|error| Usage(error.to_string()))?;
        Ok(config)
    }

    fn options(&self) -> TrainOptions {
        TrainOptions {
            budget: Budget {
                seconds: self.minutes.map(|minutes| minutes * 60.0),
                cpu_seconds: self.cpu_minutes.map(|minutes| minutes * 60.0),
            },
            evaluate: !self.no_evaluation,
            deterministic: self.deterministic,
            device_memory: self.device_memory.map(bytes_of),
        }
    }

    /// The command that goes on where this one stopped.
    fn resume_command(&self) -> String {
        let mut words = vec!["erfgs".into(), "train".into(), shell_word(&self.dataset)];
        words.extend(["--out".into(), shell_word(&self.out), "--resume".into()]);
        words.extend(self.minutes.map(|minutes| format!("--minutes {minutes}")));
        words.extend(self.cpu_minutes.map(|minutes| format!("--cpu-minutes {minutes}")));
        words.extend(self.deterministic.then(|| "--deterministic".into()));
        words.extend(self.no_evaluation.then(|| "--no-evaluation".into()));
        words.extend(self.memory.map(|size| format!("--memory {size}")));
        words.extend(self.device_memory.map(|size| format!("--device-memory {size}")));
        words.extend((self.init == Some(CloudMethod::Random)).then(|| "--init random".into()));
        words.extend(self.adapter.adapter.as_ref().map(|name| format!("--adapter {}", shell_word(Path::new(name)))));
        words.join(" ")
    }
}

fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./+=:".contains(c);
    if text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

#[derive(Serialize)]
struct Summary<'a> {
    run: &'a Path,
    finished: bool,
    iterations: u64,
    train_seconds: f64,
    cpu_seconds: f64,
    gaussians: u64,
    dynamic: u64,
    psnr: Option<f64>,
    dpsnr: Option<f64>,
    camera_poses: Vec<CameraPose>,
    camera_times: Vec<CameraTime>,
    left_out: Vec<LeftOut>,
}

impl<'a> Summary<'a> {
    /// What the curve of a finished run says.
    fn of_finished(folder: &'a RunFolder) -> anyhow::Result<Self> {
        let rows = folder.read_curve()?.rows;
        let last = rows.last().cloned().unwrap_or_default();
        let look = |quality: fn(&CurveRow) -> Option<f64>| rows.iter().rev().find_map(quality);
        let info = folder.read_info()?;
        Ok(Self {
            run: folder.root(),
            finished: true,
            iterations: last.iteration,
            train_seconds: last.wall_seconds,
            cpu_seconds: last.cpu_seconds.unwrap_or_default(),
            gaussians: last.gaussians,
            dynamic: last.dynamic,
            psnr: look(|row| row.psnr),
            dpsnr: look(|row| row.dpsnr),
            camera_poses: info.camera_poses,
            camera_times: info.camera_times,
            left_out: info.left_out,
        })
    }
}

/// Says what is wrong with the words of a training, if something is.
pub fn check(words: impl Iterator<Item = String>) -> Result<(), String> {
    #[derive(Debug, clap::Parser)]
    struct Alone {
        #[command(flatten)]
        arguments: Arguments,
    }
    let parsed = Alone::try_parse_from(std::iter::once("train".to_owned()).chain(words));
    let first_line =
        |error: clap::Error| error.to_string().lines().next().unwrap_or_default().replacen("error: ", "", 1);
    let Alone { arguments } = parsed.map_err(first_line)?;
    arguments.settings().map(drop).map_err(|error| format!("{error:#}"))
}

/// Trains.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let folder = RunFolder::new(&arguments.out);
    if !folder.checkpoint_file().is_file() {
        // What is wrong with the words is said before anything is begun.
        arguments.settings()?;
    }
    let mut dataset = Dataset::load(&arguments.dataset)?;
    let _alone = begin::alone(&folder, terminal)?;
    let checkpoint = begin::checkpoint(&folder, arguments.resume)?;
    let mut config = match &checkpoint {
        Some(checkpoint) => arguments.settings_after(&checkpoint.config)?,
        None => arguments.settings()?,
    };
    let static_set = arguments.static_set.as_ref().map(|run| StaticSet::open(&RunFolder::open(run)?)).transpose()?;
    let random = arguments.init == Some(CloudMethod::Random);
    if dataset.manifest.points.is_none() && !random && checkpoint.is_none() {
        terminal.note("the dataset has no initial points yet: making them");
        let method = arguments.init.unwrap_or_default();
        points::make(&mut dataset, &CloudOptions { method, ..CloudOptions::default() }, terminal)?;
    }
    let has_events = dataset.cameras(Split::Train).any(|camera| camera.modality != Modality::Rgb);
    if config.method == Method::ErfGs && !has_events {
        terminal.note("no training camera has events: ERF-GS trains on the frames alone");
    }
    let without_points = random || dataset.manifest.points.is_none();
    let static_set = begin::settle(&mut config, &dataset, without_points, static_set, checkpoint.as_ref(), terminal)?;
    let options = arguments.options();
    let mut tried = trial::known(&dataset, &config, options.budget, &folder)?;
    if let Some(tried) = &tried {
        trial::take(&mut config, &dataset, tried);
    }
    if let Some(checkpoint) = &checkpoint {
        let identity = |config: &Config| Trainer::identity(&dataset, config, options.budget);
        let stands = begin::same(&folder, &identity(&checkpoint.config)?, &identity(&config)?, arguments.change)?;
        if let Some(version) = stands.other_version() {
            terminal.note(format!("the run was begun with erfgs {version}; this is {}", env!("CARGO_PKG_VERSION")));
        }
        // A run of an earlier version is saved again, with what drawing it takes.
        if stands.is_finished(&folder) && checkpoint.record.is_some() {
            terminal.note(format!("{} is finished: nothing is left to do", folder.root().display()));
            let summary = Summary::of_finished(&folder)?;
            return terminal.result(&summary, || describe(&summary));
        }
    }
    let memory = arguments.memory.map(bytes_of);
    let gpu = arguments.adapter.open()?;
    let begun = checkpoint.is_some();
    if !begun && tried.is_none() {
        let (static_set, device_memory) = (static_set.as_ref(), options.device_memory);
        let setting = Setting { gpu: &gpu, dataset: &dataset, config: &config, static_set, memory, device_memory };
        tried = trial::make(&setting, options.budget, &folder, terminal)?;
        if let Some(tried) = &tried {
            trial::take(&mut config, &dataset, tried);
        }
    }
    let scene = Scene::load_within(dataset, &config, without_points, memory, folder.root())?;
    tell_of(&scene, terminal);
    let mut trainer = match (checkpoint, &static_set) {
        (Some(checkpoint), _) => Trainer::resume(&gpu, scene, Checkpoint { config, ..checkpoint }, &options)?,
        (None, Some(set)) => Trainer::within(&gpu, scene, config, &options, set)?,
        (None, None) => Trainer::new(&gpu, scene, config, &options)?,
    };
    let [most, all] = trainer.device_room();
    if all > most {
        let [most, all] = [most, all].map(bytes);
        terminal.note(format!(
            "frames and events need {all} on the device: {most} of them stay there (--device-memory), the others are uploaded when they \
             are used"
        ));
    }
    if let Some(tried) = tried.filter(|_| !begun && !arguments.deterministic) {
        trainer.clock = Clock::after([tried.seconds, tried.cpu_seconds]);
    }
    drive(arguments, terminal, &gpu, trainer, &folder, &options)
}

/// Says what of the dataset is not taken as it lies there.
fn tell_of(scene: &Scene, terminal: &Terminal) {
    if !scene.pictures.all_are_kept() {
        let [kept, all] = scene.pictures.bytes().map(bytes);
        terminal.note(format!(
            "frames need {all}: {kept} of them are kept in memory (--memory), the others are read during the training"
        ));
    }
    if scene.events_filed {
        let events: u64 = scene.events.iter().map(|events| events.count).sum();
        terminal.note(format!("{events} events are kept in temporary files, because --memory has no room for them"));
    }
    if let Some(Flicker { hz, share, .. }) = &scene.flicker {
        terminal.note(format!(
            "the light flickers at {hz:.1} Hz for {:.0} % of the event cameras' pixels: event bins begin and end at the peaks of the \
             light (earl.flicker). Steady light allows shorter bins and shows more of fast motion",
            100.0 * share
        ));
    }
    for events in &scene.events {
        let camera = &scene.dataset.manifest.cameras[events.view];
        let (file, camera) = (&camera.events, &camera.name);
        let stated = file.as_ref().map(|file| file.threshold_on / file.threshold_off);
        if let Some((told, stated)) = events.told_ratio.zip(stated) {
            terminal.note(format!(
                "camera {camera}: measured ON/OFF threshold ratio {told:.2}; the stated {stated:.2} is ignored (earl.balance)"
            ));
        }
        if events.drift != 0.0 {
            let drift = events.drift;
            terminal.note(format!(
                "camera {camera}: leak and noise events add up to {drift:+.1} contrast thresholds per pixel; they are subtracted \
                 (earl.balance)"
            ));
        }
    }
}

fn drive(
    arguments: &Arguments,
    terminal: &Terminal,
    gpu: &Gpu,
    mut trainer: Trainer<'_>,
    folder: &RunFolder,
    options: &TrainOptions,
) -> anyhow::Result<()> {
    let stop = stop_flag("the iteration ends, then a checkpoint is saved")?;
    let live = arguments.live.map(|address| Live::start(address, &trainer, folder, terminal)).transpose()?;
    let mut watch =
        Follow { bar: terminal.progress("training"), live, stop, first: None, last: None, quality: (None, None) };
    let outcome = trainer.run(folder, options, stop, &mut watch);
    let Follow { bar, live, last, quality, .. } = watch;
    drop(bar);
    if let Some(live) = live {
        live.end(&mut trainer, &outcome);
    }
    if let Err(TrainError::Scene(_)) = &outcome {
        let command = arguments.resume_command();
        terminal.note(format!("a checkpoint is saved; once the file can be read again, continue with: {command}"));
    }
    let outcome = outcome?;
    let gaussians = trainer.model.drawn.gaussians_still(gpu)?;
    write_ply(&folder.point_cloud_file(), &gaussians)?;
    if outcome == Outcome::Finished {
        folder.finish()?;
    }
    let done = trainer.iterations_done();
    let summary = Summary {
        run: folder.root(),
        finished: outcome == Outcome::Finished,
        iterations: done,
        train_seconds: trainer.clock.seconds,
        cpu_seconds: trainer.clock.cpu_seconds,
        gaussians: trainer.model.drawn.gaussians.count.into(),
        dynamic: last.map_or(0, |last| last.dynamic.into()),
        psnr: quality.0,
        dpsnr: quality.1,
        camera_poses: trainer.camera_poses(),
        camera_times: trainer.camera_times(),
        left_out: trainer.left_out().to_vec(),
    };
    terminal.result(&summary, || describe(&summary))?;
    if outcome == Outcome::Stopped {
        let command = arguments.resume_command();
        return Err(Stopped(format!("stopped after {done} iterations; go on with: {command}")).into());
    }
    terminal.note(format!("measure it with: erfgs eval {}", shell_word(folder.root())));
    Ok(())
}

/// What follows a run: a line on the terminal, and a page where one was asked for.
struct Follow {
    bar: Bar,
    live: Option<Live>,
    stop: &'static AtomicBool,
    /// Iteration and seconds of training at the first sight.
    first: Option<(u64, f64)>,
    last: Option<Progress>,
    /// PSNR and DPSNR at the last look.
    quality: (Option<f64>, Option<f64>),
}

impl Watch for Follow {
    fn progress(&mut self, now: &Progress) {
        let &mut (iteration, seconds) = self.first.get_or_insert((now.iteration, now.seconds));
        self.quality = (now.psnr.or(self.quality.0), now.dpsnr.or(self.quality.1));
        let quality = self.quality;
        self.bar.share(now.share, || {
            let pace = (now.iteration - iteration) as f64 / (now.seconds - seconds).max(1e-9);
            let mut text = format!(
                "{} iteration {}, {pace:.1} a second, {} Gaussians",
                now.stage.name(),
                thousands(now.iteration),
                thousands(now.gaussians.into())
            );
            for (name, value) in [("PSNR", quality.0), ("DPSNR", quality.1)] {
                text.extend(value.map(|value| format!(", {name} {value:.2} dB")));
            }
            text
        });
        if let Some(live) = &mut self.live {
            live.progress(now, self.stop);
        }
        self.last = Some(*now);
    }

    fn wants_look(&mut self) -> bool {
        self.live.as_mut().is_some_and(Live::wants_look)
    }

    fn look(&mut self, trainer: &mut Trainer<'_>) -> Result<(), TrainError> {
        self.live.as_mut().map_or(Ok(()), |live| live.look(trainer))
    }

    fn wants_checkpoint(&mut self) -> bool {
        self.live.as_mut().is_some_and(Live::wants_checkpoint)
    }
}

fn describe(summary: &Summary<'_>) -> String {
    let mut rows = vec![
        ("run", summary.run.display().to_string()),
        ("iterations", thousands(summary.iterations)),
        ("time", format!("{}, {} of CPU time", duration(summary.train_seconds), duration(summary.cpu_seconds))),
        ("Gaussians", format!("{}, of which {} move", thousands(summary.gaussians), thousands(summary.dynamic))),
    ];
    for (name, value) in [("PSNR", summary.psnr), ("DPSNR", summary.dpsnr)] {
        rows.extend(value.map(|value| (name, format!("{value:.2} dB at the last evaluation"))));
    }
    let mut moved: Vec<&CameraPose> = summary.camera_poses.iter().collect();
    moved.sort_by(|a, b| a.moved_px.total_cmp(&b.moved_px));
    if let Some(most) = moved.last() {
        let (median, CameraPose { camera, moved_px, .. }) = (moved[moved.len() / 2].moved_px, most);
        let text = format!(
            "learned poses differ from the calibration by {median:.2} px in the median, by {moved_px:.2} px at most ({camera})"
        );
        rows.push(("cameras", text));
    }
    if let Some(CameraTime { camera, late_ms }) =
        summary.camera_times.iter().max_by(|a, b| a.late_ms.abs().total_cmp(&b.late_ms.abs()))
    {
        let late = if *late_ms < 0.0 { "earlier" } else { "later" };
        let text =
            format!("{camera} took its frames {:.1} ms {late} than they say, the others came nearer", late_ms.abs());
        rows.push(("clocks", text));
    }
    rows.extend(summary.left_out.iter().map(|left_out| ("left out", left_out.to_string())));
    table(&rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_blanks_and_quotes_are_quoted_for_the_shell() {
        let words = ["runs/a-1", "my runs", "it's"].map(|word| shell_word(Path::new(word)));
        assert_eq!(words, ["runs/a-1", "'my runs'", r"'it'\''s'"]);
    }
}
