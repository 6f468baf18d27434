//! What an event sensor, its clock and its cable add and take away.

use std::path::Path;

use erfgs_base::{FileError, random};
use erfgs_events::{Event, Events};

use super::{Disturbance, npz};
use crate::{Camera, Dataset, DatasetError};

/// Writes the events of a camera as they are disturbed, and returns how many they are.
pub(super) fn write(
    dataset: &Dataset,
    camera: &Camera,
    disturbance: &Disturbance,
    to: &Path,
) -> Result<u64, DatasetError> {
    let Some(events) = dataset.read_events(camera)? else { return Ok(0) };
    let covers_us = camera.events.as_ref().map_or([0, 0], |events| events.covers_ns.map(|t| t.div_euclid(1000)));
    let key = random::key(disturbance.seed, &[random::purpose("disturbed events"), random::purpose(&camera.name)]);
    let noisy = with_noise(events, disturbance.noise_hz, covers_us, random::extend(key, 0));
    let mut left = without_packets(noisy, disturbance.lost, random::extend(key, 1));
    left.t_us.iter_mut().for_each(|t| *t += disturbance.event_clock_us());
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).map_err(FileError::when("write", to))?;
    }
    npz::write_events(to, &left)
        .map_err(|source| DatasetError::Events { camera: camera.name.clone(), source: Box::new(source) })?;
    Ok(left.len() as u64)
}

/// Events of either polarity, at `rate` a second and pixel, among the others.
fn with_noise(events: Events, rate: f64, covers_us: [i64; 2], key: u64) -> Events {
    let seconds = 1e-6 * (covers_us[1] - covers_us[0]) as f64;
    if !(rate > 0.0 && seconds > 0.0) {
        return events;
    }
    let mut all: Vec<Event> = events.iter().collect();
    for (pixel, (y, x)) in (0..events.height).flat_map(|y| (0..events.width).map(move |x| (y, x))).enumerate() {
        let pixel = random::extend(key, pixel as u64);
        let mut t = 0.0;
        for number in 0.. {
            let event = random::extend(pixel, number);
            t += random::exponential(random::extend(event, 0)) / rate;
            if t >= seconds {
                break;
            }
            let on = random::uniform(random::extend(event, 1)) < 0.5;
            all.push(Event { t_us: covers_us[0] + (1e6 * t) as i64, y: y as u16, x: x as u16, on });
        }
    }
    // What was recorded keeps its order where times are the same.
    all.sort_by_key(|event| event.t_us);
    let mut noisy = Events::new(events.width, events.height);
    all.into_iter().for_each(|event| noisy.push(event));
    noisy
}

/// The events of the packets that arrive.
fn without_packets(events: Events, lost: f64, key: u64) -> Events {
    if lost <= 0.0 {
        return events;
    }
    let mut left = Events::new(events.width, events.height);
    for (index, event) in events.iter().enumerate() {
        let packet = random::extend(key, (index / Disturbance::PACKET) as u64);
        if random::uniform(packet) >= lost {
            left.push(event);
        }
    }
    left
}
