//! `erfgs bench acts`.

use std::{
    collections::BTreeMap,
    fmt,
    path::{Path, PathBuf},
    str::FromStr,
};

use anyhow::Context;
use erfgs_acts::{Act, Board, METHODS, Method, Quality, Row, Size, Take, choose, report};
use erfgs_base::{FileError, Progress};
use erfgs_dataset::Dataset;
use erfgs_run::RunFolder;

use super::{
    starts,
    trainings::{dataset_of, plan, train_here},
};
use crate::{
    device::Adapter,
    errors::Usage,
    parse::Iterations,
    terminal::{Terminal, table},
};

const ITERATIONS: Iterations = Iterations { coarse: Some(600), fine: 4000 };

/// Measure how well each method reconstructs the acts of the stage, and how much of the gap to an ideal rig it closes.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Every act is filmed for every seed by an ordinary rig (8 RGB cameras at 15 frames a second with 20 ms exposures, 3 event cameras) and \
by an ideal one (the same RGB cameras, sharp, at 120 a second), which gives the ceiling. Each method trains on the first; \
4DGS trains on both, and the difference of its results is the gap. An act in which no bodies are found has no rows for the \
methods that start from bodies.

The folder holds the datasets, a sweep for each method, pictures, and acts.html, acts.md and acts.csv. The same command \
continues later with what is not done, and with more acts, seeds or methods.

Examples:
  erfgs bench acts --out acts
  erfgs bench acts --out acts --acts throw,fan,throw+fan --seeds 1,2,3
  erfgs bench acts --out acts --acts cloth --methods 4dgs,erf-gs,ceiling --iterations 300+1500
  erfgs bench acts --small --acts throw --out try")]
pub struct Arguments {
    /// The folder for datasets, trainings and the report.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Acts, separated by commas; a + joins acts that happen at once. Default: all.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    acts: Vec<Acts>,
    /// Seeds of the takes, separated by commas.
    #[arg(long, value_name = "SEEDS", value_delimiter = ',', default_value = "1")]
    seeds: Vec<u64>,
    /// Methods, separated by commas: 4dgs, erf-gs, bodies-frames, bodies, ceiling. Default: all.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    methods: Vec<String>,
    /// Iterations of each training.
    #[arg(long, value_name = "[COARSE+]FINE", default_value_t = ITERATIONS)]
    iterations: Iterations,
    /// Trainings at a time.
    #[arg(long, value_name = "N", default_value_t = 1)]
    at_once: usize,
    /// Tiny films, to see that everything works.
    #[arg(long)]
    small: bool,
    #[command(flatten)]
    adapter: Adapter,
}

/// Acts that happen at once.
#[derive(Clone, Debug, PartialEq)]
struct Acts(Vec<Act>);

impl FromStr for Acts {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        text.split('+').map(str::parse).collect::<Result<_, _>>().map(Self)
    }
}

impl fmt::Display for Acts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.iter().map(|act| act.name()).collect::<Vec<_>>().join("+"))
    }
}

/// Films, trains, and tells what it came to.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let adapter = arguments.adapter.open()?.info;
    let folder = std::path::absolute(&arguments.out).context("cannot find the current folder")?;
    let datasets = folder.join("datasets");
    std::fs::create_dir_all(&datasets).map_err(FileError::when("make the folder", &datasets))?;
    let work = Work { arguments, terminal, folder: &folder, datasets: &datasets };
    let (takes, methods) = (takes(arguments), work.methods()?);
    for take in &takes {
        for ideal in [false, true] {
            if methods.iter().any(|method| method.ideal == ideal) {
                let bodies = methods.iter().any(|method| method.ideal == ideal && method.bodies);
                work.film(take, ideal, bodies)?;
            }
        }
    }
    let mut runs: BTreeMap<(&str, String), RunFolder> = BTreeMap::new();
    for method in &methods {
        for (dataset, run) in work.train(method, &takes)? {
            runs.insert((method.name, dataset), run);
        }
    }
    let board = work.board(&takes, &methods, &runs)?;
    let made = report::Made {
        command: command(arguments),
        version: env!("CARGO_PKG_VERSION").into(),
        adapter: format!("{} ({} {})", adapter.name, adapter.driver, adapter.driver_info),
        what: format!(
            "{} takes of the stage{}, {} iterations of each method.",
            takes.len(),
            if arguments.small { " in small" } else { "" },
            arguments.iterations
        ),
    };
    for (name, text) in [
        ("acts.csv", report::csv(&board)),
        ("acts.md", report::markdown(&board, &made)),
        ("acts.html", report::page(&board, &made)),
    ] {
        let path = folder.join(name);
        erfgs_base::atomic::write(&path, text.as_bytes()).map_err(FileError::when("write", &path))?;
    }
    terminal.result(&board, || describe(&board, &folder))
}

