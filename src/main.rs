//! `erfgs`: from synchronized RGB and event cameras to a sharp 4D reconstruction.
//!
//! One file per subcommand. What a command does lies in the library of its stage; here are arguments, progress, output
//! and exit codes: 0 done, 1 failed, 2 wrong usage, 130 stopped by the user.

mod bench;
mod calibrate;
mod dataset;
mod device;
mod devices;
mod doctor;
mod errors;
mod eval;
mod event_file;
mod export;
mod import;
mod info;
mod interrupt;
mod merge;
mod parse;
mod progress;
mod quick;
mod record;
mod recover;
mod render;
mod replay;
mod report;
mod shell;
mod simulate;
mod sweep;
mod sync;
mod takes;
mod terminal;
mod train;
mod view;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use crate::terminal::Terminal;

/// From synchronized RGB and event cameras to a sharp 4D reconstruction.
#[derive(Debug, Parser)]
#[command(
    name = "erfgs",
    version = env!("ERFGS_VERSION"),
    arg_required_else_help = true,
    subcommand_required = true,
    after_help = "\
Examples: from a rig to a reconstruction
  erfgs record RIG.toml --out boards.mcap --live --quick chessboard:9x6:0.025
  erfgs calibrate board boards.mcap --target chessboard:9x6:0.025 --out rig.json
  erfgs record RIG.toml --out take1.mcap --seconds 10
  erfgs dataset import session take1.mcap --rig rig.json --from 2.5 --seconds 1 --out ds
  erfgs dataset points ds
  erfgs train ds --out run

Examples: from a multi-view recording to a report
  erfgs dataset import panoptic DIR --frames 40..84 --scale 0.5 --out ds
  erfgs dataset variant ds --subsample 4 --blur 3 --event-only 4 --out ds-dv
  erfgs dataset points ds-dv
  erfgs train ds-dv --method erf-gs --iterations 3000+14000 --out run
  erfgs eval run
  erfgs report run --out report.html

`erfgs COMMAND --help` explains a command and gives examples; `erfgs doctor` says what this machine lacks."
)]
struct Cli {
    #[command(flatten)]
    terminal: Terminal,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// List the cameras and boards that a rig can be made of, or test a rig.
    Devices(devices::Arguments),
    /// Record a rig of cameras into a session file.
    Record(record::Arguments),
    /// Calibrate the cameras of a rig.
    #[command(subcommand)]
    Calibrate(calibrate::Command),
    /// Import, vary, check and complete datasets.
    #[command(subcommand)]
    Dataset(dataset::Command),
    /// Simulate an event camera on a grey-level video.
    Simulate(simulate::Arguments),
    /// Train a dynamic scene from a dataset.
    Train(train::Arguments),
    /// Train many runs by one plan, on Slurm or on this machine.
    Sweep(sweep::Arguments),
    /// Measure a run on the held-out cameras.
    Eval(eval::Arguments),
    /// Render a run: a camera path or a camera, over a time range, to PNG, EXR or MP4.
    Render(render::Arguments),
    /// Look at runs in a browser, at any time from any place.
    View(view::Arguments),
    /// Write the Gaussians of a run, or the streams of a session or an event file, in the formats of other programs.
    Export(export::Arguments),
    /// Make a session of an event file of another program.
    Import(import::Arguments),
    /// Repair a session whose recording was cut off.
    Recover(recover::Arguments),
    /// Merge the sessions that several hosts recorded with one trigger board.
    Merge(merge::Arguments),
    /// Play a session or an event file as if its devices were there.
    Replay(replay::Arguments),
    /// Fit the clocks of a session anew and plot how well they fit.
    Sync(sync::Arguments),
    /// Say what a session, a dataset, a run, a point cloud or an event file holds.
    Info(info::Arguments),
    /// Compare runs in one self-contained HTML file.
    Report(report::Arguments),
    /// Check this machine: adapter, driver, COLMAP, ffmpeg, and what to install.
    Doctor(doctor::Arguments),
    /// Print the completions of a shell.
    Completions(shell::CompletionsArguments),
    /// Write the manual pages into a folder.
    Man(shell::ManArguments),
    /// Measure the stages on this machine.
    #[command(
        subcommand,
        after_help = "\
Examples:
  erfgs bench decode recording.raw
  erfgs bench simulate
  erfgs bench raster
  erfgs bench train ds
  erfgs bench precision --out curves
  erfgs bench stability --out stability.md
  erfgs bench budget --out budget"
    )]
    Bench(bench::Command),
}

fn main() -> ExitCode {
    let Cli { terminal, command } = Cli::parse();
    terminal.start_log();
    if let Err(error) = interrupt::stop_at_once() {
        return errors::report(&error);
    }
    let done = match command {
        Command::Devices(arguments) => devices::run(&arguments, &terminal),
        Command::Record(arguments) => record::run(&arguments, &terminal),
        Command::Calibrate(command) => calibrate::run(&command, &terminal),
        Command::Dataset(command) => dataset::run(&command, &terminal),
        Command::Simulate(arguments) => simulate::run(&arguments, &terminal),
        Command::Train(arguments) => train::run(&arguments, &terminal),
        Command::Sweep(arguments) => sweep::run(&arguments, &terminal),
        Command::Eval(arguments) => eval::run(&arguments, &terminal),
        Command::Render(arguments) => render::run(&arguments, &terminal),
        Command::View(arguments) => view::run(&arguments, &terminal),
        Command::Export(arguments) => export::run(&arguments, &terminal),
        Command::Import(arguments) => import::run(&arguments, &terminal),
        Command::Recover(arguments) => recover::run(&arguments, &terminal),
        Command::Merge(arguments) => merge::run(&arguments, &terminal),
        Command::Replay(arguments) => replay::run(&arguments, &terminal),
        Command::Sync(arguments) => sync::run(&arguments, &terminal),
        Command::Info(arguments) => info::run(&arguments, &terminal),
        Command::Report(arguments) => report::run(&arguments, &terminal),
        Command::Doctor(arguments) => doctor::run(&arguments, &terminal),
        Command::Completions(arguments) => shell::completions(&arguments, Cli::command(), &terminal),
        Command::Man(arguments) => shell::man(&arguments, Cli::command(), &terminal),
        Command::Bench(command) => bench::run(&command, &terminal),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => errors::report(&error),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        super::Cli::command().debug_assert();
    }
}
