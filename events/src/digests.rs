//! A sink that digests everything: by these numbers decoders are compared.

use sha3::{Digest, Sha3_224};

use super::sink::{ApsFrame, CdEvent, Edge, EventBatch, ImuSample, Mark, Sink};

/// A sink that counts, and digests each field: SHA3-224 over the little-endian bytes of one field after the other.
///
/// - events: `t` (u64, microseconds), `x`, `y` (u16), `on` (u8)
/// - `frame`: the samples of all frames, u8 for frames of 8 bits and u16 otherwise
/// - `imus`: rows of time (u64), temperature, accelerometer, gyroscope, magnetometer (f32)
/// - `triggers`: rows of time (u64) and [`Mark`] (u8)
/// - `edges`: rows of time (u64), channel (u8), rising (u8)
#[derive(Clone, Debug, Default)]
pub struct Digests {
    /// Number of events.
    pub events: u64,
    /// Number of events that rose.
    pub on_events: u64,
    /// Number of frames.
    pub frames: u64,
    /// Number of inertial samples.
    pub imu_samples: u64,
    /// Number of marks.
    pub marks: u64,
    /// Number of edges.
    pub edges: u64,
    /// Number of discontinuities.
    pub discontinuities: u64,
    /// Smallest and largest time of an event, microseconds.
    pub range_us: Option<(u64, u64)>,
    /// Whether some event's time is before that of the one before it.
    pub unordered: bool,
    last_us: u64,
    fields: Option<Box<[Sha3_224; 8]>>,
    buffer: Vec<u8>,
}

impl Digests {
    /// The fields in the order of [`Digests::finish`].
    pub const FIELDS: [&'static str; 8] = ["t", "x", "y", "on", "frame", "imus", "triggers", "edges"];

    /// A sink that digests. ([`Digests::default`] only counts, and is much faster.)
    #[must_use]
    pub fn new() -> Self {
        Self { fields: Some(Box::default()), ..Self::default() }
    }

    /// The digests by field, hexadecimal, of the fields that the stream has.
    #[must_use]
    pub fn finish(&self) -> Vec<(&'static str, String)> {
        let Some(fields) = &self.fields else { return Vec::new() };
        let there = [true, true, true, true, self.frames > 0, self.imu_samples > 0, self.marks > 0, self.edges > 0];
        let hexadecimal =
            |hasher: &Sha3_224| hasher.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        let all = Self::FIELDS.into_iter().zip(fields.iter().map(hexadecimal));
        all.zip(there).filter(|(_, there)| *there).map(|(field, _)| field).collect()
    }

    fn digest(&mut self, field: usize, bytes: impl Iterator<Item = u8>) {
        if let Some(fields) = &mut self.fields {
            self.buffer.clear();
            self.buffer.extend(bytes);
            fields[field].update(&self.buffer);
        }
    }
}

impl Sink for Digests {
    fn event(&mut self, CdEvent { t_us, x, y, on }: CdEvent) {
        self.events(EventBatch { t_us: &[t_us], x: &[x], y: &[y], on: &[on] });
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.events += batch.t_us.len() as u64;
        self.on_events += batch.on.iter().map(|&on| u64::from(on)).sum::<u64>();
        for &t_us in batch.t_us {
            self.unordered |= t_us < self.last_us;
            self.last_us = t_us;
            let (first, last) = self.range_us.unwrap_or((t_us, t_us));
            self.range_us = Some((first.min(t_us), last.max(t_us)));
        }
        if self.fields.is_some() {
            self.digest(0, batch.t_us.iter().flat_map(|t| t.to_le_bytes()));
            self.digest(1, batch.x.iter().flat_map(|x| x.to_le_bytes()));
            self.digest(2, batch.y.iter().flat_map(|y| y.to_le_bytes()));
            self.digest(3, batch.on.iter().map(|&on| u8::from(on)));
        }
    }

    fn edge(&mut self, edge: Edge) {
        self.edges += 1;
        self.digest(7, edge.t_us.to_le_bytes().into_iter().chain([edge.channel, u8::from(edge.rising)]));
    }

    fn imu(&mut self, sample: ImuSample) {
        self.imu_samples += 1;
        let values = sample.values().into_iter().flat_map(f32::to_le_bytes);
        self.digest(5, sample.t_us.to_le_bytes().into_iter().chain(values));
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.frames += 1;
        if frame.bits <= 8 {
            self.digest(4, frame.pixels.iter().map(|&pixel| pixel as u8));
        } else {
            self.digest(4, frame.pixels.iter().flat_map(|pixel| pixel.to_le_bytes()));
        }
    }

    fn mark(&mut self, t_us: u64, mark: Mark) {
        self.marks += 1;
        self.digest(6, t_us.to_le_bytes().into_iter().chain([mark as u8]));
        if let Some(edge) = mark.edge(t_us) {
            self.edge(edge);
        }
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.discontinuities += 1;
        self.last_us = t_us;
    }
}
