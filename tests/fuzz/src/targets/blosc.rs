//! Any bytes as a chunk that Blosc packed.

use erfgs_events::hdf5::blosc;

use crate::memory;

/// Checks one input.
pub fn blosc(bytes: &[u8]) {
    let peak = memory::peak(|| {
        if let Ok(unpacked) = blosc::unpack(bytes) {
            let length =
                bytes.get(4..).and_then(|rest| rest.first_chunk()).map_or(0, |length| u32::from_le_bytes(*length));
            assert_eq!(unpacked.len(), length as usize);
        }
    });
    // A chunk has 64 MiB at most, which Zstandard may make of a few bytes, in a window of 100 MiB.
    let limit = 640 << 20;
    assert!(peak <= limit, "{peak} bytes of memory for a chunk of {} bytes", bytes.len());
}
