//! `erfgs sweep`: many trainings by one plan, on Slurm or here.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    time::Duration,
};

use anyhow::Context;
use erfgs_sweep::{
    Ended, Job, JobState, Manifest, OverSeeds, Overview, Plan, commands, run_here, shell_line, slurm, work,
};
use erfgs_view::Precision;
use serde::Serialize;

use crate::{
    device::Adapter,
    errors::{Stopped, Usage},
    interrupt::stop_flag,
    progress::duration,
    takes,
    terminal::{Terminal, table, thousands},
    train,
};

/// How often the queue is asked.
const ASK_EVERY: Duration = Duration::from_secs(2);

/// Train many runs by one plan: datasets, windows of a long take, settings, seeds; on Slurm, or on this machine.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A plan is a TOML file (docs/guide/sweeps.md lists all of it; examples/sweep.toml is one):

  datasets = [\"ds-dv\"]            # beside the plan, with initial points
  seeds = [0, 1, 2]
  [train]                         # options of `erfgs train`; a list gives a run for each of its entries
  method = [\"4dgs\", \"erf-gs\"]
  iterations = \"3000+14000\"
  [set]                           # settings, likewise
  \"earl.weight\" = [0.5, 1.0]

If Slurm is available, missing runs are submitted as an array of jobs; otherwise they are trained here, --at-once at a time. \
The same command continues later with what is not done: killed or preempted runs restart from their last checkpoint and come \
to the same result. Windows of a long take ([[take]]) share the static Gaussians of the first one; when all are done, \
takes/NAME.html in the sweep's folder plays them in sequence. `erfgs report` takes the sweep's folder and compares the runs \
that are done so far.

Examples:
  erfgs sweep plan.toml --dry-run
  erfgs sweep plan.toml --at-once 2
  erfgs sweep plan.toml --status
  erfgs report plan --out report.html
  erfgs view plan")]
pub struct Arguments {
    /// The plan, or the folder of a sweep, whose manifest is then the plan.
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
    /// Print what would be done, and do nothing.
    #[arg(long)]
    dry_run: bool,
    /// Print the state of the runs, and do nothing.
    #[arg(long, conflicts_with = "dry_run")]
    status: bool,
    /// Train on this machine even if Slurm is available.
    #[arg(long)]
    local: bool,
    /// Submit to Slurm, and fail if there is none.
    #[arg(long, conflicts_with = "local")]
    slurm: bool,
    /// Runs that are trained at a time here; on Slurm the plan says it (slurm.at_once).
    #[arg(long, value_name = "N", default_value_t = 1)]
    at_once: usize,
    /// On Slurm: stay until no job is left in the queue.
    #[arg(long)]
    wait: bool,
    /// Write the pages of a sweep's takes, as the last job does.
    #[arg(long, hide = true)]
    pages: bool,
    /// Work on one run of a sweep's folder, as jobs do.
    #[arg(long, value_name = "NAME", hide = true)]
    job: Option<String>,
}

/// Runs, submits or tells.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let manifest = manifest(arguments)?;
    if let Some(name) = &arguments.job {
        return one(&manifest, name);
    }
    if arguments.pages {
        return pages(&manifest, terminal);
    }
    let slurm = !arguments.local && there_is_a_slurm(arguments, terminal)?;
    if arguments.dry_run {
        return dry_run(&manifest, slurm, terminal);
    }
    if arguments.status {
        return print_state(&manifest, &overview(&manifest, slurm)?, terminal);
    }
    manifest.save()?;
    if slurm { on_slurm(arguments, &manifest, terminal) } else { here(arguments, &manifest, terminal) }
}

fn there_is_a_slurm(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<bool> {
    match slurm::answers() {
        Ok(true) => Ok(true),
        Ok(false) if arguments.slurm => Err(Usage("there is no Slurm here (no `scontrol`)".into()).into()),
        Err(why) if arguments.slurm => Err(Usage(why).into()),
        Ok(false) => Ok(false),
        Err(why) => {
            terminal.note(format!("{why}: it is left out"));
            Ok(false)
        }
    }
}

fn manifest(arguments: &Arguments) -> anyhow::Result<Manifest> {
    if arguments.plan.is_dir() {
        return Ok(Manifest::load(&arguments.plan)?);
    }
    let plan = Plan::load(&arguments.plan)?;
    Ok(Manifest::of_plan(&plan, &arguments.plan, check)?)
}

/// Says what is wrong with the options of a run, if something is.
pub fn check(job: &Job) -> Result<(), String> {
    let dataset = job.dataset.to_string_lossy().into_owned();
    let words = [dataset, "--out".into(), "run".into(), "--resume".into()];
    train::check(words.into_iter().chain(job.arguments.iter().cloned()))
}

/// This program, which jobs start.
pub fn program() -> anyhow::Result<PathBuf> {
    std::env::current_exe().context("cannot find out where this program lies, which jobs are to start")
}

/// What a job of an array does.
fn one(manifest: &Manifest, name: &str) -> anyhow::Result<()> {
    let stop = stop_flag("what runs is saved")?;
    match work(manifest, manifest.job(name)?, &program()?, stop)? {
        Ended::Done => Ok(()),
        Ended::Stopped => Err(Stopped(format!("{name} was stopped, and goes on when it is started again")).into()),
        Ended::Failed { message } => {
            anyhow::bail!("{name}: {message}; see {}", manifest.log(manifest.job(name)?).display())
        }
    }
}

fn here(arguments: &Arguments, manifest: &Manifest, terminal: &Terminal) -> anyhow::Result<()> {
    let stop = stop_flag("what runs is saved")?;
    let bar = terminal.progress("sweep");
    let state = |overview: &Overview| bar.share(overview.share(), || overview.words());
    let overview = run_here(manifest, &program()?, arguments.at_once, stop, state)?;
    drop(bar);
    if !stop.load(std::sync::atomic::Ordering::Relaxed) {
        pages(manifest, terminal)?;
    }
    print_state(manifest, &overview, terminal)?;
    let left = overview.jobs.len() - overview.count(JobState::Done);
    let never = overview.count(JobState::Waiting) + overview.count(JobState::Stopped);
    match overview.count(JobState::Failed) {
        _ if stop.load(std::sync::atomic::Ordering::Relaxed) && left > 0 => Err(Stopped(format!(
            "stopped with {left} of {} runs left; the same command continues",
            overview.jobs.len()
        ))
        .into()),
        0 if never > 0 => {
            anyhow::bail!("{never} of {} runs were not trained; the same command continues", overview.jobs.len())
        }
        0 => Ok(()),
        failed => anyhow::bail!("{failed} of {} runs failed; the same command retries them", overview.jobs.len()),
    }
}

/// Writes a page for each take whose windows are all done, unless there is one of these trainings.
fn pages(manifest: &Manifest, terminal: &Terminal) -> anyhow::Result<()> {
    for take in manifest.takes().into_iter().filter(|take| take.missing == 0) {
        let adapter = Adapter { adapter: take.windows[0].job.adapter().map(str::to_owned) };
        let windows = takes::runs(manifest, &take, &adapter);
        let file = takes::page_file(&manifest.folder, &windows);
        let mark = takes::mark(&windows);
        if mark.as_ref().is_some_and(|mark| takes::has_mark(&file, mark)) {
            continue;
        }
        let page = match takes::page(&windows, Precision::Packed, &adapter, terminal) {
            Ok(page) => page,
            Err(error) => {
                terminal.note(format!("{} has no page: {error:#}", take.name));
                continue;
            }
        };
        takes::write_page(&file, &(page.text + mark.as_deref().unwrap_or_default()))?;
        terminal.note(format!("{}: the take {}, which opens from a disk", file.display(), take.name));
    }
    Ok(())
}

fn on_slurm(arguments: &Arguments, manifest: &Manifest, terminal: &Terminal) -> anyhow::Result<()> {
    let submitted = slurm::submit(manifest, &program()?)?;
    for submission in &submitted {
        terminal.note(format!("submitted job {} with {} runs", submission.id, submission.jobs.len()));
    }
    if submitted.is_empty() {
        terminal.note("nothing was submitted: all runs are done or in the queue");
    }
    let mut overview = overview(manifest, true)?;
    if arguments.wait {
        let stop = stop_flag("the jobs stay in the queue")?;
        let bar = terminal.progress("sweep");
        while overview.count(JobState::Running) + overview.count(JobState::Queued) > 0 {
            bar.share(overview.share(), || overview.words());
            std::thread::sleep(ASK_EVERY);
            if stop.load(std::sync::atomic::Ordering::Relaxed) {
                drop(bar);
                return Err(Stopped("the jobs stay in the queue; --status says where they stand".into()).into());
            }
            overview = self::overview(manifest, true)?;
        }
    }
    print_state(manifest, &overview, terminal)?;
    let failed = overview.count(JobState::Failed);
    anyhow::ensure!(failed == 0, "{failed} of {} runs failed; the same command retries them", overview.jobs.len());
    Ok(())
}

fn overview(manifest: &Manifest, slurm: bool) -> anyhow::Result<Overview> {
    let queue = if slurm { slurm::queue(manifest)? } else { Default::default() };
    Ok(Overview::of(manifest, &queue))
}

#[derive(Serialize)]
struct DryRun<'a> {
    out: &'a Path,
    slurm: bool,
    jobs: &'a [Job],
    /// Of each job, in their order: the words after the program's name.
    commands: Vec<Vec<Vec<String>>>,
    scripts: Vec<String>,
}

fn dry_run(manifest: &Manifest, slurm: bool, terminal: &Terminal) -> anyhow::Result<()> {
    let names: Vec<String> = manifest.jobs.iter().map(|job| job.name.clone()).collect();
    let scripts = if slurm { slurm::scripts(manifest, &names, &program()?)? } else { Vec::new() };
    let commands = manifest.jobs.iter().map(|job| commands(manifest, job)).collect::<Result<Vec<_>, _>>()?;
    let value = DryRun { out: &manifest.folder, slurm, jobs: &manifest.jobs, commands, scripts };
    terminal.result(&value, || {
        let mut rows = vec![["run", "dataset", "options"].map(String::from).to_vec()];
        rows.extend(
            manifest
                .jobs
                .iter()
                .map(|job| vec![job.name.clone(), job.dataset.display().to_string(), job.arguments.join(" ")]),
        );
        let place = if slurm { "on Slurm" } else { "here" };
        let mut text = table(&rows);
        text.push_str(&format!("\n{} runs {place}, into {}\n", manifest.jobs.len(), manifest.folder.display()));
        text.push_str("\nwhat they run; a dataset that several need is made by the first:\n");
        let mut state = BTreeSet::new();
        for (job, commands) in manifest.jobs.iter().zip(&value.commands) {
            text.push_str(&format!("\n# {}\n", job.name));
            for command in commands.iter().filter(|command| state.insert(*command)) {
                text.push_str(&format!("erfgs {}\n", shell_line(command)));
            }
        }
        for script in &value.scripts {
            text.push_str(&format!("\n{script}"));
        }
        text
    })
}

#[derive(Serialize)]
struct SweepState<'a> {
    out: &'a Path,
    #[serde(flatten)]
    overview: &'a Overview,
    over_seeds: Vec<OverSeeds>,
}

