//! `erfgs dataset`: make, vary, complete and check datasets.

pub mod bodies;
mod check;
mod disturb;
mod fit;
mod import;
pub mod points;
mod session;
mod undistort;
mod variant;

use clap::Subcommand;

use crate::terminal::Terminal;

/// Import, vary, check and complete datasets.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a dataset from a recording in another tool's layout.
    Import(import::Arguments),
    /// Make a dataset harder: fewer frames, motion blur, event-only viewpoints.
    Variant(Box<variant::Arguments>),
    /// Make the initial point cloud of a dataset.
    Points(points::Arguments),
    /// Find moving things as rigid bodies: tracks, rotations, shapes.
    Bodies(bodies::Arguments),
    /// Read every file of a dataset and check it against the manifest, and the poses against the pictures.
    Check(check::Arguments),
    /// Make a dataset wrong by a known amount: poses, lenses, clocks, thresholds, noise, lost packets.
    Disturb(Box<disturb::Arguments>),
    /// Make a dataset of ideal pinhole cameras.
    Undistort(undistort::Arguments),
}

/// Runs the command.
pub fn run(command: &Command, terminal: &Terminal) -> anyhow::Result<()> {
    match command {
        Command::Import(arguments) => import::run(arguments, terminal),
        Command::Variant(arguments) => variant::run(arguments, terminal),
        Command::Points(arguments) => points::run(arguments, terminal),
        Command::Bodies(arguments) => bodies::run(arguments, terminal),
        Command::Check(arguments) => check::run(arguments, terminal),
        Command::Disturb(arguments) => disturb::run(arguments, terminal),
        Command::Undistort(arguments) => undistort::run(arguments, terminal),
    }
}
