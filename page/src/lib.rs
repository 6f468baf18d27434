//! Pages of results: HTML that is one file, with plots as inline SVG. What the reports of the stages have in common.

#[cfg(feature = "serve")]
pub mod access;
#[cfg(feature = "serve")]
pub mod background;
pub mod html;
pub mod picture;
pub mod plot;
#[cfg(feature = "serve")]
pub mod serve;
