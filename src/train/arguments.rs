//! The words of `erfgs train`, and the settings that they make.

use std::{
    net::SocketAddr,
    path::{Path, PathBuf},
};

use anyhow::Context;
use clap::Parser as _;
use erfgs_points::Method as CloudMethod;
use erfgs_train::{config::Config, schedule::Budget, trainer::TrainOptions};

use super::names::{MethodName, MotionName, PresetName};
use crate::{device::Adapter, errors::Usage, parse::Iterations};

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
  bodies     a few bodies move, rigid ones and some that bend, and the Gaussians of each share paths for the whole recording; \
  starts from `erfgs dataset bodies`
  auto       the choice of the default preset: bodies if the dataset has some and the method is erf-gs, free-time if it has \
  moving points, still if neither frames nor events show motion, else hexplane

Not everything that moves is rigid or was tracked correctly. Before a training with bodies, two short trainings with and \
without them are compared on cameras that take no part. A body that explains these worse is replaced by free-time Gaussians; \
what has no single shape bends: its parts are followed from frames a few intervals apart. trial.json in the run has the figures. --set bodies.trial=0 skips the trial, --set 'bodies.free=[\"body3\"]' names bodies to replace, and \
--set 'bodies.bend=[\"body1\"]' those that bend.

A dataset may be larger than memory. Frames that do not fit in --memory are read again by a thread for each processor while \
others are trained on. Events that would take more than half of it, at 8 bytes each, are kept in temporary files in the run's \
folder. The result is the same. On a GPU reading may limit the speed; JPEG reads faster than PNG.

On the device frames and events stay, as far as --device-memory has room: events take at most half of it, frames the rest, the \
least recently used of which make way for others. If all fit, an iteration transfers nothing of the size of an image. The result is \
the same.

Before it begins, a training states the memory that it will take of the device: with the Gaussians of the start, and at most, with as \
many as density.max_gaussians and eds.max_gaussians allow. Where the device may have too little, a warning names what takes most and \
the settings that fit.

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
    pub(super) dataset: PathBuf,
    /// The run folder to write.
    #[arg(long, value_name = "RUN")]
    pub(super) out: PathBuf,
    /// The method to train. Default: erf-gs.
    #[arg(long, value_enum)]
    pub(super) method: Option<MethodName>,
    /// The preset that settings start from. Default: default.
    #[arg(long, value_enum)]
    pub(super) preset: Option<PresetName>,
    /// Settings from a file (config.toml of another run); --method, --preset and what they imply are then taken from it.
    #[arg(long, value_name = "CONFIG.toml", conflicts_with_all = ["method", "preset"])]
    pub(super) config: Option<PathBuf>,
    /// The motion model. Default: that of the preset.
    #[arg(long, value_enum)]
    pub(super) motion: Option<MotionName>,
    /// Iterations of the coarse and the fine stage; one number alone is of the fine stage.
    #[arg(long, value_name = "COARSE+FINE")]
    pub(super) iterations: Option<Iterations>,
    /// Minutes of training; learning rates and densification then follow the clock where it is ahead of the iterations.
    #[arg(long, value_name = "M", value_parser = minutes)]
    pub(super) minutes: Option<f64>,
    /// Minutes of CPU time of training, over all threads: the same amount of work on a busy machine.
    #[arg(long, value_name = "M", value_parser = minutes)]
    pub(super) cpu_minutes: Option<f64>,
    /// Seed of everything random.
    #[arg(long)]
    pub(super) seed: Option<u64>,
    /// Change a setting; may be given again.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
    /// Continue from the checkpoint of the run folder, if there is one, with its settings where none are given here.
    #[arg(long)]
    pub(super) resume: bool,
    /// With --resume: continue with the settings given here, though the run was started with others.
    #[arg(long, requires = "resume")]
    pub(super) change: bool,
    /// Give the same bytes for the same command on the same adapter: wall time has no influence.
    #[arg(long, conflicts_with_all = ["minutes", "cpu_minutes"])]
    pub(super) deterministic: bool,
    /// Do not look at held-out cameras during training.
    #[arg(long)]
    pub(super) no_evaluation: bool,
    /// Show the scene in a browser while it is trained, at this address; port 0 takes any free one.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "127.0.0.1:8200")]
    pub(super) live: Option<SocketAddr>,
    /// Memory for frames and events, GiB. Default: half of the free memory. Frames that do not fit are read from the dataset
    /// again, in parallel with training; events that do not fit are kept in files.
    #[arg(long, value_name = "GIB", value_parser = gibibytes)]
    pub(super) memory: Option<f64>,
    /// Memory of the device for frames and events, GiB. Default: a quarter of the device's memory, or of the free memory if it shares the
    /// processor's. What does not fit is uploaded when it is used.
    #[arg(long, value_name = "GIB", value_parser = gibibytes)]
    pub(super) device_memory: Option<f64>,
    /// Reuse the static Gaussians of this run, which is another window of the same take; skips the coarse stage.
    #[arg(long = "static", value_name = "RUN")]
    pub(super) static_set: Option<PathBuf>,
    /// Method for the initial points, if the dataset has none: colmap, sweep, colmap+sweep or random.
    #[arg(long, value_name = "METHOD")]
    pub(super) init: Option<CloudMethod>,
    #[command(flatten)]
    pub(super) adapter: Adapter,
}

fn minutes(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(minutes) if minutes > 0.0 && minutes <= 1e6 => Ok(minutes),
        _ => Err("a positive number of minutes is needed".into()),
    }
}

pub(super) fn bytes_of(gibibytes: f64) -> u64 {
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
    pub(super) fn settings(&self) -> anyhow::Result<Config> {
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
    pub(super) fn settings_after(&self, begun: &Config) -> anyhow::Result<Config> {
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

    pub(super) fn options(&self) -> TrainOptions {
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
    pub(super) fn resume_command(&self) -> String {
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

pub(super) fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./+=:".contains(c);
    if text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_blanks_and_quotes_are_quoted_for_the_shell() {
        let words = ["runs/a-1", "my runs", "it's"].map(|word| shell_word(Path::new(word)));
        assert_eq!(words, ["runs/a-1", "'my runs'", r"'it'\''s'"]);
    }
}
