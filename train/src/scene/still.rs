//! Whether anything moves at all, before anything is trained: by the frames of each training camera, and by its events.
//!
//! The answer errs towards motion: a lamp that is switched, or noise that comes in bursts, count as such; a lamp that flickers does not.

use erfgs_dataset::{Camera, Dataset, DatasetError, Split};
use erfgs_events::Events;
use erfgs_scene::ImageRgb8;
use rayon::prelude::*;

use super::{events::around, flicker::FlickerFinder};
use crate::config::DynamicConfig;

/// Places of one camera that may change without anything moving.
const FEW: usize = 4;
/// Events are counted in squares of so many pixels...
const BLOCK: usize = 4;
/// ...and in so many parts of the recording.
const WINDOWS: usize = 64;
/// A count that a steady source of its block's rate would have less often than once in 1e9 times is a burst: minus the logarithm.
const UNLIKELY: f64 = 20.7;
/// Noise of most pixels of a block does not fire so often, hertz; what turns or swings all the time has no bursts.
const BUSY_HZ: f64 = 10.0;

/// Whether neither frames nor events of the training cameras show that anything moves. Frames are read camera by camera, until one
/// tells.
///
/// # Errors
/// [`DatasetError`] where a file of the dataset cannot be read.
pub(crate) fn stands_still(dataset: &Dataset, options: &DynamicConfig) -> Result<bool, DatasetError> {
    let cameras: Vec<&Camera> = dataset.cameras(Split::Train).collect();
    if is_untold(&cameras) {
        return Ok(false);
    }
    let moves = |camera: &Camera| -> Result<bool, DatasetError> {
        if frames_change(dataset, camera, options.motion_threshold)? {
            return Ok(true);
        }
        let Some(file) = &camera.events else { return Ok(false) };
        let size = [camera.intrinsics.width, camera.intrinsics.height].map(|side| side as usize);
        let mut bursts = Bursts::new(size, file.covers_ns.map(|t| t.div_euclid(1000)));
        let mut flicker = FlickerFinder::new(camera.intrinsics.width, camera.intrinsics.height);
        dataset.read_event_pieces(camera, |events| -> Result<(), DatasetError> {
            bursts.add(events);
            flicker.add(events);
            Ok(())
        })?;
        Ok(bursts.tell_of_motion(&flicker.flickering()))
    };
    let decisive = cameras.into_par_iter().map(moves).find_any(|moves| !matches!(moves, Ok(false)));
    decisive.map_or(Ok(true), |decisive| decisive.map(|moves| !moves))
}

/// Whether nothing can tell: each camera was there at one instant only, and not all at the same one, as the images of a camera that moves.
fn is_untold(cameras: &[&Camera]) -> bool {
    let can_tell = |camera: &&Camera| camera.frames.len() > 1 || camera.events.is_some();
    let mut times = cameras.iter().flat_map(|camera| &camera.frames).map(|frame| frame.t_ns);
    let first = times.next();
    !cameras.iter().any(can_tell) && times.any(|time| Some(time) != first)
}

/// Whether pixels beside each other differ by more than `threshold` (of 1) among the frames.
fn frames_change(dataset: &Dataset, camera: &Camera, threshold: f32) -> Result<bool, DatasetError> {
    let [first, others @ ..] = &camera.frames[..] else { return Ok(false) };
    if others.is_empty() {
        return Ok(false);
    }
    let ImageRgb8 { width, data: mut lowest, .. } = dataset.read_image(camera, first)?;
    let mut highest = lowest.clone();
    for frame in others {
        let image = dataset.read_image(camera, frame)?;
        for ((lowest, highest), &value) in lowest.iter_mut().zip(&mut highest).zip(&image.data) {
            *lowest = value.min(*lowest);
            *highest = value.max(*highest);
        }
    }
    let limit = (threshold * 255.0).round() as u8;
    let differs = |(low, high): (&[u8], &[u8])| low.iter().zip(high).any(|(low, high)| high - low > limit);
    let changed: Vec<bool> = lowest.chunks_exact(3).zip(highest.chunks_exact(3)).map(differs).collect();
    Ok(in_company(&changed, width as usize) > FEW)
}

/// How many pixels are set of which at least two of the eight around them are, too: one alone is a pixel's own noise.
fn in_company(set: &[bool], width: usize) -> usize {
    let height = set.len() / width.max(1);
    let company = |at: usize| around(width, height, at % width, at / width).filter(|&at| set[at]).count();
    (0..set.len()).filter(|&at| set[at] && company(at) >= 3).count()
}

