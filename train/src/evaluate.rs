//! Evaluation on held-out cameras.