fn takes(arguments: &Arguments) -> Vec<Take> {
    let all = || Act::ALL.into_iter().map(|act| Acts(vec![act])).collect();
    let acts: Vec<Acts> = if arguments.acts.is_empty() { all() } else { arguments.acts.clone() };
    let with_seeds = |Acts(acts): Acts| arguments.seeds.iter().map(move |&seed| Take { acts: acts.clone(), seed });
    let mut takes: Vec<Take> = Vec::new();
    for take in acts.into_iter().flat_map(with_seeds) {
        if !takes.contains(&take) {
            takes.push(take);
        }
    }
    takes
}

struct Work<'a> {
    arguments: &'a Arguments,
    terminal: &'a Terminal,
    folder: &'a Path,
    datasets: &'a Path,
}

impl Work<'_> {
    /// The methods that were asked for, or all.
    fn methods(&self) -> anyhow::Result<Vec<Method>> {
        let known = || METHODS.map(|method| method.name).join(", ");
        if let Some(name) = self.arguments.methods.iter().find(|name| Method::named(name).is_none()) {
            return Err(Usage(format!("no method is called `{name}`; there are {}", known())).into());
        }
        let asked = &self.arguments.methods;
        let wanted = |method: &Method| asked.is_empty() || asked.iter().any(|name| name == method.name);
        Ok(METHODS.into_iter().filter(wanted).collect())
    }

    /// The dataset of a take, with its points, and its bodies where a method needs them.
    fn film(&self, take: &Take, ideal: bool, bodies: bool) -> anyhow::Result<()> {
        let bar = self.terminal.progress(&format!("filming {}", take.name(ideal)));
        let report = |step: Progress| bar.update(step.done, step.total, step.what);
        let mut dataset = take.film(self.datasets, self.size(), ideal, &report)?;
        drop(bar);
        // An act without bodies has no row of the methods that start from them.
        starts::give(&mut dataset, self.arguments.small, bodies, self.terminal)
    }

    fn size(&self) -> Size {
        if self.arguments.small { Size::Small } else { Size::Full }
    }

    /// Trains all takes with a method as a sweep, and gives the folder of each run by the name of its dataset.
    fn train(&self, method: &Method, takes: &[Take]) -> anyhow::Result<Vec<(String, RunFolder)>> {
        let mut options = vec![("iterations", self.arguments.iterations.to_string())];
        options.extend(method.train.iter().map(|(key, value)| (*key, (*value).to_owned())));
        options.extend(self.arguments.adapter.adapter.clone().map(|adapter| ("adapter", adapter)));
        let mut datasets: Vec<PathBuf> = takes.iter().map(|take| take.folder(self.datasets, method.ideal)).collect();
        if method.bodies {
            let mut with = Vec::new();
            for folder in datasets {
                if Dataset::load(&folder)?.manifest.bodies.is_some() {
                    with.push(folder);
                }
            }
            datasets = with;
        }
        if datasets.is_empty() {
            return Ok(Vec::new());
        }
        let (terminal, at_once) = (self.terminal, self.arguments.at_once);
        let plan = plan(method.name, self.folder, datasets, &[1], options);
        let manifest = train_here(&plan, terminal, at_once)?;
        Ok(manifest.jobs.iter().map(|job| (dataset_of(job), manifest.run(job))).collect())
    }

    /// What it came to, with a picture of each training.
    fn board(
        &self,
        takes: &[Take],
        methods: &[Method],
        runs: &BTreeMap<(&str, String), RunFolder>,
    ) -> anyhow::Result<Board> {
        let mut board = Board::default();
        let pictures = self.folder.join("pictures");
        for take in takes {
            let usual = take.folder(self.datasets, false);
            let shown = if usual.join(Dataset::MANIFEST).is_file() { usual } else { take.folder(self.datasets, true) };
            let shown = Dataset::load(&shown)?;
            let shot = choose(&shown)?;
            let (act, file) = (take.act(), |name: &str| pictures.join(format!("{}-{name}.png", take.name(false))));
            if let Some(shot) = &shot {
                shot.write_truth(&shown, &file("truth"))?;
                board.truths.push((act.clone(), take.seed, file("truth")));
            }
            for method in methods {
                let Some(run) = runs.get(&(method.name, take.name(method.ideal))) else { continue };
                let quality = Quality::from(&run.read_metrics()?);
                let file = file(method.name);
                let rendered = shot.as_ref().map(|shot| shot.write_render(run, &file)).transpose()?;
                let picture = rendered.unwrap_or(false).then_some(file);
                board.rows.push(Row { act: act.clone(), seed: take.seed, method: method.name, quality, picture });
            }
        }
        Ok(board)
    }
}

