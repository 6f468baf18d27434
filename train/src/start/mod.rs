//! How motion begins: from points that are known to move, and from the bodies of a dataset.

pub mod birth;
mod bodies;
mod pieces;
mod rest;
mod shutter;
mod thin;

pub use self::pieces::{Piece, pieces};
pub use bodies::{Recording, from_bodies};
pub(crate) use bodies::{SURE, agreement, silhouettes_agree};
pub use rest::unexplained;
pub use thin::thin;
