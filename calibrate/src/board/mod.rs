//! Calibration with a board: chessboard, ChArUco or AprilGrid, held before the cameras.
//!
//! Corners are found in frames (`features.rs`, `detect.rs`), of boards that lean in pictures that make them broad (`facing.rs`), and made exact (`corner.rs`); each camera's intrinsics come from its own
//! views (`intrinsics.rs`, Zhang 2000, then adjusted); boards that several cameras see at once chain their poses (`chain.rs`), those
//! with a target on either side also of cameras that face each other (`plate.rs`, `link.rs`, `back.rs`), one
//! adjustment over all cameras ends it (`joint.rs`, `rig.rs`), and what it says is held against what each camera says by itself
//! (`doubt.rs`); cameras that do not run together are brought to the same instants (`track.rs`, `scatter.rs`), and what is refused
//! says which remedies helped (`remedies.rs`). `quick.rs` does the second step while frames still
//! come in, `quick_rig.rs` for all cameras of a rig that runs. Event cameras see boards that blink on a screen (`blink.rs`) and printed ones that move (`moving.rs`).

mod alone;
mod aprilgrid;
mod back;
mod blink;
mod chain;
mod codes;
mod consistent;
mod corner;
mod detect;
mod doubt;
mod error;
mod facing;
mod features;
mod fill;
mod input;
mod intrinsics;
mod joint;
mod layout;
mod link;
mod moved;
mod moving;
mod origin;
mod picture;
mod plate;
mod print;
mod quick;
mod quick_rig;
mod remedies;
mod rig;
mod scatter;
mod session;
mod stream;
mod target;
mod track;

pub use detect::{Corner, detect};
pub use error::BoardError;
pub use input::{BoardDetections, BoardView, look};
pub use intrinsics::{LensModel, Single, single};
pub use layout::{CalibrationFolder, TwoParts};
pub use picture::pictures;
pub use plate::{Face, Plate, PlateError};
pub use print::{Paper, print};
pub use quick::{Fit, GRID, Quick, QuickState};
pub use quick_rig::QuickRig;
pub use rig::{BoardOptions, calibrate};
pub use session::look_session;
pub use stream::{EventBoard, EventPictures, Watcher};
use target::Charuco;
pub use target::{Target, not_metres};
