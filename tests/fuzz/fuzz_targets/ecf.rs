//! Any bytes as a chunk of events that Prophesee's filter ECF packed.

#![no_main]

use erfgs_events::hdf5::ecf;
use erfgs_session_fuzz::memory;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let peak = memory::peak(|| {
        if let Ok(events) = ecf::unpack(bytes) {
            let head = bytes.first_chunk().map_or(0, |head| u32::from_le_bytes(*head));
            assert_eq!(events.len(), head as usize >> 2);
        }
    });
    // A chunk has 65,535 events at most.
    assert!(peak <= 4 << 20, "{peak} bytes of memory for a chunk of {} bytes", bytes.len());
});
