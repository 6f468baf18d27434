//! Sessions and event files.

use std::{
    path::PathBuf,
    sync::{Mutex, PoisonError},
};

use erfgs_events::{EventFileHints, SensorSize, TextColumns};
use erfgs_session::source::Description;
use erfgs_sync::reading::{ALWAYS_NS, Depth, EventClock, FrameLook, ReadError, SliceOptions, TimedRecording};
use pyo3::{
    exceptions::{PyKeyError, PyValueError},
    prelude::*,
    types::{PyDict, PyTuple},
};

use crate::{
    arrays,
    clock::Clock,
    errors::{self, Error},
    reading::{FrameIterator, SliceIterator},
    times,
};

/// Opens a session, a recording of ROS 2, or an event file of any format that erfgs reads.
///
/// size: (width, height) of the sensor in pixels, for event files that do not say it; without it, what holds all addresses.
/// columns: what each column of a text of events is, as "x,y,p,t_us", whatever the text says.
#[pyfunction]
#[pyo3(signature = (path, size=None, columns=None))]
pub fn open(py: Python<'_>, path: PathBuf, size: Option<(u16, u16)>, columns: Option<String>) -> PyResult<Recording> {
    let of_text = columns.as_deref().map(str::parse::<TextColumns>).transpose();
    let hints = EventFileHints {
        size: size.map(|(width, height)| SensorSize { width, height }),
        columns: of_text.map_err(PyValueError::new_err)?,
    };
    let opened = py.detach(|| TimedRecording::open(&path, &hints)).map_err(errors::raised)?;
    let summary = opened.recording().summary();
    let described = summary.streams.iter().map(|stream| (stream.description.clone(), stream.totals.packets)).collect();
    let (duration, faults) = (times::us(opened.span_ns()[1]), summary.faults());
    let start_ns = summary.start.epoch_ns;
    Ok(Recording { path, size, columns, described, start_ns, duration, faults, open: Mutex::new(Some(opened)) })
}

/// A session or an event file that is open for reading. Times are microseconds of session time, which begins with the recording.
///
/// As a mapping it gives its streams by their names. It may be used by several threads, and pickles as the file's name.
#[pyclass(frozen, mapping, module = "erfgs")]
pub struct Recording {
    path: PathBuf,
    size: Option<(u16, u16)>,
    columns: Option<String>,
    /// The streams and how many packets each has.
    described: Vec<(Description, u64)>,
    start_ns: i64,
    duration: i64,
    faults: Vec<String>,
    open: Mutex<Option<TimedRecording>>,
}

impl Recording {
    /// Works with the open recording while the interpreter's lock is free.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut TimedRecording) -> Result<T, ReadError> + Send,
    ) -> PyResult<T> {
        let done = py.detach(|| {
            let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
            let open = open.as_mut()?;
            Some((work(open), open.take_notes()))
        });
        let Some((done, notes)) = done else {
            return Err(Error::new_err(format!("{} is closed; open it again", self.path.display())));
        };
        errors::warn(py, notes.iter().map(ToString::to_string).collect())?;
        done.map_err(errors::raised)
    }

    fn find(&self, id: &str) -> PyResult<&(Description, u64)> {
        self.described.iter().find(|(description, _)| description.id == id).ok_or_else(|| {
            let known: Vec<&str> = self.described.iter().map(|(description, _)| description.id.as_str()).collect();
            PyKeyError::new_err(format!("{} has no stream '{id}'; there are {}", self.path.display(), known.join(", ")))
        })
    }

    fn sliced(&self, py: Python<'_>, options: SliceOptions) -> PyResult<SliceIterator> {
        for id in options.streams.iter().flatten() {
            self.find(id)?;
        }
        Ok(self.with(py, |open| open.slices(&options))?.into())
    }

    fn span_ns(&self) -> PyResult<[i64; 2]> {
        // The last nanosecond counts as a whole microsecond.
        Ok([0, times::ns(self.duration.saturating_add(1))?])
    }
}

/// How frames are decoded, of arguments.
fn look(depth: u8, bits: Option<u8>) -> PyResult<FrameLook> {
    let depth = match depth {
        8 => Depth::Bits8,
        16 => Depth::Bits16,
        other => return Err(PyValueError::new_err(format!("depth is {other}; frames are given with 8 or 16 bits"))),
    };
    Ok(FrameLook { depth, bits })
}

