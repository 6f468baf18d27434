//! Reconstructions: what a run has learned, drawn and handed over as arrays.

use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::{Mutex, MutexGuard, OnceLock, PoisonError},
};

use erfgs_scene::{Distortion, ImageRgb8, Intrinsics, Pose, ply::GaussianCloud};
use erfgs_splat::{
    gaussians::sigmoid,
    gpu::{AdapterChoice, Gpu, GpuError, run_canary},
    model::{ModelError, Rendered},
    raster::View,
    trained::{Record, RecordedCamera, TrainedScene},
};
use glam::{DMat3, DVec3};
use numpy::{IntoPyArray, PyArray1, PyArrayMethods};
use pyo3::{exceptions::PyValueError, prelude::*, sync::PyOnceLock, types::PyDict};

use crate::{arrays, errors, lens::Camera, times};

/// A reconstruction that was trained: Gaussians that move. It is read from the run's folder alone, without the dataset, and drawn on the
/// graphics adapter. It may be used by several threads, and pickles as the folder's name.
#[pyclass(frozen, module = "erfgs")]
pub struct Scene {
    path: PathBuf,
    adapter: Option<String>,
    record: Record,
    counts: [usize; 2],
    device: &'static Gpu,
    drawn: Mutex<TrainedScene<'static>>,
    /// Devices do not outlive a fork.
    process: u32,
}

/// The device of this process, which is opened once for each name and never closed.
fn device(adapter: Option<&str>) -> Result<&'static Gpu, GpuError> {
    type Devices = BTreeMap<(u32, Option<String>), &'static Gpu>;
    static DEVICES: Mutex<Devices> = Mutex::new(BTreeMap::new());
    let mut devices = DEVICES.lock().unwrap_or_else(PoisonError::into_inner);
    let key = (std::process::id(), adapter.map(str::to_owned));
    if let Some(&known) = devices.get(&key) {
        return Ok(known);
    }
    let gpu = Gpu::open(&AdapterChoice { name: key.1.clone(), shape: None })?;
    run_canary(&gpu)?;
    let gpu = &*Box::leak(Box::new(gpu));
    devices.insert(key, gpu);
    Ok(gpu)
}

fn camera(of: &RecordedCamera) -> Camera {
    let View { width, height, fx, fy, cx, cy, rotation, translation } = of.view;
    let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(f64::from);
    let rotation = DMat3::from_cols_array_2d(&rotation.map(|row| row.map(f64::from))).transpose();
    Camera {
        name: of.name.clone(),
        modality: of.modality,
        intrinsics: Intrinsics { width, height, fx, fy, cx, cy, distortion: Distortion::None },
        pose: Some(Pose::from_matrix(rotation, DVec3::from(translation.map(f64::from)))),
        sigma: None,
        intrinsics_sigma: Vec::new(),
        time_offset_s: 0.0,
        undistortion: OnceLock::new(),
    }
}

/// What to draw: a camera of the recording by its name, or any other.
#[derive(FromPyObject)]
enum Viewpoint<'py> {
    Name(String),
    Camera(PyRef<'py, Camera>),
}

impl Scene {
    /// An instant in [0, 1].
    fn instant(&self, t: i64) -> PyResult<f64> {
        let (start, end) = self.span();
        if !(start..=end).contains(&t) {
            return Err(PyValueError::new_err(format!(
                "{t} lies outside of the recording, which goes from {start} to {end} microseconds"
            )));
        }
        Ok(self.record.to_unit(times::ns(t)?).clamp(0.0, 1.0))
    }

    fn recorded(&self, name: &str) -> PyResult<&RecordedCamera> {
        let cameras = || self.record.cameras.iter();
        let known = || cameras().map(|camera| camera.name.as_str());
        cameras().find(|camera| camera.name == name).ok_or_else(|| errors::no_camera(&self.path, name, known()))
    }

    fn view(&self, viewpoint: &Viewpoint<'_>) -> PyResult<View> {
        match viewpoint {
            Viewpoint::Name(name) => Ok(self.recorded(name)?.view),
            Viewpoint::Camera(camera) => View::try_from((&camera.intrinsics, camera.stands()?)).map_err(|error| {
                errors::Error::new_err(format!("camera {}: {error}; draw its pinhole()", camera.name))
            }),
        }
    }

