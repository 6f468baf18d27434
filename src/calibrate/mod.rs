//! `erfgs calibrate`: one file per way of calibrating.

mod board;
mod check;
mod convert;
mod merge;
mod points;
mod register;
mod sfm;
mod steps;
mod summary;
mod target;
mod wand;

use clap::Subcommand;

pub use board::{blink_rate, lens_model};

use crate::terminal::Terminal;

/// Intrinsics, poses and time offsets of a rig's cameras, with their uncertainties.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Calibrate with a chessboard, ChArUco board or AprilGrid that was held before the cameras.
    Board(board::Arguments),
    /// Calibrate with a wand of three LEDs that was waved before the cameras.
    Wand(Box<wand::Arguments>),
    /// Compare a rig with a later recording, and say which camera moved.
    Check(check::Arguments),
    /// Draw a board to print, or to blink on a screen.
    Target(target::Arguments),
    /// Write a rig in the format of another program, or read one from there.
    Convert(convert::Arguments),
    /// Place cameras by points of the scene whose positions are known, or set the world of a rig by them.
    Points(points::Arguments),
    /// Make one rig of several.
    Merge(merge::Arguments),
    /// Calibrate from images of whatever the cameras see, without a target.
    Sfm(sfm::Arguments),
    /// Add cameras to a calibrated rig, from images of what its cameras see too; event cameras from light that was switched on.
    Register(register::Arguments),
}

/// Runs a subcommand.
pub fn run(command: &Command, terminal: &Terminal) -> anyhow::Result<()> {
    match command {
        Command::Board(arguments) => board::run(arguments, terminal),
        Command::Check(arguments) => check::run(arguments, terminal),
        Command::Target(arguments) => target::run(arguments, terminal),
        Command::Convert(arguments) => convert::run(arguments, terminal),
        Command::Points(arguments) => points::run(arguments, terminal),
        Command::Merge(arguments) => merge::run(arguments, terminal),
        Command::Wand(arguments) => wand::run(arguments, terminal),
        Command::Sfm(arguments) => sfm::run(arguments, terminal),
        Command::Register(arguments) => register::run(arguments, terminal),
    }
}
