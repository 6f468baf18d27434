//! The bodies that bend: places of their surfaces, followed through the take.

use std::path::Path;

use erfgs_base::npy;
use glam::DVec3;

use crate::{Stage, StageError, cast::Part, form::Sample, seconds, truth::bodies::colour_at};

/// Places of a body's surface at instants.
pub(crate) struct Followed {
    /// Where each is at each instant, metres: instants, places.
    pub positions: Vec<Vec<DVec3>>,
    /// How fast each moves, metres per second.
    pub velocities: Vec<Vec<DVec3>>,
    /// The colour of each, sRGB.
    pub colours: Vec<[u8; 3]>,
}

/// A place of its surface for so much of it, square metres.
const AREA: f64 = 6e-4;
const MOST: usize = 2000;
/// Velocities are differences over twice so many seconds.
const STEP: f64 = 1e-5;

/// The surface of a body at instants, nanoseconds.
pub(crate) fn followed(stage: &Stage, body: usize, times_ns: &[i64]) -> Followed {
    let surface: Vec<(&Part, Sample)> = stage
        .cast
        .parts_of(body)
        .flat_map(|part| {
            let count = ((part.form.area() / AREA) as usize).clamp(1, MOST);
            part.form.samples(count).into_iter().map(move |sample| (part, sample))
        })
        .collect();
    let at = |t: f64| -> Vec<DVec3> {
        surface.iter().map(|(part, sample)| part.form.carried(sample, &part.path.place(t))).collect()
    };
    let moving = |t: f64| {
        let pairs = at(t + STEP).into_iter().zip(at(t - STEP));
        pairs.map(|(after, before)| (after - before) / (2.0 * STEP)).collect()
    };
    let instants = || times_ns.iter().map(|&t| seconds(t));
    let places: Vec<f64> = instants().collect();
    Followed {
        positions: instants().map(at).collect(),
        velocities: instants().map(moving).collect(),
        colours: surface.iter().map(|(part, sample)| colour_at(stage, part, sample, &places)).collect(),
    }
}

/// Writes them as NumPy's arrays into a folder of the body's name.
pub(crate) fn write(folder: &Path, body: &Followed, times_ns: &[i64]) -> Result<(), StageError> {
    let (instants, places) = (body.positions.len(), body.colours.len());
    let numbers = |of: &[Vec<DVec3>]| {
        let flat: Vec<f32> = of.iter().flatten().flat_map(|v| v.as_vec3().to_array()).collect();
        npy::encode(&[instants, places, 3], flat.into_iter())
    };
    let colours: Vec<u8> = body.colours.iter().flatten().copied().collect();
    for (name, bytes) in [
        ("t_ns.npy", npy::encode(&[instants], times_ns.iter().copied())),
        ("position_m.npy", numbers(&body.positions)),
        ("velocity_m_s.npy", numbers(&body.velocities)),
        ("colour.npy", npy::encode(&[places, 3], colours.into_iter())),
    ] {
        let path = folder.join(name);
        let failed = |source| StageError::Write { path: path.clone(), source: Box::new(source) };
        std::fs::create_dir_all(folder).map_err(failed)?;
        erfgs_base::atomic::write(&path, &bytes).map_err(failed)?;
    }
    Ok(())
}
