//! What a run notes for whoever draws it without its dataset.

use rayon::prelude::*;

use super::{TrainError, Trainer};
use crate::scene::{EventView, Scene, SceneError};
use erfgs_dataset::{Camera, Frame, Split};
use erfgs_splat::{
    field::FieldState,
    trained::{Drawing, Reconstruction, Record, RecordedCamera, RecordedEvents},
};

impl Trainer<'_> {
    /// What was learned so far, as a run keeps it to be drawn.
    ///
    /// # Errors
    /// [`TrainError`] where the device fails, or events cannot be read any more.
    pub fn reconstruction(&self) -> Result<Reconstruction, TrainError> {
        let shared = self.field()?;
        let record = self.record(shared.as_ref())?;
        Ok(Reconstruction { record, gaussians: self.gaussians()?, shared, points: self.initial_points() })
    }

    /// The places of the initial cloud.
    pub(super) fn initial_points(&self) -> Vec<[f32; 3]> {
        self.scene.points.iter().map(|(place, _)| *place).collect()
    }

    /// The recording, and how the Gaussians are drawn, where they share so much of their motion.
    pub(super) fn record(&self, shared: Option<&FieldState>) -> Result<Record, TrainError> {
        let options = self.options();
        let manifest = &self.scene.dataset.manifest;
        let times = |frame: &Frame| [frame.t_ns, frame.exposure_ns[0], frame.exposure_ns[1]];
        let camera = |(index, of): (usize, &Camera)| RecordedCamera {
            name: of.name.clone(),
            held_out: of.split == Split::Test,
            modality: of.modality,
            view: self.scene.views[index].view,
            frames_ns: of.frames.iter().map(times).collect(),
        };
        Ok(Record {
            span_ns: manifest.span_ns,
            intervals: self.scene.intervals(),
            drawing: Drawing {
                background: options.background,
                sh_degree: options.sh_degree,
                near_m: self.config.near_m,
                near_share: self.config.near_share,
                near_sigmas: options.near_sigmas,
            },
            motion: self.model.plan.clone(),
            shared_vectors: shared.map_or(0, |state| state.vectors.len()),
            cameras: manifest.cameras.iter().enumerate().map(camera).collect(),
            events: self.recorded_events()?,
        })
    }

    /// When events came. They are counted once: it takes as long as reading all of them.
    fn recorded_events(&self) -> Result<RecordedEvents, TrainError> {
        if self.counted.get().is_none() {
            // Whoever was first has counted the same.
            let _ = self.counted.set(count(&self.scene)?);
        }
        Ok(self.counted.get().cloned().unwrap_or_default())
    }
}

/// Events of all cameras in each bin.
fn count(scene: &Scene) -> Result<RecordedEvents, SceneError> {
    if scene.events.is_empty() {
        return Ok(RecordedEvents::default());
    }
    let of = |camera: &EventView, bin: usize| -> Result<f64, SceneError> {
        Ok(camera.activity(bin, bin + 1, false)?.iter().map(|&count| f64::from(count)).sum())
    };
    let bin = |bin: usize| {
        scene.events.iter().filter(|camera| camera.knows(bin, bin + 1)).map(|camera| of(camera, bin)).sum()
    };
    let counts = (0..scene.bins.len()).into_par_iter().map(bin).collect::<Result<_, _>>()?;
    Ok(RecordedEvents { edges: scene.bins.edges.clone(), counts })
}
