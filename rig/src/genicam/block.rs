//! A block of a stream, whatever transport brought it: a frame with what the camera says of it.

use super::GenicamError;

/// A block as it is handed over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Block {
    /// Its number: block ids counted on over their wraps.
    pub number: u64,
    /// When its first bytes came, nanoseconds.
    pub first_ns: i64,
    /// What the camera said of it; `None` if the leader was lost.
    pub leader: Option<Leader>,
    /// Its bytes, without those of packets that are missing, in whose place are zeros where that place is known.
    pub bytes: Vec<u8>,
    /// Packets that are missing, of those that are known to have been sent.
    pub missing: u32,
    /// Why it is not whole.
    pub damage: Option<Damage>,
    /// Whether blocks before it started over: the camera began anew.
    pub restarted: bool,
}

/// Why a block is not whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// Packets of the payload, leader or trailer are missing.
    Missing,
    /// More came than the camera said that a block has, or packets of other lengths.
    Layout,
    /// The camera says that it lost something itself: the status of a packet or of a trailer.
    Camera(u16),
}

/// What a camera says of a block before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Leader {
    /// The kind of block: [`Leader::holds_image`], [`Leader::holds_chunks`].
    pub kind: u16,
    /// The camera's clock, ticks.
    pub ticks: u64,
    /// What the image is; `None` where the leader does not say.
    pub image: Option<Image>,
}

/// An image, as its leader describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Image {
    /// Code of the pixel format (PFNC).
    pub pixels: u32,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Bytes after each row.
    pub row_padding: u16,
}

impl Leader {
    /// Whether the block is an image, with chunks behind it or without.
    #[must_use]
    pub fn holds_image(&self) -> bool {
        matches!(self.kind & 0x3fff, 1 | 5)
    }

    /// Whether chunks lie behind the image.
    #[must_use]
    pub fn holds_chunks(&self) -> bool {
        self.kind & 0x4000 != 0 || self.kind == 5
    }
}

/// Bytes of a block, as a camera tells them under some name. What it says is memory of ours, so that it is compared with the frame.
pub(crate) fn block_bytes(name: &str, value: i128, frame_bytes: usize) -> Result<usize, GenicamError> {
    let most = 2 * frame_bytes + (1 << 20);
    match usize::try_from(value) {
        Ok(bytes) if (frame_bytes..=most).contains(&bytes) => Ok(bytes),
        _ => Err(GenicamError::Feature {
            name: name.to_owned(),
            reason: format!("it says {value} bytes, and a frame has {frame_bytes}"),
        }),
    }
}
