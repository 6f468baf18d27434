//! The events near each thing around each instant.

use std::collections::BTreeMap;

use erfgs_base::random;
use erfgs_dataset::{Camera, Dataset, Split};
use glam::{DQuat, DVec2, DVec3};
use rayon::prelude::*;

use super::{
    contrast::{NetEvent, Window},
    film::{Eye, Film},
    path::Path,
    shades::Shape,
};
use crate::{CloudError, rig::station};

/// Events of a pixel are counted together over so long, microseconds.
const TICK_US: i64 = 1_000;
/// A hull is held against events so long before and after an instant, microseconds.
const SHORT_US: i64 = 8_000;
/// Hulls are too fat by so many spacings: the shutter was open for a while, and views are few.
const FAT: f64 = 1.2;
/// Events farther from what a thing's points look like are of something else: spacings of its points, and pixels at least.
const REACH: f64 = 2.5;
const LEAST_REACH_PX: f64 = 6.0;
/// Cells of the picture, pixels.
const CELL_PX: f64 = 1.5;
/// Events of one window that take part, at most, and at least.
const MOST_EVENTS: usize = 2_000;
const FEWEST_EVENTS: usize = 50;
/// Places of a thing that events are held against, at most.
const MOST_PLACES: usize = 600;
/// A thing with fewer points, or of which a camera sees less than this share, is not held against its events.
const FEWEST_POINTS: usize = 15;
const SEEN: f64 = 0.7;

/// A thing as it is held against events around an instant.
pub struct Subject<'a> {
    /// Index of the thing.
    pub thing: usize,
    /// Index of the instant.
    pub moment: usize,
    /// Places on its surface then about its centre, metres.
    pub places: Vec<DVec3>,
    /// Outwards at those places, where they are to be trusted; the nearer half of the places is seen otherwise.
    pub normals: Option<Vec<DVec3>>,
    /// Where its centre is.
    pub path: &'a Path,
    /// How it is assumed to turn, radians per second about axes.
    pub rate: DVec3,
    /// Events so long before and after the instant are moved back to it, microseconds.
    pub around_us: i64,
}

impl<'a> Subject<'a> {
    /// A thing's hull, made thinner, which is assumed not to turn; for so short a time that it hardly does.
    pub fn of_hull(film: &Film, thing: usize, shape: &Shape, path: &'a Path) -> Self {
        let thin =
            std::iter::zip(&shape.places, &shape.normals).map(|(place, normal)| place - FAT * film.cell_m * normal);
        Self::still(thing, shape.moment, (thin.collect(), None), path)
    }

    /// A ball, in the same way.
    pub fn of_ball(thing: usize, shape: &Shape, path: &'a Path) -> Self {
        Self::still(thing, shape.moment, (shape.places.clone(), Some(shape.normals.clone())), path)
    }

    fn still(thing: usize, moment: usize, (places, normals): (Vec<DVec3>, Option<Vec<DVec3>>), path: &'a Path) -> Self {
        Self { thing, moment, places, normals, path, rate: DVec3::ZERO, around_us: SHORT_US }
    }
}

/// A thing's events by instant, a window for each camera.
pub type Windows = BTreeMap<usize, Vec<Window>>;

/// What a thing looks like to a camera at an instant.
struct Look<'a> {
    subject: &'a Subject<'a>,
    centre: DVec3,
    /// The places that are seen, about its centre.
    front: Vec<DVec3>,
    low: DVec2,
    high: DVec2,
    reach_px: f64,
}

const PURPOSE: u64 = random::purpose("bodies: events that take part");

