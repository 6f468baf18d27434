//! The reconstruction in a browser, at any time from any place.
//!
//! - [`scene_file`]: what a page needs to know of a run, in one file.
//! - [`alone`]: the page and its scenes as one file.
//! - [`fourdgs`]: the same for the readers of the open container of 4D Gaussians.
//! - [`gltf`], [`spz`]: an instant of it for what reads these.
//! - [`server`]: the page and what it asks for, over HTTP.
//! - [`training`]: what a page is told of a run that is being trained.
//! - `page/`: the page itself, in plain JavaScript; it draws with the kernels of the trainer ([`erfgs_splat::shaders`]) on WebGPU.
//!
//! A browser without WebGPU is shown pictures that the server draws.

pub mod alone;
pub mod fourdgs;
pub mod gltf;
mod recorded;
mod routes;
pub mod scene_file;
pub mod server;
pub mod spz;
mod texts;
pub mod training;
mod upright;
mod window;

pub use scene_file::{Learned, Precision, SceneFile};
pub use server::{Ask, Compared, FrameError, Model, ViewPage};
pub use training::LiveTraining;
pub use upright::{NothingSeen, Written};
pub use window::Window;
