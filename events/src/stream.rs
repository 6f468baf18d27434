//! A decoder of any format, chosen at run time.

use super::{
    Anomalies, Decoder, SensorSize, Sink,
    aedat2::Aedat2Decoder,
    csv::CsvDecoder,
    dat::DatDecoder,
    davis::{DavisDecoder, DavisLayout},
    es::EsDecoder,
    evt::{Evt2Decoder, Evt3Decoder, Evt21Decoder, WordOrder},
};
use crate::EventEncoding;
#[cfg(feature = "aedat4")]
use crate::aedat4::Aedat4Decoder;

/// A decoder of any of the formats that come as a stream of bytes.
#[derive(Clone, Debug)]
#[cfg_attr(not(feature = "aedat4"), non_exhaustive)]
pub enum StreamDecoder {
    /// EVT 2.0.
    Evt2(Evt2Decoder),
    /// EVT 2.1.
    Evt21(Evt21Decoder),
    /// EVT 3.0.
    Evt3(Evt3Decoder),
    /// DAVIS.
    Davis(DavisDecoder),
    /// DAT.
    Dat(DatDecoder),
    /// AEDAT 2.
    Aedat2(Aedat2Decoder),
    /// AEDAT 4.
    #[cfg(feature = "aedat4")]
    Aedat4(Aedat4Decoder),
    /// CSV and other text.
    Csv(CsvDecoder),
    /// Event Stream.
    Es(EsDecoder),
}

impl StreamDecoder {
    /// A decoder at the start of a device's stream; a DAVIS is taken to read out in the usual order (see [`DavisLayout`] for
    /// others).
    #[must_use]
    pub fn new(encoding: EventEncoding, size: Option<SensorSize>) -> Self {
        match encoding {
            EventEncoding::Evt2 => Self::Evt2(Evt2Decoder::new(size)),
            EventEncoding::Evt21 => Self::Evt21(Evt21Decoder::new(WordOrder::Little, size)),
            EventEncoding::Evt21Legacy => Self::Evt21(Evt21Decoder::new(WordOrder::Legacy, size)),
            EventEncoding::Evt3 => Self::Evt3(Evt3Decoder::new(size)),
            EventEncoding::Davis => Self::Davis(DavisDecoder::new(layout(size))),
            #[cfg(feature = "aedat4")]
            EventEncoding::Aedat4 => Self::Aedat4(Aedat4Decoder::packets(size)),
        }
    }

    /// A decoder that goes on where another one of the same encoding gave its `state`.
    #[must_use]
    pub fn from_state(encoding: EventEncoding, state: [u8; 16], size: Option<SensorSize>) -> Option<Self> {
        match encoding {
            EventEncoding::Evt2 => Some(Self::Evt2(Evt2Decoder::from_state(state, size))),
            EventEncoding::Evt21 => Some(Self::Evt21(Evt21Decoder::from_state(state, WordOrder::Little, size))),
            EventEncoding::Evt21Legacy => Some(Self::Evt21(Evt21Decoder::from_state(state, WordOrder::Legacy, size))),
            EventEncoding::Evt3 => Some(Self::Evt3(Evt3Decoder::from_state(state, size))),
            EventEncoding::Davis => Some(Self::Davis(DavisDecoder::from_state(state, layout(size)))),
            #[cfg(feature = "aedat4")]
            EventEncoding::Aedat4 => None,
        }
    }

    /// What the decoder remembers at this point; `None` for formats of files that devices do not send.
    #[must_use]
    pub fn state(&self) -> Option<[u8; 16]> {
        match self {
            Self::Evt2(decoder) => Some(decoder.state()),
            Self::Evt21(decoder) => Some(decoder.state()),
            Self::Evt3(decoder) => Some(decoder.state()),
            Self::Davis(decoder) => Some(decoder.state()),
            #[cfg(feature = "aedat4")]
            Self::Aedat4(_) => None,
            Self::Dat(_) | Self::Aedat2(_) | Self::Csv(_) | Self::Es(_) => None,
        }
    }
}

/// The usual layout of a DAVIS of this size.
fn layout(size: Option<SensorSize>) -> DavisLayout {
    let usual = DavisLayout::default();
    DavisLayout { size: size.unwrap_or(usual.size), ..usual }
}

/// Calls the same method of whichever decoder it is.
macro_rules! each {
    ($self:expr, $decoder:ident => $call:expr) => {
        match $self {
            StreamDecoder::Evt2($decoder) => $call,
            StreamDecoder::Evt21($decoder) => $call,
            StreamDecoder::Evt3($decoder) => $call,
            StreamDecoder::Davis($decoder) => $call,
            StreamDecoder::Dat($decoder) => $call,
            StreamDecoder::Aedat2($decoder) => $call,
            #[cfg(feature = "aedat4")]
            StreamDecoder::Aedat4($decoder) => $call,
            StreamDecoder::Csv($decoder) => $call,
            StreamDecoder::Es($decoder) => $call,
        }
    };
}

impl Decoder for StreamDecoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut impl Sink) {
        each!(self, decoder => decoder.decode(bytes, sink));
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        each!(self, decoder => decoder.finish(sink));
    }

    fn restart(&mut self) {
        each!(self, decoder => decoder.restart());
    }

    fn hint_host_us(&mut self, host_us: u64) {
        each!(self, decoder => decoder.hint_host_us(host_us));
    }

    fn anomalies(&self) -> Anomalies {
        each!(self, decoder => decoder.anomalies())
    }
}
