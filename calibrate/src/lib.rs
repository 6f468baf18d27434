//! Registers every viewpoint in one frame, and makes the initial point cloud.
