//! Codecs of event streams: one state machine for each format, fed with bytes in pieces of any size.
//!
//! A decoder takes bytes and calls a [`Sink`]; where the pieces begin and end changes nothing. It never fails: what cannot
//! be right is skipped and counted ([`Anomalies`]). Times are those of the device, absolute, in microseconds, with the
//! roll-overs of its clock counted; what happens when data was lost is told to [`Sink::discontinuity`].
//!
//! Bytes of a device, decoded as they arrive ([`StreamDecoder`] chooses the format at run time):
//!
//! ```
//! use erfgs_events::{Columns, Decoder, Evt3Decoder, SensorSize};
//!
//! let mut decoder = Evt3Decoder::new(Some(SensorSize { width: 1280, height: 720 }));
//! let mut events = Columns::default();
//! // Words of 16 bits: the time (high, low), row 7, an event that rose in column 5, one that fell in column 9.
//! let bytes = [0x8000_u16, 0x6064, 0x0007, 0x2805, 0x2009].map(u16::to_le_bytes).concat();
//! let (first, rest) = bytes.split_at(3); // pieces may end anywhere
//! decoder.decode(first, &mut events);
//! decoder.decode(rest, &mut events);
//! decoder.finish(&mut events);
//!
//! assert_eq!((events.t_us, events.x, events.y, events.on), (vec![100, 100], vec![5, 9], vec![7, 7], vec![true, false]));
//! assert!(decoder.anomalies().is_empty());
//! ```
//!
//! A file of any format, into a sink of one's own:
//!
//! ```
//! use erfgs_events::{CdEvent, EventFile, Sink};
//!
//! /// Counts the events that rose.
//! struct Rises(u64);
//!
//! impl Sink for Rises {
//!     fn event(&mut self, event: CdEvent) {
//!         self.0 += u64::from(event.on);
//!     }
//! }
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("events.csv");
//! # std::fs::write(&path, "t,x,y,on\n1000,3,4,1\n1020,3,5,0\n1041,4,5,1\n")?;
//! let file = EventFile::open(&path)?; // RAW, DAT, AEDAT 2 and 4, Event Stream, CSV and other text
//! let mut rises = Rises(0);
//! let anomalies = file.decode(&mut rises)?;
//! assert_eq!((file.format.name(), rises.0, anomalies.is_empty()), ("csv", 2, true));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Encoders are the other direction: [`Evt3Encoder`], [`DatEncoder`], [`CsvEncoder`] and others.
//!
//! # Features
//!
//! Without any, EVT 2, 2.1 and 3, DAVIS, DAT, AEDAT 2, Event Stream and text are there, at the cost of `thiserror` and `erfgs-base` alone. The default is all
//! but `hdf5`.
//!
//! - `aedat4`: AEDAT 4, with its compressions.
//! - `npz`: [`npz`], NumPy's archives and structured arrays; text in zip archives.
//! - `hdf5`: [`hdf5`], with libhdf5, which must be installed. Without it `hdf5::open` says so.
//! - `digest`: [`Digests`] of decoded streams.
//! - `serde`: [`Anomalies`] and [`SensorSize`] can be written and read.

mod aedat2;
#[cfg(feature = "aedat4")]
mod aedat4;
mod anomalies;
#[cfg(feature = "npz")]
mod archive;
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
mod es;
mod event;
mod evt;
mod file;
pub mod hdf5;
mod hot_pixels;
#[cfg(feature = "npz")]
pub mod npz;
pub mod palette;
mod rows;
mod sink;
mod stage;
mod state;
mod stream;

use erfgs_base::plausible::{Implausible, check_sensor};

pub use aedat2::{Aedat2Chip, Aedat2Decoder};
#[cfg(feature = "aedat4")]
pub use aedat4::{
    AEDAT4_MAGIC, Aedat4Compression, Aedat4Decoder, Aedat4Encoder, Aedat4Header, Aedat4Kind, Aedat4Stream,
};
pub use anomalies::Anomalies;
pub use columns::Columns;
pub use csv::{CSV_HEADER, CsvDecoder, CsvEncoder, TextColumns, TextLayout};
pub use dat::{DatDecoder, DatEncoder, DatFormat, DatItems};
pub use davis::{DavisDecoder, DavisEncoder, DavisLayout};
#[cfg(feature = "digest")]
pub use digests::Digests;
pub use encode::EncodeError;
pub use encoding::EventEncoding;
pub use es::{EsDecoder, EsKind};
pub use event::{Event, Events};
pub use evt::{
    Evt2Decoder, Evt2Encoder, Evt3Decoder, Evt3Encoder, Evt21Decoder, Evt21Encoder, RawFormat, RawHeader, WordOrder,
};
pub use file::{EventFile, EventFileError, EventFileHints, EventFormat};
pub use hot_pixels::{HotPixel, PixelActivity};
pub use rows::EventRows;
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

    /// This size, which a file gave, if a sensor can have it; sides of 0 say nothing.
    ///
    /// # Errors
    /// Which number cannot be, and what can.
    pub fn checked(self) -> Result<Self, Implausible> {
        check_sensor([self.width, self.height].map(u32::from))?;
        Ok(self)
    }
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

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
