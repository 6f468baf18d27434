//! `erfgs bench budget`.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use anyhow::Context;
use erfgs_base::{FileError, Progress};
use erfgs_budget::{Base, Budget, Cause, Costs, Quality, Size, Step, causes, moved_px, report};
use erfgs_dataset::{Dataset, Split};
use erfgs_scene::PointCloud;
use erfgs_sweep::Job;

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

const ITERATIONS: Iterations = Iterations { coarse: Some(300), fine: 1500 };
const SEEDS: u64 = 3;

/// Measure what each error of a rig costs in the quality of its reconstructions.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Errors of poses, lenses, clocks, thresholds, noise and lost packets are put into the training cameras of a dataset in steps, \
one kind at a time. Each dataset gets bodies of its own, as far as it shows any, is trained with events and measured on the \
held-out cameras. Without a dataset the stage is filmed, and exposures, thresholds and numbers of cameras are varied, too.

The folder holds the datasets, the trainings as sweeps (base, wrong, without-events), and budget.html, budget.md and budget.csv. The \
same command continues later with what is not done, and with more --seeds. A hundred and fifty trainings take a night on two \
cores and minutes on a GPU. --seeds 1 takes a third of it, and does not show the noise of the figures.

Examples:
  erfgs bench budget --out budget
  erfgs bench budget --out budget --only 'place' --only 'events late'
  erfgs bench budget --out budget --only 'place=3' --only 'event cameras=1' --seeds 1
  erfgs bench budget ds --out budget-of-ds
  erfgs bench budget --small --out try")]
pub struct Arguments {
    /// A dataset with held-out cameras. Default: the stage.
    dataset: Option<PathBuf>,
    /// The folder for datasets, trainings and the report.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Only errors whose name contains this, ignoring case, or only one size of it; may be given again.
    #[arg(long, value_name = "TEXT[=SIZE]")]
    only: Vec<String>,
    /// Iterations of each training.
    #[arg(long, value_name = "[COARSE+]FINE", default_value_t = ITERATIONS)]
    iterations: Iterations,
    /// Number of seeds for each dataset; their spread is the noise of the figures.
    #[arg(long, value_name = "N", default_value_t = SEEDS, value_parser = clap::value_parser!(u64).range(1..100))]
    seeds: u64,
    /// Trainings at a time.
    #[arg(long, value_name = "N", default_value_t = 1)]
    at_once: usize,
    /// Look for no bodies: what moves is free in time.
    #[arg(long)]
    no_bodies: bool,
    /// A tiny stage and the least step of each error, to see that everything works.
    #[arg(long, conflicts_with = "dataset")]
    small: bool,
    #[command(flatten)]
    adapter: Adapter,
}

/// Makes the datasets, trains, and tells what it came to.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let adapter = arguments.adapter.open()?.info;
    let folder = std::path::absolute(&arguments.out).context("cannot find the current folder")?;
    let datasets = folder.join("datasets");
    let base = base(arguments, &datasets, terminal)?;
    let causes = chosen(arguments, &base)?;
    let work = Work { arguments, terminal, folder: &folder, datasets: &datasets };
    let (base, points) = work.with_points(base)?;
    let mut made: BTreeMap<String, Dataset> = BTreeMap::new();
    for step in causes.iter().flat_map(|cause| &cause.steps) {
        made.insert(step.name.clone(), work.step(&base, step)?);
    }
    let method = if base.has_events() { "erf-gs" } else { "4dgs" };
    let seeds: Vec<u64> = (1..=arguments.seeds).collect();
    let usual = work.train("base", method, vec![base.dataset.root.clone()], &seeds)?;
    let of = |events: bool| {
        let steps = causes.iter().flat_map(|cause| &cause.steps).filter(|step| step.events == events);
        steps.filter_map(|step| Some(made.get(&step.name)?.root.clone())).collect::<Vec<_>>()
    };
    let mut qualities = work.train("wrong", method, of(true), &seeds)?;
    qualities.extend(work.train("without-events", "4dgs", of(false), &seeds)?);
    let mut budget = Budget { base: usual.into_iter().map(|(_, quality)| quality).collect(), causes: Vec::new() };
    for cause in &causes {
        let mut costs = Costs::of(cause);
        for step in &cause.steps {
            let of_step = qualities.iter().filter(|(name, _)| *name == step.name);
            let runs: Vec<_> = of_step.map(|(_, quality)| *quality).collect();
            anyhow::ensure!(!runs.is_empty(), "{} was not trained", step.name);
            let moved = made.get(&step.name).and_then(|dataset| moved_px(&base.dataset, dataset, &points));
            costs.add(step, moved, runs);
        }
        budget.causes.push(costs);
    }
    let made = report::Made {
        command: command(arguments),
        version: env!("CARGO_PKG_VERSION").into(),
        adapter: format!("{} ({} {})", adapter.name, adapter.driver, adapter.driver_info),
        what: what(arguments, &base, method),
    };
    write(&folder, &budget, &made)?;
    terminal.result(&budget, || describe(&budget, &folder))
}

