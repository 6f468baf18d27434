//! The encoder of AEDAT 4.

use super::{
    super::{ApsFrame, CdEvent, Edge, EventBatch, ImuSample, Mark, SensorSize, Sink},
    AEDAT4_MAGIC, Aedat4Compression, Aedat4Kind, Aedat4Stream, description,
    flat::Layout,
};

/// Events, samples and marks in a packet, at most.
const PACKET: usize = 4096;
/// Time from the first to the last of them, at most, microseconds; so that what lies together in a file is of one time.
const PACKET_US: u64 = 10_000;
/// Where a frame comes from: the pixels of the sensor, and no reconstruction.
const FROM_SENSOR: u8 = 1;

/// Encodes a file as a sink: feed it, take the bytes from time to time, and [`Aedat4Encoder::finish`] it.
///
/// Streams 0 to 3 hold events, frames, inertial samples and triggers. No table of packets is written, which readers must
/// expect (interrupted recordings have none); nothing has to be patched, and what was written so far can be read.
#[derive(Debug)]
pub struct Aedat4Encoder {
    compression: Aedat4Compression,
    events: Vec<CdEvent>,
    samples: Vec<ImuSample>,
    marks: Vec<(u64, Mark)>,
    /// Time of the first that is gathered.
    since_us: Option<u64>,
    out: Vec<u8>,
}

impl Aedat4Encoder {
    /// Begins a file of a camera. `source` is its model and serial number, as DV writes them: `DAVIS346_00000002`.
    #[must_use]
    pub fn new(size: SensorSize, source: &str, compression: Aedat4Compression) -> Self {
        let streams: Vec<Aedat4Stream> = (0..)
            .zip(Aedat4Kind::ALL)
            .map(|(id, (kind, ..))| Aedat4Stream {
                id,
                kind: Some(kind),
                size: matches!(kind, Aedat4Kind::Events | Aedat4Kind::Frames).then_some(size),
                source: source.to_owned(),
            })
            .collect();
        let (code, name) = compression.code_and_name();
        let text = description::write(&streams, name);
        // compression, position of the table, description
        let (mut header, table) = Layout::new(b"IOHE", &[12, 4, 16], 20);
        header.set(table, 12, code.to_le_bytes());
        header.set(table, 4, (-1_i64).to_le_bytes());
        header.vector(table, 16, text.len(), 4);
        header.bytes.extend(text.as_bytes());
        header.bytes.push(0);
        let mut out = AEDAT4_MAGIC.to_vec();
        out.extend(header.finish());
        Self { compression, events: Vec::new(), samples: Vec::new(), marks: Vec::new(), since_us: None, out }
    }

    /// Begins a stream of packets without the header of a file: [`crate::EventEncoding::Aedat4`].
    #[must_use]
    pub fn packets() -> Self {
        let (compression, out) = (Aedat4Compression::Lz4, Vec::new());
        Self { compression, events: Vec::new(), samples: Vec::new(), marks: Vec::new(), since_us: None, out }
    }

    /// Encodes all that is gathered into packets, whole ones or not.
    pub fn flush(&mut self) {
        self.flush_events();
        self.flush_samples();
        self.flush_marks();
        self.since_us = None;
    }

    /// An item of this time comes.
    fn at(&mut self, t_us: u64) {
        if self.since_us.is_some_and(|since_us| t_us.saturating_sub(since_us) >= PACKET_US) {
            self.flush();
        }
        self.since_us.get_or_insert(t_us);
    }

    /// The bytes since the last call.
    pub fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    /// Encodes all that is gathered, and gives the last bytes.
    pub fn finish(mut self) -> Vec<u8> {
        self.flush();
        self.out
    }

    fn packet(&mut self, stream: u32, buffer: &[u8]) {
        let body = match self.compression {
            Aedat4Compression::None => buffer.to_vec(),
            Aedat4Compression::Lz4 => lz4(buffer),
            Aedat4Compression::Zstd => {
                ruzstd::encoding::compress_to_vec(buffer, ruzstd::encoding::CompressionLevel::Fastest)
            }
        };
        self.out.extend(stream.to_le_bytes());
        self.out.extend((body.len() as u32).to_le_bytes());
        self.out.extend(body);
    }

