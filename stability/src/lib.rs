//! What stiff and extreme cases come to: a suite over the numerical parts of the program.
//!
//! A [`Case`] does something real at the edge of what may be asked for, and knows beforehand what must come of it: a largest error
//! against a truth that the part under test has no share in (a twin in `f64`, a formula, the same scene scaled back), or a
//! refusal that names what is wrong. What was measured, and whether that is so, is a [`Row`]; [`report`] writes all of them as a
//! document.
//!
//! | module | what is taken to its edges | truth |
//! |---|---|---|
//! | [`sensor`] | the event simulator | a pixel in `f64` ([`pixel`]) |
//! | [`raster`] | the rasteriser | its `f64` twin |
//! | [`placing`] | scenes of other sizes and elsewhere | the same scene in its place |
//! | [`motion`] | lives and velocities | the `f64` twin of the motion |
//! | [`bodies`] | paths, nodes and gates of bodies | their `f64` twin, and exact rotations |
//! | [`clocks`] | fits of clocks | the clock that the samples were drawn from |
//! | [`training`] | whole trainings | a scene that is filmed exactly ([`filmed`]) |

pub mod bodies;
mod case;
pub mod clocks;
pub mod cloud;
pub mod filmed;
pub mod motion;
pub mod pixel;
pub mod placing;
pub mod raster;
pub mod report;
pub mod sensor;
pub mod training;

pub use case::{Bench, Bound, Case, Expected, Measured, Refusal, Row, Size, Verdict};

/// All cases of a size, in the order of the document.
#[must_use]
pub fn cases(size: Size) -> Vec<Case> {
    [
        sensor::cases(size),
        raster::cases(size),
        placing::cases(size),
        motion::cases(size),
        bodies::cases(size),
        clocks::cases(size),
        training::cases(size),
    ]
    .concat()
}

/// What the cases of a part are compared with.
pub(crate) fn truth(part: &str) -> &'static str {
    let all =
        [sensor::ABOUT, raster::ABOUT, placing::ABOUT, motion::ABOUT, bodies::ABOUT, clocks::ABOUT, training::ABOUT];
    all.into_iter().find(|[name, _]| *name == part).map_or("", |[_, truth]| truth)
}
