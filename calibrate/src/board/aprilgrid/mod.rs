//! AprilGrids: tags of the family 36h11 with a black square at each of their corners, as Kalibr prints them.
//!
//! The squares make every corner of a tag a place where two edges cross, as on a chessboard. So the features that find
//! chessboards find these corners too; four of them that edges join are a tag if what lies between reads as one
//! (`quads.rs`, `tag.rs`). Tags that contradict their neighbours are left out, and corners whose tag could not be read, because
//! something hides it or it leaves the picture, are looked for where their neighbours say (`grid.rs`).
//!
//! No detector from outside is used: those that there are (`aprilgrid`, `kornia-apriltag`) bring in a library of linear algebra
//! and one of images, some fifty crates that take minutes to build. The dictionary comes with the ChArUco detector.

mod grid;
mod quads;
mod tag;

use glam::DVec2;

use super::{
    Corner, Target,
    detect::{Grey, to_ours},
    features::features,
};
pub(super) use grid::without_strays;
pub(super) use tag::{BITS, BORDER, TAG_FAMILY, is_black};

/// A place where two edges cross.
#[derive(Clone, Copy, Debug)]
struct Saddle {
    at: DVec2,
    /// Unit vectors along the edges.
    axes: [DVec2; 2],
}

/// The corners of the grid in a picture, to a pixel or so.
pub(super) fn aprilgrid(grey: &Grey, target: &Target) -> Vec<Corner> {
    let numbers = target.numbers();
    let saddles: Vec<Saddle> = features(grey, 0.0)
        .into_iter()
        .map(|corner| Saddle {
            at: to_ours(corner.position.x, corner.position.y),
            axes: corner.axes.map(|axis| DVec2::from_angle(f64::from(axis.angle))),
        })
        .filter(|saddle| saddle.at.is_finite() && saddle.axes.iter().all(|axis| axis.is_finite()))
        .collect();
    let tags: Vec<tag::Tag> = quads::quads(&saddles)
        .into_iter()
        .filter_map(|quad| tag::read(grey, quad.map(|index| saddles[index].at), &numbers))
        .collect();
    let tags = grid::consistent(tags, target);
    grid::complete(grey, &tags, &saddles, target)
}