/// Where and when events came.
struct Bursts {
    size: [usize; 2],
    covers_us: [i64; 2],
    /// Of each block of pixels, in each part of the recording.
    blocks: Vec<[u32; WINDOWS]>,
    pixels: Vec<u32>,
}

impl Bursts {
    /// Of a camera of `size` pixels that recorded during `covers_us`.
    fn new(size: [usize; 2], covers_us: [i64; 2]) -> Self {
        let blocks = size[0].div_ceil(BLOCK) * size[1].div_ceil(BLOCK);
        Self { size, covers_us, blocks: vec![[0; WINDOWS]; blocks], pixels: vec![0; size[0] * size[1]] }
    }

    fn length_us(&self) -> i64 {
        (self.covers_us[1] - self.covers_us[0]).max(1)
    }

    fn add(&mut self, events: &Events) {
        let ([width, _], length) = (self.size, i128::from(self.length_us()));
        for event in events.iter() {
            let (x, y) = (usize::from(event.x), usize::from(event.y));
            let part = i128::from(event.t_us - self.covers_us[0]) * WINDOWS as i128 / length;
            let block = y / BLOCK * width.div_ceil(BLOCK) + x / BLOCK;
            self.blocks[block][part.clamp(0, WINDOWS as i128 - 1) as usize] += 1;
            self.pixels[y * width + x] += 1;
        }
    }

    /// Whether events came as no steady noise of each pixel, however strong, would have them: in bursts, or from whole blocks of
    /// pixels without a pause. Blocks with pixels that are `flickering` tell nothing.
    fn tell_of_motion(mut self, flickering: &[bool]) -> bool {
        let [width, _] = self.size;
        let block_of = |pixel: usize| pixel / width / BLOCK * width.div_ceil(BLOCK) + pixel % width / BLOCK;
        for (pixel, _) in flickering.iter().enumerate().filter(|(_, flickers)| **flickers) {
            self.blocks[block_of(pixel)] = [0; WINDOWS];
            self.pixels[pixel] = 0;
        }
        let bursts = |counts: &[u32; WINDOWS]| {
            let rate = f64::from(counts.iter().sum::<u32>()) / WINDOWS as f64;
            // Chernoff's bound of a Poisson distribution's tail.
            let surprise = |count: f64| count * (count / rate).ln() - (count - rate);
            let counts = counts.iter().map(|&count| f64::from(count));
            counts.filter(|&count| count > rate && surprise(count) > UNLIKELY).count()
        };
        let busy = BUSY_HZ * self.length_us() as f64 * 1e-6;
        let mut busy_pixels = vec![0; self.blocks.len()];
        for (at, _) in self.pixels.iter().enumerate().filter(|(_, count)| f64::from(**count) >= busy.max(2.0)) {
            busy_pixels[block_of(at)] += 1;
        }
        let without_pause = busy_pixels.iter().filter(|&&pixels| 2 * pixels > BLOCK * BLOCK).count();
        self.blocks.iter().map(bursts).sum::<usize>() + without_pause > FEW
    }
}

#[cfg(test)]
mod tests {
    use erfgs_base::random;
    use erfgs_events::Event;

    use super::*;

    const SIZE: [u32; 2] = [64, 48];
    const LENGTH_US: i64 = 1_000_000;

    /// Noise of all pixels at `hz`, and a hot pixel at 5 kHz.
    fn noise(hz: f64) -> Vec<Event> {
        let pixels = SIZE[0] * SIZE[1];
        let drawn = |index: u64, word: u64| random::uniform(random::key(3, &[index, word]));
        let mut events: Vec<Event> = (0..(hz * f64::from(pixels)) as u64)
            .map(|index| {
                let pixel = (drawn(index, 0) * f64::from(pixels)) as u32;
                let t_us = (drawn(index, 1) * LENGTH_US as f64) as i64;
                Event { t_us, x: (pixel % SIZE[0]) as u16, y: (pixel / SIZE[0]) as u16, on: index % 2 == 0 }
            })
            .collect();
        events.extend((0..5000).map(|index| Event { t_us: index * 200, x: 30, y: 20, on: true }));
        events
    }

    fn tells(mut events: Vec<Event>) -> bool {
        events.sort_by_key(|event| event.t_us);
        let mut columns = Events::new(SIZE[0], SIZE[1]);
        events.into_iter().for_each(|event| columns.push(event));
        let mut bursts = Bursts::new(SIZE.map(|side| side as usize), [0, LENGTH_US]);
        let mut flicker = FlickerFinder::new(SIZE[0], SIZE[1]);
        bursts.add(&columns);
        flicker.add(&columns);
        bursts.tell_of_motion(&flicker.flickering())
    }

