//! What happens at which iteration.