fn print_state(manifest: &Manifest, overview: &Overview, terminal: &Terminal) -> anyhow::Result<()> {
    let state = SweepState { out: &manifest.folder, overview, over_seeds: overview.over_seeds() };
    terminal.result(&state, || {
        let heading = ["run", "state", "done", "iterations", "time", "PSNR", "DPSNR", "starts", "machine"];
        let mut rows = vec![heading.map(String::from).to_vec()];
        let decibels = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2}"));
        rows.extend(overview.jobs.iter().map(|job| {
            vec![
                job.name.clone(),
                job.state.name().into(),
                format!("{:.0} %", 100.0 * job.share),
                thousands(job.iterations),
                duration(job.seconds),
                decibels(job.psnr),
                decibels(job.dpsnr),
                job.attempts.to_string(),
                job.node.clone(),
            ]
        }));
        let mut text = table(&rows);
        for job in &overview.jobs {
            if let Some(why) = &job.failed {
                text.push_str(&format!("{}: {why}\n", job.name));
            }
        }
        if !state.over_seeds.is_empty() {
            let spread = |values: Option<[f64; 2]>| {
                values.map_or("-".into(), |[mean, deviation]| format!("{mean:.2} ± {deviation:.2}"))
            };
            let mut rows = vec![["over seeds", "runs", "PSNR", "DPSNR"].map(String::from).to_vec()];
            rows.extend(state.over_seeds.iter().map(|group| {
                vec![group.name.clone(), group.runs.to_string(), spread(group.psnr), spread(group.dpsnr)]
            }));
            text.push_str(&format!("\n{}", table(&rows)));
        }
        text.push_str(&format!(
            "\n{}\ncompare what is done: erfgs report {} --out report.html\n",
            overview.words(),
            manifest.folder.display()
        ));
        text
    })
}