fn write(folder: &Path, budget: &Budget, made: &report::Made) -> anyhow::Result<()> {
    for (name, text) in [
        ("budget.csv", report::csv(budget)),
        ("budget.md", report::markdown(budget, made)),
        ("budget.html", report::page(budget, made)),
    ] {
        let path = folder.join(name);
        erfgs_base::atomic::write(&path, text.as_bytes()).map_err(FileError::when("write", &path))?;
    }
    Ok(())
}

fn base(arguments: &Arguments, datasets: &Path, terminal: &Terminal) -> anyhow::Result<Base> {
    if let Some(path) = &arguments.dataset {
        let dataset = Dataset::load(path)?;
        let held_out = dataset.cameras(Split::Test).any(|camera| !camera.frames.is_empty());
        if !held_out {
            let words =
                format!("{} has no held-out camera to measure quality on; import it with --test", path.display());
            return Err(Usage(words).into());
        }
        return Ok(Base::of_dataset(dataset));
    }
    let size = if arguments.small { Size::Small } else { Size::Full };
    std::fs::create_dir_all(datasets).map_err(FileError::when("make the folder", datasets))?;
    let bar = terminal.progress("filming the stage");
    Ok(Base::of_stage(size, datasets, &|step: Progress| bar.update(step.done, step.total, step.what))?)
}

fn chosen(arguments: &Arguments, base: &Base) -> anyhow::Result<Vec<Cause>> {
    let mut causes = causes(base);
    if !arguments.only.is_empty() {
        causes = only(causes, &arguments.only)?;
    }
    if arguments.small {
        causes.iter_mut().for_each(|cause| cause.steps.truncate(1));
    }
    Ok(causes)
}

/// Of these the steps that are asked for, each by its error's name, or by name and size.
fn only(mut causes: Vec<Cause>, asked: &[String]) -> Result<Vec<Cause>, Usage> {
    let has = |text: &str, name_of: &str, size: f64| {
        let (name, of_size) = text.split_once('=').map_or((text, None), |(name, size)| (name, Some(size)));
        name_of.to_lowercase().contains(&name.trim().to_lowercase())
            && of_size.is_none_or(|of_size| of_size.trim().parse() == Ok(size))
    };
    for text in asked {
        if !causes.iter().any(|cause| cause.steps.iter().any(|step| has(text, cause.about.name, step.size))) {
            let known = |cause: &Cause| {
                let sizes: Vec<String> = cause.steps.iter().map(|step| step.size.to_string()).collect();
                format!("{} ({})", cause.about.name, sizes.join(", "))
            };
            let known: Vec<String> = causes.iter().map(known).collect();
            return Err(Usage(format!("no error is named '{text}'; errors and their sizes are {}", known.join(", "))));
        }
    }
    for cause in &mut causes {
        let name = cause.about.name;
        cause.steps.retain(|step| asked.iter().any(|text| has(text, name, step.size)));
    }
    causes.retain(|cause| !cause.steps.is_empty());
    Ok(causes)
}

struct Work<'a> {
    arguments: &'a Arguments,
    terminal: &'a Terminal,
    folder: &'a Path,
    datasets: &'a Path,
}

impl Work<'_> {
    /// The base with what a training starts from, and its initial points.
    fn with_points(&self, mut base: Base) -> anyhow::Result<(Base, PointCloud)> {
        let has_events = base.has_events();
        self.start(&mut base.dataset, has_events)?;
        let points = base.dataset.read_points()?.unwrap_or_default();
        Ok((base, points))
    }

    /// The dataset of a step, with what a training starts from.
    fn step(&self, base: &Base, step: &Step) -> anyhow::Result<Dataset> {
        let bar = self.terminal.progress(&step.name);
        let mut dataset =
            step.make(base, self.datasets, &|step: Progress| bar.update(step.done, step.total, step.what))?;
        drop(bar);
        self.start(&mut dataset, step.events && base.has_events())?;
        Ok(dataset)
    }

    /// Gives a dataset what a training starts from: bodies where events tell of them.
    fn start(&self, dataset: &mut Dataset, has_events: bool) -> anyhow::Result<()> {
        let Arguments { small, no_bodies, .. } = *self.arguments;
        starts::give(dataset, small, has_events && !no_bodies, self.terminal)
    }

    /// Trains datasets as a sweep, and gives the quality of each run by the name of its dataset.
    fn train(
        &self,
        name: &str,
        method: &str,
        datasets: Vec<PathBuf>,
        seeds: &[u64],
    ) -> anyhow::Result<Vec<(String, Quality)>> {
        if datasets.is_empty() {
            return Ok(Vec::new());
        }
        let mut options = vec![("method", method.to_owned()), ("iterations", self.arguments.iterations.to_string())];
        options.extend(self.arguments.adapter.adapter.clone().map(|adapter| ("adapter", adapter)));
        let plan = plan(name, self.folder, datasets, seeds, options);
        let manifest = train_here(&plan, self.terminal, self.arguments.at_once)?;
        let quality = |job: &Job| Ok((dataset_of(job), Quality::from(&manifest.run(job).read_metrics()?)));
        manifest.jobs.iter().map(quality).collect()
    }
}

