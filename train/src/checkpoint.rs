//! Checkpoints: everything that a run needs to go on as if it had not stopped.
//!
//! A file is a [`erfgs_splat::container`]. It is written beside its name and moved there, so that a file under that name is always
//! whole.

use std::{io, path::Path, path::PathBuf};

use serde::{Deserialize, Serialize};

use crate::{
    cameras::{CameraState, Quantity, clock::CameraTimeState, colour::CameraColourState, pose::CameraPoseState},
    config::Config,
    density::{Moments, Population, ScreenStatistics},
    schedule::Clock,
};
use erfgs_run::{LeftOut, RunError, write_atomically};
use erfgs_splat::{
    container::{self, Container},
    field::FieldState,
    gaussians::{CORE, Gaussians, sh_stride},
    trained::Record,
};

/// The version that is written: a file holds what drawing takes. Earlier programs wrote [`LOGGED`] where a run was stopped between two
/// rows of its curve; otherwise [`STATIC`] where some Gaussians are a static set, [`TIMES`] where clocks of cameras are learned,
/// [`POSES`] where their poses are, [`LEVELS`] where levels of event cameras' pixels are learned, [`COLOURS`] where colours of cameras
/// are, [`ROWS`] where the motion model keeps rows for each Gaussian, and else [`PLAIN`]. The first that applies counts.
const VERSION: u32 = 9;
const LOGGED: u32 = 8;
const STATIC: u32 = 7;
const TIMES: u32 = 6;
const POSES: u32 = 5;
const LEVELS: u32 = 4;
const COLOURS: u32 = 3;
const ROWS: u32 = 2;
const PLAIN: u32 = 1;

/// Names of vectors.
const LOSSES: &str = "losses";
const POINTS: &str = "points";

/// Why a checkpoint could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file could not be read.
    #[error("could not read checkpoint '{path}': {source}; check the path, or move it away to train anew")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is damaged or of another kind.
    #[error("'{path}' is not a whole checkpoint: {reason}; move it away to train anew")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The file is whole, and holds a number that no training leaves behind.
    #[error(
        "checkpoint '{path}' cannot be used: number {index} of its '{vector}' is {value}; take an earlier copy of it, or move it away \
         to train anew"
    )]
    Implausible {
        /// The file.
        path: PathBuf,
        /// Which vector.
        vector: String,
        /// Which of its numbers, from 0.
        index: usize,
        /// What it is.
        value: f32,
    },
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] RunError),
    /// The header could not be written.
    #[error("could not write a checkpoint's header: {0}")]
    Header(#[from] serde_json::Error),
}

/// The state of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Its configuration.
    pub config: Config,
    /// Where it stands.
    pub clock: Clock,
    /// Adam steps since the moments were zero.
    pub step: u32,
    /// Gaussians and moments.
    pub population: Population,
    /// How many of the Gaussians, to the last, are a static set, which is not learned.
    pub fixed: usize,
    /// The field's box, metres.
    pub field_box: [[f32; 3]; 2],
    /// The field, in the fine stage.
    pub field: Option<FieldState>,
    /// ScreenStatistics of density control.
    pub statistics: Vec<ScreenStatistics>,
    /// How the cameras show colours, where that is learned.
    pub camera_colours: Option<CameraColourState>,
    /// What the cameras' poses have learned, where that is.
    pub camera_poses: Option<CameraPoseState>,
    /// What the cameras' clocks have learned, where that is.
    pub camera_times: Option<CameraTimeState>,
    /// What is known of the levels of each event camera's pixels, where that is learned ([`crate::losses::Levels::read`]).
    pub levels: Vec<Vec<f32>>,
    /// What the losses came to since the last row of the curve, where they did.
    pub loss_sums: Option<LossSums>,
    /// What the run leaves out.
    pub left_out: Vec<LeftOut>,
    /// The recording, and how the Gaussians are drawn; nothing where a version of before has saved it.
    pub record: Option<Record>,
    /// The places of the initial cloud, with a record.
    pub points: Vec<[f32; 3]>,
}

/// Sums of losses that the next row of the curve is a mean over.
#[derive(Clone, Debug, PartialEq)]
pub struct LossSums {
    /// Sums and numbers of samples that are kept on the host, as [`crate::trainer`] has them.
    pub counts: [f64; 7],
    /// What each thread of the device has added: photometric, event and colour loss.
    pub partial: [Vec<f32>; 3],
}

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    config: Config,
    clock: Clock,
    step: u32,
    sh_degree: u32,
    dynamic: usize,
    #[serde(default, skip_serializing_if = "is_none")]
    fixed: usize,
    #[serde(default)]
    motion_floats: usize,
    field_box: [[f32; 3]; 2],
    field_step: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    camera_colour_steps: Option<Vec<u32>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    camera_pose_steps: Option<Vec<u32>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    camera_time_steps: Option<Vec<u32>>,
    #[serde(default, skip_serializing_if = "is_none")]
    event_cameras: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    loss_counts: Option<[f64; 7]>,
    left_out: Vec<LeftOut>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    record: Option<Record>,
    vectors: Vec<(String, usize)>,
}

