//! What a run has learned, drawn from its folder alone.

mod error;
mod record;

use std::path::Path;

use serde::Deserialize;

pub use self::{
    error::TrainedError,
    record::{Drawing, Record, RecordedCamera, RecordedEvents, low_pass},
};
use crate::{
    container::{Container, implausible},
    field::{FieldState, NamedVector},
    gaussians::{CORE, Gaussians, sh_stride},
    gpu::Gpu,
    model::{Model, ModelError, Rendered, Rendering},
    motion::MotionPlan,
    raster::View,
};

/// The file of a run that holds what it learned.
pub const CHECKPOINT: &str = "checkpoint.bin";

/// What a run has learned, on the host.
#[derive(Clone, Debug, PartialEq)]
pub struct Reconstruction {
    /// The recording, and how the Gaussians are drawn.
    pub record: Record,
    /// The Gaussians.
    pub gaussians: Gaussians,
    /// What all of them share of the motion.
    pub shared: Option<FieldState>,
    /// The cloud that the training began with: it tells how near to a camera there is something to see.
    pub points: Vec<[f32; 3]>,
}

/// As much of the header of a checkpoint as drawing takes.
#[derive(Deserialize)]
struct Header {
    sh_degree: u32,
    dynamic: usize,
    #[serde(default)]
    motion_floats: usize,
    field_step: Option<u32>,
    #[serde(default)]
    record: Option<Record>,
    vectors: Vec<(String, usize)>,
}

impl Reconstruction {
    /// Reads what the run in the folder `run` has learned.
    ///
    /// # Errors
    /// [`TrainedError`]; [`TrainedError::NoRecord`] where a version of before has trained it.
    pub fn read(run: &Path) -> Result<Self, TrainedError> {
        let path = run.join(CHECKPOINT);
        let damaged = |reason: String| TrainedError::Damaged { path: path.clone(), reason };
        let bytes = std::fs::read(&path).map_err(|source| TrainedError::Read { path: path.clone(), source })?;
        let container = Container::open(&bytes).map_err(damaged)?;
        let header: Header =
            serde_json::from_slice(container.header).map_err(|error| damaged(format!("its header: {error}")))?;
        let Some(record) = header.record else {
            return Err(TrainedError::NoRecord { run: run.to_owned() });
        };
        let vectors = container.vectors(header.vectors).map_err(damaged)?;
        for NamedVector { name, values } in &vectors {
            if let Some((index, value)) = implausible(name, values) {
                return Err(TrainedError::Implausible { path, vector: name.clone(), index, value });
            }
        }
        let mut take = Take(vectors);
        let gaussians = Gaussians {
            sh_degree: header.sh_degree,
            dynamic: header.dynamic,
            core: take.vector("core"),
            sh: take.vector("sh"),
            motion_floats: header.motion_floats,
            motion: take.vector("motion"),
        };
        let points = take.vector("points").as_chunks::<3>().0.to_vec();
        let shared = header.field_step.map(|step| FieldState { step, vectors: take.last(record.shared_vectors) });
        let learned = Self { record, gaussians, shared, points };
        learned.check().map_err(damaged)?;
        Ok(learned)
    }

    /// Whether its numbers are as many as they say.
    fn check(&self) -> Result<(), String> {
        let Gaussians { sh_degree, dynamic, core, sh, motion_floats, motion } = &self.gaussians;
        let count = self.gaussians.len();
        let fits = *sh_degree <= 3
            && self.record.drawing.sh_degree <= *sh_degree
            && core.len() == count * CORE
            && sh.len() == count * sh_stride(*sh_degree)
            && *dynamic <= count
            && dynamic.checked_mul(*motion_floats) == Some(motion.len());
        if !fits {
            return Err("its vectors are of different lengths".into());
        }
        if let MotionPlan::HexPlane { field, .. } = &self.record.motion
            && field.heads.sh
            && field.sh_stride as usize != sh_stride(*sh_degree)
        {
            return Err(format!("its field has {} numbers for colours of degree {sh_degree}", field.sh_stride));
        }
        let needed = self.record.motion.row_floats();
        if needed != 0 && *motion_floats != needed {
            return Err(format!("its Gaussians have {motion_floats} numbers for their motion, which takes {needed}"));
        }
        Ok(())
    }
}

/// Vectors that are taken out by their names.
struct Take(Vec<NamedVector>);

impl Take {
    /// The first of this name; none has no numbers.
    fn vector(&mut self, name: &str) -> Vec<f32> {
        let found = self.0.iter_mut().find(|vector| vector.name == name);
        found.map(|vector| std::mem::take(&mut vector.values)).unwrap_or_default()
    }

    fn last(mut self, count: usize) -> Vec<NamedVector> {
        self.0.split_off(self.0.len().saturating_sub(count))
    }
}

/// What a run has learned, on a device.
#[derive(Debug)]
pub struct TrainedScene<'a> {
    gpu: &'a Gpu,
    model: Model,
    rendering: Rendering,
    learned: Reconstruction,
}

impl<'a> TrainedScene<'a> {
    /// Opens the run in the folder `run`, of which nothing but its checkpoint is read.
    ///
    /// # Errors
    /// [`TrainedError`].
    pub fn open(gpu: &'a Gpu, run: &Path) -> Result<Self, TrainedError> {
        Ok(Self::new(gpu, Reconstruction::read(run)?)?)
    }

    /// Puts a reconstruction on a device.
    ///
    /// # Errors
    /// [`ModelError`] where it does not fit.
    pub fn new(gpu: &'a Gpu, learned: Reconstruction) -> Result<Self, ModelError> {
        let mut model = Model::new(gpu, &learned.gaussians)?;
        model.set_motion(gpu, learned.record.motion.motion(gpu, learned.shared.as_ref())?)?;
        Ok(Self { gpu, model, rendering: Rendering::new(gpu)?, learned })
    }

    /// What is on the device, on the host.
    #[must_use]
    pub fn learned(&self) -> &Reconstruction {
        &self.learned
    }

    /// The recording, and how the Gaussians are drawn.
    #[must_use]
    pub fn record(&self) -> &Record {
        &self.learned.record
    }

    /// The device.
    #[must_use]
    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }

    /// Renders the scene from `view` at `t01` (0 is the start of the recording, 1 its end).
    ///
    /// # Errors
    /// [`ModelError`] where the device fails.
    pub fn render(&mut self, view: &View, t01: f64) -> Result<Rendered, ModelError> {
        let options = self.learned.record.options(&self.learned.points, view);
        let deformed = self.model.deform(self.gpu, t01, &mut self.rendering.tape, crate::field::Outputs::All)?;
        loop {
            self.model.draw(self.gpu, view, &options, &mut self.rendering, deformed)?;
            if self.rendering.is_complete(self.gpu)? {
                return Ok(self.rendering.picture(self.gpu)?);
            }
        }
    }

    /// The Gaussians as they stand at `t01`.
    ///
    /// # Errors
    /// [`ModelError`] where the device fails.
    pub fn gaussians_at(&mut self, t01: f64) -> Result<Gaussians, ModelError> {
        self.model.gaussians_at(self.gpu, t01)
    }

    /// The Gaussians of one moment that stand for all; see [`Model::gaussians_still`].
    ///
    /// # Errors
    /// [`ModelError`] where the device fails.
    pub fn gaussians_still(&mut self) -> Result<Gaussians, ModelError> {
        self.model.gaussians_still(self.gpu)
    }
}
