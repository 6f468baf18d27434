//! `erfgs calibrate`: one file per way of calibrating.

mod board;
mod check;
mod convert;
mod summary;
mod target;
mod wand;

use clap::Subcommand;

use crate::terminal::Terminal;

/// Intrinsics, poses and time offsets of a rig's cameras, with their uncertainties.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Calibrate with a chessboard or ChArUco board that was held before the cameras.
    Board(board::Arguments),
    /// Calibrate with a wand of three LEDs that was waved before the cameras.
    Wand(Box<wand::Arguments>),
    /// Compare a rig with a later recording, and say which camera moved.
    Check(check::Arguments),
    /// Draw a board to print, or to blink on a screen.
    Target(target::Arguments),
    /// Write a rig in the format of another program, or read one from there.
    Convert(convert::Arguments),
}

/// Runs a subcommand.
pub fn run(command: &Command, terminal: &Terminal) -> anyhow::Result<()> {
    match command {
        Command::Board(arguments) => board::run(arguments, terminal),
        Command::Check(arguments) => check::run(arguments, terminal),
        Command::Target(arguments) => target::run(arguments, terminal),
        Command::Convert(arguments) => convert::run(arguments, terminal),
        Command::Wand(arguments) => wand::run(arguments, terminal),
    }
}
