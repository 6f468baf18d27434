//! Chunks that the filter Blosc (HDF5's number 32001) compressed, as DSEC's files have them. (c-blosc, `README_HEADER.rst`.)
//!
//! | Bytes | Content |
//! |---|---|
//! | 0, 1 | versions of the format and of its compressor |
//! | 2 | flags: bit 0, bytes are shuffled; 1, stored as they are; 2, bits are shuffled; 4, blocks are not split; 5 to 7, the compressor |
//! | 3 | size of an element |
//! | 4 to 15 | unpacked bytes, bytes of a block, packed bytes with this header: 32 bits each, little-endian |
//! | then | where each block begins, 32 bits each; the blocks |
//!
//! A block is one stream, or, split, one for each byte of an element; a stream is its length in 32 bits and so many bytes,
//! which are stored as they are if they are as many as those that they stand for.

use std::io::Read;

/// HDF5's number of the filter.
pub const FILTER: i32 = 32001;

const HEADER: usize = 16;
/// Longer chunks are refused: those of event files have some MiB, and a damaged length must not fill the memory.
const MAX_BYTES: usize = 1 << 26;

/// Unpacks a chunk.
///
/// # Errors
/// What is wrong, or what is not supported.
pub fn unpack(packed: &[u8]) -> Result<Vec<u8>, String> {
    let short = || format!("a Blosc chunk of {} bytes is cut short", packed.len());
    let header: &[u8; HEADER] = packed.first_chunk().ok_or_else(short)?;
    let number = |bytes: &[u8], at: usize| -> Option<usize> {
        usize::try_from(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?)).ok()
    };
    let (flags, element) = (header[2], usize::from(header[3]));
    let [bytes, block_bytes, packed_bytes] = [4, 8, 12].map(|at| number(header, at).unwrap_or(0));
    if bytes > MAX_BYTES || packed_bytes > packed.len() {
        let limits = format!("at most {MAX_BYTES} bytes in {} are possible", packed.len());
        return Err(format!("a Blosc chunk claims {bytes} bytes packed in {packed_bytes}; {limits}"));
    }
    let packed = &packed[..packed_bytes];
    if flags & 2 != 0 {
        return packed.get(HEADER..HEADER + bytes).map(<[u8]>::to_vec).ok_or_else(short);
    }
    if bytes == 0 {
        return Ok(Vec::new());
    }
    if block_bytes == 0 || element == 0 {
        return Err("a Blosc chunk has blocks without a byte".to_owned());
    }
    let compressor = Compressor::from_code(flags >> 5)?;
    let mut out = Vec::new();
    for (index, from) in (0..bytes).step_by(block_bytes).enumerate() {
        let length = block_bytes.min(bytes - from);
        let split = flags & 16 == 0 && length == block_bytes && length.is_multiple_of(element);
        let streams = if split { element } else { 1 };
        let mut at = number(packed, HEADER + 4 * index).ok_or_else(short)?;
        let mut block = Vec::new();
        for _ in 0..streams {
            let count = number(packed, at).ok_or_else(short)?;
            let stream = packed.get(at + 4..).and_then(|rest| rest.get(..count)).ok_or_else(short)?;
            at += 4 + count;
            let wanted = length / streams;
            if count == wanted {
                block.extend_from_slice(stream);
            } else {
                compressor.unpack(stream, wanted, &mut block)?;
            }
        }
        match flags & 5 {
            0 => out.extend_from_slice(&block),
            1 => unshuffle_bytes(&block, element, &mut out),
            _ => unshuffle_bits(&block, element, &mut out),
        }
    }
    Ok(out)
}

#[derive(Clone, Copy, Debug)]
enum Compressor {
    Lz4,
    Zstd,
}

impl Compressor {
    fn from_code(code: u8) -> Result<Self, String> {
        match code {
            1 => Ok(Self::Lz4),
            4 => Ok(Self::Zstd),
            other => {
                let name =
                    ["BloscLZ", "", "Snappy", "Zlib"].get(usize::from(other)).unwrap_or(&"an unknown compressor");
                Err(format!("Blosc with {name} is not read; LZ4 and Zstandard are. `h5repack -f GZIP=1` converts"))
            }
        }
    }

