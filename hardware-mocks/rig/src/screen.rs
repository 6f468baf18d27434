//! A board that blinks on a screen. The screen is held still again and again, nearer and farther, and is dark while it is
//! carried on.

use std::{collections::BTreeMap, sync::Arc};

use erfgs_base::random;
use erfgs_events::CdEvent;
use erfgs_hardware_mocks::usb::{
    clock::TimeBase,
    scene::{EventScene, FrameScene, Picture},
};
use erfgs_scene::{Intrinsics, Pose};
use glam::{DMat3, DQuat, DVec2, DVec3};
use rayon::prelude::*;

/// The board as `erfgs calibrate` is told of it.
pub const TARGET: &str = "chessboard:9x6:0.03";
/// How often the ink comes, hertz.
pub const BLINK_HZ: f64 = 15.0;
/// The screen is held for so long, and then carried, seconds.
pub const EACH_S: f64 = 0.6;
const HELD_S: f64 = 0.5;
/// Side of a square, metres; corners in a row and rows of them.
const SQUARE_M: f64 = 0.03;
const CORNERS: [f64; 2] = [9.0, 6.0];
/// Light of paper and ink on the screen and of the room, of 255. The screen is turned low, so that event
/// cameras have little to tell.
const PAPER: f64 = 200.0;
const INK: f64 = 70.0;
const ROOM: f64 = 110.0;
/// Sub-pixel rays along each side of a pixel.
const SAMPLES: usize = 3;
/// A sensor's contrast threshold here: its biases are set so that it has little to tell.
const THRESHOLD: f64 = 0.45;

/// The screen in front of a camera.
#[derive(Clone)]
pub struct Screen {
    lens: Intrinsics,
    camera: Pose,
    begin_ns: i64,
    boards: usize,
}

impl Screen {
    /// The screen before a camera on the bench, first held `begin_ns` into the world's time.
    #[must_use]
    pub fn new(lens: Intrinsics, camera: Pose, begin_ns: i64, boards: usize) -> Self {
        Self { lens, camera, begin_ns, boards }
    }

    /// Which place the screen is held at, while it is held.
    fn held(&self, t_ns: i64) -> Option<usize> {
        let since_s = 1e-9 * (t_ns - self.begin_ns) as f64;
        let index = (since_s / EACH_S).floor();
        (index >= 0.0 && index < self.boards as f64 && since_s - index * EACH_S < HELD_S).then_some(index as usize)
    }

    /// The share of ink in each pixel, and the share that the screen takes of it, row by row.
    fn cover(&self, index: usize) -> Vec<[f32; 2]> {
        let back = place(index).then(&self.camera).inverse();
        let (from, turn) = (back.translation, DMat3::from_quat(back.rotation));
        let width = self.lens.width as usize;
        (0..width * self.lens.height as usize)
            .into_par_iter()
            .with_min_len(1024)
            .map(|pixel| {
                let mut sum = [0.0; 2];
                for sample in 0..SAMPLES * SAMPLES {
                    let sub = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
                    let at = DVec2::new(
                        (pixel % width) as f64 + sub(sample % SAMPLES),
                        (pixel / width) as f64 + sub(sample / SAMPLES),
                    );
                    let Ok(ray) = self.lens.unproject(at) else { continue };
                    let along = turn * ray;
                    let distance = -from.z / along.z;
                    let Some(ink) = (distance > 0.0).then(|| ink((from + along * distance).truncate())).flatten()
                    else {
                        continue;
                    };
                    sum[0] += f32::from(u8::from(ink));
                    sum[1] += 1.0;
                }
                sum.map(|sum| sum / (SAMPLES * SAMPLES) as f32)
            })
            .collect()
    }
}

/// Whether the ink is shown: it is for the first half of each period.
fn shows_ink(t_ns: i64) -> bool {
    (2.0 * BLINK_HZ * 1e-9 * t_ns as f64).floor() as i64 % 2 == 0
}

/// What is drawn at a point of the screen, metres from the first corner; `None` beside the screen.
fn ink(at: DVec2) -> Option<bool> {
    let square = (at / SQUARE_M).floor();
    let [columns, rows] = CORNERS;
    let within = |margin: f64| {
        (-margin..columns - 1.0 + margin).contains(&square.x) && (-margin..rows - 1.0 + margin).contains(&square.y)
    };
    within(2.0).then(|| within(1.0) && (square.x + square.y).rem_euclid(2.0) == 0.0)
}

/// Where the screen is held: the board in the bench's frame.
fn place(index: usize) -> Pose {
    // Near and far, in the middle and towards all sides, tilted in all directions.
    let key = random::key(11, &[index as u64]);
    let draw = |word: u64| 2.0 * random::uniform(random::extend(key, word)) - 1.0;
    let distance = [0.42, 0.6, 0.5, 0.85][index % 4];
    let around = 2.4 * index as f64;
    let aside = distance * if index.is_multiple_of(2) { 0.12 } else { 0.33 };
    let turn = DVec3::new(0.55 * draw(0), 0.55 * draw(1), 0.5 * draw(2));
    let middle = DVec3::new(1.3 * aside * around.cos(), 0.8 * aside * around.sin(), distance);
    let of_board = DVec3::new(0.5 * SQUARE_M * (CORNERS[0] - 1.0), 0.5 * SQUARE_M * (CORNERS[1] - 1.0), 0.0);
    let rotation = DQuat::from_scaled_axis(turn);
    Pose { rotation, translation: middle - rotation * of_board }
}

