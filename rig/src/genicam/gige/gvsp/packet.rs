//! A datagram of the stream, taken apart.

use crate::genicam::block::{Image, Leader};

/// Bytes before the content, with block ids of 16 and of 64 bits.
pub const HEADER_BYTES: [usize; 2] = [8, 20];
/// Bytes that IP and UDP put before a datagram, which count in the camera's packet size.
pub const NETWORK_BYTES: usize = 28;

/// A datagram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Datagram<'a> {
    /// 0, or why this is not what it should be.
    pub status: u16,
    /// Block id as sent; of 16 bits it runs from 1 to 65535, and over again.
    pub block: u64,
    /// Whether ids are of 64 bits.
    pub long_ids: bool,
    /// Number of the packet in its block; the leader is 0.
    pub packet: u32,
    /// What it is.
    pub content: Content<'a>,
}

/// What a datagram is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content<'a> {
    /// The beginning of a block.
    Leader(Leader),
    /// Its end.
    Trailer,
    /// A piece of it.
    Payload(&'a [u8]),
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn double(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from(word(bytes, at)?) << 32 | u64::from(word(bytes, at + 4)?))
}

impl<'a> Datagram<'a> {
    /// Takes a datagram apart. `None` if it is too short, or of no kind that is known.
    #[must_use]
    pub fn read(bytes: &'a [u8]) -> Option<Self> {
        let status = half(bytes, 0)?;
        let format = *bytes.get(4)?;
        let long_ids = format & 0x80 != 0;
        let (block, packet) = if long_ids {
            (double(bytes, 8)?, word(bytes, 16)?)
        } else {
            (u64::from(half(bytes, 2)?), word(bytes, 4)? & 0xff_ffff)
        };
        let data = bytes.get(HEADER_BYTES[usize::from(long_ids)]..)?;
        let content = match format & 0x0f {
            1 => Content::Leader(leader(data)?),
            2 => Content::Trailer,
            3 => Content::Payload(data),
            _ => return None,
        };
        Some(Self { status, block, long_ids, packet, content })
    }

    /// Whether the camera says that it cannot give what was asked for, or lost something itself.
    #[must_use]
    pub fn is_error(&self) -> bool {
        self.status & 0x8000 != 0
    }
}

fn leader(data: &[u8]) -> Option<Leader> {
    let leader = Leader { kind: half(data, 2)?, ticks: double(data, 4)?, image: None };
    let image = || {
        let size = [word(data, 16)?, word(data, 20)?];
        Some(Image { pixels: word(data, 12)?, size, row_padding: half(data, 32)? })
    };
    Some(Leader { image: if leader.holds_image() { image() } else { None }, ..leader })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_leader_of_an_image_is_read() {
        let mut bytes = vec![0, 0, 0, 7, 1, 0, 0, 0, 0, 0, 0x40, 1, 0, 0, 0, 1, 0, 0, 0, 2, 1, 8, 0, 1];
        bytes.extend([0, 0, 2, 0x80, 0, 0, 1, 0xe0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 0]);
        let image = Image { pixels: 0x0108_0001, size: [640, 480], row_padding: 4 };
        let leader = Leader { kind: 0x4001, ticks: (1 << 32) + 2, image: Some(image) };
        assert!(leader.holds_image() && leader.holds_chunks());
        let read = Datagram::read(&bytes).unwrap();
        assert_eq!(
            read,
            Datagram { status: 0, block: 7, long_ids: false, packet: 0, content: Content::Leader(leader) }
        );
        assert_eq!(Datagram::read(&bytes[..19]), None);
    }

    #[test]
    fn long_ids_are_read() {
        let mut bytes = vec![0x80, 0x0c, 0, 0, 0x83, 0, 0, 0];
        bytes.extend([0, 0, 0, 1, 0, 0, 0, 9, 0, 1, 0, 2, 5, 6]);
        let read = Datagram::read(&bytes).unwrap();
        assert!(read.is_error() && read.long_ids);
        assert_eq!((read.block, read.packet, read.content), (1 << 32 | 9, 0x1_0002, Content::Payload(&[5, 6])));
    }
}
