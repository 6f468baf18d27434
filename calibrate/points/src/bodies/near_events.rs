//! The events near each thing around each instant.

use std::collections::BTreeMap;

use erfgs_base::random;
use erfgs_dataset::{Camera, Dataset, Split};
use glam::{DVec2, DVec3};

use super::{
    contrast::{NetEvent, Window},
    film::{Eye, Film},
    path::Path,
    shades::Shape,
};
use crate::{CloudError, rig::station};

/// Events so long before and after an instant are moved back to it, microseconds.
const AROUND_US: i64 = 8_000;
/// Events of a pixel are counted together over so long, microseconds.
const TICK_US: i64 = 1_000;
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
/// A thing with fewer points, or of which a camera sees less than this share, is not held against its events.
const FEWEST_POINTS: usize = 15;
const SEEN: f64 = 0.7;

/// What a thing looks like to a camera at an instant.
struct Look {
    thing: usize,
    centre: DVec3,
    velocity: DVec3,
    /// Where the nearer half of its points is seen, and which place about its centre that is.
    front: Vec<(DVec2, DVec3)>,
    low: DVec2,
    high: DVec2,
    reach_px: f64,
}

const PURPOSE: u64 = random::purpose("bodies: events that take part");

/// The windows of each thing over all training cameras with events.
pub fn windows(
    dataset: &Dataset,
    film: &Film,
    things: &[(Vec<Shape>, Path)],
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<Vec<Window>>, CloudError> {
    let cameras: Vec<&Camera> = dataset.cameras(Split::Train).filter(|camera| camera.events.is_some()).collect();
    let mut found = vec![Vec::new(); things.len()];
    for (index, camera) in cameras.iter().enumerate() {
        progress(index, cameras.len());
        station(camera)?;
        let k = &camera.intrinsics;
        let eye = Eye::new(camera, [k.width, k.height]);
        let covers = camera.events.as_ref().map_or([0, 0], |file| file.covers_ns);
        let looks: Vec<Vec<Look>> = (0..film.moments.len())
            .map(|moment| {
                let middle = film.moments[moment].t_ns;
                let around = 1000 * AROUND_US;
                if middle.saturating_sub(around) < covers[0] || middle.saturating_add(around) > covers[1] {
                    return Vec::new();
                }
                looks(&eye, film, things, moment)
            })
            .collect();
        let counts = counted(dataset, camera, film, &looks)?;
        for (moment, (looks, counts)) in std::iter::zip(&looks, &counts).enumerate() {
            for look in looks {
                let key = random::key(0, &[PURPOSE, index as u64, moment as u64, look.thing as u64]);
                found[look.thing].extend(window(&eye, look, counts, key));
            }
        }
    }
    progress(cameras.len(), cameras.len());
    Ok(found)
}

/// What the things of an instant look like to a camera.
fn looks(eye: &Eye, film: &Film, things: &[(Vec<Shape>, Path)], moment: usize) -> Vec<Look> {
    let look = |(thing, (shapes, path)): (usize, &(Vec<Shape>, Path))| {
        let shape = shapes.iter().find(|shape| shape.moment == moment)?;
        if shape.places.len() < FEWEST_POINTS {
            return None;
        }
        let thin =
            std::iter::zip(&shape.places, &shape.normals).map(|(place, normal)| place - FAT * film.cell_m * normal);
        let mut seen: Vec<(DVec2, f64, DVec3)> = thin
            .filter_map(|place| eye.see(place + shape.centre).map(|(pixel, depth)| (pixel, depth, place)))
            .collect();
        if (seen.len() as f64) < SEEN * shape.places.len() as f64 {
            return None;
        }
        seen.sort_by(|a, b| a.1.total_cmp(&b.1));
        let middle = seen.get(seen.len() / 2)?.1;
        let bounds = |of: fn(DVec2, DVec2) -> DVec2| seen.iter().map(|seen| seen.0).reduce(of);
        let (low, high) = (bounds(DVec2::min)?, bounds(DVec2::max)?);
        let reach_px = (REACH * film.cell_m * eye.intrinsics.fx / middle.max(1e-6)).max(LEAST_REACH_PX);
        let front = seen.iter().take(seen.len().div_ceil(2)).map(|&(pixel, _, place)| (pixel, place)).collect();
        let velocity = path.velocity(film.moments[moment].t_s);
        Some(Look { thing, centre: shape.centre, velocity, front, low, high, reach_px })
    };
    things.iter().enumerate().filter_map(look).collect()
}

/// Net events of an instant: ON less OFF for each tick since the beginning of its window, row and column.
type Counts = BTreeMap<(u16, u16, u16), i32>;

/// The net events near things, for each instant.
fn counted(dataset: &Dataset, camera: &Camera, film: &Film, looks: &[Vec<Look>]) -> Result<Vec<Counts>, CloudError> {
    let mut counts = vec![Counts::new(); film.moments.len()];
    dataset.read_event_pieces(camera, |events| {
        for (moment, looks) in looks.iter().enumerate().filter(|(_, looks)| !looks.is_empty()) {
            let begin = film.moments[moment].t_ns.div_euclid(1000).saturating_sub(AROUND_US);
            for index in events.between(begin, begin.saturating_add(2 * AROUND_US)) {
                let (x, y) = (events.x[index], events.y[index]);
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let near =
                    |look: &Look| at.cmpge(look.low - look.reach_px).all() && at.cmple(look.high + look.reach_px).all();
                if looks.iter().any(near) {
                    let tick = ((events.t_us[index] - begin) / TICK_US) as u16;
                    *counts[moment].entry((tick, y, x)).or_default() += if events.on[index] { 1 } else { -1 };
                }
            }
        }
        Ok::<(), CloudError>(())
    })?;
    Ok(counts)
}

/// The window of a thing.
fn window(eye: &Eye, look: &Look, counts: &Counts, key: u64) -> Option<Window> {
    let mut events = Vec::new();
    for (&(tick, y, x), &value) in counts {
        let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let bounds = look.reach_px;
        if value == 0 || pixel.cmplt(look.low - bounds).any() || pixel.cmpgt(look.high + bounds).any() {
            continue;
        }
        let away = |front: &&(DVec2, DVec3)| front.0.distance_squared(pixel);
        let Some(nearest) = look.front.iter().min_by(|a, b| away(a).total_cmp(&away(b))) else { continue };
        if away(&nearest) < look.reach_px * look.reach_px {
            let seconds = 1e-6 * (TICK_US as f64 * (f64::from(tick) + 0.5) - AROUND_US as f64);
            events.push(NetEvent { pixel, seconds, value: f64::from(value), place: nearest.1 });
        }
    }
    if events.len() < FEWEST_EVENTS {
        return None;
    }
    if events.len() > MOST_EVENTS {
        let order = random::permutation(key, events.len());
        events = order.into_iter().take(MOST_EVENTS).map(|index| events[index]).collect();
    }
    Window::new(eye, &events, look.centre, look.velocity, CELL_PX)
}
