//! Geometry that stands before any adjustment: first guesses from what was seen, alignment of points, triangulation, and
//! what is tied to what.

mod align;
mod forest;
pub mod homography;
pub mod resection;
mod triangulate;

pub use align::{Similarity, rigid, similarity};
pub use forest::Forest;
pub use triangulate::{Ray, nearest_point, triangulate};
