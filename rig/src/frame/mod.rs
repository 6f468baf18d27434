//! RGB cameras: nokhwa as the portable path, V4L2 on Linux as the precise one.
