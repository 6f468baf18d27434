//! A camera of a rig or a dataset: its lens, and where it stands.

use std::sync::OnceLock;

use erfgs_scene::{
    Distortion, ImageGrey8, ImageRgb8, Intrinsics, Modality, Pose,
    undistort::{Undistortion, pinhole},
};
use glam::{DVec2, DVec3};
use numpy::{AllowTypeChange, PyArrayLike2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::{exceptions::PyValueError, prelude::*, types::PyDict};

use crate::{arrays, errors};

type Points<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

/// A camera: OpenCV's axes (x right, y down, z forward), metres, pixels whose centres lie at half-integers: that of the top-left pixel is
/// (0.5, 0.5).
#[pyclass(frozen, module = "erfgs")]
pub struct Camera {
    pub name: String,
    pub modality: Modality,
    pub intrinsics: Intrinsics,
    pub pose: Option<Pose>,
    /// Standard deviations: centre (metres), rotation (degrees).
    pub sigma: Option<[[Option<f64>; 3]; 2]>,
    pub intrinsics_sigma: Vec<(String, Option<f64>)>,
    pub time_offset_s: f64,
    pub undistortion: OnceLock<(Intrinsics, Undistortion)>,
}

pub fn modality(modality: Modality) -> &'static str {
    match modality {
        Modality::Rgb => "rgb",
        Modality::Event => "event",
        Modality::Both => "both",
    }
}

/// Rows of `N` numbers.
fn rows<const N: usize>(points: &Points<'_>, what: &str) -> PyResult<Vec<[f64; N]>> {
    let points = points.as_array();
    if points.ncols() != N {
        return Err(PyValueError::new_err(format!("{what} have shape (n, {N}), these {:?}", points.shape())));
    }
    Ok(points.rows().into_iter().map(|row| std::array::from_fn(|at| row[at])).collect())
}

impl Camera {
    /// Its pose; an error where nobody knows it.
    pub fn stands(&self) -> PyResult<&Pose> {
        self.pose.as_ref().ok_or_else(|| {
            errors::Error::new_err(format!("nobody knows where camera {} stands; calibrate the rig", self.name))
        })
    }

    fn undistortion(&self) -> PyResult<&(Intrinsics, Undistortion)> {
        if self.undistortion.get().is_none() {
            let (to, _) = pinhole(&self.intrinsics).map_err(|error| {
                errors::Error::new_err(format!("camera {}: {error}; calibrate it again", self.name))
            })?;
            // Whoever came first has made the same.
            let _ = self.undistortion.set((to, Undistortion::new(&self.intrinsics, &to)));
        }
        self.undistortion.get().ok_or_else(|| errors::Error::new_err("the lens was not replaced"))
    }
}

