//! Boards, wands, images and dark ramps: real ones where there are recordings, side by side with the programs of others, and
//! simulated ones whose truth is known.

mod boards;
mod bundle;
mod halves;
mod panoptic;
mod register;
#[path = "../../points/tests/it/common.rs"]
#[allow(dead_code, reason = "shared with the tests of the initial points, which use more of it")]
mod room;
mod sfm;
mod wand;