    /// What draws, unless this process is a child of the one that opened it.
    fn drawn(&self) -> PyResult<MutexGuard<'_, TrainedScene<'static>>> {
        if self.process != std::process::id() {
            return Err(errors::Error::new_err(format!(
                "run {} was opened by another process, whose device this one cannot use; open it here, or start processes by \"spawn\"",
                self.path.display()
            )));
        }
        Ok(self.drawn.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[pymethods]
impl Scene {
    /// Opens the folder of a run. adapter: a part of the name of a graphics adapter (`erfgs doctor` lists them); default: the fastest.
    #[staticmethod]
    #[pyo3(signature = (path, adapter=None))]
    fn open(py: Python<'_>, path: PathBuf, adapter: Option<String>) -> PyResult<Self> {
        py.detach(|| {
            let device = device(adapter.as_deref()).map_err(errors::raised)?;
            let scene = TrainedScene::open(device, &path).map_err(errors::raised)?;
            let (record, gaussians) = (scene.record().clone(), &scene.learned().gaussians);
            let counts = [gaussians.len(), gaussians.dynamic];
            Ok(Self { path, adapter, record, counts, device, drawn: Mutex::new(scene), process: std::process::id() })
        })
    }

    /// The run's folder.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// The graphics adapter that draws it.
    #[getter]
    fn adapter(&self) -> String {
        self.device.info.name.clone()
    }

    /// First and last instant of the recording, microseconds.
    #[getter]
    fn span(&self) -> (i64, i64) {
        times::both_us(self.record.span_ns)
    }

    /// How many Gaussians there are.
    #[getter]
    fn count(&self) -> usize {
        self.counts[0]
    }

    /// How many of them, from the first, move.
    #[getter]
    fn moving_count(&self) -> usize {
        self.counts[1]
    }

    /// The cameras of the recording by their names, with the poses that the training found.
    #[getter]
    fn cameras<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let cameras = PyDict::new(py);
        for of in &self.record.cameras {
            cameras.set_item(&of.name, camera(of))?;
        }
        Ok(cameras)
    }

    /// The names of the cameras that the training never saw.
    #[getter]
    fn held_out(&self) -> Vec<String> {
        self.record.cameras.iter().filter(|camera| camera.held_out).map(|camera| camera.name.clone()).collect()
    }

    /// The picture of a camera at an instant, microseconds. camera: the name of one of the recording, or any that has a pose and does not
    /// distort (`Camera.pinhole`).
    fn render<'py>(&self, py: Python<'py>, camera: Viewpoint<'py>, t: i64) -> PyResult<Bound<'py, PyAny>> {
        static RENDERING: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let (view, t01) = (self.view(&camera)?, self.instant(t)?);
        let rendered = py.detach(|| -> PyResult<Rendered> {
            self.drawn()?.render(&view, t01).map_err(|error: ModelError| errors::raised(error))
        })?;
        let shape = [view.height as usize, view.width as usize];
        let opacity: Vec<f32> = rendered.transmittance.iter().map(|passes| 1.0 - passes).collect();
        let image = ImageRgb8 { width: view.width, height: view.height, data: rendered.to_bytes() };
        let flat = |values| PyArray1::from_vec(py, values).reshape(shape);
        let class = arrays::of_package(py, &RENDERING, "Rendering")?;
        class.call1((arrays::colour(py, image)?, flat(opacity)?, flat(rendered.depth)?))
    }

    /// The Gaussians as they stand at an instant, microseconds. A row is the same Gaussian at all instants; one that is not there has the
    /// opacity 0.
    fn gaussians<'py>(&self, py: Python<'py>, t: i64) -> PyResult<Bound<'py, PyAny>> {
        static GAUSSIANS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let t01 = self.instant(t)?;
        let degree = self.record.drawing.sh_degree;
        let cloud = py.detach(|| -> PyResult<GaussianCloud> {
            let gaussians = self.drawn()?.gaussians_at(t01).map_err(errors::raised)?;
            Ok(GaussianCloud::from(&gaussians.with_sh_degree(degree)))
        })?;
        let colours = cloud.sh_stride() / 3;
        let unit = |[w, x, y, z]: [f32; 4]| {
            let length = (w * w + x * x + y * y + z * z).sqrt().max(f32::MIN_POSITIVE);
            [w, x, y, z].map(|part| part / length)
        };
        let class = arrays::of_package(py, &GAUSSIANS, "Gaussians")?;
        let opacities: Vec<f32> = cloud.opacity_logits.iter().map(|&logit| sigmoid(logit)).collect();
        class.call1((
            arrays::table(py, cloud.positions)?,
            arrays::table(py, cloud.rotations.into_iter().map(unit).collect())?,
            arrays::table(py, cloud.log_scales.into_iter().map(|row| row.map(f32::exp)).collect())?,
            opacities.into_pyarray(py),
            PyArray1::from_vec(py, cloud.sh).reshape([self.counts[0], colours, 3])?,
        ))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> errors::Reduced<'py, (PathBuf, Option<String>)> {
        let scene = slf.get();
        Ok((slf.get_type().getattr("open")?, (scene.path.clone(), scene.adapter.clone())))
    }

    fn __repr__(&self) -> String {
        let [count, moving] = self.counts;
        let seconds = self.record.seconds();
        format!("<erfgs.Scene {}: {count} Gaussians, {moving} of them move, {seconds:.3} s>", self.path.display())
    }
}
