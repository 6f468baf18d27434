//! `erfgs-stage`: films the stage into a dataset, or renders one frame of it.

use std::{
    error::Error,
    io::IsTerminal,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Duration,
};

use clap::{Args, Parser, Subcommand};
use erfgs_base::Progress;
use erfgs_stage::{
    Act, EventOptions, FilmOptions, FilmReport, Flicker, RigOptions, StageError, StageOptions, StageView, film,
    film::{image, mask_image},
};

/// Films a small scene with RGB cameras and event cameras: a thrown ball, a spinning fan and a swinging pendulum in a
/// furnished room. The dataset is what `erfgs train` reads, with exact ground truth.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  erfgs-stage film --out ds
  erfgs-stage film --out ds --size 192x144 --rgb 12 --event 4 --test 2 --duration-ms 500 --rgb-fps 10
  erfgs-stage frame --camera test00 --t-ms 250 --out frame.png"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Film a dataset.
    #[command(after_help = "Examples:
  erfgs-stage film --out ds
  erfgs-stage film --out ds --rgb-fps 7.5 --exposure-ms 33 --event 4
  erfgs-stage film --out clean --ideal --exposure-ms 0 --seed 3
  erfgs-stage film --out thrown --act throw --act fan --seed 3
  erfgs-stage film --out ideal --act throw --act fan --seed 3 --ceiling
  erfgs-stage film --out still --empty --rgb-fps 4
  erfgs-stage film --out flickers --flicker-hz 100 --flicker-depth 0.3")]
    Film(Film),
    /// Render one frame, and its mask and depth where asked for.
    #[command(after_help = "Examples:
  erfgs-stage frame --camera rgb03 --t-ms 250 --out sharp.png
  erfgs-stage frame --camera 3 --t-ms 250 --exposure-ms 33 --out blurred.png --mask mask.png --depth depth.f32")]
    Frame(FrameCommand),
}

/// The scene and the rig.
#[derive(Args)]
struct Set {
    /// Image size, pixels.
    #[arg(long, value_name = "WxH", default_value = "160x120", value_parser = size)]
    size: [u32; 2],
    /// How many RGB cameras.
    #[arg(long, default_value_t = 10)]
    rgb: usize,
    /// How many event cameras.
    #[arg(long, default_value_t = 4)]
    event: usize,
    /// How many held-out cameras.
    #[arg(long, default_value_t = 2)]
    test: usize,
    /// Angle of the arc that the cameras stand on, degrees (1 to 100).
    #[arg(long, default_value_t = 92.0)]
    arc_degrees: f64,
    /// Seed of the textures, the cameras' places and the sensors' noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Sub-pixel rays along each side of a pixel.
    #[arg(long, default_value_t = 3)]
    samples: u32,
    /// Let the ball and the pendulum cast shadows on the room; the masks then cover these too.
    #[arg(long)]
    shadows: bool,
    /// Nothing moves: the room without the ball, the fan's blades and the pendulum.
    #[arg(long, conflicts_with = "shadows")]
    empty: bool,
    /// What happens instead of the thrown ball, the fan and the pendulum: fan, throw, tumble, pendulum, articulated, cloth, squash,
    /// debris, crossing, shadow or gloss. Several can be combined, and the seed varies each.
    #[arg(long = "act", value_name = "NAME", conflicts_with = "empty")]
    acts: Vec<Act>,
    /// Let the lamp flicker, so often a second (100 or 120 where it hangs on the mains). Held-out frames are taken in its mean light.
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    flicker_hz: Option<f64>,
    /// How deep the lamp flickers, as a share of its mean light (0 to 1).
    #[arg(long, value_name = "SHARE", default_value_t = 0.3, requires = "flicker_hz", allow_negative_numbers = true)]
    flicker_depth: f64,
}