/// What was trained, in words.
fn what(arguments: &Arguments, base: &Base, method: &str) -> String {
    let Iterations { coarse, fine } = arguments.iterations;
    let manifest = &base.dataset.manifest;
    let training = || base.dataset.cameras(Split::Train);
    let frames = training().filter(|camera| camera.modality.has_frames()).count();
    let events = training().filter(|camera| camera.modality.has_events()).count();
    format!(
        "The scene is {}: {:.1} s, {frames} training cameras with frames and {events} with events; {} iterations of {}{}.",
        manifest.name,
        1e-9 * (manifest.span_ns[1] - manifest.span_ns[0]) as f64,
        coarse.unwrap_or(0) + fine,
        method.to_uppercase(),
        match &manifest.bodies {
            Some(bodies) => format!(" with {} bodies, found anew for each dataset", bodies.count),
            None => String::new(),
        }
    )
}

/// The command as it can be given again.
fn command(arguments: &Arguments) -> String {
    let mut words = "erfgs bench budget".to_owned();
    if let Some(dataset) = &arguments.dataset {
        words.push_str(&format!(" {}", dataset.display()));
    }
    for only in &arguments.only {
        words.push_str(&format!(" --only '{only}'"));
    }
    if arguments.no_bodies {
        words.push_str(" --no-bodies");
    }
    if arguments.small {
        words.push_str(" --small");
    }
    if arguments.iterations != ITERATIONS {
        words.push_str(&format!(" --iterations {}", arguments.iterations));
    }
    if arguments.seeds != SEEDS {
        words.push_str(&format!(" --seeds {}", arguments.seeds));
    }
    words.push_str(&format!(" --out {}", arguments.out.display()));
    words
}

fn describe(budget: &Budget, folder: &Path) -> String {
    let usual = budget.usual();
    let mut rows = vec![["error", "size", "cost, dB", "DPSNR, dB", "PSNR, dB"].map(String::from).to_vec()];
    rows.push(vec![
        "nothing".into(),
        String::new(),
        String::new(),
        format!("{:.2}", usual.dpsnr),
        format!("{:.2}", usual.psnr),
    ]);
    for costs in &budget.causes {
        rows.extend(costs.rows.iter().map(|row| {
            let quality = row.quality();
            vec![
                costs.about.name.to_owned(),
                report::sized(costs, row.size),
                format!("{:+.2}", budget.cost_db(row)),
                format!("{:.2}", quality.dpsnr),
                format!("{:.2}", quality.psnr),
            ]
        }));
    }
    let mut text = table(&rows);
    if let Some(noise) = budget.noise_db() {
        text.push_str(&format!("\na cost below {noise:.2} dB may be the seeds'"));
    }
    text.push_str(&format!("\n{}", folder.join("budget.html").display()));
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_chosen_by_name_and_by_size_and_unknown_ones_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let base = Base::of_stage(Size::Small, folder.path(), &|_| ()).unwrap();
        let chosen = |asked: &[&str]| {
            let asked: Vec<String> = asked.iter().map(ToString::to_string).collect();
            let causes = only(causes(&base), &asked).map_err(|Usage(words)| words)?;
            let steps = causes.iter().flat_map(|cause| &cause.steps);
            Ok::<_, String>(steps.map(|step| step.name.clone()).collect::<Vec<_>>())
        };
        assert_eq!(
            chosen(&["place=3", "Event Noise = 10", "place=1"]).unwrap(),
            ["place-1", "place-3", "event-noise-10"]
        );
        assert_eq!(chosen(&["late"]).unwrap().len(), 8);
        for wrong in ["gravity", "place=2", "place=", "place=3 mm"] {
            let words = chosen(&["late", wrong]).unwrap_err();
            assert!(words.contains(&format!("'{wrong}'")) && words.contains("place (1, 3, 10, 30)"), "{words}");
        }
    }
}
