//! Frames on the device, as they are stored: 8 bits a channel, three channels.

use wgpu::Buffer;

use super::{FeedError, recent::Recent};
use crate::{losses, scene::Pictures};
use erfgs_splat::gpu::Gpu;

/// Bytes that are handed to the device before it is waited for: what is on the way lies in memory, too.
pub(super) const AT_ONCE: u64 = 64 << 20;

/// The frames that were used last.
#[derive(Debug)]
pub(crate) struct Frames {
    buffers: Recent<Buffer>,
}

impl Frames {
    /// None yet, of no more than so many bytes; the one that is looked at is always there.
    pub fn new(most: u64) -> Self {
        Self { buffers: Recent::new(most) }
    }

    /// Bytes that all `count` frames take.
    pub fn bytes(pictures: &Pictures, count: usize) -> u64 {
        let one = |index| pictures.pixels(index).saturating_mul(3).div_ceil(4).saturating_mul(4);
        (0..count).map(one).fold(0, u64::saturating_add)
    }

    /// Whether a frame is there; it then stays for longer.
    pub fn keep(&mut self, index: usize) -> bool {
        self.buffers.get(index).is_some()
    }

    /// A frame, which is uploaded where it is not there.
    ///
    /// # Errors
    /// [`FeedError::Scene`] where it cannot be read any more, [`FeedError::Gpu`] where the device has no room.
    pub fn get(&mut self, gpu: &Gpu, pictures: &Pictures, index: usize) -> Result<Buffer, FeedError> {
        if let Some(buffer) = self.buffers.get(index) {
            return Ok(buffer.clone());
        }
        let bytes = losses::packed(&pictures.get(index)?);
        let size = bytes.len() as u64;
        // The room of one that goes is taken over, as most frames are of one size.
        let mut gone = self.buffers.make_room(size).into_iter();
        let fits = |buffer: &Buffer| buffer.size() == size.next_multiple_of(16);
        let buffer = match gone.find(fits) {
            Some(buffer) => buffer,
            None => gpu.storage("frame", size)?,
        };
        gpu.upload(&buffer, 0, &bytes);
        self.buffers.put(index, size, buffer.clone());
        Ok(buffer)
    }

    /// Uploads all `count` frames, if memory and device have room for all of them.
    ///
    /// # Errors
    /// As [`Frames::get`].
    pub fn fill(&mut self, gpu: &Gpu, pictures: &Pictures, count: usize) -> Result<(), FeedError> {
        if !pictures.all_are_kept() || Self::bytes(pictures, count) > self.buffers.most() {
            return Ok(());
        }
        let mut on_the_way = 0;
        for index in 0..count {
            on_the_way += self.get(gpu, pictures, index)?.size();
            if on_the_way > AT_ONCE {
                arrive(gpu)?;
                on_the_way = 0;
            }
        }
        arrive(gpu)
    }
}

/// Waits until what was uploaded is on the device.
pub(super) fn arrive(gpu: &Gpu) -> Result<(), FeedError> {
    gpu.commands().submit();
    Ok(gpu.wait("uploading frames and events")?)
}

#[cfg(test)]
mod tests {
    use erfgs_splat::gpu::AdapterChoice;

    use super::*;
    use crate::scene::fixtures;

    const FRAMES: usize = 5;

    #[test]
    fn frames_are_uploaded_once_where_there_is_room_and_again_where_there_is_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let dataset = fixtures::painted(folder.path(), FRAMES);
        let gpu = Gpu::open(&AdapterChoice::default()).expect("an adapter");
        // Of 24 bytes each.
        for (most, kept, uploads) in
            [(0, u64::MAX, 20), (47, 0, 20), (119, u64::MAX, 20), (120, u64::MAX, 5), (120, 0, 5)]
        {
            let all = (0..FRAMES).map(|index| (0, index)).collect();
            let pictures = Pictures::new(&dataset, all, kept).expect("frames");
            let mut frames = Frames::new(most);
            let before = gpu.traffic().written;
            frames.fill(&gpu, &pictures, FRAMES).expect("memory");
            let filled = most == 120 && kept > 0;
            assert_eq!(gpu.traffic().written - before, if filled { 120 } else { 0 });
            // In turn, so that with room for all but one each is asked for when it has just gone.
            for index in (0..4).flat_map(|_| 0..FRAMES) {
                assert!(frames.keep(index) || uploads == 20 || !filled);
                let buffer = frames.get(&gpu, &pictures, index).expect("a frame");
                let colours: Vec<u8> = gpu.download(&buffer, 24).expect("a frame");
                assert_eq!(colours, [index as u8, 1, 2].repeat(8));
                assert!(frames.keep(index), "the one that is looked at is there");
            }
            assert_eq!(gpu.traffic().written - before, 24 * uploads, "{most} bytes");
        }
    }
}
