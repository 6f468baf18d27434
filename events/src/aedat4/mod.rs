//! AEDAT 4 (iniVation DV): `#!AER-DAT4.0\r\n`, a header, packets of compressed FlatBuffers, and perhaps a table of them.
//! (iniVation, "AEDAT file formats", AEDAT-4.0.)
//!
//! - header: length in 32 bits, then a FlatBuffer `IOHE`: compression (0 none, 1 and 2 LZ4, 3 and 4 Zstandard), where
//!   the table lies (-1 if nowhere, as in interrupted recordings), and an XML description of the streams
//! - packet: number of the stream and length in 32 bits each, then so many bytes: a FlatBuffer with its length first,
//!   compressed as one LZ4 or Zstandard frame
//!
//! All numbers are little-endian. Times are microseconds since 1970.

mod decode;
mod description;
mod encode;
mod flat;
mod lz4;
mod packets;

pub use decode::{Aedat4Decoder, Aedat4Header};
pub use description::{Aedat4Kind, Aedat4Stream};
pub use encode::Aedat4Encoder;

/// The first bytes of a file.
pub const AEDAT4_MAGIC: &[u8; 14] = b"#!AER-DAT4.0\r\n";

/// Packets and headers longer than this, compressed or not, are taken for damaged: DV's hold 10 ms of events, a sixth of it
/// at 100 million events a second, and a damaged length must not fill the memory.
const MAX_PACKET: usize = 1 << 26;

/// How packets are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Aedat4Compression {
    /// Not at all.
    None,
    /// As an LZ4 frame.
    #[default]
    Lz4,
    /// As a Zstandard frame.
    Zstd,
}

impl Aedat4Compression {
    fn from_code(code: i32) -> Option<Self> {
        match code {
            0 => Some(Self::None),
            1 | 2 => Some(Self::Lz4),
            3 | 4 => Some(Self::Zstd),
            _ => None,
        }
    }

    fn code_and_name(self) -> (i32, &'static str) {
        match self {
            Self::None => (0, "NONE"),
            Self::Lz4 => (1, "LZ4"),
            Self::Zstd => (3, "ZSTD"),
        }
    }
}
