//! Rotation by events: contrast maximisation.
//!
//! Events of some milliseconds are moved back to the middle of them, as a hypothesis of the motion has it. If it is right, those of one
//! edge fall onto one line, and the sum of squares of the picture that they make is large.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::film::Eye;

/// Room around the picture for events that are moved out of where they were, pixels.
const ROOM_PX: f64 = 20.0;

/// A net event: where it was, and how it moves with the thing's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Moved {
    /// In cells of the picture, moved back by what the path alone does.
    at: DVec2,
    /// Net number of events: ON less OFF.
    value: f64,
    /// Cells of the picture that it is moved by for a rate of turning, along x and y: the products with the rate.
    turn: [DVec3; 2],
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
    /// The place about the thing's centre that it is of, metres.
    pub place: DVec3,
}

/// The events of one camera near a thing around one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    events: Vec<Moved>,
    columns: usize,
    rows: usize,
}

impl Window {
    /// Of `events` in a camera; the thing's centre is at `centre` in the middle of the window and goes at `velocity`; cells of the
    /// picture are `cell_px` wide. None without events.
    pub fn new(eye: &Eye, events: &[NetEvent], centre: DVec3, velocity: DVec3, cell_px: f64) -> Option<Self> {
        let first = events.first()?.pixel;
        let (low, high) =
            events.iter().fold((first, first), |(low, high), event| (low.min(event.pixel), high.max(event.pixel)));
        let corner = low - ROOM_PX;
        let size = (high + ROOM_PX - corner) / cell_px + 2.0;
        let to_world = eye.rotation.transpose();
        let moved = |event: &NetEvent| {
            let at = eye.inside(event.place + centre);
            let depth = at.z.max(1e-6);
            let k = &eye.intrinsics;
            // The gradients of the pixel by the place in the world.
            let across = to_world * (DVec3::new(1.0, 0.0, -at.x / depth) * (k.fx / depth));
            let down = to_world * (DVec3::new(0.0, 1.0, -at.y / depth) * (k.fy / depth));
            let drift = DVec2::new(across.dot(velocity), down.dot(velocity));
            // across . (rate x place) = rate . (place x across)
            let turn = [across, down].map(|along| event.place.cross(along) * (event.seconds / cell_px));
            Moved { at: (event.pixel - drift * event.seconds - corner) / cell_px, value: event.value, turn }
        };
        Some(Self {
            events: events.iter().map(moved).collect(),
            columns: size.x.clamp(1.0, 4096.0) as usize,
            rows: size.y.clamp(1.0, 4096.0) as usize,
        })
    }

    /// The sum of squares of the picture of the events moved back by a rate of turning, for each event.
    pub fn contrast(&self, rate: DVec3) -> f64 {
        let mut picture = vec![0.0; self.columns * self.rows];
        for event in &self.events {
            let at = event.at - DVec2::new(event.turn[0].dot(rate), event.turn[1].dot(rate));
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

/// The mean contrast of several windows for each of `rates`; 0 without windows.
pub fn contrasts(windows: &[Window], rates: &[DVec3]) -> Vec<f64> {
    let mean =
        |&rate: &DVec3| windows.iter().map(|window| window.contrast(rate)).sum::<f64>() / windows.len().max(1) as f64;
    rates.par_iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::{
        film::test_eye,
        turn::{climb, directions, rates},
    };
    use erfgs_base::random;
    use glam::DQuat;

    /// What three cameras see of a ball with spots that turns and flies, in 16 ms.
    fn windows(rate: DVec3, velocity: DVec3, rate_error: f64) -> Vec<Window> {
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
                    events.push(NetEvent { pixel: pixel.floor() + 0.5, seconds, value, place });
                }
            }
            Window::new(eye, &events, centre, velocity, 1.5)
        };
        eyes.iter().enumerate().filter_map(of).collect()
    }

    #[test]
    fn contrast_is_greatest_at_the_rate_that_a_ball_turns_at() {
        let truth = DVec3::new(-4.0, 14.0, 6.0);
        let windows = windows(truth, DVec3::new(2.0, -1.0, 0.5), 0.01);
        let all = rates(60, &[5.0, 10.0, 15.0, 21.0, 28.0, 37.0, 48.0]);
        let found = contrasts(&windows, &all);
        let top = std::iter::zip(found.iter().copied(), all).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let (best, rate) = climb(top, 3.0, 4, |tries| contrasts(&windows, tries));
        assert!(rate.distance(truth) < 1.0, "{rate}");
        assert!(found[0] < 0.8 * best, "no turn {} against {best}", found[0]);
    }

    #[test]
    fn no_events_have_no_contrast() {
        assert_eq!(Window::new(&test_eye(DVec3::NEG_Z, DVec3::ZERO), &[], DVec3::ZERO, DVec3::ZERO, 1.5), None);
        assert_eq!(contrasts(&[], &[DVec3::X]), [0.0]);
    }
}
