//! What is followed: tracks with their points at each instant and their paths.

use glam::DVec3;

use super::{
    centres::{self, Cloud, Owners, Track},
    chains, close, crumbs,
    detections::detections,
    edits::{self, BodyEdits, Named},
    film::Film,
    flight::Flights,
    globe::{self, Globe},
    near_events::Subject,
    path::Path,
    round::Ball,
    shades::Shape,
    slim, thrown,
};
use crate::CloudError;

/// Places of a ball are right to about so many radii, and middles of hulls at best.
const RIGHT_TO: f64 = 0.15;

/// A thing that is followed.
pub struct Thing {
    /// What the body is called.
    pub name: String,
    /// Where it is at the instants.
    pub track: Track,
    /// What it is as a ball, if it is round.
    pub ball: Option<Ball>,
    /// Its points at each of its instants, about its centre.
    pub shapes: Vec<Shape>,
    /// The same, only as deep as a ball would be whose hull is so deep: what its colours and events are held against. None of a
    /// ball that flies.
    pub slim: Vec<Shape>,
    /// The colours of a ball that flies, and so turns at one rate between bounces, at each of its instants, with their times in seconds.
    pub globes: Vec<(f64, Globe)>,
    /// Where it is at any time.
    pub path: Path,
    /// Whether it falls freely all the time, as far as its places tell, and does not bounce.
    pub falls: bool,
    /// How it turns by what the user says, radians per second about axes.
    pub rate: Option<DVec3>,
}

/// The things of a recording.
pub struct Things {
    pub all: Vec<Thing>,
    /// Which of them each moving point of each instant belongs to.
    pub owners: Owners,
}

impl Thing {
    /// Whether it is a ball that flies: where it is and how it turns needs no second look.
    pub fn flies(&self) -> bool {
        !self.globes.is_empty()
    }

    /// How a ball accelerates where it flies, metres per second squared.
    fn ball_falls(&self, times_s: &[f64], exposure_s: f64) -> Option<DVec3> {
        let ball = self.ball.as_ref()?;
        self.track.flights(times_s, exposure_s, RIGHT_TO * ball.radius_m).fall()
    }

    /// What is held against events to find out how it turns; `number` is its own among things.
    pub fn subjects(&self, film: &Film, number: usize) -> Vec<Subject<'_>> {
        match self.ball {
            Some(_) => self.shapes.iter().map(|shape| Subject::of_ball(number, shape, &self.path)).collect(),
            None => self.slim.iter().map(|shape| Subject::of_hull(film, number, shape, &self.path)).collect(),
        }
    }
}

impl Things {
    /// Follows what moves, with the corrections of the user.
    pub fn new(film: &Film, edits: &BodyEdits) -> Result<Self, CloudError> {
        let clouds: Vec<Cloud<'_>> =
            film.moments.iter().map(|moment| Cloud { points: &moment.points, colours: &moment.colours }).collect();
        let times: Vec<f64> = film.moments.iter().map(|moment| moment.t_s).collect();
        let (cell_m, exposure_s) = (film.cell_m, film.exposure_s());
        let (tracks, mut owners) = followed(film, &clouds, &times);
        let named = edits::apply(edits, tracks, &mut owners, &clouds, &times)?;
        if named.is_empty() {
            return Err(CloudError::NoBodies { instants: film.moments.len() });
        }
        let thing = |index: usize, Named { name, track, rate, may_be_round }: Named, right_m: f64| {
            let flights = track.flights(&times, exposure_s, right_m);
            let path = path(&track, &times, &flights, exposure_s);
            let shapes = shapes(&clouds, &track, &owners, index);
            let slim = shapes.iter().map(|shape| slim::slim(film, shape)).collect();
            let flown = track.instants().all(|instant| flights.at(times[instant]).is_some());
            let falls = flown && path.bounces_s().next().is_none();
            let thing = Thing { name, ball: None, shapes, slim, globes: Vec::new(), path, track, falls, rate };
            match may_be_round.then(|| Ball::new(film, &thing.track, &thing.path, &thing.shapes)).flatten() {
                Some(ball) => round(film, thing, ball),
                None => thing,
            }
        };
        let mut all: Vec<Thing> =
            named.iter().cloned().enumerate().map(|(index, named)| thing(index, named, cell_m)).collect();
        // Places of balls tell best how things fall, and middles of hulls are as far from right as hulls are large.
        if let Some(fall) = crumbs::usual(all.iter().filter_map(|thing| thing.ball_falls(&times, exposure_s))) {
            for (index, (found, mut named)) in std::iter::zip(&mut all, named).enumerate() {
                let bounces = found.path.bounces_s().next().is_some();
                if found.ball.is_none() && !found.falls && !bounces {
                    let right_m = cell_m.max(RIGHT_TO * named.track.radius_m);
                    named.track.fall = Some(fall);
                    let falling = thing(index, named, right_m);
                    if falling.falls {
                        *found = falling;
                    }
                }
            }
        }
        Ok(Self { all, owners })
    }

