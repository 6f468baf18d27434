//! `erfgs simulate`: an event camera looks at a video.

mod frames;

use std::path::{Path, PathBuf};

use anyhow::Context;
use erfgs_events::{Events, npz};
use erfgs_replay::{Mode, Simulator, SimulatorConfig};
use erfgs_session::{
    container::Recording,
    export::{EventsFormat, write_events},
};
use serde::Serialize;

use self::frames::Frames;
use crate::{
    errors::{Usage, not_over},
    export::events_format,
    terminal::{Terminal, table, thousands},
};

/// Simulate an event camera that looks at a video.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The input is a video (ffmpeg decodes it), a folder of PNG or JPEG files in the order of the numbers in their names, or an .npz archive with \
`luma[T, H, W]` (u8, display-referred). Colours become luma (0.299 R + 0.587 G + 0.114 B). Between two frames brightness is taken to change \
evenly: what moves by more than a few pixels from one to the next makes events at its old and its new place and none between.

The end of --out tells the format: .npz (arrays `t` in microseconds, `x`, `y` and `p`, 1 = ON), .csv, .raw (EVT 3 or 2), .dat, .aedat4, and \
.h5 if erfgs was built with --features hdf5.

Modes:
  parity    v2e's pixel model as its code has it; without noise, the same events
  enhanced  exact low-pass and crossing times, thresholds that vary with each event, Poisson noise

Examples:
  erfgs simulate slow-motion.mp4 --fps 240 --out events.raw
  erfgs simulate frames --fps 1000 --simulator clean --out events.npz
  erfgs simulate luma.npz --fps 30 --mode parity --threshold 0.2 --out events.npz
  erfgs simulate luma.npz --fps 30 --simulator noisy --seed 7 --out events.npz
  erfgs simulate luma.npz --fps 120 --mode enhanced --sigma 0.03 --cutoff-hz 200 --out events.npz")]
pub struct Arguments {
    /// The video, a folder of pictures, or an .npz archive with `luma[T, H, W]`.
    #[arg(value_name = "VIDEO|FOLDER|LUMA.npz")]
    input: PathBuf,
    /// Frames a second, as they were recorded. Default: when a video's container shows them.
    #[arg(long, value_parser = frame_rate)]
    fps: Option<f64>,
    /// The event file to write.
    #[arg(long, value_name = "EVENTS.npz|csv|raw|dat|aedat4|h5")]
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
    let format = format(&arguments.out)?;
    not_over(&arguments.out, arguments.force)?;
    let mut video = Frames::open(&arguments.input, arguments.fps)?;
    let [width, height] = video.size();
    let started = std::time::Instant::now();
    let mut simulator = Simulator::new(width, height, &config, 0)?;
    let mut events = Events::new(width, height);
    let progress = terminal.progress("simulating");
    let (mut frames, count) = (0, video.count());
    while let Some((grey, t_ns)) = video.next()? {
        simulator.step(grey.luma(), t_ns, &mut events)?;
        frames += 1;
        progress.update(frames, count.unwrap_or(frames).max(frames), "frames");
    }
    drop(progress);
    let frames = frames as usize;
    let pixels = width as usize * height as usize;
    let seconds = started.elapsed().as_secs_f64();
    write(&arguments.out, format, &events).context("the events were simulated but not written")?;
    let on = events.on.iter().filter(|&&on| on).count();
    let summary = Summary {
        frames,
        width,
        height,
        events: events.len(),
        on,
        off: events.len() - on,
        seconds,
        mpix_per_s: (frames * pixels) as f64 * 1e-6 / seconds,
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

/// The format that the end of a name tells.
fn format(out: &Path) -> Result<EventsFormat, Usage> {
    let extension = out.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default();
    match events_format(if extension == "hdf5" { "h5" } else { &extension }) {
        Some(EventsFormat::Hdf5) if !cfg!(feature = "hdf5") => {
            let remedy = "install libhdf5-dev and build with `cargo build --release --features hdf5`";
            Err(Usage(format!("this erfgs was built without HDF5; {remedy}, or give --out another format")))
        }
        Some(format) => Ok(format),
        None => Err(Usage(format!(
            "'{}' tells no format of events: give --out a name that ends with .npz, .csv, .raw, .dat, .aedat4 or .h5",
            out.display()
        ))),
    }
}

/// Writes the events: as arrays, or from these as any other format.
fn write(out: &Path, format: EventsFormat, events: &Events) -> anyhow::Result<()> {
    if format == EventsFormat::Npz {
        return Ok(npz::write_events(out, events)?);
    }
    let scratch = erfgs_base::scratch::Scratch::new().context("cannot make a folder for intermediate files")?;
    let arrays = scratch.path().join("events.npz");
    npz::write_events(&arrays, events)?;
    let mut recording = Recording::open(&arrays, None)?;
    let stream = recording.summary().streams.first().map(|stream| stream.description.id.clone());
    let stream = stream.context("the simulated events are no stream")?;
    write_events(&mut recording, &stream, format, out, &mut Vec::new(), |_| {})?;
    Ok(())
}
