//! How the bytes of an input say what is to be done with them.

use erfgs_events::{Anomalies, Decoder, Sink};

/// What to decode, and in which pieces.
///
/// | Bytes | Content |
/// |---|---|
/// | 1 | options of the target |
/// | 1 | number of piece lengths in the low 4 bits, of cuts in the high 4 |
/// | 1 for each length | lengths of pieces, taken in turn over and over |
/// | 6 for each cut | bytes up to it (u16), flags (bit 0: restart, bit 1: hint), the host's clock (u24, times 2 to the power of the flags' high 6 bits) |
/// | the rest | the stream |
///
/// All numbers are little-endian. An input that ends too early has no cuts and no stream.
#[derive(Clone, Debug)]
pub struct Plan<'a> {
    /// Options of the target.
    pub options: u8,
    pieces: &'a [u8],
    segments: Vec<Segment<'a>>,
}

/// A stretch of the stream, and what the decoder is told before it.
#[derive(Clone, Copy, Debug)]
struct Segment<'a> {
    bytes: &'a [u8],
    restart: bool,
    hint_us: Option<u64>,
}

impl<'a> Plan<'a> {
    /// Takes an input apart; `None` if it is too short to be one.
    pub fn read(input: &'a [u8]) -> Option<Self> {
        let (&[options, counts], rest) = input.split_first_chunk()?;
        let (pieces, rest) = rest.split_at_checked(usize::from(counts & 15))?;
        let (cuts, mut stream) = rest.split_at_checked(6 * usize::from(counts >> 4))?;
        let mut segments = Vec::new();
        let mut before = (false, None);
        for &[low, high, flags, a, b, c] in cuts.as_chunks().0 {
            let length = usize::from(u16::from_le_bytes([low, high])).min(stream.len());
            let (bytes, rest) = stream.split_at(length);
            segments.push(Segment { bytes, restart: before.0, hint_us: before.1 });
            stream = rest;
            let host = u64::from(u32::from_le_bytes([a, b, c, 0])) << (flags >> 2);
            before = (flags & 1 == 1, (flags & 2 == 2).then_some(host));
        }
        segments.push(Segment { bytes: stream, restart: before.0, hint_us: before.1 });
        Some(Self { options, pieces, segments })
    }

    /// All bytes of the stream.
    pub fn stream(&self) -> Vec<u8> {
        self.segments.iter().flat_map(|segment| segment.bytes).copied().collect()
    }

    /// How many they are.
    pub fn len(&self) -> usize {
        self.segments.iter().map(|segment| segment.bytes.len()).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The length of the piece number `index`; `usize::MAX` without lengths.
    pub fn piece(&self, index: usize) -> usize {
        // Pieces without a byte are allowed, but not only such.
        if self.pieces.iter().all(|&length| length == 0) {
            return usize::MAX;
        }
        self.pieces[index % self.pieces.len()].into()
    }

    /// Decodes the stream, restarts and hints included: in pieces, or what lies between two cuts at once.
    pub fn decode(&self, mut decoder: impl Decoder, in_pieces: bool, sink: &mut impl Sink) -> Anomalies {
        let mut index = 0;
        for segment in &self.segments {
            if segment.restart {
                decoder.restart();
            }
            if let Some(host_us) = segment.hint_us {
                decoder.hint_host_us(host_us);
            }
            let mut rest = segment.bytes;
            while in_pieces && !rest.is_empty() {
                let (piece, after) = rest.split_at(self.piece(index).min(rest.len()));
                decoder.decode(piece, sink);
                rest = after;
                index += 1;
            }
            if !in_pieces {
                decoder.decode(rest, sink);
            }
        }
        decoder.finish(sink);
        decoder.anomalies()
    }
}
