//! The report: one HTML page that compares runs.
//!
//! The page is a single file without anything to fetch: style sheet, plots (SVG) and pictures are inside it. It has no scripts but
//! for those of the view, which stands in a frame of its own. The same runs give the same bytes. Each section is a file of this
//! module.

mod clocks;
mod colours;
mod configuration;
mod curves;
mod load;
mod oracle;
mod per_camera;
mod picture_io;
mod pictures;
mod poses;
mod rig;
mod scenes;
mod setting;
mod summary;
mod time;
mod views;
mod walk;

use std::path::Path;

use erfgs_page::{html, plot};

use erfgs_base::{FileError, atomic};
use erfgs_run::{RunError, RunFolder};

/// What can go wrong with a report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// There is nothing to report.
    #[error("a report needs at least one run folder; give those that `erfgs train --out` wrote")]
    NoRuns,
    /// A run could not be read.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The page could not be written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// A report that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Report {
    /// Bytes of the page.
    pub bytes: u64,
    /// What is missing or not comparable, as the page says it.
    pub notes: Vec<String>,
}

/// What a report shows beside what is in the run folders.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extras<'a> {
    /// A run of the baseline on frames that the others did not have (all of them, and sharp): the page says how much of what
    /// the baseline lacks to it the runs with events make up for.
    pub oracle: Option<&'a RunFolder>,
    /// The view of the runs as a page of one file.
    pub view: Option<&'a str>,
}

/// Compares `runs` in one page at `out`. Differences are against the first run over the same dataset; runs over several
/// datasets give a table by scene, and a part of the page for each.
///
/// What a run lacks (it was stopped, or not evaluated) is noted in the page; what is broken is an error.
///
/// # Errors
/// [`ReportError`].
pub fn write_report(runs: &[RunFolder], extras: Extras<'_>, out: &Path) -> Result<Report, ReportError> {
    if runs.is_empty() {
        return Err(ReportError::NoRuns);
    }
    let mut scenes = load::load(runs)?;
    let oracle = extras.oracle.map(oracle::Oracle::read).transpose()?;
    let several = scenes.len() > 1;
    let mut body = if several { scenes::table(&scenes) } else { String::new() };
    let mut view = extras.view;
    for scene in &mut scenes {
        if several {
            body += &scenes::heading(scene);
        }
        // Pictures come first: what cannot be read becomes a note at the head of the page.
        let side_by_side = pictures::views(scene);
        let events = pictures::events(scene);
        let sections = [
            summary::section(scene),
            oracle.as_ref().map_or(String::new(), |oracle| oracle::section(scene, oracle)),
            curves::quality(scene),
            time::section(scene),
            side_by_side,
            // One view, in the part of the first scene.
            walk::section(scene, view.take()),
            events,
            views::section(scene),
            setting::left_out(scene),
            colours::section(scene),
            poses::section(scene),
            clocks::section(scene),
            curves::losses(scene),
            configuration::section(scene),
            setting::dataset(scene),
        ];
        body += &sections.concat();
    }
    let text = html::page(&scenes::title(&scenes), &scenes::head(&scenes), &body);
    atomic::write(out, text.as_bytes()).map_err(FileError::when("write the report", out))?;
    let notes = scenes.into_iter().flat_map(|scene| scene.notes).collect();
    Ok(Report { bytes: text.len() as u64, notes })
}