    /// Moving points, and those of them that are of no thing.
    pub fn points(&self) -> [usize; 2] {
        let all = self.owners.iter().flatten();
        [all.clone().count(), all.filter(|owner| owner.is_none()).count()]
    }
}

/// The tracks of what moves, and which points are theirs.
fn followed(film: &Film, clouds: &[Cloud<'_>], times_s: &[f64]) -> (Vec<Track>, Owners) {
    let (cell_m, exposure_s) = (film.cell_m, film.exposure_s());
    let mut found: Vec<_> = clouds.iter().map(|cloud| detections(cloud.points, cloud.colours, cell_m)).collect();
    let mut chains = chains::chains(&found, times_s);
    let sizes = [cell_m, exposure_s];
    let (mut tracks, mut owners) = centres::follow(&chains, &found, clouds, times_s, sizes, None);
    let fall = crumbs::fall(&tracks, times_s, sizes);
    if fall.is_some() {
        tracks.iter_mut().for_each(|track| track.fall = fall);
        crumbs::forget(&mut chains, &tracks, times_s, sizes);
        (tracks, owners) = centres::follow(&chains, &found, clouds, times_s, sizes, fall);
    }
    let apart = close::Followed { tracks: &tracks, owners: &owners, clouds, times_s, cell_m, exposure_s }.separated();
    if !apart.tracks.is_empty() {
        apart.chained(&mut chains, &mut found);
        (tracks, owners) = centres::follow(&chains, &found, clouds, times_s, sizes, fall);
    }
    thrown::follow(film, clouds, &found, &mut tracks, &mut owners);
    (tracks, owners)
}

/// The way of a track, with the bounces of its flight.
fn path(track: &Track, times: &[f64], flights: &Flights, exposure_s: f64) -> Path {
    let (times_s, places) = track.places(times);
    let bounces = flights.bounces();
    let places: Vec<DVec3> =
        std::iter::zip(&times_s, places).map(|(&t_s, place)| flights.at(t_s).unwrap_or(place)).collect();
    Path::bouncing(&times_s, &places, &bounces, 0.5 * exposure_s)
}

/// A thing that is round, where and as large as its discs are.
fn round(film: &Film, mut thing: Thing, ball: Ball) -> Thing {
    let times: Vec<f64> = film.moments.iter().map(|moment| moment.t_s).collect();
    let exposure_s = film.exposure_s();
    let mut clear = Track { centres: vec![None; times.len()], radius_m: ball.radius_m, ..thing.track.clone() };
    for &(instant, middle) in &ball.places {
        clear.centres[instant] = Some(middle);
        clear.sure[instant] = true;
    }
    // Where it is not seen clearly it is where it flies.
    let flights = clear.flights(&times, exposure_s, RIGHT_TO * ball.radius_m);
    let path = |track: &Track| path(track, &times, &flights, exposure_s);
    let flown = path(&clear);
    let followed: Vec<usize> = thing.track.instants().collect();
    for instant in followed {
        if clear.centres[instant].is_none() {
            clear.centres[instant] = Some(flown.at(times[instant]));
            clear.sure[instant] = false;
        }
    }
    thing.path = path(&clear);
    let places: Vec<(usize, DVec3)> =
        clear.instants().filter_map(|instant| Some((instant, clear.centres[instant]?))).collect();
    thing.shapes = places.iter().map(|&(moment, centre)| ball.shape(film, moment, centre)).collect();
    let thrown = places.len() == 2;
    if thrown || places.iter().all(|(moment, _)| flights.at(times[*moment]).is_some()) {
        let globe =
            |&(moment, centre): &(usize, DVec3)| (times[moment], Globe::new(film, moment, centre, ball.radius_m));
        thing.globes = places.iter().map(globe).collect();
        globe::without_light(&mut thing.globes);
        thing.slim.clear();
    } else {
        thing.slim = places.iter().map(|&(moment, centre)| ball.seen(film, moment, centre)).collect();
    }
    thing.track = clear;
    thing.ball = Some(ball);
    thing
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
