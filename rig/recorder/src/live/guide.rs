//! What somebody who knows more than the page, such as a calibration that runs beside the recording, adds to it.

use erfgs_session::source::Packet;
use serde::{Deserialize, Serialize};

/// What the page shows over and below one camera's preview. Places are shares of the image's width and height, from 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Guidance {
    /// The stream.
    pub id: String,
    /// What the camera sees now: marked points.
    pub points: Vec<[f32; 2]>,
    /// Columns of the grid of `coverage`.
    pub columns: usize,
    /// How much there is of each cell of a grid over the image, row by row.
    pub coverage: Vec<u32>,
    /// Figures by name, in the order in which they are shown.
    pub figures: Vec<(String, String)>,
    /// What to do next; empty for nothing.
    pub advice: String,
    /// Whether there is nothing left to do.
    pub done: bool,
}

/// Looks at packets as they pass and tells the page what it makes of them.
pub trait Guide: Send + Sync {
    /// A packet of the `stream`-th stream; must return at once.
    fn packet(&self, stream: usize, packet: &Packet);

    /// What there is to show, for the streams that it is about.
    fn guidance(&self) -> Vec<Guidance>;
}
