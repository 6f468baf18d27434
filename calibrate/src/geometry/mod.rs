//! Geometry that stands before any adjustment: first guesses from what was seen.

pub mod homography;
