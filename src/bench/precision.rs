//! `erfgs bench precision`.

use std::path::{Path, PathBuf};

use erfgs_base::FileError;
use erfgs_precision::{Bench, Component, Kept, Outcome, Size, components, report};
use serde::Serialize;

use crate::{
    device::Adapter,
    errors::Usage,
    terminal::{Terminal, table},
};

/// Draw work-precision diagrams: error against processor time.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Every setting of every knob is compared with a finer reference; the default setting is marked. \
With --out the curves are written into a folder: precision.html draws them, precision.md has them as tables, precision.csv \
has the numbers. All components take hours. Measured settings are kept in settings.jsonl in that folder, and the same command \
continues with the rest; delete the file if something has changed since.

Examples:
  erfgs bench precision
  erfgs bench precision rasteriser --out curves
  erfgs bench precision --small 'event simulator'
  erfgs bench precision --without bundle --out docs/results")]
pub struct Arguments {
    /// Only components whose name contains this, ignoring case.
    component: Option<String>,
    /// No components whose name contains this, ignoring case; may be given again.
    #[arg(long, value_name = "TEXT")]
    without: Vec<String>,
    /// Some settings of small problems, in seconds.
    #[arg(long)]
    small: bool,
    /// Write precision.html, precision.md and precision.csv into this folder.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    #[command(flatten)]
    adapter: Adapter,
}

/// Short work is repeated for so long, seconds of processor time.
const ENOUGH: f64 = 0.5;

#[derive(Serialize)]
struct Figures {
    adapter: String,
    components: Vec<Outcome>,
}

/// Runs the components and prints a line for each setting.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let size = if arguments.small { Size::Small } else { Size::Full };
    let mut components = components(size);
    let has = |component: &Component, text: &String| component.about.name.to_lowercase().contains(&text.to_lowercase());
    let names: Vec<&str> = components.iter().map(|component| component.about.name).collect();
    let known = format!("there are {}", names.join(", "));
    components.retain(|component| arguments.component.as_ref().is_none_or(|only| has(component, only)));
    components.retain(|component| !arguments.without.iter().any(|without| has(component, without)));
    if components.is_empty() {
        return Err(Usage(format!("no component has this name; {known}")).into());
    }
    let gpu = arguments.adapter.open()?;
    let adapter = format!("{} ({} {})", gpu.info.name, gpu.info.driver, gpu.info.driver_info);
    let bench = Bench::new(gpu)?;
    let enough = if arguments.small { 0.0 } else { ENOUGH };
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).map_err(FileError::when("make the folder", folder))?;
    }
    let mut kept = match &arguments.out {
        Some(folder) if !arguments.small => {
            let path = folder.join("settings.jsonl");
            let kept = Kept::open(&path, &format!("erfgs {}, {adapter}", env!("CARGO_PKG_VERSION")))?;
            if kept.count() > 0 {
                let words = format!(
                    "{} settings were measured before; delete {} to measure them again",
                    kept.count(),
                    path.display()
                );
                terminal.note(&words);
            }
            kept
        }
        _ => Kept::default(),
    };
    let progress = terminal.progress("precision");
    let total: f64 = components.iter().map(Component::weight).sum();
    let (mut before, mut outcomes) = (0.0, Vec::new());
    for component in &components {
        let advance = |done: f64| progress.share((before + done) / total, || component.about.name.to_owned());
        outcomes.push(component.run(&bench, enough, &mut kept, advance));
        before += component.weight();
    }
    drop(progress);
    let figures = Figures { adapter, components: outcomes };
    if let Some(folder) = &arguments.out {
        write(folder, arguments, &figures)?;
    }
    terminal.result(&figures, || describe(&figures))?;
    let refused: Vec<String> = figures
        .components
        .iter()
        .flat_map(|outcome| outcome.refused().map(|words| format!("{}, {}", outcome.about.name, words.join(": "))))
        .collect();
    anyhow::ensure!(refused.is_empty(), "{} settings could not be run: {}", refused.len(), refused.join("; "));
    Ok(())
}

fn write(folder: &Path, arguments: &Arguments, figures: &Figures) -> anyhow::Result<()> {
    let made = report::Made {
        command: command(arguments),
        version: env!("CARGO_PKG_VERSION").into(),
        adapter: figures.adapter.clone(),
    };
    let all = &figures.components;
    for (name, text) in [
        ("precision.csv", report::csv(all)),
        ("precision.md", report::markdown(all, &made)),
        ("precision.html", report::page(all, &made)),
    ] {
        let path = folder.join(name);
        erfgs_base::atomic::write(&path, text.as_bytes()).map_err(FileError::when("write", &path))?;
    }
    Ok(())
}

/// The command as it can be given again.
fn command(arguments: &Arguments) -> String {
    let mut words = "erfgs bench precision".to_owned();
    if let Some(component) = &arguments.component {
        words.push_str(&format!(" '{component}'"));
    }
    for without in &arguments.without {
        words.push_str(&format!(" --without '{without}'"));
    }
    if arguments.small {
        words.push_str(" --small");
    }
    if let Some(out) = &arguments.out {
        words.push_str(&format!(" --out {}", out.display()));
    }
    words
}

fn describe(figures: &Figures) -> String {
    let mut text = figures.adapter.clone();
    for outcome in &figures.components {
        text.push_str(&format!("\n\n{}", outcome.about.name));
        for curve in &outcome.curves {
            let measures = outcome.about.measures.iter().map(|of| format!("{}, {}", of.name, of.unit));
            let mut rows: Vec<Vec<String>> =
                vec![[curve.knob.clone()].into_iter().chain(measures).chain(["CPU time".into()]).collect()];
            rows.extend(report::cells(outcome, curve));
            text.push_str(&format!("\n{}", table(&rows)));
            if let Some(place) = report::better(curve) {
                text.push_str(&format!("\nthe default is beaten by {}", place.setting));
            }
        }
    }
    text
}
