//! `erfgs bench train`.

use std::{
    cell::Cell,
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
};

use anyhow::Context;
use erfgs_dataset::Dataset;
use erfgs_run::RunFolder;
use erfgs_splat::gpu::Shape;
use erfgs_train::{
    config::Config,
    scene::Scene,
    trainer::{TrainOptions, Trainer},
};
use serde::Serialize;

use crate::{
    device::Adapter,
    errors::Usage,
    terminal::{Terminal, table, thousands},
    train::{MethodName, PresetName},
};

/// Iterations of the coarse stage, and iterations of the fine stage that are not measured.
const WARM_UP: u32 = 20;

/// Measure a training run.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Iterations of the fine stage are measured, after a warm-up: first as training runs them, for iterations a second, processor time, \
submissions, dispatches, buffers that the host waits for and bytes either way; then as many again with a wait after every stage, \
which together take more than an iteration of training.

Examples:
  erfgs bench train ds-dv
  erfgs bench train ds-dv --preset paper --iterations 200 --adapter llvmpipe --json
  erfgs bench train ds-dv --kernels
  erfgs bench train ds-dv --shape gpu")]
pub struct Arguments {
    /// The dataset, with initial points.
    dataset: PathBuf,
    /// The method to train.
    #[arg(long, value_enum, default_value_t = MethodName::ErfGs)]
    method: MethodName,
    /// Where the settings start from.
    #[arg(long, value_enum, default_value_t = PresetName::Default)]
    preset: PresetName,
    /// Change a setting; may be given again.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Iterations that are measured, and as many again stage by stage.
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    iterations: u32,
    /// Time each kernel by the device's own clock, too, which slows the stages down.
    #[arg(long)]
    kernels: bool,
    /// Run the kernels in this shape, whatever the adapter is.
    #[arg(long, value_enum)]
    shape: Option<ShapeName>,
    #[command(flatten)]
    adapter: Adapter,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum ShapeName {
    /// That of graphics processors: what passes to and from one is counted on any adapter.
    Gpu,
    /// That of software drivers.
    Cpu,
}

#[derive(Serialize)]
struct Figures {
    adapter: String,
    driver: String,
    method: &'static str,
    preset: &'static str,
    gaussians: u32,
    dynamic: u32,
    iterations: u64,
    iterations_per_s: f64,
    /// Processor time of this process in an iteration, milliseconds; of the host alone where the adapter is no software driver.
    cpu_ms_an_iteration: f64,
    /// Processor time of the thread that trains, milliseconds: it records what the device computes.
    thread_ms_an_iteration: f64,
    /// What passes to and from the device in an iteration, in the mean.
    an_iteration: TrafficFigures,
    stages: Vec<StageFigures>,
    /// The longest first; none unless they were asked for.
    kernels: Vec<KernelFigures>,
}

#[derive(Serialize)]
struct TrafficFigures {
    submissions: f64,
    dispatches: f64,
    /// Buffers that the host reads, each of which it waits for.
    maps: f64,
    bytes_written: f64,
    /// In the iteration that wrote most.
    bytes_written_most: u64,
    bytes_read: f64,
}

#[derive(Serialize)]
struct StageFigures {
    stage: &'static str,
    calls: u64,
    ms_a_call: f64,
    ms_an_iteration: f64,
    /// Of the time of all stages.
    share: f64,
    /// Gaussians that the stage got through in a second, millions.
    mgaussians_per_s: f64,
}

#[derive(Serialize)]
struct KernelFigures {
    kernel: String,
    dispatches_an_iteration: f64,
    us_a_dispatch: f64,
    ms_an_iteration: f64,
}

/// Trains a little in a folder that goes, and prints a line for each stage.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut config = Config::preset(arguments.method.into(), arguments.preset.into());
    for assignment in &arguments.set {
        config.set(assignment).map_err(|error| Usage(error.to_string()))?;
    }
    config.coarse_iterations = WARM_UP;
    config.fine_iterations = WARM_UP + 2 * arguments.iterations;
    config.evaluation.leave_alone();
    config.evaluation.log_every = u32::MAX;
    let (method, preset) = (arguments.method.name(), arguments.preset.name());
    let dataset = Dataset::load(&arguments.dataset)?;
    let without_points = dataset.manifest.points.is_none();
    config.settle(&dataset, without_points)?;
    let scene = Scene::load(dataset, &config, without_points)?;
    let gpu = arguments.adapter.open_as(arguments.shape.map(|shape| match shape {
        ShapeName::Gpu => Shape::Gpu,
        ShapeName::Cpu => Shape::Cpu,
    }))?;
    let options = TrainOptions { evaluate: false, ..TrainOptions::default() };
    let mut trainer = Trainer::new(&gpu, scene, config, &options)?;
    let folder = erfgs_base::scratch::Scratch::new().context("cannot make a folder for the run")?;
    let folder = RunFolder::new(folder.path());
    let progress = terminal.progress("measuring");
    // After the last iteration: what a run saves at its end is none.
    let thread_seconds = Cell::new(0.0);
    let train_to = |trainer: &mut Trainer<'_>, end: u64, doing: &str| {
        let reached = AtomicBool::new(false);
        trainer.run(&folder, &options, &reached, &mut |now: &erfgs_train::trainer::Progress| {
            progress.share(now.share, || doing.into());
            thread_seconds.set(erfgs_base::cpu::thread_seconds().unwrap_or(0.0));
            reached.store(now.iteration >= end, Ordering::Relaxed);
        })
    };
    let [warm, counted] = [2 * WARM_UP, 2 * WARM_UP + arguments.iterations].map(u64::from);
    train_to(&mut trainer, warm, "warming up")?;
    trainer.times.count();
    let first = trainer.iterations_done();
    let spent = |trainer: &Trainer<'_>, thread: f64| [trainer.clock.seconds, trainer.clock.cpu_seconds, thread];
    let before = spent(&trainer, erfgs_base::cpu::thread_seconds().unwrap_or(0.0));
    train_to(&mut trainer, counted, "measuring")?;
    let after = spent(&trainer, thread_seconds.get());
    let [seconds, cpu_seconds, thread_seconds] = std::array::from_fn(|kind| after[kind] - before[kind]);
    let iterations = (trainer.iterations_done() - first).max(1) as f64;
    trainer.times.start();
    if arguments.kernels {
        gpu.time_kernels()?;
    }
    trainer.run(&folder, &options, &AtomicBool::new(false), &mut |now: &erfgs_train::trainer::Progress| {
        progress.share(now.share, || "measuring each stage".into());
    })?;
    drop(progress);
    let gaussians = trainer.model.drawn.gaussians.count;
    let total: f64 = trainer.times.stages().map(|(_, seconds, _)| seconds).sum();
    let stages = trainer
        .times
        .stages()
        .map(|(stage, seconds, calls)| StageFigures {
            stage,
            calls,
            ms_a_call: 1e3 * seconds / calls.max(1) as f64,
            ms_an_iteration: 1e3 * seconds / iterations,
            share: seconds / total.max(1e-12),
            mgaussians_per_s: f64::from(gaussians) * calls as f64 * 1e-6 / seconds.max(1e-12),
        })
        .collect();
    let kernels = gpu
        .kernel_times()
        .iter()
        .map(|time| KernelFigures {
            kernel: time.kernel.to_string(),
            dispatches_an_iteration: time.dispatches as f64 / iterations,
            us_a_dispatch: 1e6 * time.seconds / time.dispatches.max(1) as f64,
            ms_an_iteration: 1e3 * time.seconds / iterations,
        })
        .collect();
    let traffic = trainer.times.traffic;
    let mean = |sum: u64| sum as f64 / iterations;
    let figures = Figures {
        adapter: gpu.info.name.clone(),
        driver: format!("{} {}", gpu.info.driver, gpu.info.driver_info),
        method,
        preset,
        gaussians,
        dynamic: trainer.model.drawn.dynamic,
        iterations: iterations as u64,
        iterations_per_s: iterations / seconds.max(1e-12),
        cpu_ms_an_iteration: 1e3 * cpu_seconds / iterations,
        thread_ms_an_iteration: 1e3 * thread_seconds / iterations,
        an_iteration: TrafficFigures {
            submissions: mean(traffic.submissions),
            dispatches: mean(traffic.dispatches),
            maps: mean(traffic.maps),
            bytes_written: mean(traffic.written),
            bytes_written_most: trainer.times.most.written,
            bytes_read: mean(traffic.read),
        },
        stages,
        kernels,
    };
    terminal.result(&figures, || describe(&figures))
}