/// Pictures of the screen.
pub struct ScreenFrames {
    screen: Screen,
    kept: BTreeMap<u64, Arc<Picture>>,
}

impl ScreenFrames {
    /// What a frame camera sees of it.
    #[must_use]
    pub fn new(screen: Screen) -> Self {
        Self { screen, kept: BTreeMap::new() }
    }
}

impl FrameScene for ScreenFrames {
    fn frame(&mut self, _number: u64, exposure_ns: [i64; 2], width: u32, height: u32) -> (u64, Arc<Picture>) {
        let middle_ns = i64::midpoint(exposure_ns[0], exposure_ns[1]);
        let held = self.screen.held(middle_ns);
        let key = held.map_or(0, |index| 1 + 2 * index as u64 + u64::from(shows_ink(middle_ns)));
        if self.kept.len() > 4 {
            self.kept.clear();
        }
        let screen = &self.screen;
        let picture = self.kept.entry(key).or_insert_with(|| {
            let mut rgb = vec![ROOM as u8; 3 * (width * height) as usize];
            if let Some(index) = held {
                let ink_light = if key.is_multiple_of(2) { INK } else { PAPER };
                for (index, (pixel, [ink, seen])) in rgb.chunks_exact_mut(3).zip(screen.cover(index)).enumerate() {
                    let (ink, seen) = (f64::from(ink), f64::from(seen));
                    let light = ROOM * (1.0 - seen) + PAPER * (seen - ink) + ink_light * ink;
                    let noisy = light + 1.5 * random::normal(random::key(key, &[index as u64]));
                    pixel.fill(noisy.round().clamp(0.0, 255.0) as u8);
                }
            }
            Arc::new(Picture { width, height, rgb })
        });
        (key, Arc::clone(picture))
    }
}

/// The events that the screen makes.
pub struct ScreenEvents {
    screen: Screen,
    seed: u64,
    /// The next half of a period.
    next: i64,
    /// How many events each pixel makes when the ink comes, at the place that is known.
    known: Option<(usize, Vec<(u32, u8)>)>,
    waiting: Vec<(i64, u16, u16, bool)>,
}

impl ScreenEvents {
    /// What an event camera sees of it.
    #[must_use]
    pub fn new(screen: Screen, seed: u64) -> Self {
        Self { screen, seed, next: 0, known: None, waiting: Vec::new() }
    }

    fn half_ns(number: i64) -> i64 {
        (number as f64 * 1e9 / (2.0 * BLINK_HZ)).ceil() as i64
    }

    fn turn(&mut self, at_ns: i64) {
        let Some(index) = self.screen.held(at_ns) else { return };
        if self.known.as_ref().is_none_or(|(known, _)| *known != index) {
            let counts = self.screen.cover(index).into_iter().enumerate().filter_map(|(pixel, [ink, seen])| {
                let (ink, seen) = (f64::from(ink), f64::from(seen));
                let paper = ROOM * (1.0 - seen) + PAPER * seen;
                let contrast = (paper / (paper - (PAPER - INK) * ink)).ln();
                // Thresholds vary by a tenth from pixel to pixel.
                let varied = THRESHOLD * (1.0 + 0.1 * random::normal(random::key(self.seed, &[pixel as u64])));
                let count = (contrast / varied.max(0.1)) as u8;
                (count > 0).then_some((pixel as u32, count))
            });
            self.known = Some((index, counts.collect()));
        }
        let Some((_, counts)) = &self.known else { return };
        let (on, width) = (!shows_ink(at_ns + 1000), self.screen.lens.width);
        for &(pixel, count) in counts {
            let late = random::uniform(random::key(self.seed, &[u64::from(pixel), at_ns.unsigned_abs()]));
            for number in 0..count {
                let at = at_ns + 60_000 + (late * 400_000.0) as i64 + 150_000 * i64::from(number);
                self.waiting.push((at, (pixel % width) as u16, (pixel / width) as u16, on));
            }
        }
        self.waiting.sort_unstable();
    }
}

impl EventScene for ScreenEvents {
    fn begin(&mut self, _clock: &TimeBase, now_ns: i64) {
        self.next = (now_ns as f64 * 1e-9 * 2.0 * BLINK_HZ).floor() as i64 + 1;
        self.waiting.clear();
    }

    fn until(&mut self, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>) {
        while Self::half_ns(self.next) <= now_ns {
            self.turn(Self::half_ns(self.next));
            self.next += 1;
        }
        let due = self.waiting.partition_point(|event| event.0 <= now_ns);
        let due = self.waiting.drain(..due);
        events.extend(due.map(|(at, x, y, on)| CdEvent { t_us: clock.ticks_us(at), x, y, on }));
    }
}
