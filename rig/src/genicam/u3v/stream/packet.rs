//! The beginning and the end of a block, taken apart.

use crate::genicam::block::{Image, Leader};

/// Bytes of a leader without what depends on the kind of block.
const LEADER_BYTES: usize = 28;
/// Bytes of a trailer without what depends on the kind of block.
const TRAILER_BYTES: usize = 28;
/// Bytes of a leader that says what the image is.
const IMAGE_BYTES: usize = 50;

/// The end of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Trailer {
    /// Its id.
    pub id: u64,
    /// 0, or what the camera lost itself.
    pub status: u16,
    /// How many bytes of the payload are of use.
    pub valid_bytes: u64,
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn double(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// What begins so and says that it has so many bytes, all of which are there.
fn sized<'a>(bytes: &'a [u8], magic: &[u8; 4], least: usize) -> Option<&'a [u8]> {
    let size = usize::from(half(bytes, 6)?);
    (bytes.starts_with(magic) && size >= least).then(|| bytes.get(..size))?
}

/// A leader, with the id of its block.
#[must_use]
pub fn leader(bytes: &[u8]) -> Option<(u64, Leader)> {
    let bytes = sized(bytes, b"U3VL", LEADER_BYTES)?;
    let leader = Leader { kind: half(bytes, 18)?, ticks: double(bytes, 20)?, image: None };
    let image = || {
        let size = [word(bytes, 32)?, word(bytes, 36)?];
        Some(Image { pixels: word(bytes, 28)?, size, row_padding: half(bytes, 48)? })
    };
    let image = if leader.holds_image() && bytes.len() >= IMAGE_BYTES { image() } else { None };
    Some((double(bytes, 8)?, Leader { image, ..leader }))
}

/// A trailer.
#[must_use]
pub fn trailer(bytes: &[u8]) -> Option<Trailer> {
    let bytes = sized(bytes, b"U3VT", TRAILER_BYTES)?;
    Some(Trailer { id: double(bytes, 8)?, status: half(bytes, 16)?, valid_bytes: double(bytes, 20)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_leader_of_an_image_is_read() {
        let mut bytes = b"U3VL\0\0\x34\0\x07\0\0\0\0\0\0\0\0\0\x01\x40".to_vec();
        bytes.extend(9_000_000_000_u64.to_le_bytes());
        for word in [0x0108_0001_u32, 640, 480, 8, 4, 6] {
            bytes.extend(word.to_le_bytes());
        }
        let image = Image { pixels: 0x0108_0001, size: [640, 480], row_padding: 6 };
        let expected = Leader { kind: 0x4001, ticks: 9_000_000_000, image: Some(image) };
        assert_eq!(leader(&bytes), Some((7, expected)));
        // Filled up to the transfer.
        assert_eq!(leader(&[&bytes[..], &[0; 900]].concat()), Some((7, expected)));
        assert_eq!(leader(&bytes[..51]), None);
        assert_eq!(trailer(&bytes), None);
    }

    #[test]
    fn a_trailer_is_read() {
        let mut bytes = b"U3VT\0\0\x20\0\x07\0\0\0\0\0\0\0\x01\xa1\0\0".to_vec();
        bytes.extend(300_u64.to_le_bytes());
        bytes.extend(480_u32.to_le_bytes());
        assert_eq!(trailer(&bytes), Some(Trailer { id: 7, status: 0xa101, valid_bytes: 300 }));
        assert_eq!(trailer(&bytes[..31]), None);
        bytes[6] = 27;
        assert_eq!(trailer(&bytes), None);
    }
}
