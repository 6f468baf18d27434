//! Chunks of HDF5 files as the filters ECF and Blosc pack them.

use super::Seeds;

/// Puts them.
pub fn put(seeds: &mut Seeds) {
    ecf(seeds);
    blosc(seeds);
}

/// Five events at three times: rows, columns and polarities in runs; columns and polarities packed; all packed.
fn ecf(seeds: &mut Seeds) {
    let words = |words: &[u16]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let rows = words(&[7 << 5 | 3, 719 << 5 | 31, 2]);
    let runs = [&words(&[10 << 5 | 0b01000, 1279 << 5, 3 << 5 | 0b11000])[..], &[0x83, 0x7f, 2, 0]].concat();
    let packed_12 = words(&[0x0150, 0x0119, 0x29ff, 0x0006, 0x0808, 0x0808]);
    let packed_24: Vec<u8> = (0..6_u32).flat_map(|word| (0x0070_1500 + word * 0x0019_0033).to_le_bytes()).collect();
    for (flags, rest) in [(0, [rows.clone(), runs]), (1, [rows, packed_12]), (2, [packed_24, Vec::new()])] {
        let head = [&(5_u32 << 2 | flags).to_le_bytes()[..], &1000_u64.to_le_bytes()].concat();
        seeds.put("ecf", &[&head, &[0x02, 0x31, 0xf3, 0xf2, 0xf1, 0x12][..], &rest.concat()].concat());
    }
}

/// Stored as it is; two blocks of shuffled bytes, the first split into streams; shuffled bits; LZ4; Zstandard.
fn blosc(seeds: &mut Seeds) {
    let streams = |at: &[u32], streams: &[&[u8]]| {
        let at = at.iter().flat_map(|at| at.to_le_bytes());
        let streams = streams.iter().flat_map(|stream| [&(stream.len() as u32).to_le_bytes(), *stream].concat());
        at.chain(streams).collect::<Vec<u8>>()
    };
    let lz4 = lz4_flex::block::compress(&[7; 400]);
    // One last block that is not compressed.
    let zstd = [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, 24, 24 << 3 | 1, 0, 0][..], &[9; 24]].concat();
    for (flags, element, bytes, block, rest) in [
        (2, 4, 5, 5, b"as is".to_vec()),
        (1 | 4 << 5, 2, 6, 4, streams(&[24, 36], &[b"ac", b"bd", b"ef"])),
        (4 | 1 << 5, 1, 8, 8, streams(&[20], &[&[0xaa, 0xcc, 0xf0, 0, 0, 0, 0, 0]])),
        (16 | 1 << 5, 4, 400, 400, streams(&[20], &[&lz4])),
        (1 | 16 | 4 << 5, 4, 24, 24, streams(&[20], &[&zstd])),
    ] {
        let lengths = [bytes, block, 16 + rest.len() as u32].map(u32::to_le_bytes).concat();
        seeds.put("blosc", &[&[2, 1, flags, element], &lengths[..], &rest].concat());
    }
}
