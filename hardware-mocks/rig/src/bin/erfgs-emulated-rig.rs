//! `erfgs-emulated-rig`: records the takes of a rig of emulated devices.

use std::{
    error::Error,
    io::{IsTerminal, Write},
    path::PathBuf,
    process::ExitCode,
    sync::Mutex,
    time::{Duration, Instant},
};

use clap::{Parser, ValueEnum};
use erfgs_dataset::Dataset;
use erfgs_emulated_rig::{Act, Film, Plan, record};

/// Records a take of a rig of emulated cameras and a trigger board into a session. Nothing but what a real rig would record
/// comes out; the rig file is to be found by calibration.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  erfgs-emulated-rig screen lenses.mcap        a board blinks on a screen: erfgs calibrate board --blink 15
  erfgs-emulated-rig wand wand.mcap            a wand is waved: erfgs calibrate wand
  erfgs-emulated-rig performance throw.mcap    a ball is thrown: erfgs dataset import session
  erfgs-emulated-rig performance --rig-toml    what a user of such a rig would write into RIG.toml
  erfgs-emulated-rig film throw.mcap --dataset ds-dv --rig rig.json
                                               each camera is shown what the dataset has of it"
)]
struct Cli {
    /// What is done before the cameras.
    act: Take,
    /// The session to write.
    #[arg(value_name = "S.mcap", required_unless_present = "rig_toml")]
    out: Option<PathBuf>,
    /// Fewer cameras, smaller pictures, shorter takes.
    #[arg(long)]
    small: bool,
    /// The dataset that is the film: of each camera frames or events.
    #[arg(long, value_name = "DATASET", required_if_eq("act", "film"), conflicts_with = "small")]
    dataset: Option<PathBuf>,
    /// Where the cameras of the film stand is written into this rig file, as a calibration would tell it.
    #[arg(long, value_name = "RIG.json", requires = "dataset")]
    rig: Option<PathBuf>,
    /// Print the rig file of the take, and do nothing else.
    #[arg(long)]
    rig_toml: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Take {
    /// A board blinks on a screen before each camera.
    Screen,
    /// A wand with three lights is waved on the stage.
    Wand,
    /// A ball is thrown, a fan spins, a pendulum swings.
    Performance,
    /// A dataset is shown to the cameras.
    Film,
}

fn main() -> ExitCode {
    match run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("erfgs-emulated-rig: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Result<(), Box<dyn Error>> {
    let act = match cli.act {
        Take::Screen => Act::Screen,
        Take::Wand => Act::Wand,
        Take::Performance => Act::Performance,
        Take::Film => Act::Film,
    };
    let plan = match &cli.dataset {
        Some(_) if act != Act::Film => return Err("--dataset is for the film alone".into()),
        Some(dataset) => Film::plan(Dataset::load(dataset)?)?,
        None if cli.small => Plan::small()?,
        None => Plan::full()?,
    };
    if cli.rig_toml {
        print!("{}", plan.rig_toml(act));
        return Ok(());
    }
    let Some(out) = &cli.out else { return Ok(()) };
    let shown = Shown { is_terminal: std::io::stderr().is_terminal(), last: Mutex::default() };
    record(&plan, act, out, &|what, share| shown.tell(what, share))?;
    shown.done();
    if let Some(rig) = &cli.rig {
        plan.rig_file("film").write(rig)?;
    }
    if let Some(film) = &plan.film {
        let [from_s, seconds] = film.window_s();
        eprintln!("the film in it: erfgs dataset import session --from {from_s:.4} --seconds {seconds:.4}");
    }
    Ok(())
}

/// What was said last, and when: on a terminal one line that moves, elsewhere a line every ten seconds.
struct Shown {
    is_terminal: bool,
    last: Mutex<Option<Instant>>,
}

impl Shown {
    fn tell(&self, what: &str, share: f64) {
        let every = Duration::from_millis(if self.is_terminal { 200 } else { 10_000 });
        let Ok(mut last) = self.last.lock() else { return };
        if last.is_some_and(|at| at.elapsed() < every) {
            return;
        }
        *last = Some(Instant::now());
        let percent = 100.0 * share;
        if self.is_terminal {
            eprint!("\r\x1b[2K{what}: {percent:.0} %");
            let _ = std::io::stderr().flush();
        } else {
            eprintln!("{what}: {percent:.0} %");
        }
    }

    fn done(&self) {
        if self.is_terminal {
            eprint!("\r\x1b[2K");
        }
    }
}
