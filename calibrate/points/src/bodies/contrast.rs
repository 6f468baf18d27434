//! Rotation by events: contrast maximisation.
//!
//! Events of some milliseconds are moved back to the middle of them, as a hypothesis of the motion has it. If it is right, those of one
//! edge fall onto one line, and the sum of squares of the picture that they make is large.

use std::borrow::Borrow;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::film::Eye;

/// Room around the picture for events that are moved out of where they were, pixels.
const ROOM_PX: f64 = 20.0;

/// A net event: where it was, and how it moves with the thing's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Moved {
    /// In cells of the picture, moved back by the motion that is assumed.
    at: DVec2,
    /// Net number of events: ON less OFF.
    value: f64,
    /// Cells of the picture that it is moved back by for a rate of turning more, along x and y: the products with the rate.
    turn: [DVec3; 2],
    /// The same for a velocity more.
    shift: [DVec3; 2],
}

/// A net event as it was counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetEvent {
    /// Middle of its pixel.
    pub pixel: DVec2,
    /// Since the middle of the window, seconds.
    pub seconds: f64,
    /// ON less OFF.
    pub value: f64,
    /// Where the thing's surface was seen at its time, in the world, metres.
    pub then: DVec3,
    /// Where that part of it was in the middle of the window by the motion that is assumed, about the thing's centre.
    pub place: DVec3,
}

/// The events of one camera near a thing around one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    events: Vec<Moved>,
    columns: usize,
    rows: usize,
}

/// A motion that differs from the one that a window assumes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Change {
    /// So much faster about the thing's centre, radians per second about axes.
    pub rate: DVec3,
    /// So much faster on its path, metres per second.
    pub velocity: DVec3,
}

impl Window {
    /// Of `events` in a camera, of a thing whose centre is at `centre` in the middle of the window; cells of the picture are `cell_px`
    /// wide. None without events.
    pub fn new(eye: &Eye, events: &[NetEvent], centre: DVec3, cell_px: f64) -> Option<Self> {
        let to_world = eye.rotation.transpose();
        let k = &eye.intrinsics;
        let back = |event: &NetEvent| {
            let then = k.project_pinhole(eye.inside(event.then));
            let middle = k.project_pinhole(eye.inside(event.place + centre));
            event.pixel - (then - middle)
        };
        let back: Vec<DVec2> = events.iter().map(back).collect();
        let low = back.iter().copied().reduce(DVec2::min)?;
        let high = back.iter().copied().reduce(DVec2::max)?;
        if !(low.is_finite() && high.is_finite()) {
            return None;
        }
        let corner = low - ROOM_PX;
        let size = (high + ROOM_PX - corner) / cell_px + 2.0;
        let moved = |(event, back): (&NetEvent, DVec2)| {
            let at = eye.inside(event.place + centre);
            let depth = at.z.max(1e-6);
            // The gradients of the pixel by the place in the world.
            let across = to_world * (DVec3::new(1.0, 0.0, -at.x / depth) * (k.fx / depth));
            let down = to_world * (DVec3::new(0.0, 1.0, -at.y / depth) * (k.fy / depth));
            let shift = [across, down].map(|along| along * (event.seconds / cell_px));
            // along . (rate x place) = rate . (place x along)
            Moved {
                at: (back - corner) / cell_px,
                value: event.value,
                turn: shift.map(|along| event.place.cross(along)),
                shift,
            }
        };
        Some(Self {
            events: std::iter::zip(events, back).map(moved).collect(),
            columns: size.x.clamp(1.0, 4096.0) as usize,
            rows: size.y.clamp(1.0, 4096.0) as usize,
        })
    }

    /// Every other event, and the others: what is found by the one can be held against the other.
    pub fn halves(&self) -> [Self; 2] {
        [0, 1].map(|first| Self { events: self.events.iter().skip(first).step_by(2).copied().collect(), ..*self })
    }

