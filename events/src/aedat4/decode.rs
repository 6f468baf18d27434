//! The decoder of AEDAT 4.

use std::io::Read;

use super::{
    super::{Anomalies, Decoder, SensorSize, Sink, stage::Stage},
    AEDAT4_MAGIC, Aedat4Compression, Aedat4Kind, Aedat4Stream, MAX_PACKET, description,
    flat::Table,
    lz4, packets,
};

/// What the header of a file says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Aedat4Header {
    /// How packets are compressed.
    pub compression: Aedat4Compression,
    /// Where the table of packets lies, and so where the packets end; `None` in interrupted recordings.
    pub table: Option<u64>,
    /// The streams.
    pub streams: Vec<Aedat4Stream>,
    /// Bytes up to the first packet.
    pub length: usize,
}

impl Aedat4Header {
    /// How many bytes of a file [`Aedat4Header::parse`] needs, told by its first 18.
    #[must_use]
    pub fn needs(head: &[u8]) -> Option<usize> {
        let length = head.strip_prefix(AEDAT4_MAGIC)?.first_chunk()?;
        Some(AEDAT4_MAGIC.len() + 4 + u32::from_le_bytes(*length) as usize).filter(|&needs| needs <= MAX_PACKET)
    }

    /// Reads the header.
    ///
    /// # Errors
    /// What is wrong.
    pub fn parse(head: &[u8]) -> Result<Self, String> {
        let length = Self::needs(head).ok_or("its first 18 bytes are no AEDAT 4")?;
        let buffer = head.get(AEDAT4_MAGIC.len() + 4..length).ok_or("the file ends inside its header")?;
        let root = Table::root(buffer, b"IOHE").ok_or("its header is no FlatBuffer `IOHE`")?;
        let code = root.scalar(0).map_or(0, i32::from_le_bytes);
        let compression =
            Aedat4Compression::from_code(code).ok_or_else(|| format!("its compression {code} is unknown"))?;
        let table = root.scalar(1).map_or(-1, i64::from_le_bytes);
        let text = root.bytes(2).ok_or("it has no description")?;
        // What is no UTF-8 is Latin-1: names of people and of folders.
        let text = std::str::from_utf8(text)
            .map_or_else(|_| text.iter().copied().map(char::from).collect::<String>(), str::to_owned);
        let text = text.trim_start_matches('\u{feff}');
        Ok(Self { compression, table: u64::try_from(table).ok(), streams: description::parse(text)?, length })
    }

    /// The first stream of a kind.
    #[must_use]
    pub fn stream(&self, kind: Aedat4Kind) -> Option<&Aedat4Stream> {
        self.streams.iter().find(|stream| stream.kind == Some(kind))
    }
}

/// Decodes whole files, header included. Of several streams of one kind the first is decoded.
#[derive(Clone, Debug)]
pub struct Aedat4Decoder {
    place: Place,
    /// Bytes of what is incomplete.
    held: Vec<u8>,
    /// Bytes before those held.
    position: u64,
    header: Option<Aedat4Header>,
    /// For each kind, the last time.
    last_us: [u64; 4],
    restarted: bool,
    unpacked: Vec<u8>,
    anomalies: Anomalies,
    stage: Stage,
}

/// What comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// The header.
    Header,
    /// A packet.
    Packet,
    /// The table of packets, or nothing that makes sense: the rest is left out.
    End,
}