/// The command as it can be given again.
fn command(arguments: &Arguments) -> String {
    let mut words = "erfgs bench acts".to_owned();
    let joined = |words: Vec<String>| words.join(",");
    if !arguments.acts.is_empty() {
        words.push_str(&format!(" --acts {}", joined(arguments.acts.iter().map(Acts::to_string).collect())));
    }
    if arguments.seeds != [1] {
        words.push_str(&format!(" --seeds {}", joined(arguments.seeds.iter().map(u64::to_string).collect())));
    }
    if !arguments.methods.is_empty() {
        words.push_str(&format!(" --methods {}", arguments.methods.join(",")));
    }
    if arguments.iterations != ITERATIONS {
        words.push_str(&format!(" --iterations {}", arguments.iterations));
    }
    if arguments.small {
        words.push_str(" --small");
    }
    words.push_str(&format!(" --out {}", arguments.out.display()));
    words
}

fn describe(board: &Board, folder: &Path) -> String {
    let head = ["act", "seeds", "method"].into_iter().chain(report::COLUMNS);
    let mut rows = vec![head.map(String::from).collect::<Vec<_>>()];
    for act in board.acts() {
        for method in board.methods() {
            let means = board.mean(Some(act), method).into_iter().enumerate();
            let names = [act.to_owned(), board.seeds(act).len().to_string(), method.to_owned()];
            rows.push(names.into_iter().chain(means.map(|(column, value)| report::cell(column, value))).collect());
        }
    }
    format!("{}\n{}", table(&rows), folder.join("acts.html").display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acts_are_given_alone_or_at_once() {
        assert_eq!("throw+fan".parse(), Ok(Acts(vec![Act::Throw, Act::Fan])));
        assert_eq!("throw+fan".parse::<Acts>().unwrap().to_string(), "throw+fan");
        assert!("throw+".parse::<Acts>().unwrap_err().contains("choose from"));
    }

    #[test]
    fn every_method_is_one_that_the_program_trains() {
        for method in METHODS {
            let arguments = method.train.iter().map(|(key, value)| format!("--{key}={value}"));
            let words = ["dataset".to_owned(), "--out=run".into()].into_iter().chain(arguments);
            assert_eq!(crate::train::check(words), Ok(()), "{}", method.name);
        }
    }
}
