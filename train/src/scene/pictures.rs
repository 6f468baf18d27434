//! The pixels of training frames. Those that a bound of memory has room for are kept; the others are read from their files each time that
//! they are asked for, ahead of time where it is known what is asked for next.

use std::{
    collections::{HashMap, hash_map::Entry},
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
};

use erfgs_dataset::Dataset;
use rayon::{ThreadPool, ThreadPoolBuilder, prelude::*};

use super::SceneError;

/// Pixels of a frame, row-major, red in the lowest byte, alpha 255.
pub type Pixels = Arc<Vec<u32>>;

/// The pixels of all training frames.
#[derive(Debug)]
pub struct Pictures {
    files: Arc<Files>,
    kept: Vec<Option<Pixels>>,
    /// What reads ahead; nothing where all are kept.
    readers: Option<ThreadPool>,
    ahead: Arc<Ahead>,
    bytes: [u64; 2],
}

/// Where frames lie: the dataset, and of each frame its camera and which of that it is.
#[derive(Debug)]
struct Files {
    dataset: Dataset,
    frames: Vec<(usize, usize)>,
}

/// Frames that are being read before they are asked for.
#[derive(Debug, Default)]
struct Ahead {
    frames: Mutex<HashMap<usize, Expected>>,
    read: Condvar,
}

#[derive(Debug)]
struct Expected {
    /// When it will be asked for.
    due: u64,
    /// What came of reading it, once that is done.
    outcome: Option<Result<Pixels, SceneError>>,
}

impl Files {
    fn pixels(&self, index: usize) -> u64 {
        let size = &self.dataset.manifest.cameras[self.frames[index].0].intrinsics;
        u64::from(size.width) * u64::from(size.height)
    }

    fn bytes(&self, index: usize) -> u64 {
        4 * self.pixels(index)
    }

    fn read(&self, index: usize) -> Result<Pixels, SceneError> {
        let (camera, frame) = self.frames[index];
        let camera = &self.dataset.manifest.cameras[camera];
        let image = self.dataset.read_image(camera, &camera.frames[frame])?;
        let pixels = image.data.as_chunks::<3>().0.iter().map(|&[r, g, b]| u32::from_le_bytes([r, g, b, 255]));
        Ok(Arc::new(pixels.collect()))
    }
}

