//! Registers every viewpoint in one frame: by boards ([`board`]), by a wand of lights ([`wand`]), or from images ([`sfm`]),
//! each of which ends in one bundle adjustment ([`bundle`]).

pub mod board;
pub mod bundle;
pub mod check;
pub mod colmap;
mod coverage;
pub mod evidence;
pub mod geometry;
pub mod intensity;
pub mod report;
pub mod sfm;
pub mod statistics;
pub mod wand;