/// What is learned of all cameras, where they took steps.
fn of_cameras<Q: Quantity>(
    steps: Option<Vec<u32>>,
    next: impl FnMut(&str) -> Result<Vec<f32>, String>,
) -> Result<Option<CameraState<Q>>, String> {
    steps.map(|steps| CameraState::from_vectors(steps, next)).transpose()
}

fn is_none(count: &usize) -> bool {
    *count == 0
}

impl Checkpoint {
    /// Writes the checkpoint.
    ///
    /// # Errors
    /// [`CheckpointError::Write`].
    pub fn save(&self, path: &Path) -> Result<(), CheckpointError> {
        Ok(write_atomically(path, &self.to_bytes()?)?)
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`CheckpointError::Read`], [`CheckpointError::Damaged`] and [`CheckpointError::Implausible`].
    pub fn load(path: &Path) -> Result<Self, CheckpointError> {
        let bytes = std::fs::read(path).map_err(|source| CheckpointError::Read { path: path.into(), source })?;
        let read = Self::from_bytes(&bytes).map_err(|reason| CheckpointError::Damaged { path: path.into(), reason })?;
        match read.implausible() {
            None => Ok(read),
            Some((vector, index, value)) => {
                Err(CheckpointError::Implausible { path: path.into(), vector, index, value })
            }
        }
    }

    /// The first number that no training leaves behind, if there is one: its vector, its place and itself.
    fn implausible(&self) -> Option<(String, usize, f32)> {
        let statistics = self.statistics_floats();
        let corners = self.field_box.as_flattened();
        let vectors = self.vectors(&statistics).into_iter().chain([("field box".into(), corners)]);
        vectors.into_iter().find_map(|(name, values)| {
            let (index, value) = container::implausible(&name, values)?;
            Some((name, index, value))
        })
    }

    fn statistics_floats(&self) -> Vec<f32> {
        self.statistics
            .iter()
            .flat_map(|statistics| [statistics.gradient, statistics.iterations, statistics.radius_px])
            .collect()
    }

