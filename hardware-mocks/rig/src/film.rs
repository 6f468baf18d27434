//! A dataset as a film before the cameras of a rig: a frame camera is shown the frames of its viewpoint, an event camera the events
//! of its own. What the rig records of it can be held against the dataset.
//!
//! Training cameras wait for the trigger board, whose pulses are the film's exposures; held-out cameras run freely and in step with
//! the film. The events of a camera come from an EVK4 on whose larger sensor each pixel of the dataset is a square of equal pixels.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use erfgs_dataset::{Camera as Viewpoint, Dataset, DatasetError, Frame, Split};
use erfgs_events::{CdEvent, Event, Events};
use erfgs_hardware_mocks::usb::{
    clock::TimeBase,
    scene::{EventScene, FrameScene, Picture},
};
use erfgs_scene::Intrinsics;

use crate::{
    performance::Played,
    plan::{Camera, Kind, Plan, crystal},
    take,
};

/// Pixels of an EVK4.
const EVK4: [u32; 2] = [1280, 720];
/// The unit of a UVC camera's exposure, nanoseconds: what is called an instant in a dataset is exposed for so long.
const SHORTEST_NS: i64 = 100_000;
/// Frames of a camera may be so much out of step, nanoseconds.
const STEP_NS: i64 = 100_000;

/// Why a dataset cannot be played to a rig.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// A file of the dataset cannot be used.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A camera that no emulated device is.
    #[error(
        "camera {camera} has frames and events, which no device of this rig has: keep one of both (erfgs dataset variant \
         --event-only {camera})"
    )]
    Both {
        /// The camera.
        camera: String,
    },
    /// More pixels than an EVK4 has.
    #[error(
        "camera {camera} has {size:?} pixels, and an EVK4 has {EVK4:?}: import the recording with a smaller --scale"
    )]
    Size {
        /// The camera.
        camera: String,
        /// Its columns and rows.
        size: [u32; 2],
    },
    /// No training camera with frames.
    #[error("no training camera has two frames and more, whose exposures are the pulses of the trigger board")]
    NoFrames,
    /// Frames that no trigger gives.
    #[error("camera {camera}: frame {frame} is {late_us} us off the steps of {of}, which one trigger gives to all")]
    Step {
        /// The camera.
        camera: String,
        /// The number of its frame.
        frame: usize,
        /// Off by so much, microseconds.
        late_us: i64,
        /// Whose steps.
        of: String,
    },
}

/// Steps in which frames are exposed, nanoseconds of the film.
#[derive(Clone, Debug)]
struct Steps {
    of: String,
    first_ns: i64,
    period_ns: f64,
    exposure_ns: i64,
}

impl Steps {
    /// Those of the first of some cameras that has two frames; all others must keep them.
    fn of<'a>(cameras: impl Iterator<Item = &'a Viewpoint>) -> Result<Option<Self>, FilmError> {
        let mut steps: Option<Self> = None;
        for camera in cameras {
            let of_camera = match &steps {
                Some(steps) => steps,
                None => match Self::of_frames(camera) {
                    Some(own) => steps.insert(own),
                    None => continue,
                },
            };
            of_camera.hold(camera)?;
        }
        Ok(steps)
    }

    fn of_frames(camera: &Viewpoint) -> Option<Self> {
        let [first, .., last] = &camera.frames[..] else { return None };
        let ([start, end], [last, _]) = (first.exposure_ns, last.exposure_ns);
        let period_ns = (last - start) as f64 / (camera.frames.len() - 1) as f64;
        Some(Self { of: camera.name.clone(), first_ns: start, period_ns, exposure_ns: (end - start).max(SHORTEST_NS) })
    }

    fn hold(&self, camera: &Viewpoint) -> Result<(), FilmError> {
        for (index, frame) in camera.frames.iter().enumerate() {
            let since = (frame.exposure_ns[0] - self.first_ns) as f64;
            let late_us = ((since - (since / self.period_ns).round() * self.period_ns) / 1e3) as i64;
            if late_us.abs() > STEP_NS / 1000 {
                let (camera, of) = (camera.name.clone(), self.of.clone());
                return Err(FilmError::Step { camera, frame: index, late_us, of });
            }
        }
        Ok(())
    }

    fn rate_hz(&self) -> f64 {
        1e9 / self.period_ns
    }
}

/// A dataset that is played.
#[derive(Debug)]
pub struct Film {
    dataset: Dataset,
    triggered: Steps,
    free: Option<Steps>,
    /// The world's time at the dataset's time 0, once the board is running.
    begins_ns: OnceLock<i64>,
    failed: Mutex<Option<DatasetError>>,
}

