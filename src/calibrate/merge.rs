//! `erfgs calibrate merge`: one rig of several.

use std::path::PathBuf;

use erfgs_calibrate::{evidence::Evidence, merge::merge};
use erfgs_scene::exchange::read;

use super::summary::finish;
use crate::terminal::Terminal;

/// Make one rig of several: lenses of one and poses of another, or rigs that share a camera.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
RIGS are rig files, or those of other programs that `erfgs calibrate convert` reads. For a camera in two rigs the earlier \
entry is kept, and what it lacks is taken from the later one. The world is that of the first rig with poses; others are \
aligned to it by a common camera.

Examples:
  erfgs calibrate merge front.json back.json --out rig.json")]
pub struct Arguments {
    /// The rigs, in order.
    #[arg(required = true, num_args = 2..)]
    rigs: Vec<PathBuf>,
    /// The rig file to write; the report goes beside it, with the extension html.
    #[arg(long, value_name = "FILE", default_value = "rig.json")]
    out: PathBuf,
}

/// Merges.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let rigs = arguments.rigs.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
    finish(&merge(&rigs)?, &Evidence::default(), &arguments.out, terminal)
}
