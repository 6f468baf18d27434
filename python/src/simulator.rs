//! An event camera that looks at frames.

use std::sync::{Mutex, PoisonError};

use erfgs_events::{EventRows, Events};
use erfgs_replay::{Luma, SimulatorConfig, SimulatorError, simulator::camera_key};
use erfgs_scene::ImageRgb8;
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::{
    exceptions::{PyTypeError, PyValueError},
    prelude::*,
    types::{PyDict, PyFloat},
};
use serde_json::{Map, Value};

use crate::{arrays, errors};

/// Times before and after this, microseconds, are not those of a recording.
const FARTHEST_US: f64 = 9e15;

/// An event camera that is fed frames: `erfgs simulate`, frame by frame. preset: "noiseless", or v2e's "clean" and "noisy"; seed and camera
/// name its random numbers, those of cameras of other names differ. Parameters replace those of the preset: mode ("parity", v2e's model, or
/// "enhanced", with exact crossing times), threshold_on, threshold_off, sigma (natural-log intensity), cutoff_hz, leak_hz, leak_jitter,
/// leak_cov_decades, shot_hz, refractory_s; and in mode "enhanced" event_sigma, hot_fraction, hot_hz, linear_light. `parameters` has all.
#[pyclass(frozen, module = "erfgs")]
pub struct Simulator {
    width: u32,
    height: u32,
    config: SimulatorConfig,
    sensor: Mutex<erfgs_replay::Simulator>,
}

/// A frame as it is given.
#[derive(FromPyObject)]
enum Levels<'py> {
    Bytes(PyReadonlyArrayDyn<'py, u8>),
    Floats(PyReadonlyArrayDyn<'py, f32>),
    Other(Bound<'py, PyAny>),
}

/// Its grey levels.
enum Grey {
    Bytes(Vec<u8>),
    Floats(Vec<f32>),
}

impl Levels<'_> {
    fn grey(&self, width: u32, height: u32) -> PyResult<Grey> {
        let grey = [height as usize, width as usize];
        let colour = [grey[0], grey[1], 3];
        let shape = match self {
            Self::Bytes(frame) => frame.shape(),
            Self::Floats(frame) => frame.shape(),
            Self::Other(other) => {
                return Err(PyTypeError::new_err(format!(
                    "a frame is an array of uint8 or float32, this is a {}",
                    other.get_type()
                )));
            }
        };
        match self {
            Self::Bytes(frame) if shape == grey => Ok(Grey::Bytes(frame.as_array().iter().copied().collect())),
            Self::Bytes(frame) if shape == colour => {
                let picture = ImageRgb8 { width, height, data: frame.as_array().iter().copied().collect() };
                Ok(Grey::Floats(picture.luma()))
            }
            Self::Floats(frame) if shape == grey => Ok(Grey::Floats(frame.as_array().iter().copied().collect())),
            _ => Err(PyValueError::new_err(format!(
                "frames have shape {grey:?}, or {colour:?} of uint8; this one has {shape:?}"
            ))),
        }
    }
}

/// The preset with what is given in its place.
fn config(preset: &str, seed: u64, given: Option<&Bound<'_, PyDict>>) -> PyResult<SimulatorConfig> {
    let presets = SimulatorConfig::PRESETS.join(", ");
    let unknown = || PyValueError::new_err(format!("there is no preset '{preset}'; there are {presets}"));
    let preset = SimulatorConfig { seed, ..SimulatorConfig::preset(preset).ok_or_else(unknown)? };
    let Some(given) = given else { return Ok(preset) };
    let py = given.py();
    let options = PyDict::new(py);
    options.set_item("default", py.get_type::<PyFloat>())?;
    let text: String = py.import("json")?.call_method("dumps", (given,), Some(&options))?.extract()?;
    let refused =
        |error: serde_json::Error| PyValueError::new_err(format!("the event simulator's parameters: {error}"));
    let given: Map<String, Value> = serde_json::from_str(&text).map_err(refused)?;
    let mut all = serde_json::to_value(&preset).map_err(refused)?;
    for (name, value) in given {
        match all.get_mut(&name).filter(|_| name != "seed") {
            Some(of_preset) => *of_preset = value,
            None => {
                let known: Vec<&String> = all.as_object().into_iter().flat_map(Map::keys).collect();
                return Err(PyTypeError::new_err(format!(
                    "the event simulator has no parameter '{name}'; there are {known:?}"
                )));
            }
        }
    }
    serde_json::from_value(all).map_err(refused)
}

#[pymethods]
impl Simulator {
    #[new]
    #[pyo3(signature = (width, height, preset="noiseless", *, seed=0, camera="", **parameters))]
    fn new(
        width: u32,
        height: u32,
        preset: &str,
        seed: u64,
        camera: &str,
        parameters: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let config = config(preset, seed, parameters)?;
        let key = if camera.is_empty() { 0 } else { camera_key(camera) };
        let sensor = erfgs_replay::Simulator::new(width, height, &config, key).map_err(errors::raised)?;
        Ok(Self { width, height, config, sensor: Mutex::new(sensor) })
    }

    /// All parameters, by their names.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        arrays::plain(py, &serde_json::to_value(&self.config).map_err(errors::raised)?)
    }

    /// The events since the frame before, of this one at time t (microseconds, fractions count): a structured array of `EVENT_DTYPE`, in the
    /// order of time, then row, then column. The first frame makes none. frame: uint8 of shape (height, width) or, with red, green and blue,
    /// (height, width, 3), of which the luma counts; or float32 of shape (height, width), 0 to 255 and above.
    fn step<'py>(&self, py: Python<'py>, frame: Levels<'py>, t: f64) -> PyResult<Bound<'py, PyAny>> {
        if !(-FARTHEST_US..=FARTHEST_US).contains(&t) {
            return Err(PyValueError::new_err(format!("{t} is no time: microseconds are wanted")));
        }
        let t_ns = (t * 1e3).round() as i64;
        let (width, height) = (self.width, self.height);
        let grey = frame.grey(width, height)?;
        let rows = py.detach(|| {
            let mut events = Events::new(width, height);
            let luma = match &grey {
                Grey::Bytes(levels) => Luma::U8(levels),
                Grey::Floats(levels) => Luma::F32(levels),
            };
            self.sensor.lock().unwrap_or_else(PoisonError::into_inner).step(luma, t_ns, &mut events)?;
            let mut rows = EventRows::with_capacity(events.len());
            rows.extend(events.iter());
            Ok(rows)
        });
        arrays::events(py, rows.map_err(|error: SimulatorError| errors::raised(error))?)
    }

    fn __repr__(&self) -> String {
        let (threshold_on, threshold_off) = (self.config.threshold_on, self.config.threshold_off);
        format!(
            "<erfgs.Simulator: {} x {} pixels, thresholds {threshold_on} and {threshold_off}>",
            self.width, self.height
        )
    }
}
