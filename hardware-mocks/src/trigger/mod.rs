//! The trigger board, twice: its real firmware in simavr, and a model of its protocol on a virtual clock. Both stand
//! behind a pseudo-terminal. Written from `rig/firmware/PROTOCOL.md`.

mod model;
mod pty;
mod simavr;

pub use model::{Board, Clock, Faults, Line, LineEdge};
pub use pty::PtyBoard;
pub use simavr::{PortChange, SimulatedBoard};
