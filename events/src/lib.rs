//! Codecs of event streams: one state machine for each format, fed with bytes in pieces of any size.
//!
//! A decoder takes bytes and calls a [`Sink`]; where the pieces begin and end changes nothing. It never fails: what cannot
//! be right is skipped and counted ([`Anomalies`]). Times are those of the device, absolute, in microseconds, with the
//! roll-overs of its clock counted; see `docs/formats.md` for what happens when data was lost.

mod aedat2;
#[cfg(feature = "aedat4")]
mod aedat4;
mod anomalies;
mod carry;
mod clock;
mod columns;
mod csv;
mod dat;
mod davis;
#[cfg(feature = "digest")]
mod digests;
mod encode;
mod encoding;
pub mod event;
mod evt;
mod file;
pub mod hdf5;
#[cfg(feature = "npz")]
pub mod npz;
mod sink;
mod stage;
mod state;
mod stream;

pub use aedat2::{Aedat2Chip, Aedat2Decoder};
#[cfg(feature = "aedat4")]
pub use aedat4::{
    AEDAT4_MAGIC, Aedat4Compression, Aedat4Decoder, Aedat4Encoder, Aedat4Header, Aedat4Kind, Aedat4Stream,
};
pub use anomalies::Anomalies;
pub use columns::Columns;
pub use csv::{CSV_HEADER, CsvDecoder, CsvEncoder};
pub use dat::{DatDecoder, DatEncoder, DatFormat, DatItems};
pub use davis::{DavisDecoder, DavisEncoder, DavisLayout};
#[cfg(feature = "digest")]
pub use digests::Digests;
pub use encode::EncodeError;
pub use encoding::EventEncoding;
pub use event::{Event, Events};
pub use evt::{
    Evt2Decoder, Evt2Encoder, Evt3Decoder, Evt3Encoder, Evt21Decoder, Evt21Encoder, RawFormat, RawHeader, WordOrder,
};
pub use file::{EventFile, EventFileError, EventFormat};
pub use sink::{ApsFrame, CdEvent, Edge, EventBatch, ImuSample, Mark, Sink};
pub use stream::StreamDecoder;

/// Columns and rows of a sensor. Events outside are counted and skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SensorSize {
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}

impl SensorSize {
    /// All addresses that 11 bits can name.
    pub const ALL: Self = Self { width: 2048, height: 2048 };
}

/// A state machine that is fed with bytes.
pub trait Decoder {
    /// Decodes `bytes`, which follow those of the last call. What they leave incomplete waits for the next call.
    fn decode(&mut self, bytes: &[u8], sink: &mut impl Sink);

    /// The stream is over: hands over what waits and counts what is incomplete.
    fn finish(&mut self, sink: &mut impl Sink);

    /// Bytes were lost before those decoded next, or the device restarted: what was incomplete is dropped, and the next
    /// time is told to [`Sink::discontinuity`].
    fn restart(&mut self);

    /// The host's clock when the bytes decoded next arrived, microseconds since any fixed moment (the device's, if they
    /// are not live: when they arrived while they were recorded). Lost roll-overs of the device's clock are counted with
    /// it.
    fn hint_host_us(&mut self, host_us: u64);

    /// What was wrong so far.
    fn anomalies(&self) -> Anomalies;
}
