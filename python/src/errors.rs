//! Errors and warnings of the libraries, in their own words.

use std::{error::Error as StdError, ffi::CString, path::Path};

use pyo3::{
    create_exception,
    exceptions::{PyException, PyKeyError, PyUserWarning},
    prelude::*,
};

create_exception!(erfgs, Error, PyException, "What a file or a device is refused for, and what to do about it.");
create_exception!(
    erfgs,
    DamageWarning,
    PyUserWarning,
    "A part of a recording was passed over: it is damaged, or has no time."
);

/// How an object pickles: what is called with which arguments to make it again.
pub type Reduced<'py, A> = PyResult<(Bound<'py, PyAny>, A)>;

/// The message with those of its causes that it does not quote.
fn words(error: &dyn StdError) -> String {
    let mut words = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let message = error.to_string();
        if !words.contains(&message) {
            words = format!("{words}: {message}");
        }
        cause = error.source();
    }
    words
}

/// An error of a library as an exception.
pub fn raised(error: impl StdError) -> PyErr {
    Error::new_err(words(&error))
}

/// That something has no camera of this name, but those that are `known`.
pub fn no_camera<'a>(of: &Path, name: &str, known: impl Iterator<Item = &'a str>) -> PyErr {
    let known = known.collect::<Vec<_>>().join(", ");
    PyKeyError::new_err(format!("{} has no camera '{name}'; there are {known}", of.display()))
}

/// Warns of what was passed over.
pub fn warn(py: Python<'_>, messages: Vec<String>) -> PyResult<()> {
    let category = py.get_type::<DamageWarning>();
    for message in messages {
        let message = CString::new(message.replace('\0', " "))?;
        PyErr::warn(py, &category, &message, 1)?;
    }
    Ok(())
}
