//! Importers: recordings in the layouts of other tools, made into datasets.
//!
//! Every importer does the same in its own layout: it lists viewpoints with intrinsics, pose and frames, checks them
//! (counts, missing files, rotations, sizes), and hands them to one writer, which resizes, writes PNG files in parallel,
//! hashes them and puts the whole dataset in place in one step: `out` appears complete or not at all.
//!
//! The first imported frame lies at time 0 of the session clock, and so does its exposure: a recording does not tell
//! how long its shutters were open.

use std::path::Path;

use crate::Dataset;
use erfgs_base::progress::Progress;
use erfgs_scene::image::{Reading, Resample};

pub mod colmap;
mod common;
mod error;
pub mod nerfstudio;
pub mod neu3d;
pub mod nvidia;
pub mod panoptic;
pub mod session;
mod stamps;
mod write;

pub use common::frames as pictures;
pub use error::ImportError;

/// How a recording is imported. The defaults import all of it, unscaled.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// First and last frame, both included; numbers as in the source's file names (Panoptic) or counted from 0.
    pub frames: Option<(u64, u64)>,
    /// Size of the imported images, as a fraction of the source's; 1 where absent.
    pub scale: Option<f64>,
    /// How images are resized.
    pub resample: Resample,
    /// Frames a second, where the source does not say or is to be overruled.
    pub fps: Option<f64>,
    /// What is said of images that are transparent, or whose samples have 16 bits of which not all count.
    pub reading: Reading,
    /// Names of the test cameras (as imported, or their numbers); the layout's own choice where absent.
    pub test_cameras: Option<Vec<String>>,
    /// Threads to work with; one for each core where absent.
    pub jobs: Option<usize>,
}

/// The layouts that can be imported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// PanopticSports as Dynamic 3D Gaussians packages it.
    Panoptic,
    /// Neural 3D Video: `camNN.mp4` and `poses_bounds.npy`.
    Neu3d,
    /// Nvidia dynamic scenes: `mv_images` and `poses_bounds.npy`.
    Nvidia,
    /// `transforms.json`.
    Nerfstudio,
    /// A COLMAP model and image folders.
    Colmap,
}

/// The dataset, and what was left out or should be known.
#[derive(Debug)]
pub struct Imported {
    /// The dataset.
    pub dataset: Dataset,
    /// Sentences.
    pub notes: Vec<String>,
}

/// Imports the recording in `source`, which has the layout `layout`, into a new dataset in the folder `out`.
///
/// # Errors
/// If the source is incomplete or malformed, or the dataset cannot be written.
pub fn import(
    layout: Layout,
    source: &Path,
    options: &ImportOptions,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Imported, ImportError> {
    match layout {
        Layout::Panoptic => panoptic::import(source, options, out, progress),
        Layout::Neu3d => neu3d::import(source, options, out, progress),
        Layout::Nvidia => nvidia::import(source, options, out, progress),
        Layout::Nerfstudio => nerfstudio::import(source, options, out, progress),
        Layout::Colmap => colmap::import(source, options, out, progress),
    }
}
