//! The reconstruction in a browser, at any time from any place.
//!
//! - [`scene_file`]: what a page needs to know of a run, in one file.
//! - [`alone`]: the page and its scenes as one file.
//! - [`server`]: the page and what it asks for, over HTTP.
//! - `page/`: the page itself, in plain JavaScript; it draws with the kernels of the trainer ([`erfgs_train::shaders`]) on WebGPU.
//!
//! A browser without WebGPU is shown pictures that the server draws.

pub mod alone;
mod routes;
pub mod scene_file;
pub mod server;
mod texts;

pub use scene_file::SceneFile;
pub use server::{Ask, Compared, Model, ViewError, ViewOptions, ViewPage};
