//! `erfgs dataset bodies`: what moves in a dataset as bodies.

use std::path::PathBuf;

use erfgs_dataset::{BodiesFile, Body, Dataset};
use erfgs_points::{BodyEdits, BodyOptions, CloudError, FoundBodies, attach_bodies, find_bodies, noted_rate};

use crate::{
    takes::write_page,
    terminal::{Terminal, table, thousands},
};

/// Find what moves as bodies: tracks, rotations and shapes that training with bodies starts from.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Reads the moving points (`erfgs dataset points`), the frames of their instants and the events around them. Moving things are \
tracked from instant to instant. Their rotation is estimated from the colours in the frames and by contrast maximisation of \
the events; their shape is carved from the silhouettes of all instants. A track is then refined by its own appearance, from \
the instant at which the thing is seen best, if that makes its events sharper. Writes bodies.json into the dataset and names \
it in the manifest.

A body whose rotation is not determined does not rotate; the output says so.

--report writes a page: where each body is, what it looks like at each instant beside what was carved of it, how sharp its events are \
against how fast it may turn, and what belongs to no body. What is wrong there can be corrected by --edit, a file of TOML:

  forget = [\"body3\"]               # it is no body
  merge = [[\"body0\", \"body4\"]]    # they are one thing
  [[split]]                        # it is two things: beside each other (parts), or before and after (at_s)
  body = \"body2\"
  parts = 2
  [[turn]]                         # how it turns, from which it is improved
  body = \"body1\"
  rate_rad_s = [0.0, 0.0, 15.0]

What is round in all views is taken for a ball, which is where its silhouettes are discs; carve = [\"body2\"] has it carved instead.

Examples:
  erfgs dataset points ds
  erfgs dataset bodies ds
  erfgs dataset points ds --moving 24 && erfgs dataset bodies ds
  erfgs dataset bodies ds --report bodies.html
  erfgs dataset bodies ds --edit edits.toml --report bodies.html
  erfgs dataset bodies ds --json")]
pub struct Arguments {
    /// The dataset; it needs moving points (`erfgs dataset points`).
    dataset: PathBuf,
    /// Write a page that shows what was found, one HTML file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Correct what is found by this file: bodies to forget, to merge, to split, to carve, and how they turn
    #[arg(long, value_name = "FILE")]
    edit: Option<PathBuf>,
}

/// Finds the bodies of a dataset and names them in its manifest, which is saved.
pub fn find(
    dataset: &mut Dataset,
    options: &BodyOptions,
    terminal: &Terminal,
) -> Result<(FoundBodies, BodiesFile), CloudError> {
    let progress = terminal.progress("bodies");
    let found = find_bodies(dataset, options, &|step, done, total| {
        progress.update(done as u64, total as u64, &step.to_string());
    })?;
    drop(progress);
    let file = attach_bodies(dataset, &found)?;
    Ok((found, file))
}

/// Finds bodies and tells of each.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let mut dataset = Dataset::load(&arguments.dataset)?;
    let edits = arguments.edit.as_deref().map(BodyEdits::read).transpose()?.unwrap_or_default();
    let options = BodyOptions { edits, page: arguments.report.is_some() };
    let (found, file) = find(&mut dataset, &options, terminal)?;
    if let (Some(report), Some(page)) = (&arguments.report, &found.page) {
        write_page(report, page)?;
    }
    terminal.result(&file, || {
        let heading = ["body", "instants", "points", "radius m", "rad/s", "contrast", "rotation"].map(str::to_owned);
        let mut rows = vec![heading.to_vec()];
        rows.extend(found.bodies.iter().map(row));
        let mut text = table(&rows);
        text.push('\n');
        let mut rows = vec![vec!["file".into(), dataset.root.join(&file.file).display().to_string()]];
        for (name, value) in file.parameters.iter().filter(|(_, value)| value.is_number()) {
            rows.push(vec![name.replace('_', " "), value.to_string()]);
        }
        if let Some(report) = &arguments.report {
            rows.push(vec!["report".into(), report.display().to_string()]);
        }
        text + &table(&rows)
    })
}

/// What the terminal shows of a body.
fn row(body: &Body) -> Vec<String> {
    let number = |name: &str| body.found_by.get(name).map_or("-".into(), ToString::to_string);
    let rate = noted_rate(body).map_or("-".into(), |rate| format!("{:.1}", rate.length()));
    let rotation = body.found_by.get("rotation").and_then(|value| value.as_str()).unwrap_or("-");
    vec![
        body.name.clone(),
        number("instants"),
        thousands(body.points.len() as u64),
        number("radius_m"),
        rate,
        number("contrast_without_turn"),
        rotation.to_owned(),
    ]
}