#[derive(Args)]
struct Film {
    /// Folder of the dataset, empty or absent.
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    set: Set,
    /// Length of the take, milliseconds.
    #[arg(long, default_value_t = 500.0, allow_negative_numbers = true)]
    duration_ms: f64,
    /// Frame rate of the RGB cameras, hertz.
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true)]
    rgb_fps: f64,
    /// Exposure of the RGB cameras, milliseconds (0 for instants).
    #[arg(long, default_value_t = 33.0, allow_negative_numbers = true)]
    exposure_ms: f64,
    /// Frame rate of the held-out cameras, hertz; their frames are instants.
    #[arg(long, default_value_t = 60.0, allow_negative_numbers = true)]
    test_fps: f64,
    /// Contrast threshold of the event cameras, both polarities.
    #[arg(long, default_value_t = 0.2)]
    threshold: f64,
    /// Spread of the threshold over the pixels.
    #[arg(long, default_value_t = 0.02)]
    sigma: f64,
    /// Refractory period, microseconds.
    #[arg(long, default_value_t = 0)]
    refractory_us: i64,
    /// Rate of leak events of a pixel, hertz.
    #[arg(long, default_value_t = 0.05)]
    leak_hz: f64,
    /// Rate of noise events of a pixel, hertz.
    #[arg(long, default_value_t = 0.1)]
    shot_hz: f64,
    /// Share of hot pixels.
    #[arg(long, default_value_t = 0.0)]
    hot_share: f64,
    /// Take the logarithm of linear light instead of display luma.
    #[arg(long)]
    linear_light: bool,
    /// An ideal event sensor: no spread, leak, noise, hot pixels or refractory period.
    #[arg(long, conflicts_with_all = ["sigma", "refractory_us", "leak_hz", "shot_hz", "hot_share"])]
    ideal: bool,
    /// How many points of the true surfaces to write to truth_points.ply, for tests.
    #[arg(long, default_value_t = 20_000)]
    points: usize,
    /// Also write what is true of what moves: bodies with their paths and surfaces, and which body each pixel of a held-out camera
    /// shows (folder `truth`). Acts always come with it.
    #[arg(long)]
    truth: bool,
    /// Film what an ideal rig would record: the same RGB cameras, sharp, at eight times their rate, and no event cameras.
    #[arg(long)]
    ceiling: bool,
    /// Only these cameras film (rgb00, event01, test00), names separated by commas; all of the rig without it.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    cameras: Option<Vec<String>>,
    /// Name of the dataset in reports.
    #[arg(long, default_value = "stage")]
    name: String,
    /// Print the figures as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct FrameCommand {
    /// Name of the camera (`rgb00`, `event01`, `test00`) or its number in the rig.
    #[arg(long)]
    camera: String,
    /// Time of the middle of the exposure, milliseconds.
    #[arg(long, allow_negative_numbers = true)]
    t_ms: f64,
    /// Exposure, milliseconds (0 for an instant).
    #[arg(long, default_value_t = 0.0)]
    exposure_ms: f64,
    #[command(flatten)]
    set: Set,
    /// Length of the take that acts happen in, milliseconds.
    #[arg(long, default_value_t = 500.0, allow_negative_numbers = true)]
    duration_ms: f64,
    /// PNG file to write.
    #[arg(long)]
    out: PathBuf,
    /// Also write the mask of moving pixels, as PNG.
    #[arg(long)]
    mask: Option<PathBuf>,
    /// Also write depth (z in the camera, metres): a raw file of little-endian f32, row-major.
    #[arg(long)]
    depth: Option<PathBuf>,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || format!("`{text}` is no size: write WIDTHxHEIGHT, for example 160x120");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(wrong)?;
    Ok([width.parse().map_err(|_| wrong())?, height.parse().map_err(|_| wrong())?])
}

fn nanoseconds(ms: f64) -> i64 {
    (ms * 1e6).round() as i64
}

impl Set {
    fn film_options(&self) -> FilmOptions {
        let [width, height] = self.size;
        let (rgb, event, test) = (self.rgb, self.event, self.test);
        FilmOptions {
            stage: StageOptions {
                shadows: self.shadows,
                empty: self.empty,
                flicker: self.flicker_hz.map(|hz| Flicker { hz, depth: self.flicker_depth }),
                acts: self.acts.clone(),
                samples_per_axis: self.samples,
                seed: self.seed,
                ..StageOptions::default()
            },
            rig: RigOptions { width, height, rgb, event, test, arc_degrees: self.arc_degrees, ..RigOptions::default() },
            seed: self.seed,
            ..FilmOptions::default()
        }
    }
}

