//! GigE Vision cameras as sources of frames.

mod camera;
mod find;
mod frames;

pub use camera::GigeCamera;
pub use find::list;
