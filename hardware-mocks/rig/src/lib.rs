//! A rig of emulated devices before the stage, recorded as a real one would be.
//!
//! The event cameras are models behind their real drivers; UVC cameras and the trigger board are models behind hosts that
//! speak their wire formats and stamp what arrives as the kernel and the board's driver do. All of them live by one
//! simulated clock, which moves only when every device has been asked: a slow machine takes longer and records the same.
//!
//! A rig makes three takes: a screen with a blinking board on a bench before each camera ([`screen`]), a wand that is waved
//! where the performance will be ([`wand`]), and the performance ([`performance`]). Nothing but the sessions comes out: the
//! rig file has to be found by calibration. Before a rig of another kind a dataset is played ([`film`]), so that what recording
//! costs can be told.
//!
//! | module | what it knows |
//! |---|---|
//! | [`plan`] | which cameras there are, where they stand, their lenses and clocks; the `RIG.toml` of a take |
//! | [`world`] | the simulated clock, and whose turn it is |
//! | [`kernel`] | the host of a UVC camera |
//! | [`trigger`] | the host of the trigger board, and the wires from it |
//! | [`film`] | a dataset as a film before the cameras |
//! | [`fault`] | what goes wrong in a take, on demand |
//! | [`take`] | a session of a take |

#[path = "../../../rig/tests/it/usb_cameras/support/bus.rs"]
mod bus;
pub mod fault;
pub mod film;
pub mod kernel;
pub mod performance;
pub mod plan;
pub mod screen;
pub mod take;
pub mod trigger;
pub mod wand;
pub mod world;

pub use fault::Fault;
pub use film::{Film, FilmError};
pub use plan::{Act, Plan};
pub use take::{TakeError, record};
