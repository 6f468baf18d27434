//! GigE Vision: cameras on Ethernet.
//!
//! [`gvcp`] and [`gvsp`] are the protocols, without input or output; the sockets are in `socket` and `find`.

mod device;
mod find;
pub mod gvcp;
pub mod gvsp;
mod socket;
mod url;

pub use device::{Device, Pulse, Stream};
pub use find::{Found, Interface, Reach, Target, ask, find, interfaces};
pub use socket::{Channel, StreamSocket};
