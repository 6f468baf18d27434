//! Asks the libraries of others (`tests/oracles/bridge.py`); the environment variable `ERFGS_ORACLES` names another Python that has them.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use serde_json::Value;

/// What others found, and the folder with the bytes.
pub struct Found {
    folder: PathBuf,
    pub all: Value,
}

/// Reads a file or a bag.
pub fn read(command: &str, path: &Path) -> Found {
    let folder = path.with_extension("found");
    std::fs::create_dir(&folder).unwrap();
    let mut python = Command::new(erfgs_recordings::python());
    python.arg(erfgs_recordings::root().join("tests/oracles/bridge.py")).arg(command).args([path, &folder]);
    let output = python.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Found { folder, all: serde_json::from_slice(&output.stdout).unwrap() }
}

impl Found {
    /// The bytes that a field of a message names.
    pub fn bytes(&self, message: &Value, field: &str) -> Vec<u8> {
        std::fs::read(self.folder.join(message[field].as_str().unwrap())).unwrap()
    }
}

/// Numbers of a list.
pub fn numbers(value: &Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap_or_else(|error| panic!("{error}: {value}"))
}

/// A list.
pub fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}
