//! What was recorded, for a page: frames and events of the cameras of a dataset.

use std::{
    collections::HashMap,
    path::PathBuf,
    sync::{Arc, Mutex, PoisonError},
};

use erfgs_dataset::Dataset;
use erfgs_events::Events;

/// Events that are sent at most: what lies between is left out evenly.
const MOST_EVENTS: usize = 200_000;

/// A dataset, and the events of it that were read.
#[derive(Debug)]
pub(crate) struct Recorded {
    dataset: Dataset,
    events: Mutex<HashMap<String, Arc<Events>>>,
}

impl Recorded {
    pub fn new(dataset: Dataset) -> Self {
        Self { dataset, events: Mutex::default() }
    }

    /// The file of a frame, by the number that its camera gives it; why it cannot be had.
    pub fn frame(&self, camera: &str, index: usize) -> Result<PathBuf, String> {
        let found = self.dataset.camera(camera).and_then(|camera| camera.frames.get(index));
        let frame = found.ok_or("there is no such frame")?;
        self.dataset.path(&frame.file).map_err(|error| error.to_string())
    }

    /// Events from `from` to `to` (shares of the recording): column, row and polarity (0 or 1) of each, as little-endian u16.
    pub fn events(&self, camera: &str, [from, to]: [f64; 2]) -> Result<Vec<u8>, String> {
        let events = self.all_events(camera)?;
        let [start, end] = self.dataset.manifest.span_ns;
        let at = |t01: f64| ((start as f64 + t01 * (end - start) as f64) / 1e3).round() as i64;
        let found = events.between(at(from), at(to));
        let step = found.len().div_ceil(MOST_EVENTS).max(1);
        let packed = found.step_by(step).flat_map(|k| [events.x[k], events.y[k], u16::from(events.on[k])]);
        Ok(packed.flat_map(u16::to_le_bytes).collect())
    }

    fn all_events(&self, name: &str) -> Result<Arc<Events>, String> {
        let mut known = self.events.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(events) = known.get(name) {
            return Ok(Arc::clone(events));
        }
        let camera = self.dataset.camera(name).ok_or("there is no such camera")?;
        let read = self.dataset.read_events(camera).map_err(|error| error.to_string())?;
        let events = Arc::new(read.ok_or_else(|| format!("camera {name} has no events"))?);
        known.insert(name.to_owned(), Arc::clone(&events));
        Ok(events)
    }
}