    /// The sum of squares of the picture of the events moved back by a motion, for each event.
    pub fn contrast(&self, change: Change) -> f64 {
        let mut picture = vec![0.0; self.columns * self.rows];
        for event in &self.events {
            let along = |axis: usize| event.turn[axis].dot(change.rate) + event.shift[axis].dot(change.velocity);
            let at = event.at - DVec2::new(along(0), along(1));
            let low = at.floor();
            let part = at - low;
            if !(low.x >= 0.0 && low.y >= 0.0) {
                continue;
            }
            let (x, y) = (low.x as usize, low.y as usize);
            if x + 1 >= self.columns || y + 1 >= self.rows {
                continue;
            }
            let corner = y * self.columns + x;
            picture[corner] += event.value * (1.0 - part.x) * (1.0 - part.y);
            picture[corner + 1] += event.value * part.x * (1.0 - part.y);
            picture[corner + self.columns] += event.value * (1.0 - part.x) * part.y;
            picture[corner + self.columns + 1] += event.value * part.x * part.y;
        }
        picture.iter().map(|value| value * value).sum::<f64>() / self.events.len().max(1) as f64
    }
}

/// The mean contrast of several windows; 0 without windows.
pub fn mean_contrast(windows: &[impl Borrow<Window>], change: Change) -> f64 {
    windows.iter().map(|window| window.borrow().contrast(change)).sum::<f64>() / windows.len().max(1) as f64
}

/// The mean contrast of several windows for each of `rates` more.
pub fn contrasts(windows: &[impl Borrow<Window> + Sync], rates: &[DVec3]) -> Vec<f64> {
    rates.par_iter().map(|&rate| mean_contrast(windows, Change { rate, velocity: DVec3::ZERO })).collect()
}

/// What three cameras see of a ball with spots that turns and flies, in 16 ms.
#[cfg(test)]
pub fn test_windows(rate: DVec3, velocity: DVec3, rate_error: f64) -> Vec<Window> {
    use super::{film::test_eye, turn::directions};
    use erfgs_base::random;
    use glam::DQuat;

    let centre = DVec3::new(0.1, 0.0, 0.2);
    let eyes = [DVec3::new(0.0, -0.5, -2.0), DVec3::new(1.8, -0.8, -0.8), DVec3::new(-1.5, -1.0, 1.3)]
        .map(|from| test_eye(from, DVec3::ZERO));
    let spots: Vec<DVec3> = directions(60).into_iter().map(|along| 0.2 * along).collect();
    let of = |(index, eye): (usize, &Eye)| {
        let mut events = Vec::new();
        for (spot, &place) in spots.iter().enumerate() {
            // Only those that face the camera.
            if (eye.centre - centre - place).dot(place) < 0.0 {
                continue;
            }
            for tick in 0..16 {
                let seconds = 1e-3 * (f64::from(tick) - 7.5);
                let turned = DQuat::from_scaled_axis(rate * seconds) * place;
                let key = random::key(5, &[index as u64, spot as u64, tick as u64]);
                let noise = DVec3::new(random::normal(key), random::normal(random::extend(key, 1)), 0.0);
                let Some((pixel, _)) = eye.see(centre + velocity * seconds + turned) else { continue };
                let value = if spot % 2 == 0 { 1.0 } else { -1.0 };
                // Where the hull is wrong the place is, too.
                let place = place + rate_error * noise;
                let then = centre + velocity * seconds + place;
                events.push(NetEvent { pixel: pixel.floor() + 0.5, seconds, value, then, place });
            }
        }
        Window::new(eye, &events, centre, 1.5)
    };
    eyes.iter().enumerate().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{
        film::test_eye,
        turn::{climb, rates},
    };

    #[test]
    fn contrast_is_greatest_at_the_rate_that_a_ball_turns_at() {
        let truth = DVec3::new(-4.0, 14.0, 6.0);
        let windows = test_windows(truth, DVec3::new(2.0, -1.0, 0.5), 0.01);
        let all = rates(60, &[5.0, 10.0, 15.0, 21.0, 28.0, 37.0, 48.0]);
        let found = contrasts(&windows, &all);
        let top = std::iter::zip(found.iter().copied(), all).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let (best, rate) = climb(top, 3.0, 4, |tries| contrasts(&windows, tries));
        assert!(rate.distance(truth) < 1.0, "{rate}");
        assert!(found[0] < 0.8 * best, "no turn {} against {best}", found[0]);
    }

    #[test]
    fn no_events_have_no_contrast() {
        assert_eq!(Window::new(&test_eye(DVec3::NEG_Z, DVec3::ZERO), &[], DVec3::ZERO, 1.5), None);
        assert_eq!(contrasts(&[] as &[Window], &[DVec3::X]), [0.0]);
    }
}
