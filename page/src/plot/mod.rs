//! Plots as inline SVG.

mod intervals;
mod lines;
mod scale;
mod tradeoff;

pub use intervals::{Interval, Intervals};
pub use lines::{COLOURS, Plot, Series, legend, swatch};
pub use tradeoff::{Setting, Tradeoff};
