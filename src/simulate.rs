//! `erfgs simulate`: an event camera looks at a grey-level video.

use std::path::PathBuf;

use anyhow::Context;
use erfgs_events::{Events, npz};
use erfgs_replay::{Luma, Mode, Simulator, SimulatorConfig};
use serde::Serialize;

use crate::{
    errors::{Usage, not_over},
    terminal::{Terminal, table, thousands},
};

/// Simulate an event camera on a grey-level video.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
LUMA.npz holds `luma[T, H, W]` (u8, display-referred). The events are `t` (microseconds), `x`, `y` and `p` (1 = ON).

Modes:
  parity    v2e's pixel model as its code has it; without noise, the same events
  enhanced  exact low-pass and crossing times, thresholds that vary with each event, Poisson noise

Examples:
  erfgs simulate luma.npz --fps 30 --mode parity --threshold 0.2 --out events.npz
  erfgs simulate luma.npz --fps 30 --simulator noisy --seed 7 --out events.npz
  erfgs simulate luma.npz --fps 120 --mode enhanced --sigma 0.03 --cutoff-hz 200 --out events.npz")]
pub struct Arguments {
    /// The video: an .npz archive with `luma[T, H, W]`.
    luma: PathBuf,
    /// Frames a second.
    #[arg(long, value_parser = frame_rate)]
    fps: f64,
    /// The event file to write.
    #[arg(long, value_name = "EVENTS.npz")]
    out: PathBuf,
    /// Overwrite existing files.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    sensor: Sensor,
    /// Seed of everything random.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// The parameters of the simulated sensor. What is not given comes from the preset.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Simulated sensor")]
pub struct Sensor {
    /// Where the parameters start from: noiseless, clean or noisy (v2e's names).
    #[arg(long, value_name = "PRESET", default_value = "noiseless", value_parser = preset)]
    simulator: SimulatorConfig,
    /// The pixel model.
    #[arg(long, value_enum)]
    mode: Option<ModeName>,
    /// Contrast threshold of both polarities, natural-log intensity.
    #[arg(long, value_name = "C")]
    threshold: Option<f64>,
    /// Contrast threshold of ON events, where it differs.
    #[arg(long, value_name = "C")]
    threshold_on: Option<f64>,
    /// Contrast threshold of OFF events, where it differs.
    #[arg(long, value_name = "C")]
    threshold_off: Option<f64>,
    /// Standard deviation of the thresholds from pixel to pixel.
    #[arg(long, value_name = "C")]
    sigma: Option<f64>,
    /// Corner frequency of the photoreceptor at full brightness; 0 switches the low-pass off.
    #[arg(long, value_name = "HZ")]
    cutoff_hz: Option<f64>,
    /// Rate of leak events at each pixel.
    #[arg(long, value_name = "HZ")]
    leak_hz: Option<f64>,
    /// Rate of shot noise events at a black pixel.
    #[arg(long, value_name = "HZ")]
    shot_hz: Option<f64>,
    /// Time after an event in which a pixel makes no other.
    #[arg(long, value_name = "S")]
    refractory_s: Option<f64>,
    /// Standard deviation of the threshold from event to event (enhanced).
    #[arg(long, value_name = "C")]
    event_sigma: Option<f64>,
    /// Fraction of pixels that are hot (enhanced).
    #[arg(long, value_name = "SHARE")]
    hot_fraction: Option<f64>,
    /// Event rate of a hot pixel (enhanced).
    #[arg(long, value_name = "HZ")]
    hot_hz: Option<f64>,
    /// Take the logarithm of linear light, not of display-referred values (enhanced).
    #[arg(long)]
    linear_log: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum ModeName {
    Parity,
    Enhanced,
}

fn preset(name: &str) -> Result<SimulatorConfig, String> {
    SimulatorConfig::preset(name)
        .ok_or_else(|| format!("there is no preset '{name}': it is one of {}", SimulatorConfig::PRESETS.join(", ")))
}

fn frame_rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(fps) if (1e-3..=1e6).contains(&fps) => Ok(fps),
        _ => Err("a rate from 0.001 to 1000000 frames a second is needed".into()),
    }
}

impl Sensor {
    /// The simulator's configuration, checked.
    pub fn config(&self, seed: u64) -> Result<SimulatorConfig, Usage> {
        let mut config = SimulatorConfig { seed, ..self.simulator.clone() };
        match self.mode {
            Some(ModeName::Parity) => config.mode = Mode::Parity,
            Some(ModeName::Enhanced) => config.mode = Mode::Enhanced,
            None => {}
        }
        config.linear_light |= self.linear_log;
        let given = [
            (&mut config.threshold_on, self.threshold_on.or(self.threshold)),
            (&mut config.threshold_off, self.threshold_off.or(self.threshold)),
            (&mut config.sigma, self.sigma),
            (&mut config.cutoff_hz, self.cutoff_hz),
            (&mut config.leak_hz, self.leak_hz),
            (&mut config.shot_hz, self.shot_hz),
            (&mut config.refractory_s, self.refractory_s),
            (&mut config.event_sigma, self.event_sigma),
            (&mut config.hot_fraction, self.hot_fraction),
            (&mut config.hot_hz, self.hot_hz),
        ];
        for (field, value) in given {
            if let Some(value) = value {
                *field = value;
            }
        }
        config.validate().map_err(|error| Usage(error.to_string()))?;
        Ok(config)
    }
}

#[derive(Serialize)]
struct Summary<'a> {
    frames: usize,
    width: u32,
    height: u32,
    events: usize,
    on: usize,
    off: usize,
    seconds: f64,
    mpix_per_s: f64,
    out: &'a PathBuf,
    simulator: SimulatorConfig,
}

/// Simulates and writes the events.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let config = arguments.sensor.config(arguments.seed)?;
    not_over(&arguments.out, arguments.force)?;
    let luma = npz::read_luma(&arguments.luma)?;
    let pixels = luma.width as usize * luma.height as usize;
    let started = std::time::Instant::now();
    let mut simulator = Simulator::new(luma.width, luma.height, &config, 0)?;
    let mut events = Events::new(luma.width, luma.height);
    let progress = terminal.progress("simulating");
    for (index, frame) in luma.data.chunks_exact(pixels.max(1)).enumerate() {
        let t_ns = (index as f64 * 1e9 / arguments.fps).round() as i64;
        simulator.step(Luma::U8(frame), t_ns, &mut events)?;
        progress.update(index as u64 + 1, luma.frames as u64, "frames");
    }
    drop(progress);
    let seconds = started.elapsed().as_secs_f64();
    npz::write_events(&arguments.out, &events).context("the events were simulated but not written")?;
    let on = events.on.iter().filter(|&&on| on).count();
    let summary = Summary {
        frames: luma.frames,
        width: luma.width,
        height: luma.height,
        events: events.len(),
        on,
        off: events.len() - on,
        seconds,
        mpix_per_s: (luma.frames * pixels) as f64 * 1e-6 / seconds,
        out: &arguments.out,
        simulator: config,
    };
    terminal.result(&summary, || {
        table(&[
            vec!["frames".into(), format!("{} of {} x {}", summary.frames, summary.width, summary.height)],
            vec![
                "events".into(),
                format!(
                    "{} ({} ON, {} OFF)",
                    thousands(summary.events as u64),
                    thousands(summary.on as u64),
                    thousands(summary.off as u64)
                ),
            ],
            vec!["time".into(), format!("{seconds:.3} s, {:.1} Mpix/s", summary.mpix_per_s)],
            vec!["file".into(), arguments.out.display().to_string()],
        ])
    })
}
