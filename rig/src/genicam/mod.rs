//! Machine-vision cameras: GigE Vision, USB3 Vision, and GenICam's descriptions of what cameras can do.
//!
//! [`gige`] and [`u3v`] are the transports, their protocols without input or output; `features` reads and sets what a camera's own
//! description tells of; `settings` knows what to set, in which order, and how makers call it.

mod block;
mod chunks;
mod config;
mod description;
mod error;
mod features;
pub mod gige;
pub mod pixel;
mod settings;
mod sound;
mod status;
pub mod u3v;

pub use block::{Block, Damage, Image, Leader};
pub use chunks::{Chunk, Order, cut};
pub use config::GenicamConfig;
pub use error::GenicamError;
pub use features::{Features, Registers};
pub use settings::{Wish, Wishes, apply, chunk_values};
pub use status::Status;
