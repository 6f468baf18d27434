//! `erfgs eval`: a run measured on the held-out cameras.

use std::path::PathBuf;

use erfgs_run::{LpipsScaling, Metrics, Part};
use erfgs_train::{
    evaluate::EvaluateOptions,
    metrics::{Lpips, LpipsWeights},
};

use crate::{
    device::TrainedRun,
    progress::duration,
    terminal::{Terminal, bytes, table, thousands},
};

/// Measure a run on the held-out cameras.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Writes metrics.json, per_view.json and pictures into the run folder. DPSNR is the PSNR over moving pixels: with the masks of \
the dataset, or with masks made from the motion of the ground truth; metrics.json says which. Fast pixels are the tenth of \
them that changes most from one held-out frame to the next.

LPIPS needs network weights, which are not part of erfgs; docs/reference/run.md says how to make the file. It is null without.

Examples:
  erfgs eval run
  erfgs eval run --lpips vgg.safetensors --pictures 0 --json | jq .lpips")]
pub struct Arguments {
    #[command(flatten)]
    run: TrainedRun,
    /// Write every n-th held-out frame of a camera as pictures; 0 writes none.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pictures: u32,
    /// Weights of LPIPS.
    #[arg(long, value_name = "WEIGHTS.safetensors")]
    lpips: Option<PathBuf>,
    /// Hand pictures to LPIPS in [-1, 1], as it intends, and not in [0, 1], as the 4DGS evaluation does.
    #[arg(long, requires = "lpips")]
    lpips_centred: bool,
}

/// Evaluates and prints the figures.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let folder = arguments.run.folder()?;
    let network = arguments
        .lpips
        .as_ref()
        .map(|path| LpipsWeights::read(path).and_then(|weights| Lpips::new(&weights)))
        .transpose()?;
    let scaling = if arguments.lpips_centred { LpipsScaling::MinusOneToOne } else { LpipsScaling::ZeroToOne };
    let gpu = arguments.run.device()?;
    let mut trainer = arguments.run.trainer(&gpu, &folder)?;
    let options = EvaluateOptions {
        lpips: network.as_ref().map(|network| (network, scaling)),
        picture_stride: arguments.pictures,
    };
    let progress = terminal.progress("evaluating");
    let metrics = trainer.evaluate(&folder, &options, &mut |done, total| {
        progress.update(done as u64, total as u64, "frames");
    })?;
    drop(progress);
    terminal.result(&metrics, || describe(&metrics))
}

fn describe(metrics: &Metrics) -> String {
    let decibels = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2} dB"));
    let part = |part: &Part| match part.frames {
        0 => "no frame".to_owned(),
        frames => format!(
            "{}, moving {}, fast {}, over {frames} frames",
            decibels(part.psnr),
            decibels(part.dpsnr),
            decibels(part.psnr_fast)
        ),
    };
    let rows = [
        ("PSNR", decibels(Some(metrics.psnr))),
        ("DPSNR", format!("{} (masks: {})", decibels(metrics.dpsnr), metrics.dpsnr_mask)),
        ("fast", format!("{} in the tenth of it that changes most from frame to frame", decibels(metrics.psnr_fast))),
        ("static", format!("{} where nothing moves", decibels(metrics.psnr_static))),
        ("at frames", part(&metrics.at_frames)),
        ("between", part(&metrics.between_frames)),
        ("outside", part(&metrics.outside_frames)),
        (
            "colour-matched",
            metrics.colour_corrected.map_or("-".into(), |matched| {
                format!("{}, moving {}", decibels(Some(matched.psnr)), decibels(matched.dpsnr))
            }),
        ),
        ("SSIM", format!("{:.4}", metrics.ssim)),
        ("LPIPS", metrics.lpips.map_or("- (no weights; see --lpips)".into(), |value| format!("{value:.4}"))),
        ("training PSNR", decibels(metrics.train_psnr)),
        (
            "iterations",
            format!(
                "{} in {}{}",
                thousands(metrics.iterations),
                duration(metrics.train_seconds),
                metrics.train_cpu_seconds.map_or(String::new(), |cpu| format!(", {} of CPU time", duration(cpu)))
            ),
        ),
        ("Gaussians", format!("{}, {}", thousands(metrics.gaussians), bytes(metrics.bytes))),
        ("rendering", format!("{:.1} frames a second", metrics.render_fps)),
    ];
    table(&rows.map(|(name, value)| vec![name.to_owned(), value]))
}
