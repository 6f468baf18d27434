//! `erfgs bench stability`.

use std::path::PathBuf;

use erfgs_base::FileError;
use erfgs_stability::{Bench, Case, Row, Size, cases, report};
use serde::Serialize;

use crate::{
    device::Adapter,
    errors::Usage,
    terminal::{Terminal, table},
};

/// Take every numerical stage to its extremes.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each case has a bound, stated beforehand with its reason, and an independent reference; or it must be refused by name. The \
exit code is 1 if a case fails.

Examples:
  erfgs bench stability
  erfgs bench stability --small
  erfgs bench stability --only needles
  erfgs bench stability --without '10,000 iterations'
  erfgs bench stability --out docs/results/stability.md")]
pub struct Arguments {
    /// Some cases of every stage, in seconds.
    #[arg(long)]
    small: bool,
    /// Only cases whose stage or name contains this, ignoring case.
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// No cases whose stage or name contains this, ignoring case.
    #[arg(long, value_name = "TEXT")]
    without: Option<String>,
    /// Write the table as a Markdown document, too.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    adapter: Adapter,
}

#[derive(Serialize)]
struct Figures {
    adapter: String,
    failed: usize,
    rows: Vec<Row>,
}

/// Runs the cases and prints a line for each.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let size = if arguments.small { Size::Small } else { Size::Full };
    let mut cases = cases(size);
    let has = |case: &Case, text: &str| {
        let text = text.to_lowercase();
        [case.part, &case.name].iter().any(|words| words.to_lowercase().contains(&text))
    };
    cases.retain(|case| arguments.only.as_ref().is_none_or(|only| has(case, only)));
    cases.retain(|case| !arguments.without.as_ref().is_some_and(|without| has(case, without)));
    if cases.is_empty() {
        return Err(Usage("no case has this name; omit --only and --without to see all".into()).into());
    }
    let gpu = arguments.adapter.open()?;
    let adapter = format!("{} ({} {})", gpu.info.name, gpu.info.driver, gpu.info.driver_info);
    let bench = Bench::new(gpu)?;
    let progress = terminal.progress("stability");
    let total: f64 = cases.iter().map(|case| case.weight).sum();
    let (mut done, mut rows) = (0.0, Vec::with_capacity(cases.len()));
    for (index, case) in cases.iter().enumerate() {
        progress.share(done / total, || format!("{} of {} cases, {}", index, cases.len(), case.name));
        rows.push(case.run(&bench));
        done += case.weight;
    }
    drop(progress);
    if let Some(path) = &arguments.out {
        let made = report::Made {
            command: command(arguments),
            version: env!("CARGO_PKG_VERSION").into(),
            adapter: adapter.clone(),
        };
        erfgs_base::atomic::write(path, report::markdown(&rows, &made).as_bytes())
            .map_err(FileError::when("write", path))?;
    }
    let failed = rows.iter().filter(|row| row.failed()).count();
    let figures = Figures { adapter, failed, rows };
    terminal.result(&figures, || describe(&figures))?;
    match failed {
        0 => Ok(()),
        _ => anyhow::bail!("{failed} of {} cases exceeded their bounds", figures.rows.len()),
    }
}

/// The command as it can be given again.
fn command(arguments: &Arguments) -> String {
    let mut words = "erfgs bench stability".to_owned();
    if arguments.small {
        words.push_str(" --small");
    }
    if let Some(only) = &arguments.only {
        words.push_str(&format!(" --only '{only}'"));
    }
    if let Some(without) = &arguments.without {
        words.push_str(&format!(" --without '{without}'"));
    }
    if let Some(out) = &arguments.out {
        words.push_str(&format!(" --out {}", out.display()));
    }
    words
}

fn describe(figures: &Figures) -> String {
    let mut rows =
        vec![["stage", "case", "bound", "error", "not finite", "CPU s", "verdict"].map(String::from).to_vec()];
    rows.extend(figures.rows.iter().map(|row| {
        let [must, _, measured, not_finite, cpu] = report::cells(row);
        vec![row.part.to_owned(), row.name.clone(), must, measured, not_finite, cpu, row.verdict.to_string()]
    }));
    format!("{}: {} cases, {} failed\n{}", figures.adapter, figures.rows.len(), figures.failed, table(&rows))
}
