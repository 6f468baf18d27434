//! `erfgs bench`: how fast the stages are on this machine, what precision costs, and what they do at their extremes.

mod acts;
mod budget;
mod decode;
mod precision;
mod raster;
mod simulate;
mod stability;
mod starts;
mod train;
mod trainings;

use clap::Subcommand;

use crate::terminal::Terminal;

/// Measure the stages on this machine.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The event simulator: pixels a second on each thread.
    Simulate(Box<simulate::Arguments>),
    /// The decoding of an event file, from memory, on one core.
    Decode(decode::Arguments),
    /// The rasteriser, stage by stage, on Gaussians spread over the view.
    Raster(raster::Arguments),
    /// A training run, stage by stage, on a dataset.
    Train(train::Arguments),
    /// Every numerical stage at its extremes, each case against its bound.
    Stability(stability::Arguments),
    /// The error of numerical components against their processor time, over their own knobs.
    Precision(precision::Arguments),
    /// What each error of a rig costs in the quality of its reconstructions.
    Budget(budget::Arguments),
    /// How well each method reconstructs the acts of the stage, and how much of the gap to an ideal rig it closes.
    Acts(acts::Arguments),
}

/// Runs the command.
pub fn run(command: &Command, terminal: &Terminal) -> anyhow::Result<()> {
    match command {
        Command::Simulate(arguments) => simulate::run(arguments, terminal),
        Command::Decode(arguments) => decode::run(arguments, terminal),
        Command::Raster(arguments) => raster::run(arguments, terminal),
        Command::Train(arguments) => train::run(arguments, terminal),
        Command::Stability(arguments) => stability::run(arguments, terminal),
        Command::Precision(arguments) => precision::run(arguments, terminal),
        Command::Budget(arguments) => budget::run(arguments, terminal),
        Command::Acts(arguments) => acts::run(arguments, terminal),
    }
}
