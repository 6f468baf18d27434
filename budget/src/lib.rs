//! The error budget: what each error of a rig costs in the quality of what is reconstructed, each varied alone.
//!
//! ```text
//! the base: a film of the stage, or a dataset of the user's ──► disturbed, or filmed otherwise, one step at a time
//!                                                                    │ points, training, evaluation (by the caller)
//!                                                                    ▼
//!                                       Row: by how much it is worse ──► what a rig may get wrong, report
//! ```
//!
//! [`causes`] are what may be wrong, in steps of growing size; [`Step::make`] makes the dataset of one. Whoever calls trains and
//! measures each on the held-out cameras, which are never touched, and [`Budget`] tells what it came to.

mod cause;
mod outcome;
mod pixels;
pub mod report;
mod stage;

pub use cause::{About, BudgetError, Cause, Kind, Step, causes};
pub use outcome::{Budget, Costs, Quality, Row, Tolerated};
pub use pixels::moved_px;
pub use stage::{Base, Size};
