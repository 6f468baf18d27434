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
    /// Whether each is followed: how it turns between instants is a guess, since frames did not tell, or it bends.
    pub followed: Vec<bool>,
    /// The instant that each of those that bend is followed from, in [0, 1].
    pub bends: Vec<Option<f64>>,
    /// How many nodes they have in all.
    pub nodes: usize,
    /// The body of each node.
    pub node_bodies: Vec<usize>,
    /// Control points of each.
    pub knots: usize,
    /// Stretches between knots in a second.
    pub per_second: f64,
    /// Control points: see `shared.wgsl`.
    pub control: Vec<f32>,
    /// Gates and nodes: see `poses.wgsl`.
    pub other: Vec<f32>,
    /// Neighbours of nodes, [`NEIGHBOURS`] each: see `settle.wgsl`.
    pub neighbours: Vec<u32>,
    /// The Gaussians of all bodies, with their rows.
    pub gaussians: Gaussians,
}

/// A node that is not there, in a list of neighbours.
pub const NO_NODE: u32 = u32::MAX;
/// What a node says of a neighbour is in so many bits beside its number.
pub const CODES: u32 = 8;
/// The bit of nodes of bodies that bend.
pub const LOOSE: u32 = 4;

impl Start {
    /// Of each node whether its body bends.
    #[must_use]
    pub fn loose(&self) -> Vec<bool> {
        self.node_bodies.iter().map(|&body| self.bends[body].is_some()).collect()
    }
}