impl Ahead {
    fn lock(&self) -> MutexGuard<'_, HashMap<usize, Expected>> {
        self.frames.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pictures {
    /// The frames of `dataset` that are told by camera and by which of its frames; so many are read and kept, evenly among all, as take
    /// no more than `most` bytes.
    ///
    /// # Errors
    /// [`SceneError::Dataset`] where one that is kept cannot be read.
    pub fn new(dataset: &Dataset, frames: Vec<(usize, usize)>, most: u64) -> Result<Self, SceneError> {
        let files = Arc::new(Files { dataset: dataset.clone(), frames });
        let count = files.frames.len();
        let total: u64 = (0..count).map(|index| files.bytes(index)).sum();
        let (mut kept, mut passed) = (0, 0);
        let keeps: Vec<bool> = (0..count)
            .map(|index| {
                let bytes = files.bytes(index);
                passed += bytes;
                let has_room = u128::from(kept + bytes) * u128::from(total) <= u128::from(most) * u128::from(passed);
                kept += if has_room { bytes } else { 0 };
                has_room
            })
            .collect();
        let readers = (kept < total).then(readers).transpose()?;
        let read = |(index, keep): (usize, &bool)| keep.then(|| files.read(index)).transpose();
        let pixels = keeps.par_iter().enumerate().map(read).collect::<Result<_, _>>()?;
        Ok(Self { files, kept: pixels, readers, ahead: Arc::default(), bytes: [kept, total] })
    }

    /// Bytes of the frames that are kept, and of all.
    #[must_use]
    pub fn bytes(&self) -> [u64; 2] {
        self.bytes
    }

    /// How many pixels a frame has.
    #[must_use]
    pub fn pixels(&self, index: usize) -> u64 {
        self.files.pixels(index)
    }

    /// Whether no frame is read again.
    #[must_use]
    pub fn all_are_kept(&self) -> bool {
        self.readers.is_none()
    }

    /// The pixels of a frame.
    ///
    /// # Errors
    /// [`SceneError::Dataset`] where it is not kept and cannot be read any more.
    pub fn get(&self, index: usize) -> Result<Pixels, SceneError> {
        if let Some(kept) = &self.kept[index] {
            return Ok(kept.clone());
        }
        let mut frames = self.ahead.lock();
        while frames.get(&index).is_some_and(|expected| expected.outcome.is_none()) {
            frames = self.ahead.read.wait(frames).unwrap_or_else(PoisonError::into_inner);
        }
        let read = frames.remove(&index).and_then(|expected| expected.outcome);
        drop(frames);
        read.unwrap_or_else(|| self.files.read(index))
    }

    /// Begins to read a frame that will be asked for when `due`.
    pub fn expect(&self, index: usize, due: u64) {
        let Some(readers) = self.readers.as_ref().filter(|_| self.kept[index].is_none()) else { return };
        match self.ahead.lock().entry(index) {
            Entry::Occupied(mut begun) => {
                begun.get_mut().due = due;
                return;
            }
            Entry::Vacant(place) => place.insert(Expected { due, outcome: None }),
        };
        let (files, ahead) = (self.files.clone(), self.ahead.clone());
        readers.spawn(move || {
            // A decoder that panics shall do so where the frame is asked for.
            let outcome = catch_unwind(AssertUnwindSafe(|| files.read(index))).ok();
            let mut frames = ahead.lock();
            match (outcome, frames.get_mut(&index)) {
                (outcome @ Some(_), Some(expected)) => expected.outcome = outcome,
                _ => drop(frames.remove(&index)),
            }
            ahead.read.notify_all();
        });
    }

    /// Leaves what was expected before `now` and has not been asked for.
    pub fn forget_before(&self, now: u64) {
        self.ahead.lock().retain(|_, expected| expected.due >= now || expected.outcome.is_none());
    }
}

/// A thread for each processor: reading waits for disks, too, and must not keep waiting what computes.
fn readers() -> Result<ThreadPool, SceneError> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let pool = ThreadPoolBuilder::new().num_threads(threads).thread_name(|index| format!("frames {index}"));
    pool.build().map_err(|source| SceneError::Threads { source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::fixtures;

    const FRAMES: usize = 10;

    fn pictures(root: &std::path::Path, most: u64) -> Pictures {
        Pictures::new(&fixtures::painted(root, FRAMES), (0..FRAMES).map(|index| (0, index)).collect(), most)
            .expect("frames")
    }

    fn pixels(index: usize) -> Vec<u32> {
        vec![u32::from_le_bytes([index as u8, 1, 2, 255]); 8]
    }

    #[test]
    fn all_frames_are_the_same_however_many_are_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        for (most, kept) in [(0, 0), (31, 0), (32, 1), (100, 3), (319, 9), (320, 10), (u64::MAX, 10)] {
            let pictures = pictures(folder.path(), most);
            assert_eq!(pictures.bytes(), [32 * kept, 320], "{most}");
            assert_eq!(pictures.all_are_kept(), kept == 10);
            for due in 0..FRAMES {
                pictures.forget_before(due as u64);
                // Some are expected, one twice, and one is asked for though nobody expected it.
                (due..FRAMES.min(due + 3)).filter(|index| index % 4 != 3).for_each(|at| pictures.expect(at, at as u64));
                assert_eq!(*pictures.get(due).expect("a frame"), pixels(due));
            }
            pictures.forget_before(u64::MAX);
            assert!(pictures.ahead.lock().values().all(|expected| expected.outcome.is_none()), "nothing is left");
        }
    }

    #[test]
    fn what_is_kept_is_spread_over_the_recording() {
        let folder = tempfile::tempdir().expect("a folder");
        let kept: Vec<bool> = pictures(folder.path(), 160).kept.iter().map(Option::is_some).collect();
        assert_eq!(kept, [false, true, false, true, false, true, false, true, false, true]);
    }

    #[test]
    fn a_frame_that_is_gone_is_told_when_it_is_asked_for() {
        let folder = tempfile::tempdir().expect("a folder");
        let pictures = pictures(folder.path(), 0);
        std::fs::remove_file(folder.path().join("7.png")).expect("removed");
        pictures.expect(7, 1);
        for _ in 0..2 {
            let error = pictures.get(7).expect_err("it is not there").to_string();
            assert!(error.contains("7.png") && error.contains("camera a"), "{error}");
        }
        assert_eq!(*pictures.get(6).expect("a frame"), pixels(6));
    }
}
