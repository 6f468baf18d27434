//! Bodies: what moves as a few things, each with a path, a way of turning and a shape of its own.
//!
//! The moving points of the initial cloud are hulls of all that moves, one for each instant. Connected pieces of them are chained into
//! tracks through the instants (`detections`, `chains`), points go to the nearest track and centres follow them (`centres`); a smooth
//! path goes through the centres (`path`). How a thing turns is told by the colours of frames (`shades`) and by its events, which are
//! sharp if they are moved back rightly (`contrast`, `near_events`); `spin` weighs both. With its motion known, a thing is carved in its
//! own frame by the silhouettes of all instants (`carve`).

mod carve;
mod centres;
mod chains;
mod contrast;
mod detections;
mod film;
mod near_events;
mod normals;
mod path;
mod shades;
mod smooth;
mod spin;
mod turn;

use std::{collections::BTreeMap, fmt};

use erfgs_calibrate::statistics::median;
use erfgs_dataset::{Bodies, BodiesFile, Body, BodyPose, Dataset};
use glam::DVec3;
use serde_json::{Value, json};

use self::{
    carve::Place,
    centres::{Cloud, Owners, Track},
    detections::detections,
    film::Film,
    path::Path,
    shades::{Shades, Shape},
    spin::{Spin, rounded, vector},
    turn::Turn,
};
use crate::CloudError;

/// Poses are at most so far apart, seconds, and turn by at most so much from one to the next, radians.
const POSE_STEP_S: f64 = 0.004;
const POSE_TURN: f64 = 0.5;
/// More poses of one body are of no use; they are farther apart then.
const MOST_POSES: f64 = 50_000.0;
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
    let windows =
        near_events::windows(dataset, &film, &things, &|done, total| progress(BodyStep::Events, done, total))?;
    let step_s = median(film.moments.windows(2).map(|pair| pair[1].t_s - pair[0].t_s)).unwrap_or(1.0);
    let mut bodies = Vec::new();
    let mut unshaped = 0;
    for (index, track) in tracks.iter().enumerate() {
        progress(BodyStep::Rotation, index, tracks.len());
        let (shapes, path) = &things[index];
        let usual = median(shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
        let shades = if usual >= FEWEST_POINTS_THAT_TURN { Shades::new(&film, shapes) } else { None };
        let spin = spin::spin(shades.as_ref(), &windows[index], step_s);
        progress(BodyStep::Shapes, index, tracks.len());
        match assemble(&film, track, shapes, path, spin, bodies.len()) {
            Some(body) => bodies.push(body),
            None => unshaped += 1,
        }
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

/// A body of what was found; none where no shape is left.
fn assemble(film: &Film, track: &Track, shapes: &[Shape], path: &Path, spin: Spin, number: usize) -> Option<Body> {
    let best = best_seen(film, track, shapes)?;
    let turn = Turn { upright_s: film.moments[best.moment].t_s, rate: spin.rate };
    let place = |shape: &Shape| Place {
        moment: shape.moment,
        centre: shape.centre,
        rotation: turn.at(film.moments[shape.moment].t_s),
    };
    let places: Vec<Place> = shapes.iter().map(place).collect();
    // A cell of the hulls is two or three pixels wide: cells of about one, but of a thing no more than some thousand.
    let cell_m = (0.36 * film.cell_m).max(0.045 * track.radius_m);
    let carved = carve::carve(film, &best.places, &places, cell_m)?;
    let span_ns = span_ns(film, track);
    let mut found_by = spin.found_by;
    let usual = median(shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
    let facts = [
        ("instants", json!(shapes.len())),
        ("sure_instants", json!(track.sure.iter().filter(|sure| **sure).count())),
        ("hull_points", json!(usual)),
        ("radius_m", json!(rounded(track.radius_m, 4))),
        ("rate_rad_s", vector(spin.rate)),
        ("carving_agreement", json!(rounded(carved.agree, 2))),
        ("carving_cell_m", json!(rounded(carved.cell_m, 5))),
        ("best_seen_ns", json!(film.moments[best.moment].t_ns)),
    ];
    found_by.extend(facts.map(|(name, value)| (name.to_owned(), value)));
    Some(Body {
        name: format!("body{number}"),
        span_ns,
        poses: poses(film, path, &turn),
        points: carved.points,
        found_by,
    })
}

/// The instant at which a thing is seen best: surely, with about as many points as usual, about the middle of its time.
fn best_seen<'a>(film: &Film, track: &Track, shapes: &'a [Shape]) -> Option<&'a Shape> {
    let usual = median(shapes.iter().map(|shape| shape.places.len() as f64))?.max(1.0);
    let middle = median(shapes.iter().map(|shape| film.moments[shape.moment].t_s))?;
    let any_sure = shapes.iter().any(|shape| track.sure[shape.moment]);
    let odd = |shape: &Shape| {
        (shape.places.len().max(1) as f64 / usual).ln().abs() + (film.moments[shape.moment].t_s - middle).abs()
    };
    shapes.iter().filter(|shape| track.sure[shape.moment] || !any_sure).min_by(|a, b| odd(a).total_cmp(&odd(b)))
}

/// When a track is in view: half an interval beyond its ends, or as long as the recording where it is followed from end to end.
fn span_ns(film: &Film, track: &Track) -> [i64; 2] {
    let [begin, end] = film.span_ns;
    let (first, last) = (track.instants().next(), track.instants().next_back());
    let time = |moment: usize| film.moments[moment].t_ns;
    let from = match first {
        Some(first) if first > 0 => time(first) - (time(first) - time(first - 1)) / 2,
        _ => begin,
    };
    let to = match last {
        Some(last) if last + 1 < film.moments.len() => time(last) + (time(last + 1) - time(last)) / 2,
        _ => end,
    };
    [from.max(begin), to.min(end)]
}

/// The poses of a body over the whole recording.
fn poses(film: &Film, path: &Path, turn: &Turn) -> Vec<BodyPose> {
    let seconds = film.seconds();
    let step = POSE_STEP_S.min(POSE_TURN / turn.rate.length().max(1e-9)).max(seconds / MOST_POSES);
    let count = (seconds / step).ceil().max(1.0) as usize;
    let pose = |index: usize| {
        let t_s = seconds * index as f64 / count as f64;
        let rotation = turn.at(t_s);
        BodyPose {
            t_ns: film.ns(t_s),
            translation_m: path.at(t_s).to_array(),
            rotation_wxyz: [rotation.w, rotation.x, rotation.y, rotation.z],
        }
    };
    (0..=count).map(pose).collect()
}
