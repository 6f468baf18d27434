//! USB transport: control and bulk transfers, and a stream of asynchronous ones.
