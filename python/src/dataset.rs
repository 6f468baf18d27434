//! Datasets: what a training reads.

use std::{
    collections::HashMap,
    path::PathBuf,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use erfgs_dataset::{Camera as OfManifest, Dataset as Folder, DatasetError, Frame, Split};
use erfgs_events::{EventRows, Events};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::{
    exceptions::{PyIndexError, PyKeyError, PyValueError},
    prelude::*,
    sync::PyOnceLock,
    types::{PyDict, PyList},
};

use crate::{
    arrays, errors,
    lens::{Camera, modality},
    times,
};

/// A dataset, with the events of its cameras once they were read.
struct Open {
    folder: Folder,
    events: Mutex<HashMap<String, Arc<Events>>>,
}

/// A dataset. As a mapping it gives its cameras by their names; it pickles as the folder's name.
#[pyclass(frozen, mapping, module = "erfgs")]
pub struct Dataset(Arc<Open>);

/// One viewpoint of a dataset. Times are microseconds of the dataset.
#[pyclass(frozen, module = "erfgs")]
pub struct DatasetCamera {
    dataset: Arc<Open>,
    name: String,
}

#[pymethods]
impl Dataset {
    /// Reads the manifest of a dataset's folder and looks whether all files that it names are there.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let folder = py.detach(|| Folder::load(&path)).map_err(errors::raised)?;
        Ok(Self(Arc::new(Open { folder, events: Mutex::default() })))
    }

    /// The folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.0.folder.root.clone()
    }

    /// A short name.
    #[getter]
    fn name(&self) -> &str {
        &self.0.folder.manifest.name
    }

    /// First and last instant, microseconds.
    #[getter]
    fn span(&self) -> (i64, i64) {
        times::both_us(self.0.folder.manifest.span_ns)
    }

    /// The viewpoints by their names.
    #[getter]
    fn cameras<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let cameras = PyDict::new(py);
        for camera in &self.0.folder.manifest.cameras {
            cameras.set_item(&camera.name, self.__getitem__(&camera.name)?)?;
        }
        Ok(cameras)
    }

    /// The initial points: positions, float32 of shape (n, 3), metres, and colours, uint8 of shape (n, 3); None where none were made.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>> {
        let Some(cloud) = py.detach(|| self.0.folder.read_points()).map_err(errors::raised)? else { return Ok(None) };
        Ok(Some((arrays::table(py, cloud.positions)?, arrays::table(py, cloud.colours)?)))
    }

    fn __getitem__(&self, name: &str) -> PyResult<DatasetCamera> {
        let folder = &self.0.folder;
        let known = || folder.manifest.cameras.iter().map(|camera| camera.name.as_str());
        let found = folder.camera(name).map(|_| DatasetCamera { dataset: self.0.clone(), name: name.to_owned() });
        found.ok_or_else(|| errors::no_camera(&folder.root, name, known()))
    }

    fn __contains__(&self, name: &str) -> bool {
        self.0.folder.camera(name).is_some()
    }

    fn __len__(&self) -> usize {
        self.0.folder.manifest.cameras.len()
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.cameras(py)?.call_method0("__iter__")
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> errors::Reduced<'py, (PathBuf,)> {
        Ok((slf.get_type().getattr("load")?, (slf.get().path(),)))
    }

    fn __repr__(&self) -> String {
        let Folder { root, manifest } = &self.0.folder;
        let seconds = (manifest.span_ns[1] - manifest.span_ns[0]) as f64 * 1e-9;
        format!("<erfgs.Dataset {}: {} cameras, {seconds:.3} s>", root.display(), manifest.cameras.len())
    }
}

impl DatasetCamera {
    fn of(&self) -> PyResult<&OfManifest> {
        let camera = self.dataset.folder.camera(&self.name);
        camera.ok_or_else(|| PyKeyError::new_err(format!("the dataset has no camera '{}'", self.name)))
    }

    fn frame(&self, index: usize) -> PyResult<&Frame> {
        let frames = &self.of()?.frames;
        frames.get(index).ok_or_else(|| {
            PyIndexError::new_err(format!(
                "camera {} has {} frames, and none of index {index}",
                self.name,
                frames.len()
            ))
        })
    }