impl Default for Aedat4Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Aedat4Decoder {
    /// A decoder at the beginning of a file.
    #[must_use]
    pub fn new() -> Self {
        Self {
            place: Place::Header,
            held: Vec::new(),
            position: 0,
            header: None,
            last_us: [0; 4],
            restarted: false,
            unpacked: Vec::new(),
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// A decoder of packets without the header of a file ([`crate::EventEncoding::Aedat4`]) of a sensor of this size; it
    /// can start before any packet.
    #[must_use]
    pub fn packets(size: Option<SensorSize>) -> Self {
        let streams = (0..).zip(Aedat4Kind::ALL);
        let streams = streams
            .map(|(id, (kind, ..))| Aedat4Stream { id, kind: Some(kind), size, source: String::new() })
            .collect();
        let header = Aedat4Header { compression: Aedat4Compression::Lz4, table: None, streams, length: 0 };
        Self { place: Place::Packet, header: Some(header), ..Self::new() }
    }

    /// The header, once it was read.
    #[must_use]
    pub fn header(&self) -> Option<&Aedat4Header> {
        self.header.as_ref()
    }

    /// Takes one item off the beginning of `bytes` and says how long it was; `None` if it is not whole.
    fn item(&mut self, bytes: &[u8], sink: &mut impl Sink) -> Option<usize> {
        match self.place {
            Place::Header => self.take_header(bytes),
            Place::Packet => self.take_packet(bytes, sink),
            Place::End => (!bytes.is_empty()).then_some(bytes.len()),
        }
    }

    fn take_header(&mut self, bytes: &[u8]) -> Option<usize> {
        if bytes.len() < AEDAT4_MAGIC.len() + 4 {
            return None;
        }
        let Some(needs) = Aedat4Header::needs(bytes) else { return self.give_up(bytes) };
        let head = bytes.get(..needs)?;
        match Aedat4Header::parse(head) {
            Ok(header) => {
                self.header = Some(header);
                self.place = Place::Packet;
                Some(needs)
            }
            Err(_) => self.give_up(bytes),
        }
    }

    /// Nothing that follows can be found any more.
    fn give_up(&mut self, bytes: &[u8]) -> Option<usize> {
        self.anomalies.damaged += 1;
        self.place = Place::End;
        Some(bytes.len())
    }

    fn take_packet(&mut self, bytes: &[u8], sink: &mut impl Sink) -> Option<usize> {
        let header = self.header.as_ref()?;
        if bytes.is_empty() {
            return None;
        }
        if header.table.is_some_and(|table| self.position >= table) {
            self.place = Place::End;
            return Some(bytes.len());
        }
        let &[a, b, c, d, e, f, g, h] = bytes.first_chunk()?;
        let (id, length) = (u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h]) as usize);
        if length > MAX_PACKET {
            return self.give_up(bytes);
        }
        let body = bytes.get(8..8 + length)?;
        let stream = header.streams.iter().find(|stream| stream.id == id);
        let compression = header.compression;
        let Some(stream) = stream else {
            self.anomalies.unknown += 1;
            return Some(8 + length);
        };
        let first = |kind| header.stream(kind).is_some_and(|stream| stream.id == id);
        if let Some(kind) = stream.kind.filter(|&kind| first(kind)) {
            let size = stream.size.unwrap_or(SensorSize { width: 1 << 15, height: 1 << 15 });
            if self.restarted {
                self.restarted = false;
                self.anomalies.discontinuities += 1;
                sink.discontinuity(self.last_us[kind as usize]);
            }
            let mut unpacked = std::mem::take(&mut self.unpacked);
            let decoded = unpack(compression, body, &mut unpacked).and_then(|buffer| {
                let (last_us, stage) = (&mut self.last_us[kind as usize], &mut self.stage);
                packets::decode(kind, size, buffer, last_us, stage, &mut self.anomalies, sink)
            });
            self.stage.flush(sink);
            self.anomalies.damaged += u64::from(decoded.is_none());
            self.unpacked = unpacked;
        }
        Some(8 + length)
    }

    /// Takes all whole items off the beginning of `bytes`; says how many bytes they were.
    fn items(&mut self, bytes: &[u8], sink: &mut impl Sink) -> usize {
        let mut taken = 0;
        while let Some(length) = self.item(&bytes[taken..], sink) {
            taken += length;
            self.position += length as u64;
        }
        taken
    }
}

/// Takes the compression and the length off a packet, in a buffer whose content does not matter; `None` if it is damaged.
fn unpack<'a>(compression: Aedat4Compression, body: &'a [u8], buffer: &'a mut Vec<u8>) -> Option<&'a [u8]> {
    let whole: &[u8] = match compression {
        Aedat4Compression::None => body,
        Aedat4Compression::Lz4 => lz4::unpack(body, MAX_PACKET, buffer)?,
        Aedat4Compression::Zstd => {
            buffer.clear();
            ruzstd::decoding::StreamingDecoder::new(body).ok()?.take(MAX_PACKET as u64).read_to_end(buffer).ok()?;
            buffer
        }
    };
    let (length, rest) = whole.split_first_chunk()?;
    rest.get(..u32::from_le_bytes(*length) as usize)
}

impl Decoder for Aedat4Decoder {
    fn decode(&mut self, mut bytes: &[u8], sink: &mut impl Sink) {
        // Items that lie whole in `bytes` are decoded where they are; what is incomplete is held, and grows by as much
        // as it needs.
        while !self.held.is_empty() && !bytes.is_empty() {
            let held = self.held.len();
            let wanted = match self.place {
                Place::Header if held < AEDAT4_MAGIC.len() + 4 => AEDAT4_MAGIC.len() + 4,
                Place::Header => Aedat4Header::needs(&self.held).unwrap_or(held),
                Place::Packet => match self.held.get(4..8).and_then(|length| length.first_chunk()) {
                    Some(length) => 8 + (u32::from_le_bytes(*length) as usize).min(MAX_PACKET + 1),
                    None => 8,
                },
                Place::End => held,
            };
            let (part, rest) = bytes.split_at(bytes.len().min(wanted.saturating_sub(held)));
            let mut whole = std::mem::take(&mut self.held);
            whole.extend(part);
            bytes = rest;
            let taken = self.items(&whole, sink);
            whole.drain(..taken);
            self.held = whole;
        }
        let taken = self.items(bytes, sink);
        self.held.extend(&bytes[taken..]);
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        self.anomalies.truncated_bytes += self.held.len() as u64;
        self.held.clear();
        self.stage.flush(sink);
    }

    /// What follows must be whole packets.
    fn restart(&mut self) {
        self.anomalies.truncated_bytes += self.held.len() as u64;
        self.held.clear();
        self.restarted = self.last_us != [0; 4];
    }

    /// The format's times need no host clock.
    fn hint_host_us(&mut self, _host_us: u64) {}

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}
