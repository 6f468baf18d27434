//! Bodies: what moves as a few things, each with a path, a way of turning and a shape of its own.
//!
//! The moving points of the initial cloud are hulls of all that moves, one for each instant. Connected pieces of them are chained into
//! tracks through the instants (`detections`, `chains`), points go to the nearest track and centres follow them (`centres`); a smooth
//! path goes through the centres (`path`). How a thing turns is told by the colours of frames (`shades`) and by its events, which are
//! sharp if they are moved back rightly (`contrast`, `near_events`); `spin` weighs both for one rate, and `varying` for rates that change.
//! With its motion known, a thing is carved in its own frame by the silhouettes of all instants (`carve`). Rates that are a little wrong
//! add up: so it is followed by its own looks from the instant at which it is seen best (`grow`). With that shape its events are looked
//! at again (`refine`), which tell how it gets from one instant to the next.

mod carve;
mod centres;
mod chains;
mod contrast;
mod detections;
mod draft;
mod film;
mod grow;
mod near_events;
mod normals;
mod path;
mod refine;
mod shades;
mod smooth;
mod spin;
mod turn;
mod varying;

use std::{collections::BTreeMap, fmt};

use erfgs_calibrate::statistics::median;
use erfgs_dataset::{Bodies, BodiesFile, Body, Dataset};
use glam::DVec3;
use serde_json::{Value, json};

use self::{
    centres::{Cloud, Owners, Track},
    detections::detections,
    draft::Draft,
    film::Film,
    near_events::Subject,
    path::Path,
    shades::{Shades, Shape},
    spin::rounded,
    varying::Evidence,
};
use crate::CloudError;

/// With fewer points than this at most instants, how a thing turns is not asked of frames.
const FEWEST_POINTS_THAT_TURN: f64 = 60.0;

/// What the finding of bodies is busy with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BodyStep {
    /// Reading frames and making silhouettes.
    Frames,
    /// Tracks of moving points.
    Tracks,
    /// Reading events near what moves.
    Events,
    /// How bodies turn.
    Rotation,
    /// Shapes of bodies.
    Shapes,
}

impl fmt::Display for BodyStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Frames => "frames",
            Self::Tracks => "tracks",
            Self::Events => "events",
            Self::Rotation => "rotation",
            Self::Shapes => "shapes",
        })
    }
}

/// Is told how far the finding of bodies has come: the step, and how many of its items are done. May be called from several threads.
pub type BodyProgress<'a> = &'a (dyn Fn(BodyStep, usize, usize) + Sync);

/// The bodies of a dataset and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundBodies {
    /// The bodies.
    pub bodies: Vec<Body>,
    /// What was counted on the way, for the manifest: instants, moving points, and those that no body explains.
    pub parameters: BTreeMap<String, Value>,
}

