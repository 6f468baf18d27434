//! What any bytes are given to: a file for each target, with a function of the same name, which panics where something
//! does not hold.

mod aedat2;
mod aedat4;
mod blosc;
mod container;
mod csv;
mod dat;
mod davis;
mod ecf;
mod es;
mod evt2;
mod evt21;
mod evt3;
mod frames;
#[cfg(target_os = "linux")]
mod gencp;
mod headers;
mod npy;
mod npz;
mod repair;
#[cfg(target_os = "linux")]
mod u3vcamera;
#[cfg(target_os = "linux")]
mod u3vstream;

pub use aedat2::aedat2;
pub use aedat4::aedat4;
pub use blosc::blosc;
pub use container::container;
pub use csv::csv;
pub use dat::dat;
pub use davis::davis;
pub use ecf::ecf;
pub use es::es;
pub use evt2::evt2;
pub use evt3::evt3;
pub use evt21::evt21;
pub use frames::frames;
#[cfg(target_os = "linux")]
pub use gencp::gencp;
pub use headers::headers;
pub use npy::npy;
pub use npz::npz;
pub use repair::repair;
#[cfg(target_os = "linux")]
pub use u3vcamera::u3vcamera;
#[cfg(target_os = "linux")]
pub use u3vstream::u3vstream;

/// A target: what checks one input, by panicking.
pub type Target = fn(&[u8]);

/// All targets by name.
pub const TARGETS: &[(&str, Target)] = &[
    ("evt2", evt2),
    ("evt21", evt21),
    ("evt3", evt3),
    ("dat", dat),
    ("aedat2", aedat2),
    ("aedat4", aedat4),
    ("davis", davis),
    ("csv", csv),
    ("es", es),
    ("headers", headers),
    ("npy", npy),
    ("npz", npz),
    ("container", container),
    ("repair", repair),
    ("ecf", ecf),
    ("blosc", blosc),
    ("frames", frames),
    #[cfg(target_os = "linux")]
    ("gencp", gencp),
    #[cfg(target_os = "linux")]
    ("u3vstream", u3vstream),
    #[cfg(target_os = "linux")]
    ("u3vcamera", u3vcamera),
];

/// The target of this name.
#[must_use]
pub fn target(name: &str) -> Option<Target> {
    TARGETS.iter().find(|(known, _)| *known == name).map(|&(_, target)| target)
}
