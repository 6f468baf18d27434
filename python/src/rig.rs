//! Calibrated rigs.

use std::path::PathBuf;

use erfgs_scene::rig_file::{RigCamera, RigFile};
use pyo3::{prelude::*, types::PyDict};

use crate::{errors, lens::Camera};

/// A calibrated rig: `rig.json`. As a mapping it gives its cameras by their names; it pickles as the file's name.
#[pyclass(frozen, mapping, module = "erfgs")]
pub struct Rig {
    path: PathBuf,
    file: RigFile,
}

fn camera(of: &RigCamera) -> Camera {
    let sigma = of.sigma.as_ref();
    Camera {
        name: of.name.clone(),
        modality: of.modality,
        intrinsics: of.intrinsics,
        pose: of.pose,
        sigma: sigma.map(|sigma| [sigma.centre_m, sigma.rotation_deg]),
        intrinsics_sigma: sigma.into_iter().flat_map(|sigma| sigma.intrinsics.clone()).collect(),
        time_offset_s: of.time_offset_s,
        undistortion: std::sync::OnceLock::new(),
    }
}

#[pymethods]
impl Rig {
    /// Reads a rig file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let file = py.detach(|| RigFile::read(&path)).map_err(errors::raised)?;
        Ok(Self { path, file })
    }

    /// The file's name.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// How it was made: "board", "wand", "sfm", or the format that it was converted from.
    #[getter]
    fn method(&self) -> &str {
        &self.file.method
    }

    /// Whether lengths are metres; a rig from images alone has no scale.
    #[getter]
    fn is_metric(&self) -> bool {
        self.file.metric
    }

    /// Root mean square reprojection error over all cameras, pixels; None where it was converted.
    #[getter]
    fn rms(&self) -> Option<f64> {
        self.file.quality.as_ref().map(|quality| quality.rms_px)
    }

    /// What should be known before relying on it, of the rig and of its cameras.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        let of_cameras = self.file.cameras.iter();
        let of_cameras = of_cameras
            .flat_map(|camera| camera.warnings.iter().map(move |warning| format!("{}: {warning}", camera.name)));
        self.file.warnings.iter().cloned().chain(of_cameras).collect()
    }

    /// The cameras by their names.
    #[getter]
    fn cameras<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let cameras = PyDict::new(py);
        for of in &self.file.cameras {
            cameras.set_item(&of.name, camera(of))?;
        }
        Ok(cameras)
    }

    fn __getitem__(&self, name: &str) -> PyResult<Camera> {
        let known = || self.file.cameras.iter().map(|camera| camera.name.as_str());
        self.file.camera(name).map(camera).ok_or_else(|| errors::no_camera(&self.path, name, known()))
    }

    fn __contains__(&self, name: &str) -> bool {
        self.file.camera(name).is_some()
    }

    fn __len__(&self) -> usize {
        self.file.cameras.len()
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.cameras(py)?.call_method0("__iter__")
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> errors::Reduced<'py, (PathBuf,)> {
        Ok((slf.get_type().getattr("load")?, (slf.get().path.clone(),)))
    }

    fn __repr__(&self) -> String {
        let names: Vec<&str> = self.file.cameras.iter().map(|camera| camera.name.as_str()).collect();
        format!("<erfgs.Rig {}: {}>", self.path.display(), names.join(", "))
    }
}
