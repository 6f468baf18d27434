//! Event cameras: Prophesee EVK4 and iniVation DAVIS346.
//!
//! A driver is written over [`Transport`](crate::usb::Transport) and knows one device while it is plugged in;
//! [`EventSource`] makes a [`Source`](erfgs_session::source::Source) of it that finds the camera again after it was
//! unplugged.

mod config;
#[cfg(feature = "davis346")]
pub mod davis346;
mod driver;
mod error;
#[cfg(feature = "evk4")]
pub mod evk4;
mod list;
mod source;
mod stream;
mod supervisor;

pub use config::{StreamConfig, Window};
#[cfg(feature = "davis346")]
pub use davis346::Davis346Config;
pub use driver::Driver;
pub use error::EventError;
#[cfg(feature = "evk4")]
pub use evk4::{BiasOffsets, Evk4Config};
pub use list::{FoundDevice, Kind, list, list_on};
pub use source::EventSource;

/// An EVK4 as a source.
#[cfg(feature = "evk4")]
pub type Evk4Source = EventSource<evk4::Evk4>;

/// A DAVIS346 as a source.
#[cfg(feature = "davis346")]
pub type Davis346Source = EventSource<davis346::Davis346>;