    /// All vectors by their names, in the order of the file; `statistics` are those of density control as numbers.
    fn vectors<'a>(&'a self, statistics: &'a [f32]) -> Vec<(String, &'a [f32])> {
        let Population { gaussians, moments } = &self.population;
        let mut vectors: Vec<(String, &[f32])> = vec![
            ("core".into(), &gaussians.core),
            ("sh".into(), &gaussians.sh),
            ("core.m".into(), &moments.core_first),
            ("core.v".into(), &moments.core_second),
            ("sh.m".into(), &moments.sh_first),
            ("sh.v".into(), &moments.sh_second),
            ("seen".into(), statistics),
        ];
        if gaussians.motion_floats > 0 {
            vectors.extend([
                ("motion".into(), &gaussians.motion[..]),
                ("motion.m".into(), &moments.motion_first),
                ("motion.v".into(), &moments.motion_second),
            ]);
        }
        vectors.extend(self.camera_colours.iter().flat_map(|colours| colours.vectors()));
        vectors.extend(self.camera_poses.iter().flat_map(|poses| poses.vectors()));
        vectors.extend(self.camera_times.iter().flat_map(|times| times.vectors()));
        vectors.extend(self.levels.iter().map(|levels| ("levels".into(), &levels[..])));
        if let Some(sums) = &self.loss_sums {
            vectors.extend(sums.partial.iter().map(|partial| (LOSSES.into(), &partial[..])));
        }
        if self.record.is_some() {
            vectors.push((POINTS.into(), self.points.as_flattened()));
        }
        if let Some(field) = &self.field {
            vectors.extend(field.vectors.iter().map(|vector| (vector.name.clone(), &vector.values[..])));
        }
        vectors
    }

    fn to_bytes(&self) -> Result<Vec<u8>, CheckpointError> {
        let gaussians = &self.population.gaussians;
        let statistics = self.statistics_floats();
        let vectors = self.vectors(&statistics);
        let header = serde_json::to_vec(&Header {
            version: if self.record.is_some() {
                VERSION
            } else if self.loss_sums.is_some() {
                LOGGED
            } else if self.fixed > 0 {
                STATIC
            } else if self.camera_times.is_some() {
                TIMES
            } else if self.camera_poses.is_some() {
                POSES
            } else if !self.levels.is_empty() {
                LEVELS
            } else if self.camera_colours.is_some() {
                COLOURS
            } else if gaussians.motion_floats > 0 {
                ROWS
            } else {
                PLAIN
            },
            config: self.config.clone(),
            clock: self.clock,
            step: self.step,
            sh_degree: gaussians.sh_degree,
            dynamic: gaussians.dynamic,
            fixed: self.fixed,
            motion_floats: gaussians.motion_floats,
            field_box: self.field_box,
            field_step: self.field.as_ref().map(|field| field.step),
            camera_colour_steps: self.camera_colours.as_ref().map(|colours| colours.steps.clone()),
            camera_pose_steps: self.camera_poses.as_ref().map(|poses| poses.steps.clone()),
            camera_time_steps: self.camera_times.as_ref().map(|times| times.steps.clone()),
            event_cameras: self.levels.len(),
            loss_counts: self.loss_sums.as_ref().map(|sums| sums.counts),
            left_out: self.left_out.clone(),
            record: self.record.clone(),
            vectors: vectors.iter().map(|(name, values)| (name.clone(), values.len())).collect(),
        })?;
        Ok(container::to_bytes(&header, &vectors))
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        let container = Container::open(bytes)?;
        let header: Header =
            serde_json::from_slice(container.header).map_err(|error| format!("its header: {error}"))?;
        if !(PLAIN..=VERSION).contains(&header.version) {
            let known = format!("versions {PLAIN} to {VERSION}");
            return Err(format!("it is of version {}, this program reads {known}", header.version));
        }
        header.config.validate().map_err(|error| error.to_string())?;
        let mut vectors = container.vectors(header.vectors)?.into_iter();
        let mut next = |name: &str| match vectors.next() {
            Some(vector) if vector.name == name => Ok(vector.values),
            _ => Err(format!("'{name}' is missing")),
        };
        let mut gaussians = Gaussians {
            sh_degree: header.sh_degree,
            dynamic: header.dynamic,
            core: next("core")?,
            sh: next("sh")?,
            motion_floats: header.motion_floats,
            motion: Vec::new(),
        };
        let mut moments = Moments {
            core_first: next("core.m")?,
            core_second: next("core.v")?,
            sh_first: next("sh.m")?,
            sh_second: next("sh.v")?,
            ..Moments::default()
        };
        let statistics: Vec<ScreenStatistics> = next("seen")?
            .as_chunks::<3>()
            .0
            .iter()
            .map(|row| ScreenStatistics { gradient: row[0], iterations: row[1], radius_px: row[2] })
            .collect();
        if header.motion_floats > 0 {
            gaussians.motion = next("motion")?;
            (moments.motion_first, moments.motion_second) = (next("motion.m")?, next("motion.v")?);
        }
        let camera_colours = of_cameras(header.camera_colour_steps, &mut next)?;
        let camera_poses = of_cameras(header.camera_pose_steps, &mut next)?;
        let camera_times = of_cameras(header.camera_time_steps, &mut next)?;
        let mut levels = Vec::new();
        for _ in 0..header.event_cameras {
            levels.push(next("levels")?);
        }
        let loss_sums = match header.loss_counts {
            None => None,
            Some(counts) => Some(LossSums { counts, partial: [next(LOSSES)?, next(LOSSES)?, next(LOSSES)?] }),
        };
        let points = if header.record.is_some() { next(POINTS)? } else { Vec::new() };
        let (points, []) = points.as_chunks::<3>() else { return Err("its points are not whole".into()) };
        let points = points.to_vec();
        let count = gaussians.len();
        let motion = header.dynamic.checked_mul(header.motion_floats);
        let sh = if header.sh_degree <= 3 { count * sh_stride(header.sh_degree) } else { usize::MAX };
        let core = count * CORE;
        let fits = [&gaussians.core, &moments.core_first, &moments.core_second].iter().all(|v| v.len() == core)
            && [&gaussians.sh, &moments.sh_first, &moments.sh_second].iter().all(|v| v.len() == sh)
            && [&gaussians.motion, &moments.motion_first, &moments.motion_second]
                .iter()
                .all(|v| Some(v.len()) == motion)
            && statistics.len() == count
            && header.dynamic <= count
            && header.fixed <= count - header.dynamic;
        if !fits {
            return Err("its vectors are of different lengths".into());
        }
        let field = header.field_step.map(|step| FieldState { step, vectors: vectors.collect() });
        Ok(Self {
            config: header.config,
            clock: header.clock,
            step: header.step,
            population: Population { gaussians, moments },
            fixed: header.fixed,
            field_box: header.field_box,
            field,
            statistics,
            camera_colours,
            camera_poses,
            camera_times,
            levels,
            loss_sums,
            left_out: header.left_out,
            record: header.record,
            points,
        })
    }
}

#[cfg(test)]
mod tests;
