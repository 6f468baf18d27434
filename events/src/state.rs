//! The state of a decoder in 16 bytes.

/// Writes numbers of few bits one after the other, lowest bits first.
#[derive(Debug, Default)]
pub(super) struct BitWriter {
    bits: u128,
    length: u32,
}

impl BitWriter {
    /// Appends the lowest `count` bits of `value`.
    pub fn put(&mut self, value: impl Into<u64>, count: u32) {
        debug_assert!(self.length + count <= 128);
        let value = value.into() & (u64::MAX >> (64 - count));
        self.bits |= u128::from(value) << self.length;
        self.length += count;
    }

    /// Appends the bytes of an item that did not come whole, at most `capacity` and less than 8, and how many they are.
    pub fn carry(&mut self, bytes: &[u8], capacity: usize) {
        self.put(bytes.len() as u64, if capacity == 1 { 1 } else { 3 });
        for at in 0..capacity {
            self.put(bytes.get(at).copied().unwrap_or(0), 8);
        }
    }

    /// All bits.
    pub fn bytes(self) -> [u8; 16] {
        self.bits.to_le_bytes()
    }
}

/// Reads what a [`BitWriter`] wrote.
#[derive(Debug)]
pub(super) struct BitReader {
    bits: u128,
}

impl BitReader {
    /// From the first bit on.
    pub fn new(state: [u8; 16]) -> Self {
        Self { bits: u128::from_le_bytes(state) }
    }

    /// The next `count` bits.
    pub fn take(&mut self, count: u32) -> u64 {
        let value = self.bits as u64 & (u64::MAX >> (64 - count));
        self.bits >>= count;
        value
    }

    /// As [`BitWriter::carry`] wrote them.
    pub fn take_carry(&mut self, capacity: usize) -> Vec<u8> {
        let length = self.take(if capacity == 1 { 1 } else { 3 }) as usize;
        let bytes: Vec<u8> = (0..capacity).map(|_| self.take(8) as u8).collect();
        bytes[..length.min(capacity)].to_vec()
    }
}