/// Finds what moves as bodies, by the moving points of the initial cloud, frames and events.
///
/// # Errors
/// No initial points of what moves, nothing that could be followed, frames or events that cannot be read: see [`CloudError`].
pub fn find_bodies(dataset: &Dataset, progress: BodyProgress<'_>) -> Result<FoundBodies, CloudError> {
    let film = Film::read(dataset, &|done, total| progress(BodyStep::Frames, done, total))?;
    progress(BodyStep::Tracks, 0, 1);
    let (tracks, owners) = tracks(&film);
    if tracks.is_empty() {
        return Err(CloudError::NoBodies { instants: film.moments.len() });
    }
    let things: Vec<(Vec<Shape>, Path)> = tracks
        .iter()
        .enumerate()
        .map(|(index, track)| (shapes(&film, track, &owners, index), path(&film, track)))
        .collect();
    progress(BodyStep::Tracks, 1, 1);
    let reading = |done, total| progress(BodyStep::Events, done, total);
    let mut subjects = Vec::new();
    for (thing, (shapes, path)) in things.iter().enumerate() {
        subjects.extend(shapes.iter().map(|shape| Subject::of_hull(&film, thing, shape, path)));
    }
    let windows = near_events::windows(dataset, &film, &subjects, things.len(), &reading)?;
    drop(subjects);
    let step_s = median(film.moments.windows(2).map(|pair| pair[1].t_s - pair[0].t_s)).unwrap_or(1.0);
    let mut drafts = Vec::new();
    for (index, track) in tracks.iter().enumerate() {
        progress(BodyStep::Rotation, index, tracks.len());
        let (shapes, path) = &things[index];
        let usual = median(shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
        let shades = if usual >= FEWEST_POINTS_THAT_TURN { Shades::new(&film, shapes) } else { None };
        let all: Vec<_> = windows[index].values().flatten().collect();
        let spin = spin::spin(shades.as_ref(), &all, step_s);
        let instants = shapes.iter().map(|shape| (shape.moment, film.moments[shape.moment].t_s)).collect();
        let evidence = Evidence { shades: shades.as_ref(), windows: &windows[index], instants };
        let rates = varying::varying(&evidence, spin.rate);
        progress(BodyStep::Shapes, index, tracks.len());
        drafts.extend(Draft::new(&film, track, shapes, path.clone(), spin, rates));
    }
    let subjects: Vec<Subject<'_>> =
        drafts.iter().enumerate().flat_map(|(index, draft)| draft.subjects(&film, 2 * index, step_s)).collect();
    let again = near_events::windows(dataset, &film, &subjects, 2 * drafts.len(), &reading)?;
    drop(subjects);
    let mut bodies = Vec::new();
    let (count, unshaped) = (drafts.len(), tracks.len() - drafts.len());
    for (index, (mut draft, windows)) in std::iter::zip(drafts, again.as_chunks().0).enumerate() {
        progress(BodyStep::Shapes, index, count);
        draft.look_again(&film, windows);
        bodies.push(draft.body(&film, bodies.len()));
    }
    progress(BodyStep::Shapes, tracks.len(), tracks.len());
    if bodies.is_empty() {
        return Err(CloudError::NoBodies { instants: film.moments.len() });
    }
    let points = owners.iter().map(Vec::len).sum::<usize>();
    let owned = owners.iter().flatten().filter(|owner| owner.is_some()).count();
    let parameters = BTreeMap::from([
        ("instants".into(), json!(film.moments.len())),
        ("spacing_m".into(), json!(rounded(film.cell_m, 5))),
        ("moving_points".into(), json!(points)),
        ("moving_points_without_body".into(), json!(points - owned)),
        ("tracks_without_shape".into(), json!(unshaped)),
    ]);
    Ok(FoundBodies { bodies, parameters })
}

/// Writes `bodies.json` into the dataset's folder and names it in the manifest, which is saved.
///
/// # Errors
/// When a file cannot be written.
pub fn attach_bodies(dataset: &mut Dataset, found: &FoundBodies) -> Result<BodiesFile, CloudError> {
    dataset.set_bodies(&Bodies::new(found.bodies.clone()), found.parameters.clone())?;
    if !dataset.manifest.sha256.is_empty() {
        dataset.hash_files()?;
    }
    dataset.save()?;
    let count = found.bodies.len() as u64;
    Ok(BodiesFile { file: Bodies::FILE.into(), count, parameters: found.parameters.clone() })
}

fn tracks(film: &Film) -> (Vec<Track>, Owners) {
    let clouds: Vec<Cloud<'_>> =
        film.moments.iter().map(|moment| Cloud { points: &moment.points, colours: &moment.colours }).collect();
    let times: Vec<f64> = film.moments.iter().map(|moment| moment.t_s).collect();
    let found: Vec<_> = clouds.iter().map(|cloud| detections(cloud.points, cloud.colours, film.cell_m)).collect();
    centres::follow(&chains::chains(&found, &times), &found, &clouds, &times, film.cell_m)
}

/// The points of a track at each of its instants, about its centre.
fn shapes(film: &Film, track: &Track, owners: &Owners, index: usize) -> Vec<Shape> {
    let shape = |moment: usize| {
        let Moments { points, colours } = Moments::of(film, moment);
        let members = owners[moment].iter().enumerate().filter(|(_, owner)| **owner == Some(index));
        Some(Shape::new(moment, track.centres[moment]?, members.map(|(at, _)| (points[at], colours[at]))))
    };
    track.instants().filter_map(shape).collect()
}

struct Moments<'a> {
    points: &'a [DVec3],
    colours: &'a [[u8; 3]],
}

impl<'a> Moments<'a> {
    fn of(film: &'a Film, moment: usize) -> Self {
        Self { points: &film.moments[moment].points, colours: &film.moments[moment].colours }
    }
}

fn path(film: &Film, track: &Track) -> Path {
    let times: Vec<f64> = film.moments.iter().map(|moment| moment.t_s).collect();
    let (times, places) = track.places(&times);
    Path::new(times, places)
}
