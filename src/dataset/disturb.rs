//! `erfgs dataset disturb`: a dataset that is wrong by a known amount.

use std::path::PathBuf;

use erfgs_dataset::{
    Dataset,
    disturb::{Disturbance, disturb},
};

use crate::{info, terminal::Terminal};

/// Make a dataset wrong by a known amount: poses, lenses, clocks, thresholds, noise, lost packets.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Puts errors of calibration, clocks and sensors into a dataset whose truth is known, to measure what they cost. Held-out \
cameras stay as they are. Each camera draws its own errors from the seed and its name; twice the size is the same error twice as \
large. The manifest of the new dataset records the step. `erfgs bench budget` does this for every kind of error.

Examples:
  erfgs dataset disturb ds --pose-mm 3 --pose-degrees 0.1 --out ds-moved
  erfgs dataset disturb ds --event-clock-us 1000 --out ds-late
  erfgs dataset disturb ds --noise-hz 5 --lose-percent 2 --out ds-noisy
  erfgs dataset disturb ds --cameras rgb00,rgb02,event00 --out ds-few")]
pub struct Arguments {
    /// The dataset.
    dataset: PathBuf,
    /// The folder of the new dataset.
    #[arg(long, value_name = "DATASET")]
    out: PathBuf,
    /// Event cameras' clocks are late by this much, microseconds.
    #[arg(long, value_name = "US", default_value_t = 0.0, allow_negative_numbers = true)]
    event_clock_us: f64,
    /// Spread of the times of RGB cameras, each off by its own shift, microseconds.
    #[arg(long, value_name = "US", default_value_t = 0.0)]
    frame_clock_us: f64,
    /// Spread of cameras' places along each axis, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    pose_mm: f64,
    /// Spread of cameras' directions about each axis, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0)]
    pose_degrees: f64,
    /// Spread of focal lengths, percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    focal_percent: f64,
    /// How much higher the stated contrast thresholds are than the true ones, percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, allow_negative_numbers = true)]
    threshold_percent: f64,
    /// How much higher the stated ratio of ON to OFF thresholds is than the true one, percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, allow_negative_numbers = true)]
    balance_percent: f64,
    /// Events of noise of each pixel in a second.
    #[arg(long, value_name = "HZ", default_value_t = 0.0)]
    noise_hz: f64,
    /// Share of the packets of events that are lost, percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    lose_percent: f64,
    /// The training cameras to keep, names separated by commas. Default: all.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    cameras: Option<Vec<String>>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl Arguments {
    fn disturbance(&self) -> Disturbance {
        Disturbance {
            event_clock_s: 1e-6 * self.event_clock_us,
            frame_clock_s: 1e-6 * self.frame_clock_us,
            place_m: 1e-3 * self.pose_mm,
            direction_deg: self.pose_degrees,
            focal: 1e-2 * self.focal_percent,
            threshold: 1e-2 * self.threshold_percent,
            balance: 1e-2 * self.balance_percent,
            noise_hz: self.noise_hz,
            lost: 1e-2 * self.lose_percent,
            cameras: self.cameras.clone(),
            seed: self.seed,
        }
    }
}

/// Disturbs and says what came of it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let dataset = Dataset::load(&arguments.dataset)?;
    let progress = terminal.progress("disturbing");
    let advance = &mut |step: erfgs_base::Progress| progress.update(step.done, step.total, step.what);
    let wrong = disturb(&dataset, &arguments.disturbance(), &arguments.out, advance)?;
    drop(progress);
    info::dataset(&wrong, terminal)
}