    fn flush_events(&mut self) {
        if self.events.is_empty() {
            return;
        }
        let (mut layout, table) = Layout::new(b"EVTS", &[4], 8);
        layout.vector(table, 4, self.events.len(), 8);
        for CdEvent { t_us, x, y, on } in std::mem::take(&mut self.events) {
            layout.bytes.extend(t_us.to_le_bytes());
            layout.bytes.extend(x.to_le_bytes());
            layout.bytes.extend(y.to_le_bytes());
            layout.bytes.extend([u8::from(on), 0, 0, 0]);
        }
        self.packet(0, &layout.finish());
    }

    fn flush_samples(&mut self) {
        if self.samples.is_empty() {
            return;
        }
        let samples = std::mem::take(&mut self.samples);
        let (mut layout, table) = Layout::new(b"IMUS", &[4], 8);
        layout.vector(table, 4, samples.len(), 4);
        let fields: Vec<u16> = [4, 12].into_iter().chain((0..9).map(|axis| 16 + 4 * axis)).collect();
        let places = layout.tables(samples.len(), &fields, 52);
        for (place, sample) in places.into_iter().zip(samples) {
            layout.set(place, 4, sample.t_us.to_le_bytes());
            layout.set(place, 12, sample.temperature.to_le_bytes());
            let axes = [sample.accelerometer, sample.gyroscope, sample.magnetometer].concat();
            for (&offset, value) in fields[2..].iter().zip(axes) {
                layout.set(place, offset, value.to_le_bytes());
            }
        }
        self.packet(2, &layout.finish());
    }

    fn flush_marks(&mut self) {
        if self.marks.is_empty() {
            return;
        }
        let marks = std::mem::take(&mut self.marks);
        let (mut layout, table) = Layout::new(b"TRIG", &[4], 8);
        layout.vector(table, 4, marks.len(), 4);
        let places = layout.tables(marks.len(), &[4, 12], 16);
        for (place, (t_us, mark)) in places.into_iter().zip(marks) {
            layout.set(place, 4, t_us.to_le_bytes());
            layout.set(place, 12, [mark as u8]);
        }
        self.packet(3, &layout.finish());
    }
}

fn lz4(buffer: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    // Writing into memory does not fail.
    let written = encoder.write_all(buffer).is_ok();
    debug_assert!(written);
    encoder.finish().unwrap_or_default()
}

impl Sink for Aedat4Encoder {
    fn event(&mut self, event: CdEvent) {
        self.at(event.t_us);
        self.events.push(event);
        if self.events.len() == PACKET {
            self.flush_events();
        }
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        batch.iter().for_each(|event| self.event(event));
    }

    fn imu(&mut self, sample: ImuSample) {
        self.at(sample.t_us);
        self.samples.push(sample);
        if self.samples.len() == PACKET {
            self.flush_samples();
        }
    }

    fn mark(&mut self, t_us: u64, mark: Mark) {
        self.at(t_us);
        self.marks.push((t_us, mark));
        if self.marks.len() == PACKET {
            self.flush_marks();
        }
    }

    /// The format has one external input: the channel is lost.
    fn edge(&mut self, edge: Edge) {
        self.mark(edge.t_us, if edge.rising { Mark::ExternalRising } else { Mark::ExternalFalling });
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.flush();
        let (bytes, depth): (Vec<u8>, u8) = if frame.bits <= 8 {
            (frame.pixels.iter().map(|&pixel| pixel as u8).collect(), 0)
        } else {
            // 10 bits are scaled to 16, as DV shows them.
            let shift = 16_u8.saturating_sub(frame.bits);
            (frame.pixels.iter().flat_map(|&pixel| (pixel << shift).to_le_bytes()).collect(), 2)
        };
        let format = depth | frame.channels.saturating_sub(1) << 3;
        // Newer readers take the time, the start of the exposure, and its length; older ones look at the four others.
        let fields = [4, 12, 20, 28, 36, 52, 44, 46, 48, 50, 56, 60, 68];
        let (mut layout, table) = Layout::new(b"FRME", &fields, 72);
        let (start, end) = (frame.exposure_start_us, frame.exposure_end_us);
        let length = end.saturating_sub(start);
        for (offset, t_us) in [(4, start), (12, start), (20, end), (28, start), (36, end), (60, length)] {
            layout.set(table, offset, t_us.to_le_bytes());
        }
        layout.set(table, 68, [FROM_SENSOR]);
        layout.set(table, 44, frame.width.to_le_bytes());
        layout.set(table, 46, frame.height.to_le_bytes());
        layout.set(table, 52, [format]);
        layout.vector(table, 56, bytes.len(), 4);
        layout.bytes.extend(bytes);
        self.packet(1, &layout.finish());
    }
}
