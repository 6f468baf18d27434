//! From a block of the stream to a frame.

use bytes::Bytes;
use erfgs_scene::pixel::{PixelFormat, frame_bytes};
use erfgs_session::source::{FrameStamp, Packet, StampClock, StampPoint};

use crate::{
    frame::check::without_padding,
    genicam::{Block, Order, cut, pixel},
};

/// What the frames of a stream are to be.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Pixels.
    pub format: PixelFormat,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Ticks of the camera's clock a second.
    pub tick_hz: u64,
    /// Which way the numbers of chunks lie.
    pub order: Order,
}

/// A frame, and the chunks behind it.
pub struct Frame {
    /// The frame.
    pub packet: Packet,
    /// Chunks: ids and bytes.
    pub chunks: Vec<(u32, Bytes)>,
    /// What is not as it was agreed, if something is.
    pub strange: Option<String>,
}

impl Shape {
    /// Bytes of a frame.
    pub fn bytes(&self) -> usize {
        frame_bytes(self.format, self.size[0], self.size[1]).unwrap_or(0)
    }

    /// Makes a frame of a block: without chunks and padding, marked where it is not whole.
    pub fn frame(&self, block: Block, sequence: u64) -> Frame {
        let mut damaged = block.damage.is_some();
        let mut strange = None;
        let image = block.leader.and_then(|leader| leader.image);
        if let Some(leader) = block.leader.filter(|leader| !leader.holds_image()) {
            strange = Some(format!("blocks of kind {:#06x}, which are no images", leader.kind));
        }
        if let Some(image) =
            image.filter(|image| Some(image.pixels) != pixel::code_of(self.format) || image.size != self.size)
        {
            let [width, height] = image.size;
            strange = Some(format!("images of format {:#010x} with {width} x {height} pixels", image.pixels));
        }
        let bytes = Bytes::from(block.bytes);
        // Where something is missing, where chunks begin is not known.
        let parts = block.leader.filter(|leader| leader.holds_chunks() && !damaged).map(|_| cut(&bytes, self.order));
        let (mut payload, chunks) = match parts {
            Some(Some(parts)) => {
                let rest = parts.iter().skip(1).map(|chunk| (chunk.id, bytes.slice_ref(chunk.data))).collect();
                (parts.first().map_or_else(Bytes::new, |image| bytes.slice_ref(image.data)), rest)
            }
            Some(None) => {
                strange = Some("blocks whose chunks cannot be taken apart".into());
                (bytes, Vec::new())
            }
            None => (bytes, Vec::new()),
        };
        let padding = image.map_or(0, |image| u32::from(image.row_padding));
        let row = erfgs_scene::pixel::row_bytes(self.format, self.size[0]).unwrap_or(0) as u32;
        if padding > 0
            && let Some(rows) = without_padding(self.format, self.size[0], row.saturating_add(padding), &payload)
        {
            payload = rows.into();
        }
        damaged |= strange.is_some();
        if damaged {
            // What lies behind the image is no part of it.
            payload.truncate(self.bytes());
        }
        damaged |= payload.len() != self.bytes();
        let stamp = block.leader.map(|leader| FrameStamp {
            kernel_ns: self.camera_ns(leader.ticks),
            clock: StampClock::Camera,
            point: StampPoint::StartOfExposure,
            sequence: block.number as u32,
        });
        let discontinuity = block.restarted;
        let packet = Packet { sequence, host_ns: block.first_ns, discontinuity, damaged, stamp, payload };
        Frame { packet, chunks, strange }
    }

    fn camera_ns(&self, ticks: u64) -> i64 {
        let ns = u128::from(ticks) * 1_000_000_000 / u128::from(self.tick_hz.max(1));
        i64::try_from(ns).unwrap_or(i64::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::genicam::{Damage, Image, Leader};

    const SHAPE: Shape = Shape { format: PixelFormat::Grey8, size: [2, 2], tick_hz: 125_000_000, order: Order::Big };

    fn block(kind: u16, bytes: &[u8], padding: u16) -> Block {
        let image = Image { pixels: 0x0108_0001, size: [2, 2], row_padding: padding };
        Block {
            number: 1 << 32 | 5,
            first_ns: 77,
            leader: Some(Leader { kind, ticks: 250, image: Some(image) }),
            bytes: bytes.to_vec(),
            missing: 0,
            damage: None,
            restarted: false,
        }
    }

    #[test]
    fn a_frame_has_its_image_alone_and_the_cameras_time() {
        let frame = SHAPE.frame(block(1, &[1, 2, 3, 4], 0), 9);
        let stamp =
            FrameStamp { kernel_ns: 2000, clock: StampClock::Camera, point: StampPoint::StartOfExposure, sequence: 5 };
        assert_eq!((&frame.packet.payload[..], frame.packet.stamp), (&[1, 2, 3, 4][..], Some(stamp)));
        assert_eq!((frame.packet.sequence, frame.packet.host_ns, frame.packet.damaged), (9, 77, false));
        let padded = SHAPE.frame(block(1, &[1, 2, 0, 3, 4, 0], 1), 9).packet;
        assert_eq!((&padded.payload[..], padded.damaged), (&[1, 2, 3, 4][..], false));
        let chunked = [&[1, 2, 3, 4, 0, 0, 0x10, 0, 0, 0, 0, 4][..], &[9, 9, 0, 0, 0x10, 1, 0, 0, 0, 2]].concat();
        let frame = SHAPE.frame(block(0x4001, &chunked, 0), 9);
        assert_eq!((&frame.packet.payload[..], frame.packet.damaged), (&[1, 2, 3, 4][..], false));
        assert_eq!(frame.chunks, [(0x1001, Bytes::from_static(&[9, 9]))]);
    }

    #[test]
    fn what_is_not_as_agreed_is_damaged_and_told() {
        let missing = Block { damage: Some(Damage::Missing), leader: None, ..block(1, &[1, 2, 3, 4, 5, 6], 0) };
        let frame = SHAPE.frame(missing, 0);
        assert_eq!(
            (&frame.packet.payload[..], frame.packet.damaged, frame.packet.stamp),
            (&[1, 2, 3, 4][..], true, None)
        );
        assert_eq!(frame.strange, None);
        assert!(SHAPE.frame(block(1, &[1, 2, 3], 0), 0).packet.damaged);
        let mut other = block(1, &[1, 2, 3, 4], 0);
        other.leader.as_mut().unwrap().image.as_mut().unwrap().size = [4, 1];
        let frame = SHAPE.frame(other, 0);
        assert!(frame.packet.damaged && frame.strange.unwrap().contains("4 x 1 pixels"));
        assert!(SHAPE.frame(block(6, &[1, 2, 3, 4], 0), 0).strange.unwrap().contains("no images"));
        assert!(SHAPE.frame(block(0x4001, &[1, 2, 3, 4], 0), 0).strange.unwrap().contains("chunks"));
    }
}
