//! The scoreboard: every act of the stage, filmed by an ordinary rig and by an ideal one, and reconstructed by every method.
//!
//! ```text
//! Take (acts, seed) ──► film, and its ceiling ──► points, bodies, training, evaluation by each Method (by the caller)
//!                                                        │
//!                                                        ▼
//!                       Board: quality, and the share of the gap closed ──► report (csv, markdown, page)
//! ```
//!
//! The gap is what lies between 4DGS on what the rig recorded and 4DGS on what the same cameras would have recorded if they were sharp
//! and eight times as fast. Held-out cameras and their times are the same for all.

mod board;
mod method;
mod picture;
pub mod report;
mod take;

pub use board::{Board, Quality, Row, closed};
pub use erfgs_stage::Act;
pub use method::{BASELINE, CEILING, METHODS, Method};
pub use picture::{Shot, choose};
pub use take::{Size, Take};

use erfgs_dataset::DatasetError;
use erfgs_run::RunError;
use erfgs_scene::image::ImageError;
use erfgs_stage::StageError;

/// Why a part of the scoreboard could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ActsError {
    /// The dataset.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The film.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// A training's folder.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A picture.
    #[error(transparent)]
    Image(#[from] ImageError),
}
