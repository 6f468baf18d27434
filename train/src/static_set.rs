//! What stands still in all windows of a long take, learned once.
//!
//! One window is trained as any dataset is. The others take over from it what stands still, where its cameras were found to stand and how
//! they show colours: those Gaussians are drawn and no longer learned, so that nothing jumps from one window to the next and only what moves
//! is trained. What a window shows otherwise - a chair that was moved meanwhile, the wall that somebody had stood before - is found by its
//! frames and learned anew ([`crate::trainer::Trainer::within`]).

use std::path::PathBuf;

use erfgs_run::{RunError, RunFolder};
use sha2::{Digest, Sha256};

use crate::{
    cameras::{CameraState, Quantity, colour::CameraColourState, pose::CameraPoseState},
    checkpoint::{Checkpoint, CheckpointError},
    schedule::Stage,
};
use erfgs_splat::gaussians::Gaussians;

/// Why a run gives no static set.
#[derive(Debug, thiserror::Error)]
pub enum StaticSetError {
    /// There is no run, or it is damaged.
    #[error(transparent)]
    Run(#[from] RunError),
    /// So is its checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// It is still in its first stage.
    #[error(
        "run {run} does not yet separate moving from static Gaussians; train it to its end first: erfgs train ... --out {run} --resume"
    )]
    Unfinished {
        /// The run.
        run: PathBuf,
    },
    /// All of it moves.
    #[error(
        "run {run} has no static Gaussians: all of them move, or a field moves them; train it with --motion free-time"
    )]
    Nothing {
        /// The run.
        run: PathBuf,
    },
}

/// Gaussians that stand still, and the cameras as they were found with them.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticSet {
    /// The Gaussians; none is dynamic.
    pub gaussians: Gaussians,
    cameras: Vec<String>,
    colours: Option<CameraColourState>,
    poses: Option<CameraPoseState>,
}

impl StaticSet {
    /// That of a run.
    ///
    /// # Errors
    /// [`StaticSetError`] where the run cannot be read, or has none.
    pub fn open(run: &RunFolder) -> Result<Self, StaticSetError> {
        let cameras = run.read_dataset()?.cameras.into_iter().map(|camera| camera.name).collect();
        let root = run.root().to_owned();
        let checkpoint = Checkpoint::load(&run.checkpoint_file())?;
        if checkpoint.clock.stage == Stage::Coarse {
            return Err(StaticSetError::Unfinished { run: root });
        }
        let learned = &checkpoint.population.gaussians;
        let still: Vec<usize> = (learned.dynamic..learned.len()).collect();
        if still.is_empty() {
            return Err(StaticSetError::Nothing { run: root });
        }
        let gaussians = Gaussians { motion_floats: 0, ..learned.select(&still, 0) };
        let (colours, poses) = (checkpoint.camera_colours, checkpoint.camera_poses);
        Ok(Self { gaussians, cameras, colours, poses })
    }

    /// What tells it from others: the SHA-256 of all that is taken over.
    #[must_use]
    pub fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        let mut add = |values: &[f32]| values.iter().for_each(|value| hash.update(value.to_le_bytes()));
        add(&self.gaussians.core);
        add(&self.gaussians.sh);
        self.colours.iter().for_each(|colours| add(&colours.values));
        self.poses.iter().for_each(|poses| add(&poses.values));
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// How these cameras show colours, by their names; nothing where that was not learned.
    pub(crate) fn colours(&self, cameras: &[&str], takes_frames: &[bool]) -> Option<CameraColourState> {
        let found = self.colours.as_ref()?;
        let mut state = CameraColourState::neutral(takes_frames);
        self.copy(cameras, found, &mut state);
        Some(state)
    }

    /// Where these cameras were found to stand, by their names; nothing where that was not learned.
    pub(crate) fn poses(&self, cameras: &[&str]) -> Option<CameraPoseState> {
        let found = self.poses.as_ref()?;
        let mut state = CameraPoseState::calibrated(cameras.len());
        self.copy(cameras, found, &mut state);
        Some(state)
    }

    /// Copies what is known of those of `cameras` that this knows.
    fn copy<Q: Quantity>(&self, cameras: &[&str], found: &CameraState<Q>, to: &mut CameraState<Q>) {
        for (camera, name) in cameras.iter().enumerate() {
            if let Some(own) = self.cameras.iter().position(|own| own == name) {
                to.row_mut(camera).copy_from_slice(found.row(own));
            }
        }
    }
}
