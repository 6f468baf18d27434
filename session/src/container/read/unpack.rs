//! What the chunks of other programs are compressed with.
//!
//! The reader of the `mcap` crate (`sans_io::LinearReader`) does not serve here, since files are repaired by what is read:
//! - it does not say where in a chunk a record lies, which the index of a repaired file must;
//! - it stops at the length that a chunk claims, and overlooks that the chunk holds more;
//! - records of a chunk without a checksum come before it is known whether the chunk is whole;
//! - after an error it does not go on behind the chunk;
//! - its decoders are C libraries, and those that take their place must take bytes as they come, which ours do not.
//!
//! Thus the crate parses the chunk's record, as it does all others ([`super::parse`]), and this module unpacks what it holds.

use std::io::{self, Read};

use bytes::Bytes;

use super::framing::MAX_BODY;

/// How a chunk is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Lz4,
    Zstd,
}

impl Compression {
    /// From its name in the file; `None` for those that are not read.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "" => Some(Self::None),
            "lz4" => Some(Self::Lz4),
            "zstd" => Some(Self::Zstd),
            _ => None,
        }
    }

    /// The records of a chunk, which claims that they have `length` bytes. Memory grows with what comes out, to a little
    /// over [`MAX_BODY`] at most (twice as much while it grows), whatever is claimed.
    ///
    /// # Errors
    /// What is wrong: the compressed bytes are damaged, or the records are shorter or longer than claimed.
    pub fn unpack(self, packed: Bytes, length: u64) -> Result<Bytes, String> {
        if self == Self::None {
            let found = packed.len() as u64;
            return if found == length {
                Ok(packed)
            } else {
                Err(format!("the chunk holds {found} bytes, and claims {length}"))
            };
        }
        if length > MAX_BODY {
            return Err(format!("a chunk of {length} bytes is longer than erfgs reads"));
        }
        let mut records = Vec::new();
        // One byte more tells that there are more than claimed.
        let unpacked = match self {
            Self::Zstd => zstd(&packed, length + 1, &mut records),
            _ => lz4(&packed, length + 1, &mut records),
        };
        unpacked.map_err(|error| format!("the content of the chunk cannot be unpacked: {error}"))?;
        match records.len() as u64 {
            unpacked if unpacked < length => Err(format!("the chunk holds {unpacked} bytes of the {length} it claims")),
            unpacked if unpacked > length => Err(format!("the chunk holds more than the {length} bytes it claims")),
            _ => Ok(records.into()),
        }
    }
}

/// Appends what the frames in `packed` hold to `out`, until that has `limit` bytes.
fn lz4(mut packed: &[u8], limit: u64, out: &mut Vec<u8>) -> io::Result<()> {
    while !packed.is_empty() && (out.len() as u64) < limit {
        lz4_flex::frame::FrameDecoder::new(&mut packed).take(limit - out.len() as u64).read_to_end(out)?;
    }
    Ok(())
}

/// As [`lz4`]. A frame's own checksum is verified where it has one.
fn zstd(mut packed: &[u8], limit: u64, out: &mut Vec<u8>) -> io::Result<()> {
    // Its window has 128 MiB at most.
    let mut decoder = ruzstd::decoding::FrameDecoder::new();
    while !packed.is_empty() && (out.len() as u64) < limit {
        let frame = ruzstd::decoding::StreamingDecoder::new_with_decoder(&mut packed, &mut decoder);
        frame.map_err(io::Error::other)?.take(limit - out.len() as u64).read_to_end(out)?;
        let stated = decoder.get_checksum_from_data().filter(|_| decoder.can_collect() == 0);
        if stated.is_some_and(|stated| decoder.get_calculated_checksum() != Some(stated)) {
            return Err(io::Error::other("it does not match its checksum"));
        }
    }
    Ok(())
}

/// How a frame of Zstandard begins.
const ZSTD_MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];

/// A message that rosbag2 compressed by itself (`compression_mode: message`), unpacked; one that it did not as it is. CDR begins
/// with two zeros, or a zero and a one.
///
/// # Errors
/// If it is damaged, or longer than messages are.
pub(super) fn message(packed: &Bytes) -> Result<Bytes, String> {
    if !packed.starts_with(&ZSTD_MAGIC) {
        return Ok(packed.clone());
    }
    let mut unpacked = Vec::new();
    zstd(packed, MAX_BODY + 1, &mut unpacked).map_err(|error| format!("a message cannot be unpacked: {error}"))?;
    if unpacked.len() as u64 > MAX_BODY {
        return Err(format!("a message unpacks to more than {MAX_BODY} bytes"));
    }
    Ok(unpacked.into())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn packed(compression: Compression, records: &[u8]) -> Vec<u8> {
        if compression == Compression::Zstd {
            return ruzstd::encoding::compress_to_vec(records, ruzstd::encoding::CompressionLevel::Fastest);
        }
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(records).unwrap();
        encoder.finish().unwrap()
    }

    fn records() -> Vec<u8> {
        (0..300_000_u32).map(|i| (i % 251) as u8 ^ (i >> 12) as u8).collect()
    }

    #[test]
    fn frames_follow_each_other() {
        for compression in [Compression::Lz4, Compression::Zstd] {
            let records = records();
            let (first, rest) = records.split_at(200_000);
            let frames = [packed(compression, first), packed(compression, b""), packed(compression, rest)].concat();
            let found = compression.unpack(frames.into(), records.len() as u64).unwrap();
            assert!(found == records, "{compression:?}");
        }
    }

    #[test]
    fn a_claimed_length_must_be_the_true_one() {
        for compression in [Compression::Lz4, Compression::Zstd] {
            let records = records();
            let unpack = |length| compression.unpack(packed(compression, &records).into(), length).unwrap_err();
            let length = records.len() as u64;
            for more in [length - 1, 1, 0] {
                assert!(unpack(more).contains("more than"), "{compression:?} {more}");
            }
            for less in [length + 1, MAX_BODY] {
                assert!(unpack(less).contains("holds 300000 bytes of the"), "{compression:?} {less}");
            }
            for absurd in [MAX_BODY + 1, u64::MAX] {
                assert!(unpack(absurd).contains("longer than erfgs reads"), "{compression:?} {absurd}");
            }
        }
    }

    #[test]
    fn a_bomb_is_left_once_it_holds_more_than_is_claimed() {
        for compression in [Compression::Lz4, Compression::Zstd] {
            let bomb = packed(compression, &vec![0; 64 << 20]);
            let mut out = Vec::new();
            let unpack = if compression == Compression::Zstd { zstd } else { lz4 };
            unpack(&bomb, 101, &mut out).unwrap();
            assert!(out.len() == 101 && out.capacity() < 1 << 20, "{compression:?}");
        }
    }

    #[test]
    fn what_is_cut_or_damaged_is_refused_and_does_not_panic() {
        for compression in [Compression::Lz4, Compression::Zstd] {
            let records = &records()[..3000];
            let whole = packed(compression, records);
            for cut in 0..whole.len() {
                let unpacked = compression.unpack(whole[..cut].to_vec().into(), records.len() as u64);
                // An end mark and a checksum may lack where all that they end is there.
                assert!(unpacked.is_err() || cut + 8 >= whole.len(), "{compression:?} cut at {cut}");
            }
            for place in 0..8 * whole.len() {
                let mut damaged = whole.clone();
                damaged[place / 8] ^= 1 << (place % 8);
                let _ = compression.unpack(damaged.into(), records.len() as u64);
            }
        }
    }
}
