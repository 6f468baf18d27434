//! What moves as bodies: Gaussians that live for the whole recording in the frame of a thing, whose path all of them share.
//!
//! A body is a cubic B-spline of poses; the nodes on its surface are splines of small poses in its frame, so that it need not be
//! rigid. A Gaussian at x in the frame of body b hangs on the four nodes k that were nearest when it was born, by weights w that
//! fall with the distance from their rests n:
//!
//! ```text
//! w_k = softmax(-|x - n_k|^2 / 2 r_k^2)         y = sum_k w_k (R_k(t) (x - n_k) + n_k + u_k(t))
//! mean(t) = R_b(t) y + p_b(t)                   turn(t) = q_b(t) (sum_k w_k q_k(t) / |..|) q
//! ```
//!
//! A body that is not in view for the whole recording appears and vanishes by a product of two sigmoids in time. Gaussians of no body
//! are free in time ([`super::free_time`]): a row holds what either needs. The definition in double precision is
//! [`crate::reference::bodies`].

mod carry_on;
mod device;
mod index;
mod options;
pub mod spline;
mod start;
#[cfg(test)]
mod tests;

pub use device::{Bodies, SOFTNESS};
pub use options::{BodiesOptions, MOST_NODES};
pub use start::{CODES, EXTRA_FLOATS, LOOSE, NEIGHBOURS, NEVER, NO_NODE, Start};
