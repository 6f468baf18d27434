//! Recorded sessions as live streams, the event simulator, and the dataset variants.