impl Film {
    fn options(&self) -> FilmOptions {
        let noisy = EventOptions {
            threshold_sigma: self.sigma,
            refractory_us: self.refractory_us,
            leak_hz: self.leak_hz,
            shot_hz: self.shot_hz,
            hot_share: self.hot_share,
            ..EventOptions::default()
        };
        let options = FilmOptions {
            events: EventOptions {
                threshold_on: self.threshold,
                threshold_off: self.threshold,
                linear_light: self.linear_light,
                ..if self.ideal { EventOptions::ideal() } else { noisy }
            },
            duration_ns: nanoseconds(self.duration_ms),
            rgb_fps: self.rgb_fps,
            exposure_ns: nanoseconds(self.exposure_ms),
            test_fps: self.test_fps,
            truth_points: self.points,
            cameras: self.cameras.clone(),
            truth: self.truth,
            name: self.name.clone(),
            ..self.set.film_options()
        };
        if self.ceiling { options.ceiling() } else { options }
    }

    fn run(&self) -> Result<(), StageError> {
        let live = std::io::stderr().is_terminal();
        let show = |progress: Progress| {
            if live {
                eprint!("\rfilming: {} of {} {}  ", progress.done, progress.total, progress.what);
            }
        };
        let report = film(&self.out, &self.options(), &show)?;
        if live {
            eprintln!();
        }
        self.print(&report);
        Ok(())
    }

    fn print(&self, report: &FilmReport) {
        let milliseconds = |time: Duration, count: u64| time.as_secs_f64() * 1e3 / count.max(1) as f64;
        let rgb = milliseconds(report.rgb_time, report.rgb_frames);
        let test = milliseconds(report.test_time, report.test_frames);
        let (events, seconds) = (report.events, report.event_time.as_secs_f64());
        let rate = if seconds > 0.0 { events as f64 / seconds } else { 0.0 };
        let (room, total) = (report.room_time.as_secs_f64(), report.total_time.as_secs_f64());
        if self.json {
            let figures = serde_json::json!({
                "rgb_frames": report.rgb_frames, "rgb_ms_per_frame": rgb,
                "test_frames": report.test_frames, "test_ms_per_frame": test,
                "events": events, "events_per_second": rate,
                "room_seconds": room, "event_seconds": seconds, "total_seconds": total,
            });
            println!("{figures:#}");
            return;
        }
        println!("{} in {total:.1} s", self.out.display());
        println!("  {} RGB frames, {rgb:.1} ms each", report.rgb_frames);
        println!("  {events} events, {:.2} million a second", rate * 1e-6);
        println!("  {} test frames with masks, {test:.1} ms each", report.test_frames);
        println!("  {room:.1} s for the empty room from {} viewpoints", report.dataset.manifest.cameras.len());
    }
}

impl FrameCommand {
    fn run(&self) -> Result<(), StageError> {
        let (stage, rig) =
            FilmOptions { duration_ns: nanoseconds(self.duration_ms), ..self.set.film_options() }.set_up()?;
        let numbered = self.camera.parse::<usize>().ok().and_then(|number| rig.get(number));
        let named = || rig.iter().find(|camera| camera.name == self.camera);
        let camera = numbered.or_else(named).ok_or_else(|| StageError::unknown(&self.camera, &rig))?;
        let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera)?;
        let (t, exposure) = (nanoseconds(self.t_ms), nanoseconds(self.exposure_ms.max(0.0)));
        let shutter = [t.saturating_sub(exposure / 2), t.saturating_add(exposure / 2)];
        let linear = view.exposure(shutter, view.exposure_samples(shutter, 0.35));
        written(&self.out, image(&view, &linear).write_png(&self.out))?;
        if let Some(path) = &self.mask {
            written(path, mask_image(&view, &view.mask(t)).write_png(path))?;
        }
        if let Some(path) = &self.depth {
            let bytes: Vec<u8> = view.depth(t).iter().flat_map(|z| z.to_le_bytes()).collect();
            written(path, std::fs::write(path, bytes))?;
        }
        Ok(())
    }
}

fn written<E: Error + Send + Sync + 'static>(path: &Path, result: Result<(), E>) -> Result<(), StageError> {
    result.map_err(|source| StageError::Write { path: path.to_owned(), source: Box::new(source) })
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().command {
        Command::Film(command) => command.run(),
        Command::Frame(command) => command.run(),
    };
    let Err(error) = outcome else { return ExitCode::SUCCESS };
    eprint!("erfgs-stage: {error}");
    let mut cause: Option<&dyn Error> = error.source();
    while let Some(source) = cause {
        eprint!(": {source}");
        cause = source.source();
    }
    eprintln!();
    ExitCode::FAILURE
}
