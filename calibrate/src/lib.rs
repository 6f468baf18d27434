//! Registers every viewpoint in one frame: by boards ([`board`]), by a wand of lights ([`wand`]), from images ([`sfm`]) or by
//! known points ([`landmarks`]), each of which ends in one bundle adjustment ([`bundle`]).

pub mod board;
pub mod bundle;
pub mod check;
pub mod colmap;
mod coverage;
pub mod evidence;
pub mod geometry;
pub mod intensity;
pub mod landmarks;
mod linear;
pub mod merge;
pub mod report;
pub mod sfm;
pub mod statistics;
pub mod wand;
