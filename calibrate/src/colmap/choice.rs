//! How a user names the COLMAP to use.

use std::{convert::Infallible, path::PathBuf, str::FromStr};

use serde::{Deserialize, Serialize};

/// Which COLMAP does the work.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub enum ColmapProgram {
    /// `colmap` on the PATH; without one, a Python with pycolmap.
    #[default]
    Auto,
    /// This program (3.8 or 4.x).
    Binary(PathBuf),
    /// pycolmap 4.x, run by this Python; without one, by `$ERFGS_PYTHON` or the `python3` on the PATH.
    Pycolmap(Option<PathBuf>),
}

impl FromStr for ColmapProgram {
    type Err = Infallible;

    /// `auto`, `pycolmap`, `pycolmap:PYTHON` or the path of a program.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self::from(text.to_owned()))
    }
}

impl From<String> for ColmapProgram {
    fn from(text: String) -> Self {
        match text.as_str() {
            "" | "auto" => Self::Auto,
            "pycolmap" => Self::Pycolmap(None),
            other => match other.strip_prefix("pycolmap:") {
                Some(python) => Self::Pycolmap(Some(python.into())),
                None => Self::Binary(other.into()),
            },
        }
    }
}

impl From<ColmapProgram> for String {
    fn from(program: ColmapProgram) -> Self {
        match program {
            ColmapProgram::Auto => "auto".into(),
            ColmapProgram::Binary(path) => path.display().to_string(),
            ColmapProgram::Pycolmap(None) => "pycolmap".into(),
            ColmapProgram::Pycolmap(Some(python)) => format!("pycolmap:{}", python.display()),
        }
    }
}