/// The windows of each of `things` that are the subjects', over all training cameras with events.
pub fn windows(
    dataset: &Dataset,
    film: &Film,
    subjects: &[Subject<'_>],
    things: usize,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<Windows>, CloudError> {
    let cameras: Vec<&Camera> = dataset.cameras(Split::Train).filter(|camera| camera.events.is_some()).collect();
    let mut found = vec![Windows::new(); things];
    for (index, camera) in cameras.iter().enumerate() {
        progress(index, cameras.len());
        station(camera)?;
        let k = &camera.intrinsics;
        let eye = Eye::new(camera, [k.width, k.height]);
        let covers = camera.events.as_ref().map_or([0, 0], |file| file.covers_ns);
        let looks: Vec<Look<'_>> = subjects
            .iter()
            .filter(|subject| {
                let (middle, around) = (film.moments[subject.moment].t_ns, 1000 * subject.around_us);
                middle.saturating_sub(around) >= covers[0] && middle.saturating_add(around) <= covers[1]
            })
            .filter_map(|subject| look(&eye, film, subject))
            .collect();
        let counts = counted(dataset, camera, film, &looks)?;
        let windows = looks.par_iter().map(|look| {
            let Subject { thing, moment, .. } = *look.subject;
            let key = random::key(0, &[PURPOSE, index as u64, moment as u64, thing as u64]);
            Some((thing, moment, window(&eye, film, look, &counts[moment], key)?))
        });
        for (thing, moment, window) in windows.collect::<Vec<_>>().into_iter().flatten() {
            found[thing].entry(moment).or_default().push(window);
        }
    }
    progress(cameras.len(), cameras.len());
    Ok(found)
}

/// What a thing looks like to a camera; none where it has too few points or is hardly in view.
fn look<'a>(eye: &Eye, film: &Film, subject: &'a Subject<'a>) -> Option<Look<'a>> {
    if subject.places.len() < FEWEST_POINTS {
        return None;
    }
    let t_s = film.moments[subject.moment].t_s;
    let centre = subject.path.at(t_s);
    let mut seen: Vec<(DVec2, f64, usize)> = (0..subject.places.len())
        .filter_map(|at| eye.see(subject.places[at] + centre).map(|(pixel, depth)| (pixel, depth, at)))
        .collect();
    if (seen.len() as f64) < SEEN * subject.places.len() as f64 {
        return None;
    }
    seen.sort_by(|a, b| a.1.total_cmp(&b.1));
    let middle = seen.get(seen.len() / 2)?.1;
    let around_s = 1e-6 * subject.around_us as f64;
    // The box holds it where it is before and after, too.
    let drifts = [-around_s, around_s]
        .into_iter()
        .filter_map(|after| Some(eye.see(subject.path.at(t_s + after))?.0 - eye.see(centre)?.0));
    let drifts: Vec<DVec2> = drifts.chain([DVec2::ZERO]).collect();
    let all = || seen.iter().flat_map(|seen| drifts.iter().map(move |drift| seen.0 + *drift));
    let (low, high) = (all().reduce(DVec2::min)?, all().reduce(DVec2::max)?);
    let faces = |normals: &[DVec3], at: usize| (eye.centre - centre - subject.places[at]).dot(normals[at]) > 0.0;
    let mut front: Vec<DVec3> = match &subject.normals {
        Some(normals) => seen.iter().filter(|seen| faces(normals, seen.2)).map(|seen| subject.places[seen.2]).collect(),
        None => seen.iter().take(seen.len().div_ceil(2)).map(|seen| subject.places[seen.2]).collect(),
    };
    let step = front.len().div_ceil(MOST_PLACES).max(1);
    front = front.into_iter().step_by(step).collect();
    let reach_px = (REACH * film.cell_m * eye.intrinsics.fx / middle.max(1e-6)).max(LEAST_REACH_PX);
    Some(Look { subject, centre, front, low, high, reach_px })
}

/// Net events of an instant: ON less OFF for each tick since its middle, row and column.
type Counts = BTreeMap<(i32, u16, u16), i32>;

/// The net events near things, for each instant.
fn counted(dataset: &Dataset, camera: &Camera, film: &Film, looks: &[Look<'_>]) -> Result<Vec<Counts>, CloudError> {
    let mut counts = vec![Counts::new(); film.moments.len()];
    let mut of_moment: Vec<Vec<&Look<'_>>> = vec![Vec::new(); film.moments.len()];
    for look in looks {
        of_moment[look.subject.moment].push(look);
    }
    dataset.read_event_pieces(camera, |events| {
        for (moment, looks) in of_moment.iter().enumerate() {
            let Some(around_us) = looks.iter().map(|look| look.subject.around_us).max() else { continue };
            let middle = film.moments[moment].t_ns.div_euclid(1000);
            for index in events.between(middle.saturating_sub(around_us), middle.saturating_add(around_us)) {
                let (x, y) = (events.x[index], events.y[index]);
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                if looks.iter().any(|look| look.holds(at)) {
                    let tick = (events.t_us[index] - middle).div_euclid(TICK_US) as i32;
                    *counts[moment].entry((tick, y, x)).or_default() += if events.on[index] { 1 } else { -1 };
                }
            }
        }
        Ok::<(), CloudError>(())
    })?;
    Ok(counts)
}

impl Look<'_> {
    /// Whether a pixel is in the box around the thing.
    fn holds(&self, pixel: DVec2) -> bool {
        pixel.cmpge(self.low - self.reach_px).all() && pixel.cmple(self.high + self.reach_px).all()
    }
}

/// The window of a thing.
fn window(eye: &Eye, film: &Film, look: &Look<'_>, counts: &Counts, key: u64) -> Option<Window> {
    let subject = look.subject;
    let pixel = |event: &(&(i32, u16, u16), &i32)| DVec2::new(f64::from(event.0.2) + 0.5, f64::from(event.0.1) + 0.5);
    let seconds = |tick: i32| 1e-6 * TICK_US as f64 * (f64::from(tick) + 0.5);
    let around_s = 1e-6 * subject.around_us as f64;
    let mut all: Vec<(&(i32, u16, u16), &i32)> = counts
        .iter()
        .filter(|event| *event.1 != 0 && seconds(event.0.0).abs() < around_s && look.holds(pixel(event)))
        .collect();
    // Far more than are wanted are thinned before the nearest places are looked for.
    let order = random::permutation(key, all.len());
    let mut picked: Vec<usize> = order.into_iter().take(4 * MOST_EVENTS).collect();
    picked.sort_unstable();
    all = picked.into_iter().map(|index| all[index]).collect();
    let mut events = Vec::new();
    for of_tick in all.chunk_by(|a, b| a.0.0 == b.0.0) {
        let after = seconds(of_tick[0].0.0);
        let turn = DQuat::from_scaled_axis(subject.rate * after);
        let centre = subject.path.at(film.moments[subject.moment].t_s + after);
        let then = look.front.iter().map(|&place| (turn * place + centre, place));
        let then: Vec<(DVec2, DVec3, DVec3)> =
            then.filter_map(|(then, place)| Some((eye.see(then)?.0, then, place))).collect();
        for event in of_tick {
            let pixel = pixel(event);
            let away = |of: &&(DVec2, DVec3, DVec3)| of.0.distance_squared(pixel);
            let Some(nearest) = then.iter().min_by(|a, b| away(a).total_cmp(&away(b))) else { continue };
            if away(&nearest) < look.reach_px * look.reach_px {
                let value = f64::from(*event.1);
                events.push(NetEvent { pixel, seconds: after, value, then: nearest.1, place: nearest.2 });
            }
        }
    }
    if events.len() < FEWEST_EVENTS {
        return None;
    }
    let order = random::permutation(random::extend(key, 1), events.len());
    events = order.into_iter().take(MOST_EVENTS).map(|index| events[index]).collect();
    Window::new(eye, &events, look.centre, CELL_PX)
}
