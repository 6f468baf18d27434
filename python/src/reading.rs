//! Frames and slices, one after the other, read while the interpreter's lock is free.

use std::sync::{Mutex, PoisonError};

use erfgs_sync::reading::{Frames, Part, Slice, Slices, TimedFrame};
use pyo3::{
    prelude::*,
    sync::PyOnceLock,
    types::{PyDict, PyList},
};

use crate::{arrays, errors, times};

/// The frames of a stream, in the order of the recording.
#[pyclass(frozen, module = "erfgs")]
pub struct FrameIterator(Mutex<Frames>);

/// The slices of a recording, one after the other.
#[pyclass(frozen, module = "erfgs")]
pub struct SliceIterator(Mutex<Slices>);

/// What comes next of what is read, and what was passed over on the way.
fn next<R>(py: Python<'_>, reader: &Mutex<R>, damage: fn(&mut R) -> Vec<String>) -> PyResult<Option<R::Item>>
where
    R: Iterator + Send,
    R::Item: Send,
{
    let (found, damage) = py.detach(|| {
        let mut reader = reader.lock().unwrap_or_else(PoisonError::into_inner);
        (reader.next(), damage(&mut reader))
    });
    errors::warn(py, damage)?;
    Ok(found)
}

#[pymethods]
impl FrameIterator {
    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let found = next(py, &self.0, Frames::take_damage)?;
        found.map(|found| frame(py, found.map_err(errors::raised)?)).transpose()
    }
}

#[pymethods]
impl SliceIterator {
    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let found = next(py, &self.0, Slices::take_damage)?;
        found.map(|found| slice(py, found.map_err(errors::raised)?)).transpose()
    }
}

impl From<Frames> for FrameIterator {
    fn from(frames: Frames) -> Self {
        Self(Mutex::new(frames))
    }
}

impl From<Slices> for SliceIterator {
    fn from(slices: Slices) -> Self {
        Self(Mutex::new(slices))
    }
}

fn frame(py: Python<'_>, frame: TimedFrame) -> PyResult<Bound<'_, PyAny>> {
    static FRAME: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let image = arrays::frame(py, frame.picture)?;
    let exposure = frame.exposure.length_ns.map(|_| times::both_us(frame.exposure.span_ns()));
    arrays::of_package(py, &FRAME, "Frame")?.call1((image, times::us(frame.exposure.mid_ns), exposure, frame.sequence))
}

/// A slice: events of streams that have them, frames of streams that have them.
fn slice(py: Python<'_>, Slice { span_ns, parts }: Slice) -> PyResult<Bound<'_, PyAny>> {
    static SLICE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let (events, frames) = (PyDict::new(py), PyDict::new(py));
    for Part { id, events: rows, frames: taken, has_events, has_frames } in parts {
        if has_events {
            events.set_item(&id, arrays::events(py, rows)?)?;
        }
        if has_frames {
            let list = PyList::empty(py);
            for one in taken {
                list.append(frame(py, one)?)?;
            }
            frames.set_item(&id, list)?;
        }
    }
    let (start, end) = times::both_us(span_ns);
    arrays::of_package(py, &SLICE, "Slice")?.call1((start, end, events, frames))
}

impl SliceIterator {
    /// The one slice that there is.
    pub fn only<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.__next__(py)?.ok_or_else(|| errors::Error::new_err("the slice holds no time"))
    }
}
