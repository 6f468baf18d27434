//! The registers of the camera's own features: words, whose bytes lie in the order of the transport.

/// Which way the bytes of numbers lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// GigE Vision.
    Big,
    /// USB3 Vision.
    Little,
}

impl Order {
    pub fn word(self, word: u32) -> [u8; 4] {
        match self {
            Self::Big => word.to_be_bytes(),
            Self::Little => word.to_le_bytes(),
        }
    }

    pub fn double(self, double: u64) -> [u8; 8] {
        match self {
            Self::Big => double.to_be_bytes(),
            Self::Little => double.to_le_bytes(),
        }
    }
}

/// Bytes of all features' registers.
pub(crate) const FEATURES_BYTES: u32 = 0x100;

/// Where each feature lies, from the first on.
pub(crate) mod feature {
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
    pub const TRIGGER_SOFTWARE: u32 = 0x3c;
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
pub(crate) enum Layout {
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
pub(crate) const FORMATS: [(&str, u32, Layout); 7] = [
    ("Mono8", 0x0108_0001, Layout::Byte),
    ("Mono12", 0x0110_0005, Layout::Word),
    ("Mono12p", 0x010c_0047, Layout::Bits),
    ("Mono12Packed", 0x010c_0006, Layout::Around),
    ("BayerRG8", 0x0108_0009, Layout::Byte),
    ("BayerRG12", 0x0110_0011, Layout::Word),
    ("BayerRG12p", 0x010c_0059, Layout::Bits),
];

/// What the camera can measure of a frame: name, id, bytes.
pub(crate) const CHUNKS: [(&str, u32, usize); 3] =
    [("Timestamp", 0x1001, 8), ("ExposureTime", 0x1002, 8), ("FrameID", 0x1003, 8)];
/// The id of the image among the chunks.
pub(crate) const IMAGE_CHUNK: u32 = 0x1000;

/// The features' registers.
#[derive(Clone, Debug)]
pub(crate) struct Features {
    words: [u32; FEATURES_BYTES as usize / 4],
    order: Order,
}

impl Features {
    /// All zeros.
    pub fn new(order: Order) -> Self {
        Self { words: [0; FEATURES_BYTES as usize / 4], order }
    }

    /// The order of bytes.
    pub fn order(&self) -> Order {
        self.order
    }

    /// A feature's word.
    pub fn get(&self, at: u32) -> u32 {
        self.words[at as usize / 4]
    }

    /// Sets it.
    pub fn put(&mut self, at: u32, word: u32) {
        self.words[at as usize / 4] = word;
    }

    /// Bytes as a host reads them, if they are all there.
    pub fn bytes(&self, at: u32, length: usize) -> Option<Vec<u8>> {
        let all: Vec<u8> = self.words.iter().flat_map(|&word| self.order.word(word)).collect();
        Some(all.get(at as usize..(at as usize).checked_add(length)?)?.to_vec())
    }
}
