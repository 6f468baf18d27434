//! `erfgs calibrate points`: cameras placed by known points of the scene.

use std::path::PathBuf;

use erfgs_calibrate::{
    evidence::Evidence,
    landmarks::{place, read_sights, set_world},
};
use erfgs_scene::rig_file::RigFile;

use super::summary::finish;
use crate::terminal::Terminal;

/// Place cameras by points of the scene whose positions are known, or set the world of a rig by them.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
POINTS is a table (CSV) with a line for each point in each image and the columns camera, u, v (pixels; the centre of the first \
one is at 0.5) and x, y, z (metres). Each camera needs five points or more, not all of them on a line.

The intrinsics come from --rig. With --keep-poses the rig stays as it is and its world (origin, axes, and, where it has none, the \
scale) becomes that of the points; three points that two cameras see are needed.

Examples:
  erfgs calibrate board lenses --target chessboard:9x6:0.025 --intrinsics-only --out lenses.json
  erfgs calibrate points field.csv --rig lenses.json --out rig.json
  erfgs calibrate points floor.csv --rig rig.json --keep-poses --out rig-on-floor.json")]
pub struct Arguments {
    /// The table of known points.
    points: PathBuf,
    /// The rig file with the intrinsics.
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// Keep how the cameras stand to each other, and move the world alone.
    #[arg(long)]
    keep_poses: bool,
    /// The rig file to write; the report goes beside it, with the extension html.
    #[arg(long, value_name = "FILE", default_value = "rig.json")]
    out: PathBuf,
}

/// Places cameras, or the world.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let rig = RigFile::read(&arguments.rig)?;
    let sights = read_sights(&arguments.points)?;
    let (rig, evidence) =
        if arguments.keep_poses { (set_world(&rig, &sights)?, Evidence::default()) } else { place(&rig, &sights)? };
    finish(&rig, &evidence, &arguments.out, terminal)
}