    /// Its events, which are kept.
    fn read_events(&self, py: Python<'_>) -> PyResult<Arc<Events>> {
        let camera = self.of()?;
        let read = py.detach(|| -> Result<_, DatasetError> {
            let mut kept = self.dataset.events.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(events) = kept.get(&self.name) {
                return Ok(Some(events.clone()));
            }
            let Some(read) = self.dataset.folder.read_events(camera)? else { return Ok(None) };
            let events = Arc::new(read);
            kept.insert(self.name.clone(), events.clone());
            Ok(Some(events))
        });
        let none = || errors::Error::new_err(format!("camera {} has no events", self.name));
        read.map_err(errors::raised)?.ok_or_else(none)
    }
}

#[pymethods]
impl DatasetCamera {
    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// What it is for: "train" or "test".
    #[getter]
    fn split(&self) -> PyResult<&'static str> {
        Ok(match self.of()?.split {
            Split::Train => "train",
            Split::Test => "test",
        })
    }

    /// What it recorded: "rgb", "event" or "both".
    #[getter]
    fn modality(&self) -> PyResult<&'static str> {
        Ok(modality(self.of()?.modality))
    }

    /// Its lens and where it stood.
    #[getter]
    fn camera(&self) -> PyResult<Camera> {
        let of = self.of()?;
        let known = |sigma: [f64; 3]| sigma.map(Some);
        Ok(Camera {
            name: of.name.clone(),
            modality: of.modality,
            intrinsics: of.intrinsics,
            pose: Some(of.world_to_camera),
            sigma: of.pose_sigma.map(|sigma| [known(sigma.centre_m), known(sigma.rotation_deg)]),
            intrinsics_sigma: Vec::new(),
            time_offset_s: 0.0,
            undistortion: OnceLock::new(),
        })
    }

    /// When its frames were taken, in the order of time.
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        static FRAME: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let class = arrays::of_package(py, &FRAME, "FrameTime")?;
        let frames = PyList::empty(py);
        for frame in &self.of()?.frames {
            frames.append(class.call1((times::us(frame.t_ns), times::both_us(frame.exposure_ns)))?)?;
        }
        Ok(frames)
    }

    /// A frame, uint8 of shape (height, width, 3): red, green, blue, encoded for display (sRGB).
    fn image<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyAny>> {
        let (camera, frame) = (self.of()?, self.frame(index)?);
        let image = py.detach(|| self.dataset.folder.read_image(camera, frame)).map_err(errors::raised)?;
        arrays::colour(py, image)
    }

    /// Which pixels of a frame move, uint8 of shape (height, width), 255 where they do; None where the frame has no mask.
    fn mask<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Option<Bound<'py, PyAny>>> {
        let (camera, frame) = (self.of()?, self.frame(index)?);
        let mask = py.detach(|| self.dataset.folder.read_mask(camera, frame)).map_err(errors::raised)?;
        mask.map(|mask| arrays::grey(py, mask)).transpose()
    }

    /// The events from `start` (inclusive) to `end` (exclusive), microseconds; all where nothing is said. The array is that of
    /// `Stream.events`.
    #[pyo3(signature = (start=None, end=None))]
    fn events<'py>(&self, py: Python<'py>, start: Option<i64>, end: Option<i64>) -> PyResult<Bound<'py, PyAny>> {
        let events = self.read_events(py)?;
        let rows = py.detach(|| {
            let within = events.between(start.unwrap_or(i64::MIN), end.unwrap_or(i64::MAX));
            let mut rows = EventRows::with_capacity(within.len());
            rows.extend(within.map(|index| events.get(index)));
            rows
        });
        arrays::events(py, rows)
    }

    /// How many events each pixel had from `start` (inclusive) to `end` (exclusive), microseconds: int32 of shape
    /// (2, height, width), first the falls and then the rises.
    fn counts<'py>(&self, py: Python<'py>, start: i64, end: i64) -> PyResult<Bound<'py, PyAny>> {
        let events = self.read_events(py)?;
        let counts = py.detach(|| events.counts(start, end));
        let shape = [2, events.height as usize, events.width as usize];
        let counts = PyArray1::from_vec(py, counts).reshape(shape);
        Ok(counts.map_err(|error| PyValueError::new_err(error.to_string()))?.into_any())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> errors::Reduced<'py, (Dataset, String)> {
        Ok((py.import("operator")?.getattr("getitem")?, (Dataset(self.dataset.clone()), self.name.clone())))
    }

    fn __repr__(&self) -> PyResult<String> {
        let of = self.of()?;
        let events = of.events.as_ref().map_or(0, |events| events.count);
        Ok(format!("<erfgs.DatasetCamera {}: {} frames, {events} events>", self.name, of.frames.len()))
    }
}
