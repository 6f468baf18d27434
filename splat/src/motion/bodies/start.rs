//! What bodies are made of: control points, nodes and Gaussians.

use crate::gaussians::Gaussians;

/// Vectors of a row of a Gaussian beside its path: see `row.wgsl`.
pub const EXTRA_FLOATS: usize = 8;
/// Neighbours of a node on either side, at most.
pub const NEIGHBOURS: usize = 16;
/// The instant of a Gaussian that a body carries, as one that is free in time would have it: never.
pub const NEVER: f32 = 1e9;

/// Where bodies start from.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// How many.
    pub bodies: usize,
    /// What they are called.
    pub names: Vec<String>,
    /// Whether how each turns between instants is a guess: frames did not tell.
    pub guessed: Vec<bool>,
    /// How many nodes they have in all.
    pub nodes: usize,
    /// Control points of each.
    pub knots: usize,
    /// Stretches between knots in a second.
    pub per_second: f64,
    /// Control points: see `shared.wgsl`.
    pub control: Vec<f32>,
    /// Gates and nodes: see `poses.wgsl`.
    pub other: Vec<f32>,
    /// Neighbours of nodes: see `settle.wgsl`.
    pub neighbours: Vec<u32>,
    /// The Gaussians of all bodies, with their rows.
    pub gaussians: Gaussians,
}
