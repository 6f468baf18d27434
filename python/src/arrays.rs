//! What libraries hold, as arrays of NumPy: memory is handed over and not copied.

use erfgs_events::EventRows;
use erfgs_scene::{ImageGrey8, ImageRgb8};
use erfgs_sync::reading::{Picture, Samples};
use numpy::{Element, IntoPyArray, PyArray1, PyArrayMethods, ndarray::Array2};
use pyo3::{exceptions::PyValueError, prelude::*, sync::PyOnceLock};
use serde_json::Value;

/// Something that the package defines in Python.
pub fn of_package<'py>(py: Python<'py>, cell: &PyOnceLock<Py<PyAny>>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    let found = cell.get_or_try_init(py, || py.import("erfgs._types")?.getattr(name).map(Bound::unbind))?;
    Ok(found.bind(py).clone())
}

/// Settings as dictionaries, lists, numbers and texts.
pub fn plain<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (value.to_string(),))
}

/// Events as a structured array.
pub fn events(py: Python<'_>, rows: EventRows) -> PyResult<Bound<'_, PyAny>> {
    static DTYPE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    rows.into_words().into_pyarray(py).call_method1("view", (of_package(py, &DTYPE, "EVENT_DTYPE")?,))
}

/// Samples of a picture: `height` rows of `width` pixels, and a third axis where there is more than one channel.
fn picture<T: Element>(
    py: Python<'_>,
    data: Vec<T>,
    [height, width, channels]: [usize; 3],
) -> PyResult<Bound<'_, PyAny>> {
    let flat = PyArray1::from_vec(py, data);
    Ok(if channels == 1 {
        flat.reshape([height, width])?.into_any()
    } else {
        flat.reshape([height, width, channels])?.into_any()
    })
}

/// A frame.
pub fn frame(py: Python<'_>, Picture { width, height, channels, samples }: Picture) -> PyResult<Bound<'_, PyAny>> {
    let shape = [height as usize, width as usize, channels];
    match samples {
        Samples::Bits8(data) => picture(py, data, shape),
        Samples::Bits16(data) => picture(py, data, shape),
    }
}

/// A colour image.
pub fn colour(py: Python<'_>, ImageRgb8 { width, height, data }: ImageRgb8) -> PyResult<Bound<'_, PyAny>> {
    picture(py, data, [height as usize, width as usize, 3])
}

/// A grey image.
pub fn grey(py: Python<'_>, ImageGrey8 { width, height, data }: ImageGrey8) -> PyResult<Bound<'_, PyAny>> {
    picture(py, data, [height as usize, width as usize, 1])
}

/// A table of `rows` of `N` numbers.
pub fn table<T: Element, const N: usize>(py: Python<'_>, rows: Vec<[T; N]>) -> PyResult<Bound<'_, PyAny>> {
    let shape = (rows.len(), N);
    let table = Array2::from_shape_vec(shape, rows.into_iter().flatten().collect());
    Ok(table.map_err(|error| PyValueError::new_err(error.to_string()))?.into_pyarray(py).into_any())
}
