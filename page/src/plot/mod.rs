//! Plots as inline SVG.

mod intervals;
mod lines;
mod scale;

pub use intervals::{Interval, Intervals};
pub use lines::{COLOURS, Plot, Series, legend, swatch};
