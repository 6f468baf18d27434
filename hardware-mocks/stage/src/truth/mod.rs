//! What is true of what moves: paths and surfaces of the bodies, and which body each pixel shows.
//!
//! | file | what it holds |
//! |---|---|
//! | `truth/bodies.json` | the rigid bodies, as [`erfgs_dataset::Bodies`] describes them |
//! | `truth/bending/NAME/*.npy` | a body that bends, at the instants of the held-out frames: `t_ns` (instants), `position_m` and `velocity_m_s` (instants, places, 3), `colour` (places, 3) (sRGB); a place is the same bit of the surface at every instant |
//! | `truth/labels.json` | the names of all bodies, in the order of their labels, and which of them are rigid |
//! | `truth/labels/CAMERA/00000.png` | for each frame of a held-out camera the label of the body that each pixel shows: 0 for none |

mod bending;
mod bodies;

pub use bodies::truth_bodies;

use std::path::Path;

use serde::Serialize;

use super::{Stage, StageError};

/// The folder of the truth in a dataset's folder.
pub const TRUTH: &str = "truth";

/// What `truth/labels.json` says of a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Labelled {
    /// Its label in pictures of labels.
    pub label: u8,
    /// Its name.
    pub name: String,
    /// Whether its shape stays as it is.
    pub rigid: bool,
}

/// The bodies of a stage by their labels, which begin at 1.
#[must_use]
pub fn labelled(stage: &Stage) -> Vec<Labelled> {
    let of = |(index, body): (usize, &crate::cast::Body)| Labelled {
        label: label(index),
        name: body.name.clone(),
        rigid: body.rigid,
    };
    stage.cast.bodies.iter().enumerate().map(of).collect()
}

/// The label of a body by its number: there are fewer bodies than labels.
pub(crate) fn label(body: usize) -> u8 {
    u8::try_from(body + 1).unwrap_or(u8::MAX)
}

/// Writes what is true of a stage's bodies over a span of nanoseconds into the folder of a dataset; of what bends at these instants.
pub(crate) fn write(out: &Path, stage: &Stage, span_ns: [i64; 2], times_ns: &[i64]) -> Result<(), StageError> {
    let folder = out.join(TRUTH);
    let json = |name: &str, value: serde_json::Result<Vec<u8>>| {
        let path = folder.join(name);
        let failed =
            |source: Box<dyn std::error::Error + Send + Sync>| StageError::Write { path: path.clone(), source };
        let mut text = value.map_err(|error| failed(Box::new(error)))?;
        text.push(b'\n');
        std::fs::create_dir_all(&folder).map_err(|error| failed(Box::new(error)))?;
        erfgs_base::atomic::write(&path, &text).map_err(|error| failed(Box::new(error)))
    };
    json(erfgs_dataset::Bodies::FILE, serde_json::to_vec(&truth_bodies(stage, span_ns)))?;
    for (number, body) in stage.cast.bodies.iter().enumerate().filter(|(_, body)| !body.rigid) {
        let followed = bending::followed(stage, number, times_ns);
        bending::write(&folder.join("bending").join(&body.name), &followed, times_ns)?;
    }
    json("labels.json", serde_json::to_vec_pretty(&labelled(stage)))
}
