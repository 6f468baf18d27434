//! Emulated devices, and the stage that they film.
