//! Plain `f64` twins of the kernels of learning: the definitions that those are tested against. Those of the model and its renderer
//! are in [`erfgs_splat::reference`].

pub mod counts;
pub mod losses;