    /// Three steps up and down a hundred times a second, at half of the picture.
    fn lamp() -> Vec<Event> {
        let steps =
            |period: i64| [1000, 1500, 2000, 6000, 6500, 7000].map(|t| 10_000 * period + t).into_iter().enumerate();
        let half = || (0..SIZE[1]).flat_map(|y| (0..SIZE[0] / 2).map(move |x| (x, y)));
        let pixel = |(x, y): (u32, u32)| {
            (0..100).flat_map(steps).map(move |(step, t_us)| Event { t_us, x: x as u16, y: y as u16, on: step < 3 })
        };
        half().flat_map(pixel).collect()
    }

    #[test]
    fn a_lamp_that_flickers_is_not_motion_and_hides_none_elsewhere() {
        let with = |more: &dyn Fn() -> Vec<Event>| [noise(0.1), lamp(), more()].concat();
        assert!(!tells(with(&Vec::new)));
        let passes = || {
            let square = (40..56).flat_map(|x| (10..26).map(move |y| (x, y)));
            square.map(|(x, y)| Event { t_us: 400_000 + 500 * i64::from(x), x, y, on: true }).collect()
        };
        assert!(tells(with(&passes)));
    }

    #[test]
    fn noise_is_not_motion_however_strong() {
        for hz in [0.0, 0.1, 1.0, 5.0] {
            assert!(!tells(noise(hz)), "noise of {hz} Hz");
        }
    }

    #[test]
    fn a_thing_of_three_pixels_that_crosses_the_picture_once_is_motion() {
        for hz in [0.1, 1.0] {
            let mut events = noise(hz);
            for step in 0..60_u16 {
                let edge = |offset: u16, on: bool| {
                    (0..3).flat_map(move |y| {
                        (0..3).map(move |again| {
                            let t_us = 400_000 + 2000 * i64::from(step) + again;
                            Event { t_us, x: step + offset, y: 30 + y, on }
                        })
                    })
                };
                events.extend(edge(3, true).chain(edge(0, false)));
            }
            assert!(tells(events), "beside noise of {hz} Hz");
        }
    }

    #[test]
    fn what_turns_without_a_pause_is_motion() {
        let mut events = noise(0.1);
        for turn in 0..40 {
            let pixel = |at: u16| Event {
                t_us: turn * 25_000 + i64::from(at),
                x: 8 + at % 12,
                y: 8 + at / 12,
                on: turn % 2 == 0,
            };
            events.extend((0..144).map(pixel));
        }
        assert!(tells(events));
    }

    #[test]
    fn images_of_several_instants_without_a_second_of_any_view_tell_nothing() {
        let camera = |times: &[i64]| {
            let frames = times
                .iter()
                .enumerate()
                .map(|(n, t)| serde_json::json!({ "file": n.to_string(), "t_ns": t, "exposure_ns": [t, t] }));
            let intrinsics = serde_json::json!({ "width": 4, "height": 4, "fx": 4.0, "fy": 4.0, "cx": 2.0, "cy": 2.0, "distortion": "none" });
            let pose = serde_json::json!({ "rotation_wxyz": [1.0, 0.0, 0.0, 0.0], "translation_m": [0.0, 0.0, 0.0] });
            let camera = serde_json::json!({
                "name": "a", "modality": "rgb", "split": "train", "intrinsics": intrinsics, "world_to_camera": pose,
                "frames": frames.collect::<Vec<_>>(),
            });
            serde_json::from_value::<Camera>(camera).unwrap()
        };
        let untold = |cameras: &[&[i64]]| {
            let cameras: Vec<Camera> = cameras.iter().map(|times| camera(times)).collect();
            is_untold(&cameras.iter().collect::<Vec<_>>())
        };
        assert!(untold(&[&[0], &[1], &[2]]));
        // Images of one instant are of a scene that stands still, and a camera that was there twice tells.
        assert!(!untold(&[&[0], &[0], &[0]]) && !untold(&[&[0], &[1], &[2, 3]]) && !untold(&[&[5]]) && !untold(&[]));
    }

    #[test]
    fn a_changed_pixel_counts_in_company() {
        let mut set = vec![false; 100];
        for at in [0, 35, 44, 45, 99] {
            set[at] = true;
        }
        assert_eq!(in_company(&set, 10), 3);
    }
}
