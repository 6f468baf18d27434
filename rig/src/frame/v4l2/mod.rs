//! V4L2 cameras: the kernel's stamps as they are, lost frames known, cameras that die or are unplugged noticed, and
//! found again by serial number or place.

mod camera;
mod controls;
mod find;
mod stamp;
mod sys;

pub use camera::PreciseCamera;
pub use find::{list, list_in};