#[pymethods]
impl Recording {
    /// The file's name.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// The streams by their names, in the order of the file.
    #[getter]
    fn streams<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        let streams = PyDict::new(slf.py());
        for (description, _) in &slf.get().described {
            streams
                .set_item(&description.id, Stream { recording: slf.clone().unbind(), id: description.id.clone() })?;
        }
        Ok(streams)
    }

    /// From the recording's beginning to its last packet, microseconds.
    #[getter]
    fn duration(&self) -> i64 {
        self.duration
    }

    /// When the recording began, nanoseconds since 1970; 0 where nothing tells.
    #[getter]
    fn epoch_ns(&self) -> i64 {
        self.start_ns
    }

    /// What is known to be damaged or missing in the file, a message each; empty for a sound file.
    #[getter]
    fn faults(&self) -> Vec<String> {
        self.faults.clone()
    }

    fn __getitem__(slf: &Bound<'_, Self>, id: String) -> PyResult<Stream> {
        slf.get().find(&id)?;
        Ok(Stream { recording: slf.clone().unbind(), id })
    }

    fn __contains__(&self, id: &str) -> bool {
        self.find(id).is_ok()
    }

    fn __len__(&self) -> usize {
        self.described.len()
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let ids: Vec<&str> = self.described.iter().map(|(description, _)| description.id.as_str()).collect();
        PyTuple::new(py, ids)?.call_method0("__iter__")
    }

    /// What all cameras saw, slice by slice of `dt` microseconds on one clock, from `start` (inclusive; default: 0) to `end`
    /// (exclusive; default: the recording's end), those without anything included.
    ///
    /// streams: names; default: those of all cameras. depth and bits: as in `Stream.frames`.
    /// A frame belongs to the slice in which the middle of its exposure lies.
    #[pyo3(signature = (dt, streams=None, start=None, end=None, *, depth=8, bits=None))]
    #[expect(clippy::too_many_arguments, reason = "they have names in Python")]
    fn slices(
        &self,
        py: Python<'_>,
        dt: i64,
        streams: Option<Vec<String>>,
        start: Option<i64>,
        end: Option<i64>,
        depth: u8,
        bits: Option<u8>,
    ) -> PyResult<SliceIterator> {
        let span_ns = times::span_ns(start, end, self.span_ns()?)?;
        let length_ns = times::ns(dt)?;
        self.sliced(py, SliceOptions { length_ns, streams, span_ns, look: look(depth, bits)? })
    }

    /// What all cameras saw from `start` (inclusive) to `end` (exclusive), microseconds: one slice of `slices`.
    #[pyo3(signature = (start, end, streams=None, *, depth=8, bits=None))]
    fn slice<'py>(
        &self,
        py: Python<'py>,
        start: i64,
        end: i64,
        streams: Option<Vec<String>>,
        depth: u8,
        bits: Option<u8>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let span_ns = [times::ns(start)?, times::ns(end)?];
        if span_ns[0] >= span_ns[1] {
            return Err(PyValueError::new_err(format!("a slice from {start} to {end} µs holds nothing: end it later")));
        }
        let length_ns = span_ns[1].saturating_sub(span_ns[0]);
        let slices = self.sliced(py, SliceOptions { length_ns, streams, span_ns, look: look(depth, bits)? })?;
        slices.only(py)
    }

    /// The clock of a stream of a session and how well it is known. Taken from the file beside the session
    /// (`erfgs sync`) or fitted now, for which the session is read through.
    fn clock(&self, py: Python<'_>, id: &str) -> PyResult<Clock> {
        self.find(id)?;
        let found = self.with(py, TimedRecording::synchronisation)?;
        let found = found.ok_or_else(|| {
            let path = self.path.display();
            Error::new_err(format!(
                "{path} is the file of one camera: there is no other clock that its times are tied to"
            ))
        })?;
        let stream = found.stream(id).cloned();
        stream.map(Clock::from).ok_or_else(|| Error::new_err(format!("nothing is known of the clock of stream '{id}'")))
    }

    /// Closes the file; what is being read of it goes on.
    fn close(&self, py: Python<'_>) {
        py.detach(|| *self.open.lock().unwrap_or_else(PoisonError::into_inner) = None);
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_raised))]
    fn __exit__(&self, py: Python<'_>, _raised: &Bound<'_, PyTuple>) {
        self.close(py);
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> errors::Reduced<'py, Bound<'py, PyAny>> {
        let this = slf.get();
        let arguments = (&this.path, this.size, &this.columns).into_pyobject(slf.py())?.into_any();
        Ok((slf.py().import("erfgs")?.getattr("open")?, arguments))
    }

    fn __repr__(&self) -> String {
        let streams: Vec<String> = self
            .described
            .iter()
            .map(|(stream, _)| format!("{} ({}, {}x{})", stream.id, stream.encoding, stream.width, stream.height))
            .collect();
        let seconds = self.duration as f64 * 1e-6;
        format!("<erfgs.Recording {}: {seconds:.3} s of {}>", self.path.display(), streams.join(", "))
    }
}

