//! Both shapes of every kernel against the `f64` twin in `reference::raster`.

mod extremes;
mod gradients;
mod images;
mod scenes;
