//! `erfgs calibrate convert`: rigs in the formats of other programs.

use std::path::PathBuf;

use erfgs_scene::exchange::{Format, Unit, read_in, write};
use serde::Serialize;

use crate::terminal::Terminal;

/// Write a rig in the format of another program, or read one from there.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
RIG is a rig.json, a folder with a COLMAP model, a folder with YAML files of OpenCV or ROS (or one such file), a Kalibr camchain (YAML), a nerfstudio \
transforms.json, LLFF's poses_bounds.npy, or the TOML of caliscope or pose2sim.

Formats:
  colmap      a model without points (text): a folder
  kalibr      a camchain: a YAML file
  opencv      camera_matrix, distortion_coefficients, R and T: a YAML file for each camera, in a folder
  ros         camera_info: a YAML file for each camera, without poses, in a folder
  nerfstudio  transforms.json
  llff        poses_bounds.npy
  caliscope   camera_array.toml
  pose2sim    Calib.toml
  rig         rig.json

Lengths become metres. A unit stated in the file is used (unit: mm, in OpenCV's and Kalibr's YAML and in TOML). A rig of \
OpenCV, Kalibr, caliscope or pose2sim with cameras more than 20 m apart is refused, with the units that it may be in, unless \
--units states one.

Names of cameras become names of files. Pixel centres and axes are converted. What a format cannot store is reported; a lens \
that it cannot represent is refused.

Examples:
  erfgs calibrate convert rig.json --to colmap --out sparse
  erfgs calibrate convert camchain.yaml --to rig --out rig.json
  erfgs calibrate convert sparse --to rig --metres --out rig.json
  erfgs calibrate convert calibration.toml --to rig --units mm --out rig.json      # Anipose's, of a board in millimetres")]
pub struct Arguments {
    /// The rig to convert.
    rig: PathBuf,
    /// The format to write.
    #[arg(long, value_name = "FORMAT")]
    to: Format,
    /// The file or folder to write. Default: named after the format.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// The input is in metres, though its format does not state a unit (COLMAP, nerfstudio, LLFF).
    #[arg(long)]
    metres: bool,
    /// Unit of the input: m, cm, mm or inch; lengths become metres.
    #[arg(long, value_name = "UNIT", conflicts_with = "metres")]
    units: Option<Unit>,
}

#[derive(Serialize)]
struct Answer {
    out: PathBuf,
    cameras: usize,
    lost: Vec<String>,
}

/// Converts.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let rig = read_in(&arguments.rig, arguments.units.or(arguments.metres.then_some(Unit::Metre)))?;
    for warning in &rig.warnings {
        terminal.note(warning);
    }
    let name = match arguments.to {
        Format::Colmap => "colmap",
        Format::Kalibr => "camchain.yaml",
        Format::OpenCv => "opencv",
        Format::Ros => "camera_info",
        Format::Nerfstudio => "transforms.json",
        Format::Llff => "poses_bounds.npy",
        Format::Caliscope => "camera_array.toml",
        Format::Pose2sim => "Calib.toml",
        Format::Rig => "rig.json",
    };
    let out = arguments.out.clone().unwrap_or_else(|| name.into());
    let lost = write(&rig, arguments.to, &out)?;
    let answer = Answer { out, cameras: rig.cameras.len(), lost };
    terminal.result(&answer, || {
        let mut text = format!("{} cameras written to {}\n", answer.cameras, answer.out.display());
        for lost in &answer.lost {
            text.push_str(&format!("not kept: {lost}\n"));
        }
        text
    })
}
