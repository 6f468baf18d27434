//! Machine-vision cameras: GigE Vision, and GenICam's descriptions of what cameras can do.
//!
//! [`gige`] is the transport, its protocols without input or output; `features` reads and sets what a camera's own description
//! tells of; `settings` knows what to set, in which order, and how makers call it.

mod chunks;
mod config;
mod error;
mod features;
pub mod gige;
pub mod pixel;
mod settings;
mod sound;

pub use chunks::{Chunk, Order, cut};
pub use config::GenicamConfig;
pub use error::GenicamError;
pub use features::{Features, Registers};
pub use settings::{Wish, Wishes, apply, chunk_values};
