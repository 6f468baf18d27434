//! How bodies start and learn.

use serde::{Deserialize, Serialize};

/// How bodies start and learn. Rates fall exponentially from the first to the last value over the fine stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodiesOptions {
    /// Knots of paths in an RGB interval; more where something turns by more than a radian from one to the next.
    pub knots: f32,
    /// Nodes of all bodies together; each has at least five.
    pub nodes: u32,
    /// When nodes begin to learn, as a share of the fine stage; 1 or more: bodies stay rigid.
    pub nodes_from: f32,
    /// For this share of the fine stage bodies of which frames do not tell how they turn are followed: the part of the recording in which
    /// they are learned grows from its middle; 0: it is all of it at once.
    #[serde(default)]
    pub follow: f32,
    /// Renderings of an exposure, each at a random instant of its share of it; 1: a frame is taken for an instant.
    pub exposure: u32,
    /// How far apart the Gaussians of a body start, in pixels of the cameras that have it in view; 0: one for each point of its surface.
    #[serde(default)]
    pub spacing_px: f32,
    /// The opacity that a Gaussian of a body starts with.
    pub opacity: f32,
    /// Learning rate of the places of bodies, extents of the scene: first, last.
    pub path: [f32; 2],
    /// Learning rate of the turns of bodies: first, last.
    pub turn: [f32; 2],
    /// Learning rate of the places of nodes, extents of the scene: first, last.
    pub node_path: [f32; 2],
    /// Learning rate of the turns of nodes: first, last.
    pub node_turn: [f32; 2],
    /// Learning rate of the logarithm of how far a node reaches.
    pub reach: f32,
    /// Learning rate of when a body appears and vanishes, seconds.
    pub gate: f32,
    /// Weight of the squared change of places between neighbouring nodes, in extents (as rigid as possible).
    pub rigid: f32,
    /// Weight of the squared shift of nodes, in extents.
    pub away: f32,
    /// Weight of the squared sine of half the turn between neighbouring nodes.
    pub alike: f32,
    /// Weight of the squared third differences of places, in extents: of bodies, of nodes.
    pub smooth_path: [f32; 2],
    /// Weight of the squared third differences of turns: of bodies, of nodes.
    pub smooth_turn: [f32; 2],
    /// Iterations of each of the two short trainings that tell which bodies carry Gaussians, a quarter of the fine stage at most; 0: all
    /// bodies do.
    pub trial: u32,
    /// Bodies that carry none: what lies on them is free in time. A trial is made where none is named, here or as one that bends.
    pub free: Vec<String>,
    /// Bodies that bend: they are followed from the instant at which they were seen best, and their nodes may go where they are seen to go.
    pub bend: Vec<String>,
    /// So many RGB intervals a piece of such a body is there for: each starts with what was seen of it at an instant of its own. 0: it is one
    /// piece.
    pub piece: f32,
    /// What `rigid` and `away` are multiplied by for the nodes of these.
    pub loose: f32,
    /// Learning rate of the places of their nodes, extents of the scene: first, last.
    pub bend_path: [f32; 2],
    /// Learning rate of the turns of their nodes: first, last.
    pub bend_turn: [f32; 2],
}

impl Default for BodiesOptions {
    fn default() -> Self {
        Self {
            knots: 3.0,
            nodes: 128,
            nodes_from: 0.1,
            follow: 0.4,
            exposure: 4,
            spacing_px: 2.5,
            opacity: 0.57,
            path: [1e-3, 8e-5],
            turn: [5e-3, 3e-4],
            node_path: [4e-4, 4e-5],
            node_turn: [2e-3, 2e-4],
            reach: 5e-3,
            gate: 5e-4,
            rigid: 90.0,
            away: 2.0,
            alike: 0.03,
            smooth_path: [0.3, 1.2],
            smooth_turn: [0.005, 0.02],
            trial: 120,
            free: Vec::new(),
            bend: Vec::new(),
            piece: 3.0,
            loose: 0.005,
            bend_path: [2e-3, 5e-4],
            bend_turn: [5e-3, 2e-3],
        }
    }
}

/// More nodes have never been of use; each row names four of them in numbers that single precision holds.
pub const MOST_NODES: u32 = 1 << 12;
