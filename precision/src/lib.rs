//! Work-precision diagrams: the error of numerical components against the processor time that it takes, over its own knobs.
//!
//! A [`Component`] is run with each of its settings against a truth that is finer than any of them: a formula, double precision,
//! or a much smaller step. A [`Curve`] is what one knob does while the others stay where they are; the setting that the program
//! has by default is marked on it. [`report`] writes the curves as a table of numbers, a document and a page, and says where a
//! default is beaten by another setting of the same knob.
//!
//! | module | component | truth |
//! |---|---|---|
//! | [`raster`] | the rasteriser | every Gaussian at every pixel in `f64`, with no rule that leaves any out |
//! | [`sensor`] | the event simulator | the stage's intensity at a much smaller step, through a pixel in `f64` |
//! | [`clocks`] | the fit of a clock | the clock that the samples were drawn from |
//! | [`bundle`] | bundle adjustment | the rig that its observations were projected with |
//! | [`points`] | the initial points | the stage's own depth |
//! | [`training`] | trainings, their motion and their field | what held-out cameras see of the stage |

pub mod bundle;
pub mod clocks;
mod component;
mod exact;
mod filmed;
mod kept;
mod matching;
pub mod points;
pub mod raster;
pub mod report;
pub mod sensor;
mod stopwatch;
pub mod training;

use std::sync::Arc;

pub use component::{Component, Curve, Measure, Outcome, Place, Result, Spent, Study};
pub use erfgs_stability::{Bench, Refusal, Size};
pub use kept::Kept;
pub use stopwatch::Stopwatch;

/// All components of a size, in the order of the document.
#[must_use]
pub fn components(size: Size) -> Vec<Component> {
    let filmed = Arc::new(filmed::Filmed::to_train_on(size));
    vec![
        raster::component(size),
        sensor::component(size),
        clocks::component(size),
        bundle::component(size),
        points::component(size),
        training::component(size, &filmed),
        training::motion(size, &filmed),
        training::field(size, &filmed),
    ]
}
