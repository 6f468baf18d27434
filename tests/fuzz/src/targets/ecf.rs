//! Any bytes as a chunk of events that Prophesee's filter ECF packed.

use erfgs_events::hdf5::ecf;

use crate::memory;

/// Checks one input.
pub fn ecf(bytes: &[u8]) {
    let peak = memory::peak(|| {
        if let Ok(events) = ecf::unpack(bytes) {
            let head = bytes.first_chunk().map_or(0, |head| u32::from_le_bytes(*head));
            assert_eq!(events.len(), head as usize >> 2);
        }
    });
    // A chunk has 65,535 events at most.
    assert!(peak <= 4 << 20, "{peak} bytes of memory for a chunk of {} bytes", bytes.len());
}
