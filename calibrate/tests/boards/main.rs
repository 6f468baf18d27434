//! Boards in real pictures: OpenCV's chessboards, side by side with OpenCV, and a rig of four webcams.

mod chessboards;
mod session;
mod webcams;