impl Film {
    /// A rig with a device for each camera of a dataset, and the film for it.
    ///
    /// # Errors
    /// If a camera has frames and events, or frames that are not evenly spaced, or more pixels than a sensor has.
    pub fn plan(dataset: Dataset) -> Result<Plan, FilmError> {
        let with_frames = |split| dataset.cameras(split).filter(|camera| !camera.frames.is_empty());
        let triggered = Steps::of(with_frames(Split::Train))?.ok_or(FilmError::NoFrames)?;
        let free = Steps::of(with_frames(Split::Test))?;
        let mut cameras = Vec::new();
        for (index, camera) in dataset.manifest.cameras.iter().enumerate() {
            let (kind, serial, lens) = match (camera.frames.is_empty(), &camera.events) {
                (false, None) => {
                    let kind = Kind::Uvc { triggered: camera.split == Split::Train };
                    (kind, format!("UVC{index:05}"), camera.intrinsics)
                }
                (true, Some(_)) => {
                    let lens = on_evk4(&camera.intrinsics, side(camera)?);
                    (Kind::Evk4, format!("{:08x}", 0x0006_0101 + index), lens)
                }
                (false, Some(_)) => return Err(FilmError::Both { camera: camera.name.clone() }),
                (true, None) => continue,
            };
            let pose = camera.world_to_camera;
            let clock = crystal(index);
            cameras.push(Camera { id: camera.name.clone(), kind, serial, lens, place: pose, bench: pose, clock });
        }
        let [first, last] = dataset.manifest.span_ns;
        Ok(Plan {
            cameras,
            rate_hz: triggered.rate_hz(),
            exposure_us: triggered.exposure_ns as f64 / 1e3,
            free_hz: free.as_ref().map_or(triggered.rate_hz(), Steps::rate_hz),
            performance_s: 1e-9 * (last - first.min(0)) as f64,
            film: Some(Arc::new(Self {
                dataset,
                triggered,
                free,
                begins_ns: OnceLock::new(),
                failed: Mutex::new(None),
            })),
            ..Plan::empty()
        })
    }

    /// Exposure of the cameras that run freely, microseconds.
    pub(crate) fn free_exposure_us(&self) -> f64 {
        self.free.as_ref().map_or(SHORTEST_NS, |steps| steps.exposure_ns) as f64 / 1e3
    }

    /// Begins with the first pulse after a time. `pulse` tells when a pulse of the board comes.
    pub(crate) fn begin(&self, after_ns: i64, pulse: impl Fn(i64) -> Option<i64>) {
        let first = (0..).map_while(&pulse).find(|&rise_ns| rise_ns >= after_ns);
        let _ = self.begins_ns.set(first.unwrap_or(after_ns) - self.triggered.first_ns);
    }

    /// When the film begins, the world's time.
    pub(crate) fn begins_ns(&self) -> Option<i64> {
        self.begins_ns.get().copied()
    }

    /// The first time after `now_ns` at which a camera that runs freely may begin, so that it keeps the film's steps.
    pub(crate) fn in_step_ns(&self, now_ns: i64) -> i64 {
        let (Some(steps), Some(begins_ns)) = (&self.free, self.begins_ns()) else { return now_ns };
        let until = (begins_ns + steps.first_ns - now_ns) as f64;
        now_ns + until.rem_euclid(steps.period_ns) as i64
    }

    /// When the film begins in the recording, and how long it is, seconds: a bit earlier and longer, so that no exposure is cut.
    #[must_use]
    pub fn window_s(&self) -> [f64; 2] {
        let [first, last] = self.dataset.manifest.span_ns;
        let margin_ns = 1e6 + 0.5 * self.free.as_ref().map_or(0, |steps| steps.exposure_ns) as f64;
        let from_ns = self.begins_ns().unwrap_or(0) as f64 + first as f64 - take::RECORDED_NS as f64 - margin_ns;
        [1e-9 * from_ns, 1e-9 * ((last - first) as f64 + 2.0 * margin_ns)]
    }

    fn viewpoint(&self, name: &str) -> Result<&Viewpoint, FilmError> {
        // The plan is of this dataset.
        self.dataset.camera(name).ok_or(FilmError::NoFrames)
    }

