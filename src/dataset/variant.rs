//! `erfgs dataset variant`: fewer frames, motion blur, event-only viewpoints.

use std::path::PathBuf;

use erfgs_dataset::Dataset;
use erfgs_replay::{
    VariantOptions,
    variant::{BlurOptions, Edge, EventOnly, Label, Rounding, Window, variant},
};

use crate::{errors::Usage, info, parse::CameraChoice, simulate::Sensor, terminal::Terminal};

/// Make a dataset harder: fewer frames, motion blur, event-only viewpoints.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Events are simulated first, from all frames; then frames are dropped, blurred and taken away. Held-out cameras stay as \
they are. The manifest of the new dataset records every step.

Examples: the three variants of the paper, and a factor of 8
  erfgs dataset variant ds --subsample 4 --out ds-ts
  erfgs dataset variant ds --subsample 4 --blur 3 --out ds-mb
  erfgs dataset variant ds --subsample 4 --blur 3 --event-only 4 --out ds-dv
  erfgs dataset variant ds --subsample 8 --blur 3 --event-only 03,07,12 --out ds-dv8")]
pub struct Arguments {
    /// The dataset to start from.
    dataset: PathBuf,
    /// The folder of the new dataset.
    #[arg(long, value_name = "DATASET")]
    out: PathBuf,
    /// Keep each n-th frame of the training cameras.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    subsample: u32,
    /// Average n successive frames to one.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    blur: u32,
    /// Training cameras that keep their events alone: how many (drawn with the seed), or names separated by commas.
    #[arg(long, value_name = "COUNT|NAMES")]
    event_only: Option<CameraChoice>,
    /// Simulate events of the training cameras that keep their frames too.
    #[arg(long)]
    keep_rgb_events: bool,
    /// Keep the initial point cloud, though it may have been made from frames that are dropped.
    #[arg(long)]
    keep_points: bool,
    /// Name of the new dataset in reports.
    #[arg(long)]
    name: Option<String>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    blurring: Blurring,
    #[command(flatten)]
    sensor: Sensor,
}

/// How frames are averaged.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Motion blur")]
struct Blurring {
    /// Which frames are averaged.
    #[arg(long, value_enum, default_value_t = WindowName::Forward)]
    blur_window: WindowName,
    /// What happens where the average runs past the end.
    #[arg(long, value_enum, default_value_t = EdgeName::Drop)]
    blur_edge: EdgeName,
    /// Average linear light, as an exposure does, not display-referred values.
    #[arg(long)]
    linear_light: bool,
    /// Round the average to the nearest level; it is cut off without this, as in the paper's code.
    #[arg(long)]
    blur_nearest: bool,
    /// Label a blurred frame with the middle of its exposure, not with its first frame's time.
    #[arg(long)]
    blur_label_mid: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum WindowName {
    /// The kept frame and those after it.
    Forward,
    /// As many before as after.
    Centred,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum EdgeName {
    /// Leave the frame out.
    Drop,
    /// Average the frames that there are.
    Shorten,
}

impl Arguments {
    fn options(&self) -> Result<VariantOptions, Usage> {
        let event_only = match &self.event_only {
            None => EventOnly::None,
            Some(CameraChoice::Names(names)) => EventOnly::Names(names.clone()),
            Some(CameraChoice::Count(count)) => EventOnly::Count(*count),
        };
        let blurring = &self.blurring;
        Ok(VariantOptions {
            name: self.name.clone(),
            subsample: self.subsample,
            blur: BlurOptions {
                frames: self.blur,
                window: match blurring.blur_window {
                    WindowName::Forward => Window::Forward,
                    WindowName::Centred => Window::Centred,
                },
                edge: match blurring.blur_edge {
                    EdgeName::Drop => Edge::Drop,
                    EdgeName::Shorten => Edge::Shorten,
                },
                rounding: if blurring.blur_nearest { Rounding::Nearest } else { Rounding::Truncate },
                linear_light: blurring.linear_light,
                label: if blurring.blur_label_mid { Label::Mid } else { Label::Frame },
            },
            event_only,
            keep_rgb_events: self.keep_rgb_events,
            keep_points: self.keep_points,
            simulator: self.sensor.config(self.seed)?,
            seed: self.seed,
        })
    }
}

/// Makes the variant and says what came of it.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let options = arguments.options()?;
    let source = Dataset::load(&arguments.dataset)?;
    let progress = terminal.progress("making the variant");
    let made = variant(&source, &options, &arguments.out, &mut |step| {
        progress.update(step.done, step.total, step.what);
    })?;
    drop(progress);
    info::dataset(&made, terminal)
}
