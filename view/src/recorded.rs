//! What was recorded, for a page: frames and events of the cameras of a dataset.

use std::{
    collections::HashMap,
    io::Read,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
};

use erfgs_dataset::Dataset;
use erfgs_events::Events;

/// Events that are sent at most: what lies between is left out evenly.
const MOST_EVENTS: usize = 200_000;

/// Bytes of the largest frame.
const LONGEST_FRAME: u64 = 256 << 20;

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

    /// A frame as it lies on the disk, by the number that its camera gives it; why it cannot be had.
    pub fn frame(&self, camera: &str, index: usize) -> Result<Vec<u8>, String> {
        let found = self.dataset.camera(camera).and_then(|camera| camera.frames.get(index));
        let frame = found.ok_or("there is no such frame")?;
        let path = self.file(&frame.file)?;
        let wrong = |what: String| format!("{}: {what}", path.display());
        let file = std::fs::File::open(&path).map_err(|error| wrong(error.to_string()))?;
        let mut bytes = Vec::new();
        file.take(LONGEST_FRAME + 1).read_to_end(&mut bytes).map_err(|error| wrong(error.to_string()))?;
        if bytes.len() as u64 > LONGEST_FRAME {
            return Err(wrong(format!("it is longer than {LONGEST_FRAME} bytes, which no frame is")));
        }
        Ok(bytes)
    }

    /// Where a file of the dataset lies.
    fn file(&self, path: &Path) -> Result<PathBuf, String> {
        let path = self.dataset.path(path).map_err(|error| error.to_string())?;
        if_a_file(&path).map(|()| path)
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
        if let Some(events) = &camera.events {
            self.file(&events.file)?;
        }
        let read = self.dataset.read_events(camera).map_err(|error| error.to_string())?;
        let events = Arc::new(read.ok_or_else(|| format!("camera {name} has no events"))?);
        known.insert(name.to_owned(), Arc::clone(&events));
        Ok(events)
    }
}

/// What is no file is not opened: a pipe would be waited for.
fn if_a_file(path: &Path) -> Result<(), String> {
    let found = std::fs::metadata(path).map_err(|error| format!("{}: {error}", path.display()))?;
    if found.is_file() { Ok(()) } else { Err(format!("{}: it is no file", path.display())) }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_pipe_in_place_of_a_frame_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let [pipe, file] = ["pipe", "file"].map(|name| folder.path().join(name));
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        std::fs::write(&file, b"x").unwrap();
        assert!(if_a_file(&file).is_ok());
        for path in [&pipe, folder.path(), &folder.path().join("nothing")] {
            assert!(if_a_file(path).unwrap_err().contains(&path.display().to_string()));
        }
    }
}
