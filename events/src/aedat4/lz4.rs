//! Frames of LZ4 (<https://github.com/lz4/lz4/blob/dev/doc/lz4_Frame_format.md>), unpacked into a buffer that is kept from one to the
//! next: AEDAT 4 has a frame for each packet, and new buffers of a block's size cost more than what is in them.

use lz4_flex::block::{decompress_into, decompress_into_with_dict};
use twox_hash::XxHash32;

const MAGIC: [u8; 4] = 0x184D_2204_u32.to_le_bytes();
/// How far back a block may refer to those before it, bytes.
const WINDOW: usize = 1 << 16;

/// What a frame says of itself.
struct Descriptor {
    /// Whether no block refers to those before it.
    independent: bool,
    block_sums: bool,
    content_sum: bool,
    /// Bytes of all blocks, if that is told.
    size: Option<u64>,
    /// Bytes of a block at most.
    block: usize,
}

impl Descriptor {
    /// Takes it off the beginning of a frame.
    fn take(frame: &mut &[u8]) -> Option<Self> {
        if take(frame)? != MAGIC {
            return None;
        }
        let whole = *frame;
        let [flags, sizes] = take(frame)?;
        let flag = |bit: u32| flags >> bit & 1 == 1;
        // Version 1, and no dictionary.
        if flags & 0b1100_0011 != 0b0100_0000 {
            return None;
        }
        let block = match sizes {
            0x40 | 0x50 | 0x60 | 0x70 => 1 << (8 + 2 * (sizes >> 4)),
            _ => return None,
        };
        let size = if flag(3) { Some(u64::from_le_bytes(take(frame)?)) } else { None };
        let sum = XxHash32::oneshot(0, &whole[..whole.len() - frame.len()]);
        let [checksum] = take(frame)?;
        let descriptor = Self { independent: flag(5), block_sums: flag(4), content_sum: flag(2), size, block };
        (checksum == (sum >> 8) as u8).then_some(descriptor)
    }
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (first, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*first)
}

/// Takes the sum of `content` off the beginning of `bytes`; `None` if it is another.
fn check(bytes: &mut &[u8], content: &[u8]) -> Option<()> {
    (u32::from_le_bytes(take(bytes)?) == XxHash32::oneshot(0, content)).then_some(())
}

/// What is in a frame, at most `limit` bytes; `None` if it is damaged or has more. The buffer grows and is never cleared.
pub(super) fn unpack<'a>(mut frame: &[u8], limit: usize, buffer: &'a mut Vec<u8>) -> Option<&'a [u8]> {
    let descriptor = Descriptor::take(&mut frame)?;
    let mut length = 0;
    loop {
        let head = u32::from_le_bytes(take(&mut frame)?);
        if head == 0 {
            break;
        }
        let (packed, stored) = (head >> 31 == 0, (head & 0x7FFF_FFFF) as usize);
        let (body, rest) = frame.split_at_checked(stored).filter(|_| stored <= descriptor.block)?;
        frame = rest;
        if descriptor.block_sums {
            check(&mut frame, body)?;
        }
        if buffer.len() < length + descriptor.block {
            buffer.resize(length + descriptor.block, 0);
        }
        let (before, free) = buffer.split_at_mut(length);
        let free = &mut free[..descriptor.block];
        let window = if descriptor.independent { &[] } else { &before[before.len().saturating_sub(WINDOW)..] };
        length += if !packed {
            free[..stored].copy_from_slice(body);
            stored
        } else if window.is_empty() {
            decompress_into(body, free).ok()?
        } else {
            decompress_into_with_dict(body, free, window).ok()?
        };
        if length > limit {
            return None;
        }
    }
    let content = &buffer[..length];
    if descriptor.content_sum {
        check(&mut frame, content)?;
    }
    descriptor.size.is_none_or(|size| size == length as u64).then_some(content)
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use lz4_flex::frame::{BlockMode, BlockSize, FrameDecoder, FrameEncoder, FrameInfo};
    use proptest::prelude::*;

    use super::*;

    const LIMIT: usize = 1 << 20;

    fn frames() -> impl Strategy<Value = (Vec<u8>, Vec<u8>)> {
        let sizes = prop_oneof![Just(BlockSize::Max64KB), Just(BlockSize::Max256KB)];
        let content =
            (proptest::collection::vec(0_u8..4, 0..300), 0_usize..700, 0_usize..3).prop_map(|(part, times, cut)| {
                let mut content = part.repeat(times);
                content.truncate(content.len() - cut.min(content.len()));
                content
            });
        (content, sizes, any::<[bool; 4]>()).prop_map(|(content, size, [linked, blocks, whole, sized])| {
            let info = FrameInfo::new()
                .block_size(size)
                .block_mode(if linked { BlockMode::Linked } else { BlockMode::Independent })
                .block_checksums(blocks)
                .content_checksum(whole)
                .content_size(sized.then_some(content.len() as u64));
            let mut encoder = FrameEncoder::with_frame_info(info, Vec::new());
            encoder.write_all(&content).unwrap();
            (content, encoder.finish().unwrap())
        })
    }

    proptest! {
        #[test]
        fn frames_of_another_encoder_are_unpacked((content, frame) in frames(), other in frames()) {
            let mut buffer = Vec::new();
            prop_assert_eq!(unpack(&frame, LIMIT, &mut buffer), Some(&content[..]));
            prop_assert_eq!(unpack(&other.1, LIMIT, &mut buffer), Some(&other.0[..]), "into what is there");
            if !content.is_empty() {
                prop_assert_eq!(unpack(&frame, content.len() - 1, &mut buffer), None, "more than the limit");
            }
            for length in 0..frame.len() {
                prop_assert_eq!(unpack(&frame[..length], LIMIT, &mut buffer), None, "cut to {}", length);
            }
        }

        #[test]
        fn damaged_ones_are_taken_as_by_another_decoder((_, mut frame) in frames(), place in any::<prop::sample::Index>(), bit in 0..8) {
            let place = place.index(frame.len());
            let end_mark = frame.len() - if frame[4] >> 2 & 1 == 1 { 4 } else { 0 } - 4;
            frame[place] ^= 1_u8 << bit;
            let mut expected = Vec::new();
            // Without the mark of its end a frame is not whole. The other makes an end of any block that holds nothing.
            let ends = !(end_mark..end_mark + 4).contains(&place);
            let whole = FrameDecoder::new(&frame[..]).read_to_end(&mut expected).is_ok() && ends;
            let mut buffer = Vec::new();
            prop_assert_eq!(unpack(&frame, LIMIT, &mut buffer), whole.then_some(&expected[..]));
        }
    }
}