/// One stream of a recording.
#[pyclass(frozen, module = "erfgs")]
pub struct Stream {
    recording: Py<Recording>,
    id: String,
}

impl Stream {
    fn described(&self) -> PyResult<&(Description, u64)> {
        self.recording.get().find(&self.id)
    }
}

#[pymethods]
impl Stream {
    /// Its name within the rig.
    #[getter]
    fn id(&self) -> String {
        self.id.clone()
    }

    /// What it holds: "events", "frames" or "trigger".
    #[getter]
    fn kind(&self) -> PyResult<&'static str> {
        let encoding = self.described()?.0.encoding;
        Ok(match (encoding.is_events(), encoding.is_frames()) {
            (true, _) => "events",
            (_, true) => "frames",
            _ => "trigger",
        })
    }

    /// How its packets are encoded, as `evt3` or `mjpeg`.
    #[getter]
    fn encoding(&self) -> PyResult<&'static str> {
        Ok(self.described()?.0.encoding.name())
    }

    /// Maker and model.
    #[getter]
    fn model(&self) -> PyResult<String> {
        Ok(self.described()?.0.model.clone())
    }

    /// Serial number; empty where there is none.
    #[getter]
    fn serial(&self) -> PyResult<String> {
        Ok(self.described()?.0.serial.clone())
    }

    /// Columns, pixels.
    #[getter]
    fn width(&self) -> PyResult<u32> {
        Ok(self.described()?.0.width)
    }

    /// Rows, pixels.
    #[getter]
    fn height(&self) -> PyResult<u32> {
        Ok(self.described()?.0.height)
    }

    /// Packets in the file; 0 for event files, whose packets nobody counts.
    #[getter]
    fn packets(&self) -> PyResult<u64> {
        Ok(self.described()?.1)
    }

    /// Settings as read back from the device: biases, exposure, firmware.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        arrays::plain(py, &serde_json::Value::Object(self.described()?.0.settings.clone()))
    }

    /// The events from `start` (inclusive) to `end` (exclusive), microseconds of session time; all where nothing is said.
    ///
    /// A structured array of shape (n,): x and y (uint16, pixels), p (int16, 1 for a rise, 0 for a fall), t (int64, microseconds), in
    /// the order of t. clock: "session" for times that all streams share, "device" for the camera's own as recorded.
    /// Reading begins at the last stored state of the decoder before `start`, not at the beginning of a session.
    #[pyo3(signature = (start=None, end=None, *, clock="session"))]
    fn events<'py>(
        &self,
        py: Python<'py>,
        start: Option<i64>,
        end: Option<i64>,
        clock: &str,
    ) -> PyResult<Bound<'py, PyAny>> {
        let clock = match clock {
            "session" => EventClock::Session,
            "device" => EventClock::Device,
            other => {
                return Err(PyValueError::new_err(format!("there is no clock '{other}': \"session\" or \"device\"")));
            }
        };
        let span_ns = times::span_ns(start, end, ALWAYS_NS)?;
        let found = self.recording.get().with(py, |open| open.events(&self.id, span_ns, clock))?;
        errors::warn(py, found.damage)?;
        arrays::events(py, found.rows)
    }

    /// The frames whose exposures have their middles from `start` (inclusive) to `end` (exclusive), microseconds of session time; all
    /// where nothing is said.
    ///
    /// Images are arrays of shape (height, width) of grey cameras, else (height, width, 3) in the order red, green, blue, encoded for
    /// display (sRGB), of uint8, or of uint16 with depth=16. Frames that nothing dates are left out, and so are damaged ones, both
    /// with a DamageWarning. bits: how many of 16 bits of samples count, in files of AEDAT 4 that leave it open.
    #[pyo3(signature = (start=None, end=None, *, depth=8, bits=None))]
    fn frames(
        &self,
        py: Python<'_>,
        start: Option<i64>,
        end: Option<i64>,
        depth: u8,
        bits: Option<u8>,
    ) -> PyResult<FrameIterator> {
        let (span_ns, look) = (times::span_ns(start, end, ALWAYS_NS)?, look(depth, bits)?);
        Ok(self.recording.get().with(py, |open| open.frames(&self.id, span_ns, look))?.into())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> errors::Reduced<'py, (Py<Recording>, String)> {
        let this = slf.get();
        let getitem = slf.py().import("operator")?.getattr("getitem")?;
        Ok((getitem, (this.recording.clone_ref(slf.py()), this.id.clone())))
    }

    fn __repr__(&self) -> PyResult<String> {
        let (stream, _) = self.described()?;
        Ok(format!(
            "<erfgs.Stream {}: {} of {} x {} pixels, {}>",
            stream.id, stream.encoding, stream.width, stream.height, stream.model
        ))
    }
}