fn describe(figures: &Figures) -> String {
    let heading = ["stage", "calls", "ms a call", "ms an iteration", "share %", "MGaussian/s"];
    let mut rows = vec![heading.map(String::from).to_vec()];
    rows.extend(figures.stages.iter().map(|row| {
        vec![
            row.stage.to_owned(),
            row.calls.to_string(),
            format!("{:.3}", row.ms_a_call),
            format!("{:.3}", row.ms_an_iteration),
            format!("{:.1}", 100.0 * row.share),
            format!("{:.2}", row.mgaussians_per_s),
        ]
    }));
    let heading = ["kernel", "dispatches an iteration", "us a dispatch", "ms an iteration"];
    let mut kernels = vec![heading.map(String::from).to_vec()];
    kernels.extend(figures.kernels.iter().map(|row| {
        vec![
            row.kernel.clone(),
            format!("{:.2}", row.dispatches_an_iteration),
            format!("{:.1}", row.us_a_dispatch),
            format!("{:.3}", row.ms_an_iteration),
        ]
    }));
    let kernels = if figures.kernels.is_empty() { String::new() } else { format!("\n\n{}", table(&kernels)) };
    format!(
        "{} ({}): {} with preset {}, {} Gaussians of which {} move, {:.1} iterations a second\n\
         an iteration: {:.2} ms of processor time ({:.2} of the thread that trains), {:.1} submissions of {:.0} dispatches, {:.1} kB written (at most {:.1}), {:.1} \
         buffers and {:.1} kB read back\n{}{kernels}",
        figures.adapter,
        figures.driver,
        figures.method,
        figures.preset,
        thousands(figures.gaussians.into()),
        thousands(figures.dynamic.into()),
        figures.iterations_per_s,
        figures.cpu_ms_an_iteration,
        figures.thread_ms_an_iteration,
        figures.an_iteration.submissions,
        figures.an_iteration.dispatches,
        1e-3 * figures.an_iteration.bytes_written,
        1e-3 * figures.an_iteration.bytes_written_most as f64,
        figures.an_iteration.maps,
        1e-3 * figures.an_iteration.bytes_read,
        table(&rows)
    )
}
