//! The run folder: what a training run leaves behind, as files that other tools can open.
//!
//! ```text
//! run/run.json                          what ran: method, preset, dataset, adapter, seed, what was left out
//! run/config.toml                       the effective configuration
//! run/dataset.json                      a copy of the dataset's manifest, so that the folder explains itself
//! run/curve.csv                         losses, Gaussians and quality over iterations and wall seconds
//! run/metrics.json, run/per_view.json   the evaluation
//! run/renders/<camera>/<index>.png      held-out views, beside run/truth/<camera>/<index>.png
//! run/masks/<camera>/<index>.png        the pixels that count for DPSNR (white)
//! run/events/<camera>/<index>-measured.png, <index>-rendered.png
//! run/point_cloud.ply, run/point_cloud_t/<index>.ply
//! run/checkpoint.bin
//! ```
//!
//! `docs/reference/run.md` describes every field. JSON files are replaced in one step; `curve.csv` is flushed line by line, so
//! that a killed run loses at most its last line.

mod curve;
mod error;
mod figures;
mod folder;
mod identity;
mod info;
mod json;
mod lock;
mod lpips;

pub use curve::{Curve, CurveRow, CurveWriter};
pub use error::RunError;
pub use figures::{ColourCorrected, MaskKind, Metrics, Part, PerView};
pub use folder::RunFolder;
pub use identity::{Identity, flat};
pub use info::{CameraColour, CameraPose, CameraTime, LeftOut, RunInfo};
pub use json::write_atomically;
pub use lock::FolderLock;
pub use lpips::{LpipsKind, LpipsNet, LpipsScaling};