    /// Appends exactly `wanted` bytes.
    fn unpack(self, stream: &[u8], wanted: usize, out: &mut Vec<u8>) -> Result<(), String> {
        let before = out.len();
        match self {
            Self::Lz4 => {
                out.resize(before + wanted, 0);
                let count = lz4_flex::block::decompress_into(stream, &mut out[before..])
                    .map_err(|error| format!("a Blosc block is damaged: {error}"))?;
                out.truncate(before + count);
            }
            Self::Zstd => {
                let decoder = ruzstd::decoding::StreamingDecoder::new(stream)
                    .map_err(|error| format!("a Blosc block is damaged: {error}"))?;
                decoder
                    .take(wanted as u64 + 1)
                    .read_to_end(out)
                    .map_err(|error| format!("a Blosc block is damaged: {error}"))?;
            }
        }
        if out.len() == before + wanted {
            Ok(())
        } else {
            Err(format!("a Blosc block holds {} bytes instead of {wanted}", out.len() - before))
        }
    }
}

/// All first bytes of the elements, then all second bytes, and so on; what makes no whole element comes last as it is.
fn unshuffle_bytes(block: &[u8], element: usize, out: &mut Vec<u8>) {
    let count = block.len() / element;
    for index in 0..count {
        out.extend((0..element).map(|byte| block[byte * count + index]));
    }
    out.extend_from_slice(&block[count * element..]);
}

/// As [`unshuffle_bytes`] with bits: the lowest bits of all first bytes, eight to a byte, then their second bits, and so on.
/// A block whose elements are no multiple of eight was left as it is.
fn unshuffle_bits(block: &[u8], element: usize, out: &mut Vec<u8>) {
    let count = block.len() / element;
    if !count.is_multiple_of(8) {
        out.extend_from_slice(block);
        return;
    }
    let row = count / 8;
    for index in 0..count {
        for byte in 0..element {
            let bit = |bit: usize| block[(8 * byte + bit) * row + index / 8] >> (index % 8) & 1;
            out.push((0..8).fold(0, |value, at| value | bit(at) << at));
        }
    }
    out.extend_from_slice(&block[count * element..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(flags: u8, element: u8, bytes: u32, block: u32, rest: &[u8]) -> Vec<u8> {
        let mut out = vec![2, 1, flags, element];
        [bytes, block, (HEADER + rest.len()) as u32].iter().for_each(|n| out.extend(n.to_le_bytes()));
        out.extend_from_slice(rest);
        out
    }

    #[test]
    fn blocks_streams_and_bytes_are_put_together_again() {
        assert_eq!(unpack(&chunk(2, 4, 5, 5, b"as is")).unwrap(), b"as is");
        // Two blocks, of which the first is split into two streams of stored bytes; bytes are shuffled.
        let mut rest = [24_u32, 36].map(u32::to_le_bytes).concat();
        for stream in [&b"ac"[..], b"bd", b"ef"] {
            rest.extend((stream.len() as u32).to_le_bytes());
            rest.extend_from_slice(stream);
        }
        assert_eq!(unpack(&chunk(1 | 4 << 5, 2, 6, 4, &rest)).unwrap(), b"abcdef");
        // Bits: eight elements of one byte, 0 to 7.
        let mut rest = 20_u32.to_le_bytes().to_vec();
        rest.extend(8_u32.to_le_bytes());
        rest.extend([0b1010_1010, 0b1100_1100, 0b1111_0000, 0, 0, 0, 0, 0]);
        assert_eq!(unpack(&chunk(4 | 1 << 5, 1, 8, 8, &rest)).unwrap(), [0, 1, 2, 3, 4, 5, 6, 7]);
    }

    #[test]
    fn every_cut_and_every_claim_is_an_error() {
        let mut rest = 20_u32.to_le_bytes().to_vec();
        let stream = lz4_flex::block::compress(&[7; 400]);
        rest.extend((stream.len() as u32).to_le_bytes());
        rest.extend(stream);
        let whole = chunk(16 | 1 << 5, 4, 400, 400, &rest);
        assert_eq!(unpack(&whole).unwrap(), [7; 400]);
        for length in 0..whole.len() {
            assert!(unpack(&whole[..length]).is_err(), "{length}");
        }
        assert!(unpack(&chunk(16 | 1 << 5, 4, u32::MAX, 400, &rest)).is_err());
        assert!(unpack(&chunk(16 | 1 << 5, 4, 401, 401, &rest)).is_err());
        assert!(unpack(&chunk(16, 4, 400, 400, &rest)).unwrap_err().contains("BloscLZ"));
    }
}
