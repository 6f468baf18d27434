//! The registers that GigE Vision gives every camera, all big-endian.

/// GigE Vision's own.
pub mod boot {
    pub const VERSION: u32 = 0x000;
    pub const MODE: u32 = 0x004;
    pub const MAC: u32 = 0x008;
    pub const ADDRESS: u32 = 0x024;
    pub const MASK: u32 = 0x034;
    pub const MAKER: u32 = 0x048;
    pub const MODEL: u32 = 0x068;
    pub const DEVICE_VERSION: u32 = 0x088;
    pub const SERIAL: u32 = 0x0d8;
    pub const NAME: u32 = 0x0e8;
    pub const URL: u32 = 0x200;
    pub const STREAMS: u32 = 0x904;
    pub const CAPABILITY: u32 = 0x934;
    pub const HEARTBEAT_MS: u32 = 0x938;
    pub const TICK_HZ: u32 = 0x93c;
    pub const PRIVILEGE: u32 = 0xa00;
    pub const CONTROLLER_PORT: u32 = 0xa04;
    pub const CONTROLLER: u32 = 0xa14;
    pub const STREAM_PORT: u32 = 0xd00;
    pub const PACKET_SIZE: u32 = 0xd04;
    pub const PACKET_DELAY: u32 = 0xd08;
    pub const STREAM_ADDRESS: u32 = 0xd18;
    pub const STREAM_SOURCE_PORT: u32 = 0xd1c;
    /// Behind the last.
    pub const END: u32 = 0x1000;
}

/// Where the features begin.
pub const FEATURES: u32 = 0x1_0000;
/// Where the description begins.
pub const DESCRIPTION: u32 = 0x10_0000;

/// Memory of big-endian words.
#[derive(Clone, Debug)]
pub struct Memory(Vec<u8>);

impl Memory {
    /// All zeros.
    pub fn new() -> Self {
        Self(vec![0; boot::END as usize])
    }

    /// Bytes, if they are all there.
    pub fn bytes(&self, at: u32, length: usize) -> Option<&[u8]> {
        self.0.get(at as usize..at as usize + length)
    }

    /// Puts bytes there.
    pub fn put(&mut self, at: u32, bytes: &[u8]) {
        self.0[at as usize..at as usize + bytes.len()].copy_from_slice(bytes);
    }

    /// A word.
    pub fn word(&self, at: u32) -> u32 {
        let at = at as usize;
        u32::from_be_bytes([self.0[at], self.0[at + 1], self.0[at + 2], self.0[at + 3]])
    }

    /// Puts a word there.
    pub fn put_word(&mut self, at: u32, word: u32) {
        self.put(at, &word.to_be_bytes());
    }
}
