//! What is followed: tracks with their points at each instant and their paths.

use glam::DVec3;

use super::{
    centres::{self, Cloud, Owners, Track},
    chains, close,
    detections::detections,
    edits::{self, BodyEdits, Named},
    film::Film,
    path::Path,
    shades::Shape,
    slim,
};
use crate::CloudError;

/// A thing that is followed.
pub struct Thing {
    /// What the body is called.
    pub name: String,
    /// Where it is at the instants.
    pub track: Track,
    /// Its points at each of its instants, about its centre.
    pub shapes: Vec<Shape>,
    /// The same, only as deep as a ball would be whose hull is so deep: what its colours and events are held against.
    pub slim: Vec<Shape>,
    /// Where it is at any time.
    pub path: Path,
    /// How it turns by what the user says, radians per second about axes.
    pub rate: Option<DVec3>,
}

/// The things of a recording.
pub struct Things {
    pub all: Vec<Thing>,
    /// Which of them each moving point of each instant belongs to.
    pub owners: Owners,
}

impl Things {
    /// Follows what moves, with the corrections of the user.
    pub fn new(film: &Film, edits: &BodyEdits) -> Result<Self, CloudError> {
        let clouds: Vec<Cloud<'_>> =
            film.moments.iter().map(|moment| Cloud { points: &moment.points, colours: &moment.colours }).collect();
        let times: Vec<f64> = film.moments.iter().map(|moment| moment.t_s).collect();
        let (cell_m, exposure_s) = (film.cell_m, film.exposure_s());
        let (tracks, mut owners) = followed(&clouds, &times, [cell_m, exposure_s]);
        let named = edits::apply(edits, tracks, &mut owners, &clouds, &times)?;
        if named.is_empty() {
            return Err(CloudError::NoBodies { instants: film.moments.len() });
        }
        let thing = |(index, Named { name, track, rate }): (usize, Named)| {
            let path = path(&track, &times, [cell_m, exposure_s]);
            let shapes = shapes(&clouds, &track, &owners, index);
            let slim = shapes.iter().map(|shape| slim::slim(film, shape)).collect();
            Thing { name, shapes, slim, path, track, rate }
        };
        Ok(Self { all: named.into_iter().enumerate().map(thing).collect(), owners })
    }

    /// Moving points, and those of them that are of no thing.
    pub fn points(&self) -> [usize; 2] {
        let all = self.owners.iter().flatten();
        [all.clone().count(), all.filter(|owner| owner.is_none()).count()]
    }
}

/// The tracks of what moves, and which points are theirs.
fn followed(clouds: &[Cloud<'_>], times_s: &[f64], [cell_m, exposure_s]: [f64; 2]) -> (Vec<Track>, Owners) {
    let mut found: Vec<_> = clouds.iter().map(|cloud| detections(cloud.points, cloud.colours, cell_m)).collect();
    let mut chains = chains::chains(&found, times_s);
    let (tracks, owners) = centres::follow(&chains, &found, clouds, times_s, [cell_m, exposure_s]);
    let apart = close::Followed { tracks: &tracks, owners: &owners, clouds, times_s, cell_m, exposure_s }.told_apart();
    if apart.tracks.is_empty() {
        return (tracks, owners);
    }
    apart.chained(&mut chains, &mut found);
    centres::follow(&chains, &found, clouds, times_s, [cell_m, exposure_s])
}

/// The way of a track, with the bounces of its flight.
fn path(track: &Track, times: &[f64], [cell_m, exposure_s]: [f64; 2]) -> Path {
    let (times_s, places) = track.places(times);
    let flights = track.flights(times, exposure_s, cell_m);
    let bounces = flights.bounces();
    let places: Vec<DVec3> =
        std::iter::zip(&times_s, places).map(|(&t_s, place)| flights.at(t_s).unwrap_or(place)).collect();
    Path::bouncing(&times_s, &places, &bounces, 0.5 * exposure_s)
}

/// The points of a track at each of its instants, about its centre.
fn shapes(clouds: &[Cloud<'_>], track: &Track, owners: &Owners, index: usize) -> Vec<Shape> {
    let shape = |moment: usize| {
        let Cloud { points, colours } = clouds[moment];
        let members = owners[moment].iter().enumerate().filter(|(_, owner)| **owner == Some(index));
        Some(Shape::new(moment, track.centres[moment]?, members.map(|(at, _)| (points[at], colours[at]))))
    };
    track.instants().filter_map(shape).collect()
}
