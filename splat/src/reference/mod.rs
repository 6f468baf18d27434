//! Plain `f64` twins of the kernels: the definitions that those are tested against.

pub mod adam;
pub mod bodies;
pub mod field;
pub mod free_time;
pub mod raster;
