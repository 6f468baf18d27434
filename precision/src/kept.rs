//! What was measured before, so that hours of settings go on where they stopped.

use std::{
    collections::HashMap,
    fs::{File, OpenOptions},
    io::Write as _,
    path::Path,
};

use erfgs_base::FileError;
use serde::{Deserialize, Serialize};

use crate::Spent;

/// A line of the file.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    /// Program and adapter that measured.
    by: String,
    component: String,
    /// The setting as the program knows it.
    setting: String,
    spent: Spent,
}

/// Settings that were measured, each a line of a file that grows.
#[derive(Debug, Default)]
pub struct Kept {
    by: String,
    known: HashMap<(String, String), Spent>,
    file: Option<File>,
}

impl Kept {
    /// Those in the file that were measured `by` the same program and adapter; from now on what is measured is added to it. A line that
    /// was cut off does not count.
    ///
    /// # Errors
    /// [`FileError`] where the file cannot be read or written.
    pub fn open(path: &Path, by: &str) -> Result<Self, FileError> {
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(FileError::when("read", path)(error)),
        };
        let lines = text.lines().filter_map(|line| serde_json::from_str::<Line>(line).ok());
        let known =
            lines.filter(|line| line.by == by).map(|line| ((line.component, line.setting), line.spent)).collect();
        let mut file =
            OpenOptions::new().create(true).append(true).open(path).map_err(FileError::when("write", path))?;
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n").map_err(FileError::when("write", path))?;
        }
        Ok(Self { by: by.to_owned(), known, file: Some(file) })
    }

    /// How many there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.known.len()
    }

    pub(crate) fn get(&self, component: &str, setting: &str) -> Option<Spent> {
        self.known.get(&(component.to_owned(), setting.to_owned())).cloned()
    }

    /// Keeps what came of a setting. A disk that is full loses no more than that: it would be measured again.
    pub(crate) fn add(&mut self, component: &str, setting: &str, spent: &Spent) {
        let Some(file) = &mut self.file else { return };
        let (by, component, setting) = (self.by.clone(), component.to_owned(), setting.to_owned());
        let Ok(mut line) = serde_json::to_string(&Line { by, component, setting, spent: spent.clone() }) else {
            return;
        };
        line.push('\n');
        let _ = file.write_all(line.as_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spent(error: f64) -> Spent {
        Spent { errors: vec![error], cpu_seconds: 0.1, cpu_range: [0.05, 1.0 / 3.0], wall_seconds: 0.1, runs: 3 }
    }

    #[test]
    fn what_was_measured_is_found_again_but_for_a_line_that_was_cut() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("kept.jsonl");
        let mut kept = Kept::open(&path, "1, a card").expect("a file");
        assert_eq!(kept.count(), 0);
        kept.add("clock", "{ knots: 1 }", &spent(0.5));
        kept.add("clock", "{ knots: 2 }", &spent(0.25));
        let text = std::fs::read_to_string(&path).expect("lines");
        std::fs::write(&path, &text[..text.len() - 10]).expect("a cut file");
        let mut again = Kept::open(&path, "1, a card").expect("a file");
        assert_eq!((again.count(), again.get("clock", "{ knots: 1 }")), (1, Some(spent(0.5))));
        assert_eq!(again.get("field", "{ knots: 1 }"), None);
        again.add("clock", "{ knots: 2 }", &spent(0.125));
        let whole = Kept::open(&path, "1, a card").expect("a file");
        assert_eq!((whole.count(), whole.get("clock", "{ knots: 2 }")), (2, Some(spent(0.125))));
        // Another adapter's time is another's.
        assert_eq!(Kept::open(&path, "1, another card").expect("a file").count(), 0);
    }
}
