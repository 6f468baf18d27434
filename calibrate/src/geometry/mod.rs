//! Geometry that stands before any adjustment: first guesses from what was seen, alignment of points, triangulation,
//! epipolar lines, and what is tied to what.

mod align;
mod epipolar;
mod forest;
mod hand_eye;
pub mod homography;
pub mod resection;
mod triangulate;

pub use align::{Similarity, angle, rigid, similarity};
pub use epipolar::EpipolarCurve;
pub use forest::Forest;
pub use hand_eye::hand_eye;
pub use triangulate::{Ray, nearest_point, triangulate};
