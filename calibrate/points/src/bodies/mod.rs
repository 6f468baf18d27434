//! Bodies: what moves as a few things, each with a path, a way of turning and a shape of its own.
//!
//! The moving points of the initial cloud are hulls of all that moves, one for each instant. Connected pieces of them are chained into
//! tracks through the instants (`detections`, `chains`), points go to the nearest track and centres follow them (`centres`); a smooth
//! path goes through the centres (`path`). How a thing turns is told by the colours of frames (`shades`) and by its events, which are
//! sharp if they are moved back rightly (`contrast`, `near_events`); `spin` weighs both. With its motion known, a thing is carved in its
//! own frame by the silhouettes of all instants (`carve`); with that shape its events are looked at again (`refine`).

mod carve;
mod centres;
mod chains;
mod contrast;
mod detections;
mod film;
mod near_events;
mod normals;
mod path;
mod refine;
mod shades;
mod smooth;
mod spin;
mod turn;

use std::{collections::BTreeMap, fmt};

use erfgs_calibrate::statistics::median;
use erfgs_dataset::{Bodies, BodiesFile, Body, BodyPose, Dataset, SurfacePoint};
use glam::DVec3;
use serde_json::{Value, json};

use self::{
    carve::{Carved, Place},
    centres::{Cloud, Owners, Track},
    contrast::Window,
    detections::detections,
    film::Film,
    near_events::Subject,
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
/// For this share of the exposure a thing must be inside its silhouettes; near its ends it hardly leaves a trace.
const EXPOSED: f64 = 0.4;
/// So many places of a shape are held against events, at most.
const MOST_SURFACE: usize = 2400;
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
    let mut windows = vec![Vec::new(); things.len()];
    for near in near_events::windows(dataset, &film, &subjects, &reading)? {
        windows[near.thing].push(near.window);
    }
    drop(subjects);
    let step_s = median(film.moments.windows(2).map(|pair| pair[1].t_s - pair[0].t_s)).unwrap_or(1.0);
    let mut drafts = Vec::new();
    for (index, track) in tracks.iter().enumerate() {
        progress(BodyStep::Rotation, index, tracks.len());
        let (shapes, path) = &things[index];
        let usual = median(shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
        let shades = if usual >= FEWEST_POINTS_THAT_TURN { Shades::new(&film, shapes) } else { None };
        let spin = spin::spin(shades.as_ref(), &windows[index], step_s);
        progress(BodyStep::Shapes, index, tracks.len());
        drafts.extend(Draft::new(&film, track, shapes, path.clone(), spin));
    }
    let subjects: Vec<Subject<'_>> = drafts
        .iter()
        .enumerate()
        .flat_map(|(thing, draft)| draft.shapes.iter().map(move |shape| (thing, draft, shape.moment)))
        .map(|(thing, draft, moment)| draft.subject(&film, thing, moment, step_s))
        .collect();
    let mut again = vec![BTreeMap::<usize, Vec<Window>>::new(); drafts.len()];
    for near in near_events::windows(dataset, &film, &subjects, &reading)? {
        again[near.thing].entry(near.moment).or_default().push(near.window);
    }
    drop(subjects);
    let mut bodies = Vec::new();
    let (count, unshaped) = (drafts.len(), tracks.len() - drafts.len());
    for (index, (mut draft, windows)) in std::iter::zip(drafts, again).enumerate() {
        progress(BodyStep::Shapes, index, count);
        draft.look_again(&film, &windows);
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

/// A body as far as it is known.
struct Draft<'a> {
    track: &'a Track,
    shapes: &'a [Shape],
    best: &'a Shape,
    path: Path,
    turn: Turn,
    carved: Carved,
    found_by: BTreeMap<String, Value>,
}

impl<'a> Draft<'a> {
    /// With a shape of its own; none where none is left.
    fn new(film: &Film, track: &'a Track, shapes: &'a [Shape], path: Path, spin: Spin) -> Option<Self> {
        let best = best_seen(film, track, shapes)?;
        let turn = Turn::steady(film.moments[best.moment].t_s, spin.rate);
        let carved = carved(film, track, shapes, best, &path, &turn)?;
        Some(Self { track, shapes, best, path, turn, carved, found_by: spin.found_by })
    }

    /// The shape as it is held against the events around an instant.
    fn subject(&self, film: &Film, thing: usize, moment: usize, step_s: f64) -> Subject<'_> {
        let t_s = film.moments[moment].t_s;
        let rotation = self.turn.at(t_s);
        let step = self.carved.points.len().div_ceil(MOST_SURFACE).max(1);
        let points = self.carved.points.iter().step_by(step);
        let turned =
            |point: &SurfacePoint| (rotation * DVec3::from(point.position_m), rotation * DVec3::from(point.normal));
        let (places, normals): (Vec<DVec3>, Vec<DVec3>) = points.map(turned).unzip();
        let rate = self.turn.rate(t_s);
        let around_us = refine::around_us(self.turn.fastest(), step_s);
        Subject { thing, moment, places, normals: Some(normals), path: &self.path, rate, around_us }
    }

    /// Improves the rotation by windows of its own shape, and carves that again.
    fn look_again(&mut self, film: &Film, windows: &BTreeMap<usize, Vec<Window>>) {
        let refined = refine::refine(windows);
        let upright_s = film.moments[self.best.moment].t_s;
        let time = |moment: usize| film.moments[moment].t_s;
        let rates: Vec<(f64, DVec3)> =
            refined.rates.iter().map(|&(moment, more)| (time(moment), self.turn.rate(time(moment)) + more)).collect();
        let turn = match rates.first() {
            None => return,
            Some(&(_, rate)) if !refined.changing => Turn::steady(upright_s, rate),
            Some(_) => Turn::changing(upright_s, rates.clone()),
        };
        let velocities: Vec<(f64, DVec3)> = refined
            .velocities
            .iter()
            .map(|&(moment, more)| (time(moment), self.path.velocity(time(moment)) + more))
            .collect();
        self.found_by.extend(refined.found_by);
        let path = self.path.clone().with_velocities(&velocities);
        if let Some(carved) = carved(film, self.track, self.shapes, self.best, &path, &turn) {
            (self.path, self.turn, self.carved) = (path, turn, carved);
            if refined.changing {
                let rates = rates.iter().map(|&(t_s, rate)| json!({"t_ns": film.ns(t_s), "rate_rad_s": vector(rate)}));
                self.found_by.insert("rates".into(), rates.collect());
            }
        }
    }

    /// The body.
    fn body(self, film: &Film, number: usize) -> Body {
        let usual = median(self.shapes.iter().map(|shape| shape.places.len() as f64)).unwrap_or(0.0);
        let upright_s = film.moments[self.best.moment].t_s;
        let facts = [
            ("instants", json!(self.shapes.len())),
            ("sure_instants", json!(self.track.sure.iter().filter(|sure| **sure).count())),
            ("hull_points", json!(usual)),
            ("radius_m", json!(rounded(self.track.radius_m, 4))),
            ("rate_rad_s", vector(self.turn.rate(upright_s))),
            ("carving_agreement", json!(rounded(self.carved.agree, 2))),
            ("carving_cell_m", json!(rounded(self.carved.cell_m, 5))),
            ("best_seen_ns", json!(film.moments[self.best.moment].t_ns)),
        ];
        let mut found_by = self.found_by;
        found_by.extend(facts.map(|(name, value)| (name.to_owned(), value)));
        Body {
            name: format!("body{number}"),
            span_ns: span_ns(film, self.track),
            poses: poses(film, &self.path, &self.turn),
            points: self.carved.points,
            found_by,
        }
    }
}

/// Carves a thing by how it turns.
fn carved(film: &Film, track: &Track, shapes: &[Shape], best: &Shape, path: &Path, turn: &Turn) -> Option<Carved> {
    let place = |shape: &Shape| {
        let moment = &film.moments[shape.moment];
        let open = [-0.5, 0.5].map(|side| moment.t_s + side * EXPOSED * moment.exposure_s);
        Place {
            moment: shape.moment,
            centre: shape.centre,
            rotation: turn.at(moment.t_s),
            exposed: open.map(|t_s| (path.at(t_s), turn.at(t_s))),
        }
    };
    let places: Vec<Place> = shapes.iter().map(place).collect();
    // A cell of the hulls is two or three pixels wide: cells of about one, but of a thing no more than some thousand.
    let cell_m = (0.36 * film.cell_m).max(0.045 * track.radius_m);
    carve::carve(film, &best.places, &places, cell_m)
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
    let step = POSE_STEP_S.min(POSE_TURN / turn.fastest().max(1e-9)).max(seconds / MOST_POSES);
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
