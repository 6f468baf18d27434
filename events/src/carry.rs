//! The beginning of an item of `N` bytes whose end did not come yet.

/// At most `N - 1` bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Carry<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

impl<const N: usize> Default for Carry<N> {
    fn default() -> Self {
        Self { bytes: [0; N], length: 0 }
    }
}

impl<const N: usize> Carry<N> {
    /// The bytes held.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Holds `bytes`, of which all but the last `N - 1` are left out.
    pub fn hold(&mut self, bytes: &[u8]) {
        let bytes = &bytes[bytes.len().saturating_sub(N - 1)..];
        self.length = bytes.len();
        self.bytes[..self.length].copy_from_slice(bytes);
    }

    /// Splits `bytes`, which follow those held, into the item that began earlier, if it is complete now, and the whole
    /// items behind it; holds what is left.
    pub fn split<'a>(&mut self, mut bytes: &'a [u8]) -> (Option<[u8; N]>, &'a [[u8; N]]) {
        let first = self.complete(&mut bytes);
        let (items, rest) = bytes.as_chunks();
        if !rest.is_empty() {
            self.hold(rest);
        }
        (first, items)
    }

    /// Completes an item that began earlier with the beginning of `bytes` and takes it off them.
    fn complete(&mut self, bytes: &mut &[u8]) -> Option<[u8; N]> {
        if self.length == 0 {
            return None;
        }
        let taken = bytes.len().min(N - self.length);
        let (begin, rest) = bytes.split_at(taken);
        self.bytes[self.length..self.length + taken].copy_from_slice(begin);
        *bytes = rest;
        self.length += taken;
        if self.length < N {
            return None;
        }
        self.length = 0;
        Some(self.bytes)
    }

    /// Forgets the bytes and says how many they were.
    pub fn drop(&mut self) -> u64 {
        std::mem::take(&mut self.length) as u64
    }
}
