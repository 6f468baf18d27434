//! Any bytes as the header of an event file. What a RAW header says is written as a header that says the same.

use erfgs_events::{Aedat2Chip, Aedat4Header, DatFormat, RawHeader};

use crate::memory;

/// Checks one input.
pub fn headers(bytes: &[u8]) {
    let peak = memory::peak(|| {
        let (raw, at) = RawHeader::parse(bytes);
        assert!(at <= bytes.len());
        let again = raw.encode();
        let (read, length) = RawHeader::parse(&again);
        if again.len() < RawHeader::MAX_BYTES {
            assert_eq!(length, again.len());
            let keys: std::collections::BTreeSet<&str> = raw.fields.iter().map(|(key, _)| key.as_str()).collect();
            if keys.len() == raw.fields.len() {
                assert_eq!(read.format(), raw.format(), "{:?} and {:?}", raw.fields, read.fields);
            }
        }
        if let Ok((_, _, at)) = DatFormat::parse(bytes) {
            assert!(at <= bytes.len());
        }
        let (_, _, at) = Aedat2Chip::parse(bytes);
        assert!(at <= bytes.len());
        if let Ok(header) = Aedat4Header::parse(bytes) {
            assert!(header.length <= bytes.len());
        }
    });
    let limit = (64 << 10) + 256 * bytes.len();
    assert!(peak <= limit, "{peak} bytes of memory for a header of {} bytes", bytes.len());
}
