//! The registers of the emulated camera, all big-endian: those that GigE Vision gives every camera, and its own features.

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
/// Where they end.
pub const FEATURES_END: u32 = FEATURES + 0x100;
/// Where the description begins.
pub const DESCRIPTION: u32 = 0x10_0000;

/// Features, from [`FEATURES`] on.
pub mod feature {
    pub const WIDTH: u32 = 0x00;
    pub const HEIGHT: u32 = 0x04;
    pub const OFFSET_X: u32 = 0x08;
    pub const OFFSET_Y: u32 = 0x0c;
    pub const PIXEL_FORMAT: u32 = 0x10;
    pub const PAYLOAD: u32 = 0x14;
    pub const EXPOSURE_US: u32 = 0x18;
    /// Tenths of a decibel.
    pub const GAIN: u32 = 0x1c;
    /// An IEEE number, as the next but one.
    pub const RATE_HZ: u32 = 0x20;
    pub const RATE_ENABLE: u32 = 0x24;
    pub const MOST_RATE_HZ: u32 = 0x28;
    pub const ACQUIRE: u32 = 0x2c;
    pub const TRIGGER_MODE: u32 = 0x30;
    pub const TRIGGER_SOURCE: u32 = 0x34;
    pub const TRIGGER_ACTIVATION: u32 = 0x38;
    pub const CHUNK_ACTIVE: u32 = 0x40;
    pub const CHUNK_SELECTOR: u32 = 0x44;
    /// One word for each chunk.
    pub const CHUNK_ENABLE: u32 = 0x48;
    pub const LOCKED: u32 = 0x58;
    pub const LINE_SELECTOR: u32 = 0x5c;
    pub const LINE_MODE: u32 = 0x60;
    pub const LINE_SOURCE: u32 = 0x64;
    pub const EXPOSURE_AUTO: u32 = 0x68;
    pub const GAIN_AUTO: u32 = 0x6c;
    /// An IEEE number.
    pub const TEMPERATURE: u32 = 0x70;
    pub const BLACK_LEVEL: u32 = 0x74;
    pub const GAMMA_ENABLE: u32 = 0x78;
    pub const THROUGHPUT: u32 = 0x7c;
}

/// How a value of 8 bits lies in a stream; of 12 bits it is the upper 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// A byte.
    Byte,
    /// 12 bits in two bytes, the lower first.
    Word,
    /// 12 bits after 12 bits, from the lowest on.
    Bits,
    /// Two upper bytes around a byte with both lower parts.
    Around,
}

/// Pixel formats: name, code, and layout.
pub const FORMATS: [(&str, u32, Layout); 7] = [
    ("Mono8", 0x0108_0001, Layout::Byte),
    ("Mono12", 0x0110_0005, Layout::Word),
    ("Mono12p", 0x010c_0047, Layout::Bits),
    ("Mono12Packed", 0x010c_0006, Layout::Around),
    ("BayerRG8", 0x0108_0009, Layout::Byte),
    ("BayerRG12", 0x0110_0011, Layout::Word),
    ("BayerRG12p", 0x010c_0059, Layout::Bits),
];

/// What the camera can measure of a frame: name, id, bytes.
pub const CHUNKS: [(&str, u32, usize); 3] =
    [("Timestamp", 0x1001, 8), ("ExposureTime", 0x1002, 8), ("FrameID", 0x1003, 8)];
/// The id of the image among the chunks.
pub const IMAGE_CHUNK: u32 = 0x1000;

/// Memory of big-endian words.
#[derive(Clone, Debug)]
pub struct Memory(Vec<u8>);

impl Memory {
    /// All zeros.
    pub fn new() -> Self {
        Self(vec![0; FEATURES_END as usize])
    }

    /// Bytes, if they are all there.
    pub fn bytes(&self, at: u32, length: usize) -> Option<&[u8]> {
        let known = (0..boot::END).contains(&at) || (FEATURES..FEATURES_END).contains(&at);
        let bytes = self.0.get(at as usize..at as usize + length)?;
        known.then_some(bytes)
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

    /// A feature.
    pub fn feature(&self, at: u32) -> u32 {
        self.word(FEATURES + at)
    }

    /// Sets a feature.
    pub fn put_feature(&mut self, at: u32, word: u32) {
        self.put_word(FEATURES + at, word);
    }
}
