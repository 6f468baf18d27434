//! `erfgs bench raster`.

use erfgs_splat::raster::{self, BenchScene};
use serde::Serialize;

use crate::{
    device::Adapter,
    terminal::{Terminal, table, thousands},
};

/// Measure the rasteriser.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each stage is timed alone, with a wait for the device at its end; the sum is more than a pass takes.

Examples:
  erfgs bench raster
  erfgs bench raster --gaussians 200000 --size 640x360 --adapter llvmpipe")]
pub struct Arguments {
    /// Number of Gaussians, all of them in view.
    #[arg(long, default_value_t = 30_000, value_parser = clap::value_parser!(u32).range(1..=50_000_000))]
    gaussians: u32,
    /// Size of the image, pixels.
    #[arg(long, value_name = "WxH", default_value = "320x180", value_parser = size)]
    size: [u32; 2],
    /// Median standard deviation of a splat, pixels.
    #[arg(long, value_name = "PX", default_value_t = 1.5)]
    sigma: f64,
    /// Degree of the spherical harmonics.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=3))]
    sh_degree: u32,
    /// Number of runs; the fastest one counts.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    #[command(flatten)]
    adapter: Adapter,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    sides
        .filter(|sides| sides.iter().all(|side| (1..=16_384).contains(side)))
        .ok_or_else(|| format!("'{text}' is no size; write for example 640x360, with sides up to 16384"))
}

#[derive(Serialize)]
struct RasterFigures {
    adapter: String,
    gaussians: u32,
    width: u32,
    height: u32,
    intersections: u32,
    forward_ms: f64,
    backward_ms: f64,
    stages: Vec<StageFigures>,
}

#[derive(Serialize)]
struct StageFigures {
    stage: &'static str,
    ms: f64,
}

/// Measures and prints a line for each stage.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let gpu = arguments.adapter.open()?;
    let scene = BenchScene {
        gaussians: arguments.gaussians,
        width: arguments.size[0],
        height: arguments.size[1],
        sigma_px: arguments.sigma,
        sh_degree: arguments.sh_degree,
    };
    let result = raster::bench(&gpu, &scene, arguments.runs)?;
    let figures = RasterFigures {
        adapter: gpu.info.name.clone(),
        gaussians: scene.gaussians,
        width: scene.width,
        height: scene.height,
        intersections: result.intersections,
        forward_ms: result.forward_ms,
        backward_ms: result.backward_ms,
        stages: result.stages.into_iter().map(|(stage, ms)| StageFigures { stage, ms }).collect(),
    };
    terminal.result(&figures, || {
        let mut rows = vec![["stage", "ms"].map(String::from).to_vec()];
        let stages = figures.stages.iter().map(|row| (row.stage, row.ms));
        let passes = [("forward pass", figures.forward_ms), ("backward pass", figures.backward_ms)];
        rows.extend(stages.chain(passes).map(|(stage, ms)| vec![stage.to_owned(), format!("{ms:.3}")]));
        format!(
            "{}: {} Gaussians, {} tile intersections, {} x {}\n{}",
            figures.adapter,
            thousands(figures.gaussians.into()),
            thousands(figures.intersections.into()),
            figures.width,
            figures.height,
            table(&rows)
        )
    })
}