#[pymethods]
impl Camera {
    /// Name, as in the recording.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// What it records: "rgb", "event" or "both".
    #[getter]
    fn modality(&self) -> &'static str {
        modality(self.modality)
    }

    /// Columns, pixels.
    #[getter]
    fn width(&self) -> u32 {
        self.intrinsics.width
    }

    /// Rows, pixels.
    #[getter]
    fn height(&self) -> u32 {
        self.intrinsics.height
    }

    /// The camera matrix, float64 of shape (3, 3), pixels.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        arrays::table(py, vec![[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    }

    /// The model of the lens: "pinhole", "brown-conrady" or "kannala-brandt".
    #[getter]
    fn model(&self) -> &'static str {
        match self.intrinsics.distortion {
            Distortion::None => "pinhole",
            Distortion::BrownConrady(_) => "brown-conrady",
            Distortion::KannalaBrandt(_) => "kannala-brandt",
        }
    }

    /// The coefficients of the model in OpenCV's order: none, 8 (k1, k2, p1, p2, k3, k4, k5, k6) or 4 (k1, k2, k3, k4).
    #[getter]
    fn coefficients(&self) -> Vec<f64> {
        match self.intrinsics.distortion {
            Distortion::None => Vec::new(),
            Distortion::BrownConrady(of) => of.to_vec(),
            Distortion::KannalaBrandt(of) => of.to_vec(),
        }
    }

    /// Whether its pose is known.
    #[getter]
    fn has_pose(&self) -> bool {
        self.pose.is_some()
    }

    /// World-to-camera rotation, float64 of shape (3, 3).
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let columns = glam::DMat3::from_quat(self.stands()?.rotation).transpose();
        arrays::table(py, columns.to_cols_array_2d().to_vec())
    }

    /// World-to-camera translation (x, y, z), metres.
    #[getter]
    fn translation(&self) -> PyResult<(f64, f64, f64)> {
        Ok(self.stands()?.translation.into())
    }

    /// The centre of projection (x, y, z) in the world, metres.
    #[getter]
    fn centre(&self) -> PyResult<(f64, f64, f64)> {
        Ok(self.stands()?.inverse().translation.into())
    }

    /// What to add to the camera's times to get the rig's, microseconds.
    #[getter]
    fn time_offset(&self) -> f64 {
        1e6 * self.time_offset_s
    }

    /// Standard deviations where the calibration tells them: "centre" (x, y, z; metres), "rotation" (about the camera's axes; degrees),
    /// and those of the intrinsics by their names; None for what it does not tell.
    #[getter]
    fn sigma<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = PyDict::new(py);
        if let Some([centre, rotation]) = self.sigma {
            found.set_item("centre", <(_, _, _)>::from(centre))?;
            found.set_item("rotation", <(_, _, _)>::from(rotation))?;
        }
        for (name, sigma) in &self.intrinsics_sigma {
            found.set_item(name, sigma)?;
        }
        Ok(found)
    }

    /// The pixels that see points of the world: float64 of shape (n, 3), metres, to float64 of shape (n, 2), through the lens. NaN where
    /// a point lies behind the camera or where the model of the lens does not hold; pixels may lie outside of the image.
    fn project<'py>(&self, py: Python<'py>, points: Points<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (pose, points) = (*self.stands()?, rows::<3>(&points, "points")?);
        let project = |point: [f64; 3]| {
            let seen = self.intrinsics.project(pose.transform(DVec3::from(point)));
            seen.unwrap_or(DVec2::NAN).to_array()
        };
        let pixels = py.detach(|| points.into_iter().map(project).collect());
        arrays::table(py, pixels)
    }

    /// The rays that meet pixels, float64 of shape (n, 2): their directions in the world, float64 of shape (n, 3) and length 1, from
    /// `centre`. NaN where the model of the lens does not hold.
    fn rays<'py>(&self, py: Python<'py>, pixels: Points<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (turn, pixels) = (self.stands()?.rotation.inverse(), rows::<2>(&pixels, "pixels")?);
        let ray = |pixel: [f64; 2]| {
            let ray = self.intrinsics.unproject(DVec2::from(pixel)).map(|ray| turn * ray);
            ray.unwrap_or(DVec3::NAN).to_array()
        };
        let rays = py.detach(|| pixels.into_iter().map(ray).collect());
        arrays::table(py, rays)
    }

    /// The same camera with a lens that does not distort, whose pixels this one saw all: what `undistort` makes pictures of.
    fn pinhole(&self) -> PyResult<Self> {
        let (to, _) = self.undistortion()?;
        Ok(Self {
            name: self.name.clone(),
            modality: self.modality,
            intrinsics: *to,
            pose: self.pose,
            sigma: self.sigma,
            intrinsics_sigma: Vec::new(),
            time_offset_s: self.time_offset_s,
            undistortion: OnceLock::new(),
        })
    }

    /// A picture of this camera, uint8 of shape (height, width) or (height, width, 3), as `pinhole()` would have taken it.
    fn undistort<'py>(&self, py: Python<'py>, image: PyReadonlyArrayDyn<'py, u8>) -> PyResult<Bound<'py, PyAny>> {
        let (width, height) = (self.intrinsics.width, self.intrinsics.height);
        let wanted = [height as usize, width as usize, 3];
        let data: Vec<u8> = image.as_array().iter().copied().collect();
        let shape = image.shape().to_vec();
        let (_, undistortion) = self.undistortion()?;
        if shape == wanted {
            let picture = py.detach(|| undistortion.picture(&ImageRgb8 { width, height, data }));
            arrays::colour(py, picture)
        } else if shape == wanted[..2] {
            let picture = py.detach(|| undistortion.grey(&ImageGrey8 { width, height, data }));
            arrays::grey(py, picture)
        } else {
            Err(PyValueError::new_err(format!(
                "pictures of camera {} have shape ({height}, {width}) or ({height}, {width}, 3), this one {shape:?}",
                self.name
            )))
        }
    }

    /// Where pixels of this camera lie in pictures of `pinhole()`: float64 of shape (n, 2) both, NaN where the model of the lens does
    /// not hold. For events: `np.stack([e["x"], e["y"]], 1) + 0.5`.
    fn undistort_pixels<'py>(&self, py: Python<'py>, pixels: Points<'py>) -> PyResult<Bound<'py, PyAny>> {
        let pixels = rows::<2>(&pixels, "pixels")?;
        let (to, _) = self.undistortion()?;
        let place = |pixel: [f64; 2]| {
            let ray = self.intrinsics.unproject(DVec2::from(pixel)).ok();
            ray.and_then(|ray| to.project(ray)).unwrap_or(DVec2::NAN).to_array()
        };
        let places = py.detach(|| pixels.into_iter().map(place).collect());
        arrays::table(py, places)
    }

    fn __repr__(&self) -> String {
        let Intrinsics { width, height, .. } = self.intrinsics;
        format!("<erfgs.Camera {}: {width} x {height} pixels, {}>", self.name, self.model())
    }
}
