//! `erfgs calibrate check`: whether a rig still stands as it was calibrated.

use std::path::PathBuf;

use anyhow::bail;
use erfgs_calibrate::{
    board::{BoardOptions, Target, calibrate},
    check::{Tolerance, compare},
    report::write_drift,
};
use erfgs_scene::rig_file::RigFile;

use super::board::{Sides, boards, recorded};
use crate::{
    errors::Usage,
    terminal::{Terminal, table},
};

/// Compare a rig with a later recording, and say which camera moved.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
LATER is a rig.json that was made later, by any method, or a recording of a board as `erfgs calibrate board` takes it; then \
--target says which, and the intrinsics of the rig are kept.

The exit code is 1 if a camera moved.

Examples:
  erfgs calibrate check rig.json videos-of-today --target chessboard:9x6:0.025
  erfgs calibrate check rig.json rig-of-today.json")]
pub struct Arguments {
    /// The rig as it was calibrated.
    rig: PathBuf,
    /// A later rig, or a later recording of a board.
    later: PathBuf,
    /// The board of the recording.
    #[arg(long, value_name = "TARGET")]
    target: Option<Target>,
    #[command(flatten)]
    sides: Sides,
    /// Shifts up to this are let pass, millimetres.
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = crate::parse::within(0.0, 1e6))]
    shift: f64,
    /// Turns up to this are let pass, degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.05, value_parser = crate::parse::within(0.0, 360.0))]
    turn: f64,
    /// The page to write: each camera's shift and turn against what is known of them, and the rig before and after.
    #[arg(long, value_name = "FILE", default_value = "check.html")]
    out: PathBuf,
}

/// Compares.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let earlier = RigFile::read(&arguments.rig)?;
    let session = arguments.later.extension().is_some_and(|extension| extension == "mcap");
    let later = if session || arguments.later.is_dir() {
        let Some(target) = &arguments.target else {
            return Err(Usage("a recording needs --target, the board that it shows".into()).into());
        };
        let plate = &arguments.sides.plate(target)?;
        let seen = boards(&recorded(&arguments.later, terminal)?, plate, None, terminal)?.0;
        let known = earlier.cameras.iter().map(|camera| (camera.name.clone(), camera.intrinsics)).collect();
        let back_thickness_m = arguments.sides.thickness_m();
        let options = BoardOptions { known, back_thickness_m, ..BoardOptions::default() };
        calibrate(&seen, plate, &options, &|_, _, _| {})?.0
    } else {
        RigFile::read(&arguments.later)?
    };
    let tolerance = Tolerance { shift_m: 1e-3 * arguments.shift, turn_deg: arguments.turn };
    let comparison = compare(&earlier, &later, tolerance)?;
    let moved: Vec<&str> = comparison.moved().map(|drift| drift.camera.as_str()).collect();
    write_drift(&earlier, &comparison, &arguments.out)?;
    terminal.result(&comparison, || {
        let head = ["camera", "shift mm", "± mm", "turn deg", "± deg", ""].map(String::from).to_vec();
        let rows = comparison.cameras.iter().map(|drift| {
            vec![
                drift.camera.clone(),
                format!("{:.2}", drift.shift_mm),
                format!("{:.2}", drift.shift_sigma_mm),
                format!("{:.3}", drift.turn_deg),
                format!("{:.3}", drift.turn_sigma_deg),
                if drift.moved { "moved".into() } else { String::new() },
            ]
        });
        let mut text = table(&std::iter::once(head).chain(rows).collect::<Vec<_>>());
        if !comparison.missing.is_empty() {
            text.push_str(&format!("not in both: {}\n", comparison.missing.join(", ")));
        }
        text.push_str(&format!("\n{}\n", arguments.out.display()));
        text
    })?;
    if moved.is_empty() {
        return Ok(());
    }
    if comparison.majority {
        bail!("{} moved since the calibration; calibrate the rig again", moved.join(", "));
    }
    bail!("cameras moved, and too few agree to tell which ones; calibrate the rig again")
}