    /// What went wrong while it was shown.
    pub(crate) fn take_failure(&self) -> Option<DatasetError> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// How many pixels of an EVK4 each pixel of a dataset is, along each side: as many as have room and share out both sides.
fn enlargement([width, height]: [u32; 2]) -> Option<u32> {
    let most = (EVK4[0] / width.max(1)).min(EVK4[1] / height.max(1));
    (1..=most).rev().find(|times| EVK4.iter().all(|side| side.is_multiple_of(*times)))
}

/// The same for a camera.
fn side(camera: &Viewpoint) -> Result<u32, FilmError> {
    let size = [camera.intrinsics.width, camera.intrinsics.height];
    enlargement(size).ok_or_else(|| FilmError::Size { camera: camera.name.clone(), size })
}

/// The lens of a camera before an EVK4: what the dataset has is in the corner where pixels are counted from.
fn on_evk4(of: &Intrinsics, times: u32) -> Intrinsics {
    let [width, height] = EVK4;
    Intrinsics { width, height, ..of.resized(of.width * times, of.height * times) }
}

/// Each event at all pixels of its square.
fn enlarged(events: &Events, times: u16) -> Events {
    let mut larger = Events::new(EVK4[0], EVK4[1]);
    for event in events.iter() {
        for y in 0..times {
            for x in 0..times {
                larger.push(Event { x: event.x * times + x, y: event.y * times + y, ..event });
            }
        }
    }
    larger
}

/// The frames of a camera: the one whose exposure is nearest, and the first and the last beyond the ends.
pub struct FilmFrames {
    film: Arc<Film>,
    camera: Viewpoint,
}

impl FilmFrames {
    /// What a frame camera is shown.
    ///
    /// # Errors
    /// If the film has no such camera.
    pub fn new(film: Arc<Film>, name: &str) -> Result<Self, FilmError> {
        let camera = film.viewpoint(name)?.clone();
        Ok(Self { film, camera })
    }

    fn at(&self, exposure_ns: [i64; 2]) -> usize {
        let middle = |[start, end]: [i64; 2]| i64::midpoint(start, end);
        let Some(begins_ns) = self.film.begins_ns() else { return 0 };
        let t_ns = middle(exposure_ns) - begins_ns;
        let off = |frame: &Frame| middle(frame.exposure_ns).abs_diff(t_ns);
        (0..self.camera.frames.len()).min_by_key(|&index| off(&self.camera.frames[index])).unwrap_or(0)
    }
}

impl FrameScene for FilmFrames {
    fn frame(&mut self, _number: u64, exposure_ns: [i64; 2], width: u32, height: u32) -> (u64, Arc<Picture>) {
        let index = self.at(exposure_ns);
        let read = self.camera.frames.get(index).map(|frame| self.film.dataset.read_image(&self.camera, frame));
        let image = read.transpose().unwrap_or_else(|error| {
            self.film.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            None
        });
        let rgb = image.map_or_else(|| vec![0; 3 * width as usize * height as usize], |image| image.data);
        (index as u64, Arc::new(Picture { width, height, rgb }))
    }
}

/// The events of a camera.
pub struct FilmEvents {
    film: Arc<Film>,
    played: Played,
}

impl FilmEvents {
    /// What an event camera sees.
    ///
    /// # Errors
    /// If the camera's events cannot be read.
    pub fn new(film: Arc<Film>, name: &str) -> Result<Self, FilmError> {
        let camera = film.viewpoint(name)?;
        let events = film.dataset.read_events(camera)?.unwrap_or_default();
        let played = Played::new(enlarged(&events, side(camera)? as u16));
        Ok(Self { film, played })
    }
}

impl EventScene for FilmEvents {
    fn begin(&mut self, _clock: &TimeBase, _now_ns: i64) {}

    fn until(&mut self, clock: &TimeBase, now_ns: i64, events: &mut Vec<CdEvent>) {
        if let Some(begins_ns) = self.film.begins_ns() {
            self.played.until(begins_ns, clock, now_ns, events);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_becomes_a_square_that_shares_out_the_sensor() {
        assert_eq!(enlargement([320, 180]), Some(4));
        assert_eq!(enlargement([160, 120]), Some(5));
        assert_eq!(enlargement([1280, 720]), Some(1));
        assert_eq!(enlargement([1000, 700]), Some(1));
        assert_eq!(enlargement([1281, 720]), None);
        let mut events = Events::new(320, 180);
        events.push(Event { t_us: 5, x: 319, y: 179, on: true });
        let large = enlarged(&events, 4);
        assert_eq!((large.len(), large.get(15)), (16, Event { t_us: 5, x: 1279, y: 719, on: true }));
    }
}
