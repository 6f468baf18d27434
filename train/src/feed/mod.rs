//! What is learned from, on the device: frames, where in images something moves, and events. It is uploaded once, as far as the device has
//! room, so that an iteration hands over nothing of the size of an image.

mod events;
mod frames;
mod recent;

use std::sync::Arc;

use erfgs_base::memory;
use wgpu::Buffer;

pub(crate) use self::{events::Events, frames::Frames};
use crate::scene::{Scene, SceneError};
use erfgs_splat::{
    gpu::{Gpu, GpuError, stored},
    raster::Region,
};
use frames::AT_ONCE;

/// What share of the device's memory frames and events may take: one of so many. Of memory that it shares with the processor, of what is
/// free.
const SHARE: u64 = 4;

/// The device's memory where it is not known, bytes.
const UNKNOWN: u64 = 8 << 30;

/// Events take no more than one of so many parts of that. The rest is for frames.
const EVENTS: u64 = 2;

/// Why something is not on the device.
#[derive(Debug, thiserror::Error)]
pub enum FeedError {
    /// It cannot be read any more.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The device has no room.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// What is learned from, on the device.
#[derive(Debug)]
pub(crate) struct Feed {
    pub frames: Frames,
    pub events: Events,
    /// A bit for each pixel of each view where something moves in it.
    regions: Vec<Option<Buffer>>,
    most: u64,
    filled: bool,
}

impl Feed {
    /// Nothing yet, in at most so many bytes of the device's memory.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no room.
    pub fn new(gpu: &Gpu, scene: &Scene, most: Option<u64>) -> Result<Self, GpuError> {
        let most = most.unwrap_or_else(|| {
            let memory = gpu.memory().or_else(memory::available).unwrap_or(UNKNOWN);
            memory / SHARE
        });
        let events = Events::new(gpu, &scene.events)?;
        Ok(Self { frames: Frames::new(most), events, regions: Vec::new(), most, filled: false })
    }

    /// Bytes of the device's memory that it will take at most, and bytes that are on the way to it at a time.
    pub fn bytes(&self, scene: &Scene, with_events: bool) -> [u64; 2] {
        let [most, all] = self.room(scene, with_events);
        let pixels = scene.views.iter().map(|view| u64::from(view.view.width) * u64::from(view.view.height));
        // The frame that is looked at is there whatever is said. Each is rounded up.
        let held = all.min(most).max(3 * u64::from(scene.max_pixels())) + 16 * scene.frames.len() as u64;
        let regions = pixels.map(|pixels| stored(pixels.div_ceil(32) * 4)).sum::<u64>();
        [held + regions + Events::bytes_to_count(&scene.events), held.min(AT_ONCE) + 3 * u64::from(scene.max_pixels())]
    }

    /// Uploads what there is room for, once. `with_events` is whether events are learned from.
    ///
    /// # Errors
    /// [`FeedError`] where something cannot be read any more, or the device has less room than it should.
    pub fn fill(&mut self, gpu: &Gpu, scene: &Scene, with_events: bool) -> Result<(), FeedError> {
        if self.filled {
            return Ok(());
        }
        let taken = if with_events { self.events.fill(gpu, &scene.events, self.most / EVENTS)? } else { 0 };
        self.frames = Frames::new(self.most - taken);
        self.frames.fill(gpu, &scene.pictures, scene.frames.len())?;
        self.filled = true;
        Ok(())
    }

    /// Bytes that frames and events may take, and what all of them take. `with_events` is whether events are learned from.
    pub fn room(&self, scene: &Scene, with_events: bool) -> [u64; 2] {
        let events = scene.events.iter().filter(|_| with_events).map(Events::bytes);
        let frames = Frames::bytes(&scene.pictures, scene.frames.len());
        [self.most, events.fold(frames, u64::saturating_add)]
    }

    /// Takes up where something moves in the views.
    ///
    /// # Errors
    /// [`GpuError`] where the device has no room.
    pub fn set_regions(&mut self, gpu: &Gpu, scene: &Scene, regions: &[Option<Arc<Region>>]) -> Result<(), GpuError> {
        let bits = |(region, view): (&Option<Arc<Region>>, usize)| {
            let Some(region) = region else { return Ok(None) };
            let size = &scene.views[view].view;
            gpu.storage_from("region", &region.bits(size.width, size.height)).map(Some)
        };
        self.regions = regions.iter().zip(0..).map(bits).collect::<Result<_, _>>()?;
        Ok(())
    }

    /// A bit for each pixel of a view: whether something moves there; nothing where all of the view is looked at.
    pub fn region(&self, view: usize) -> Option<&Buffer> {
        self.regions.get(view)?.as_ref()
    }
}
