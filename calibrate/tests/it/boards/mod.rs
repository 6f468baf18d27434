//! Boards in real pictures: OpenCV's chessboards, side by side with OpenCV, and a rig of four webcams; and in pictures of a
//! camera that is known (`scene.rs`).

mod aprilgrids;
mod blink;
mod chessboards;
mod clear;
mod coverage;
mod doubt;
mod focal;
mod moving;
mod oblique;
mod offsets;
mod print;
mod quick;
mod report;
mod scene;
mod session;
mod two_sides;
mod webcams;
