//! What the checksum of a chunk that is not compressed tells beyond that something is wrong: which bit flipped, and what the
//! fields around the content were.
//!
//! The checksum of MCAP is CRC-32. Flipping one bit changes it in a way that depends on nothing but how many bits follow, and
//! differs for all of the first 2^32 of them: where the difference is that of one flipped bit, there is one bit that explains
//! it. Damage of many bits is taken for that of one in one of 2^32 cases for each bit of the chunk: 1 of 128 at 4 MiB.

use mcap::records::op;

/// A chunk's fields before its content, where it is not compressed: opcode and length, two times, the length of the content,
/// its checksum, the name of no compression, the length once more.
pub(super) const FIELDS: usize = 9 + 40;
/// Longer contents are not searched for a flipped bit: 64 MiB take a second.
const LONGEST: usize = 64 << 20;
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Which bit of `length` bytes explains that their checksum differs by `difference`: the byte, and its bit.
pub(super) fn flipped_bit(length: usize, difference: u32) -> Option<(usize, u32)> {
    if difference == 0 || length > LONGEST {
        return None;
    }
    // What flipping the last bit does, then that before it, and so on.
    let mut change = POLYNOMIAL;
    for behind in 0..8 * length {
        if change == difference {
            let place = 8 * length - 1 - behind;
            return Some((place / 8, (place % 8) as u32));
        }
        change = (change >> 1) ^ if change & 1 == 1 { POLYNOMIAL } else { 0 };
    }
    None
}

/// The length of the content that a chunk claims which is not compressed, from the first [`FIELDS`] bytes of its record;
/// `None` if these are no such chunk's, whatever its opcode and its length say. It may be that of damaged fields: three of four
/// lengths must agree.
pub(super) fn content_length(fields: &[u8; FIELDS], room: u64) -> Option<u64> {
    let u64_at = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| fields[at + i]));
    let record = u64_at(1).checked_sub(40);
    let [unpacked, packed] = [u64_at(25), u64_at(41)];
    let named = fields[37..41] != [0; 4];
    let votes = |length: u64| {
        usize::from(record == Some(length)) + usize::from(unpacked == length) + usize::from(packed == length)
    };
    let length = [Some(unpacked), Some(packed)].into_iter().flatten().find(|&length| votes(length) >= 2)?;
    // All else must be right where something is wrong.
    let wrong = usize::from(named) + usize::from(fields[0] != op::CHUNK) + 3 - votes(length);
    (wrong <= 1 && length > 0 && FIELDS as u64 + length <= room).then_some(length)
}

/// The fields as they are where nothing is damaged.
pub(super) fn fields_of(mut fields: [u8; FIELDS], content: &[u8]) -> [u8; FIELDS] {
    let length = content.len() as u64;
    fields[0] = op::CHUNK;
    fields[1..9].copy_from_slice(&(length + 40).to_le_bytes());
    fields[25..33].copy_from_slice(&length.to_le_bytes());
    fields[33..37].copy_from_slice(&crc32fast::hash(content).to_le_bytes());
    fields[37..41].fill(0);
    fields[41..49].copy_from_slice(&length.to_le_bytes());
    fields
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_bit_that_flipped_is_found_by_the_checksum() {
        let content: Vec<u8> = (0..5000_u32).map(|i| ((i * i) >> 3) as u8).collect();
        let checksum = crc32fast::hash(&content);
        for place in (0..8 * content.len()).step_by(37).chain([8 * content.len() - 1]) {
            let mut damaged = content.clone();
            damaged[place / 8] ^= 1 << (place % 8);
            let found = flipped_bit(damaged.len(), crc32fast::hash(&damaged) ^ checksum);
            assert_eq!(found, Some((place / 8, (place % 8) as u32)));
        }
    }

    #[test]
    fn damage_of_more_bits_is_not_explained_by_one() {
        let content: Vec<u8> = (0..5000_u32).map(|i| (i * 31) as u8).collect();
        let checksum = crc32fast::hash(&content);
        for at in 0..content.len() {
            let mut damaged = content.clone();
            damaged[at] ^= 0x55;
            assert_eq!(flipped_bit(damaged.len(), crc32fast::hash(&damaged) ^ checksum), None, "{at}");
        }
        assert_eq!(flipped_bit(100, 0), None);
    }
}
