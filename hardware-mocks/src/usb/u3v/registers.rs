//! The registers that USB3 Vision gives every camera, all little-endian: the bootstrap registers of GenCP (ABRM), those of USB3 Vision
//! (SBRM), of its stream (SIRM), and where the description lies (manifest).

/// GenCP's own, from 0 on.
pub mod abrm {
    pub const VERSION: u64 = 0x000;
    pub const MAKER: u64 = 0x004;
    pub const MODEL: u64 = 0x044;
    pub const FAMILY: u64 = 0x084;
    pub const DEVICE_VERSION: u64 = 0x0c4;
    pub const SERIAL: u64 = 0x144;
    pub const NAME: u64 = 0x184;
    pub const CAPABILITY: u64 = 0x1c4;
    pub const RESPONSE_MS: u64 = 0x1cc;
    pub const MANIFEST: u64 = 0x1d0;
    pub const SBRM: u64 = 0x1d8;
    pub const TIMESTAMP: u64 = 0x1f0;
    pub const LATCH: u64 = 0x1f8;
    pub const INCREMENT: u64 = 0x1fc;
    /// Behind the last.
    pub const END: u64 = 0x210;
}

pub const SBRM: u64 = 0x1_0000;
pub const SBRM_END: u64 = SBRM + 0x48;
pub const SIRM: u64 = 0x2_0000;
pub const SIRM_END: u64 = SIRM + 0x30;
pub const MANIFEST: u64 = 0x3_0000;
pub const MANIFEST_END: u64 = MANIFEST + 8 + 64;
/// Where the features begin.
pub const FEATURES: u64 = 0x4_0000;
/// Where the description begins.
pub const DESCRIPTION: u64 = 0x10_0000;

/// Of the stream, from [`SIRM`] on.
pub mod sirm {
    pub const INFO: u64 = 0x00;
    pub const CONTROL: u64 = 0x04;
    pub const PAYLOAD: u64 = 0x08;
    pub const LEADER: u64 = 0x10;
    pub const TRAILER: u64 = 0x14;
    /// What the host sets: largest leader, transfers of the payload, their count, two more, largest trailer.
    pub const SIZES: [u64; 6] = [0x18, 0x1c, 0x20, 0x24, 0x28, 0x2c];
}

/// The registers' memory.
#[derive(Clone, Debug)]
pub struct Memory(Vec<u8>);

impl Memory {
    /// All zeros.
    pub fn new() -> Self {
        Self(vec![0; MANIFEST_END as usize])
    }

    /// Bytes, if they are all there.
    pub fn bytes(&self, at: u64, length: usize) -> Option<&[u8]> {
        let end = at.checked_add(length as u64)?;
        let known = [(0, abrm::END), (SBRM, SBRM_END), (SIRM, SIRM_END), (MANIFEST, MANIFEST_END)];
        known.iter().any(|(first, behind)| *first <= at && end <= *behind).then_some(())?;
        self.0.get(at as usize..end as usize)
    }

    /// Puts bytes there.
    pub fn put(&mut self, at: u64, bytes: &[u8]) {
        self.0[at as usize..at as usize + bytes.len()].copy_from_slice(bytes);
    }

    /// A word.
    pub fn word(&self, at: u64) -> u32 {
        let at = at as usize;
        u32::from_le_bytes([self.0[at], self.0[at + 1], self.0[at + 2], self.0[at + 3]])
    }

    /// Puts a word there.
    pub fn put_word(&mut self, at: u64, word: u32) {
        self.put(at, &word.to_le_bytes());
    }

    /// Puts two words there.
    pub fn put_double(&mut self, at: u64, double: u64) {
        self.put(at, &double.to_le_bytes());
    }
}
