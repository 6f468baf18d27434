//! A stick with three lights that somebody waves where the performance will be. The lights blink; the room is dim.

use std::sync::Arc;

use erfgs_base::random;
use erfgs_events::CdEvent;
use erfgs_hardware_mocks::usb::{
    clock::TimeBase,
    scene::{EventScene, FrameScene, Picture},
};
use erfgs_scene::{Intrinsics, Pose};
use erfgs_stage::rig::CENTRE;
use glam::{DVec2, DVec3};

use crate::plan::{LEDS_HZ, WAND_M};

/// A light is seen up to this brightness, times that of the room.
const BRIGHT: f64 = 20.0;
/// A sensor's contrast threshold.
const THRESHOLD: f64 = 0.8;
/// The room, of 255.
const ROOM: f64 = 22.0;
/// Instants that an exposure is the mean of.
const INSTANTS: i64 = 6;

/// The wand before a camera.
#[derive(Clone)]
pub struct Wand {
    lens: Intrinsics,
    camera: Pose,
    begin_ns: i64,
    /// What a light is spread over (standard deviation), pixels.
    spread_px: f64,
}

impl Wand {
    /// The wand before a camera on the stage.
    #[must_use]
    pub fn new(lens: Intrinsics, camera: Pose, begin_ns: i64) -> Self {
        // The lens spreads a point by so much of the width of what it sees.
        let spread_px = (f64::from(lens.width) / 240.0).clamp(1.3, 2.2);
        Self { lens, camera, begin_ns, spread_px }
    }

    /// Where the lights are in the image.
    fn lights(&self, t_ns: i64) -> [Option<DVec2>; 3] {
        let t = 1e-9 * (t_ns - self.begin_ns) as f64;
        let swing = |rate: f64, phase: f64| (rate * t + phase).sin();
        let middle = CENTRE + DVec3::new(0.6 * swing(1.9, 0.0), 0.42 * swing(2.6, 1.0), 0.5 * swing(1.5, 2.0));
        let along = DVec3::new(swing(1.0, 1.5), swing(1.7, 0.5), 0.8 * swing(1.2, 0.0)).normalize_or(DVec3::X);
        // As `--wand` has it: gaps from the first light to the second and on to the third.
        let half = 0.5 * (WAND_M[0] + WAND_M[1]);
        [-half, WAND_M[0] - half, half].map(|offset| {
            let at = self.camera.transform(middle + along * offset);
            if at.z < 0.2 { None } else { self.lens.project(at) }
        })
    }

    /// The pixels around a light, and how bright it is there, times the room.
    fn around(&self, middle: DVec2) -> impl Iterator<Item = (u32, u32, f64)> {
        let reach = (3.3 * self.spread_px).ceil() as i64;
        let (left, top, side) = (middle.x.floor() as i64 - reach, middle.y.floor() as i64 - reach, 2 * reach + 1);
        let (width, height, spread) = (i64::from(self.lens.width), i64::from(self.lens.height), self.spread_px);
        (0..side * side).map(move |i| (left + i % side, top + i / side)).filter_map(move |(x, y)| {
            let inside = (0..width).contains(&x) && (0..height).contains(&y);
            let distance = (DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - middle).length();
            inside.then(|| (x as u32, y as u32, BRIGHT * (-0.5 * (distance / spread).powi(2)).exp()))
        })
    }
}

/// How long a light stays lit, and then dark, nanoseconds.
fn half_ns(light: usize) -> i64 {
    (0.5e9 / LEDS_HZ[light]).round() as i64
}

/// Pictures of the wand.
pub struct WandFrames {
    wand: Wand,
    seed: u64,
}

impl WandFrames {
    /// What a frame camera sees of it.
    #[must_use]
    pub fn new(wand: Wand, seed: u64) -> Self {
        Self { wand, seed }
    }
}

impl FrameScene for WandFrames {
    fn frame(&mut self, number: u64, exposure_ns: [i64; 2], width: u32, height: u32) -> (u64, Arc<Picture>) {
        let pixels = (width * height) as usize;
        let mut light = vec![1.0; pixels];
        for instant in 0..INSTANTS {
            let t_ns = exposure_ns[0] + (exposure_ns[1] - exposure_ns[0]) * (2 * instant + 1) / (2 * INSTANTS);
            for middle in self.wand.lights(t_ns).into_iter().flatten() {
                for (x, y, bright) in self.wand.around(middle) {
                    // Lit for half of the time.
                    light[(y * width + x) as usize] += 0.5 * bright / INSTANTS as f64;
                }
            }
        }
        let key = random::key(self.seed, &[number]);
        let level = |(index, light): (usize, f64)| {
            let noisy = ROOM * light + 1.5 * random::normal(random::extend(key, index as u64));
            [noisy.round().clamp(0.0, 255.0) as u8; 3]
        };
        let rgb = light.into_iter().enumerate().flat_map(level).collect();
        (number, Arc::new(Picture { width, height, rgb }))
    }
}

/// The events of the lights.
pub struct WandEvents {
    wand: Wand,
    seed: u64,
    /// The next time that each light turns, counted in halves of its period.
    next: [i64; 3],
    waiting: Vec<(i64, u16, u16, bool)>,
}

impl WandEvents {
    /// What an event camera sees of it.
    #[must_use]
    pub fn new(wand: Wand, seed: u64) -> Self {
        Self { wand, seed, next: [0; 3], waiting: Vec::new() }
    }
}

impl EventScene for WandEvents {
    fn begin(&mut self, _clock: &TimeBase, now_ns: i64) {
        self.next = [0, 1, 2].map(|light| now_ns / half_ns(light) + 1);
        self.waiting.clear();
    }

    fn until(&mut self, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>) {
        for light in 0..3 {
            while self.next[light] * half_ns(light) <= now_ns {
                let at_ns = self.next[light] * half_ns(light);
                let on = self.next[light] % 2 == 0;
                self.next[light] += 1;
                let Some(middle) = self.wand.lights(at_ns)[light] else { continue };
                let key = random::key(self.seed, &[light as u64, at_ns.unsigned_abs()]);
                for (x, y, bright) in self.wand.around(middle) {
                    let late =
                        (20_000.0 * random::uniform(random::extend(key, u64::from(y) << 16 | u64::from(x)))) as i64;
                    for count in 0..((1.0 + bright).ln() / THRESHOLD) as i64 {
                        self.waiting.push((at_ns + 20_000 + late + 30_000 * count, x as u16, y as u16, on));
                    }
                }
            }
        }
        self.waiting.sort_unstable();
        let due = self.waiting.partition_point(|event| event.0 <= now_ns);
        let due = self.waiting.drain(..due);
        events.extend(due.map(|(at, x, y, on)| CdEvent { t_us: clock.ticks_us(at), x, y, on }));
    }
}
