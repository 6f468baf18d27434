//! What an event camera sees of a chessboard that blinks on a screen.

use erfgs_base::random;
use erfgs_events::Event;
use erfgs_scene::{Distortion, Intrinsics, Pose};
use glam::{DQuat, DVec2, DVec3};

/// A camera that sees one of 8 x 5 corners, 30 mm apart, as a whole.
pub fn camera() -> Intrinsics {
    Intrinsics { width: 320, height: 240, fx: 300.0, fy: 300.0, cx: 163.0, cy: 118.0, distortion: Distortion::None }
}

/// A board of `corners` columns and rows of inner corners, `square` metres apart, that blinks at 20 Hz: 0.7 s at each of eight
/// places, a second from one to the next. Every thirtieth pixel is a lamp at 100 Hz.
pub fn events(corners: [u8; 2], square: f64, camera: &Intrinsics) -> Vec<Event> {
    let [columns, rows] = corners.map(f64::from);
    let mut all = Vec::new();
    for place in 0..8_u64 {
        let angle = |axis| random::range(random::key(3, &[place, axis]), -0.45, 0.45);
        let board = Pose {
            rotation: DQuat::from_scaled_axis(DVec3::new(angle(0), angle(1), 0.5 * angle(2))),
            translation: DVec3::new(-0.12 + 0.1 * angle(3), -0.08 + 0.1 * angle(4), 0.42 + 0.15 * angle(5)),
        };
        let back = board.inverse();
        let mut events = Vec::new();
        for y in 0..camera.height {
            for x in 0..camera.width {
                let ray = camera.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
                let (from, along) = (back.translation, back.rotation * ray);
                let at = from - along * (from.z / along.z);
                let cell = (at / square).floor();
                let on_board = cell.x >= -1.0 && cell.y >= -1.0 && cell.x < columns && cell.y < rows;
                let inked = on_board && (cell.x + cell.y) as i64 % 2 == 0;
                let period = if inked {
                    50_000
                } else if (x + y) % 30 == 0 {
                    10_000
                } else {
                    continue;
                };
                for half in 0..700_000 / (period / 2) {
                    let late = random::below(random::key(4, &[place, u64::from(x), u64::from(y), half]), 2000);
                    let t_us = (place * 1_000_000 + half * period / 2 + late) as i64;
                    events.push(Event { t_us, x: x as u16, y: y as u16, on: half % 2 == 1 });
                }
            }
        }
        events.sort_unstable_by_key(|event| (event.t_us, event.x, event.y, event.on));
        all.extend(events);
    }
    all
}

/// The events as EVT2 words.
pub fn as_evt2(events: &[Event]) -> Vec<u8> {
    let mut words = Vec::new();
    let mut high = u32::MAX;
    for event in events {
        let t_us = event.t_us as u32;
        if t_us >> 6 != high {
            high = t_us >> 6;
            words.extend((0x8000_0000 | high).to_le_bytes());
        }
        let word = u32::from(event.on) << 28 | (t_us & 63) << 22 | u32::from(event.x) << 11 | u32::from(event.y);
        words.extend(word.to_le_bytes());
    }
    words
}
