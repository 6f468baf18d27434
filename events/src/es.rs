//! Event Stream (`.es`), version 2, of the neuromorphic laboratory in Paris, its `event_stream`, Loris and faery. Read, not
//! written.
//!
//! `Event Stream`, three bytes of version, one of the kind; then width and height (u16), but for the generic kind. An event is
//! a byte with the microseconds since the last one and what it is, then column and row (u16, little-endian):
//!
//! | kind | the first byte of an event | time goes on alone | no event |
//! |---|---|---|---|
//! | 1, DVS | bits 1 to 7 are time, bit 0 the polarity, 1 = ON | 0xFF: by 127 | 0xFE |
//! | 2, ATIS | bits 2 to 7 are time, bit 1 the polarity, bit 0 marks a measurement of light | 0b1111_11nn: by 63 n | |
//!
//! Rows count from the bottom in the file, and from the top here. Measurements of light (ATIS) are skipped. Generic and colour
//! events have no polarity, and are refused by name.

use super::{Anomalies, Decoder, SensorSize, Sink, stage::Stage};

/// How a file begins.
pub(super) const MAGIC: &[u8] = b"Event Stream";

/// What the events of a file are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EsKind {
    /// Changes.
    Dvs,
    /// Changes, and measurements of light.
    Atis,
}

/// Reads the header: the kind, the size, and where the events begin.
///
/// # Errors
/// Where it is wrong, and what is.
pub(super) fn parse_header(head: &[u8]) -> Result<(EsKind, SensorSize, usize), (usize, String)> {
    let Some(&[major, minor, patch, kind]) = head.get(12..).and_then(|rest| rest.first_chunk()) else {
        return Err((head.len(), "it ends inside its header".into()));
    };
    if major != 2 {
        return Err((12, format!("version {major}.{minor}.{patch} is not read, only 2; convert it with faery")));
    }
    let kind = match kind {
        1 => EsKind::Dvs,
        2 => EsKind::Atis,
        0 | 4 => return Err((15, "it holds generic or colour events, which have no polarity".into())),
        _ => return Err((15, format!("its kind {kind} is none that is known"))),
    };
    let Some(&[a, b, c, d]) = head.get(16..).and_then(|rest| rest.first_chunk()) else {
        return Err((16, "it ends inside its header".into()));
    };
    Ok((kind, SensorSize { width: u16::from_le_bytes([a, b]), height: u16::from_le_bytes([c, d]) }, 20))
}

/// Decodes what follows the header.
#[derive(Clone, Debug)]
pub struct EsDecoder {
    kind: EsKind,
    size: SensorSize,
    t_us: u64,
    restarted: bool,
    /// The bytes of an event that is not whole yet.
    event: [u8; 5],
    length: usize,
    anomalies: Anomalies,
    stage: Stage,
}

impl EsDecoder {
    /// A decoder at the first event.
    #[must_use]
    pub fn new(kind: EsKind, size: SensorSize) -> Self {
        Self {
            kind,
            size,
            t_us: 0,
            restarted: false,
            event: [0; 5],
            length: 0,
            anomalies: Anomalies::default(),
            stage: Stage::default(),
        }
    }

    /// Takes the first byte of an event, or one that stands alone.
    fn first(&mut self, byte: u8, sink: &mut impl Sink) {
        let (step, is_event) = match self.kind {
            EsKind::Dvs if byte == 0xFF => (127, false),
            EsKind::Dvs if byte == 0xFE => (0, false),
            EsKind::Dvs => (byte >> 1, true),
            EsKind::Atis if byte >= 0xFC => (63 * (byte & 3), false),
            EsKind::Atis => (byte >> 2, true),
        };
        self.t_us = self.t_us.saturating_add(step.into());
        if std::mem::take(&mut self.restarted) {
            self.anomalies.discontinuities += 1;
            self.stage.flush(sink);
            sink.discontinuity(self.t_us);
        }
        if is_event {
            (self.event[0], self.length) = (byte, 1);
        }
    }

    fn event(&mut self, sink: &mut impl Sink) {
        let [first, a, b, c, d] = self.event;
        let on = match self.kind {
            EsKind::Dvs => first & 1 == 1,
            EsKind::Atis if first & 1 == 1 => return,
            EsKind::Atis => first & 2 == 2,
        };
        let (x, row) = (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        if x < self.size.width && row < self.size.height {
            self.stage.room(1, sink);
            self.stage.push(self.t_us, x, self.size.height - 1 - row, on);
        } else {
            self.anomalies.outside += 1;
        }
    }
}

impl Decoder for EsDecoder {
    fn decode(&mut self, bytes: &[u8], sink: &mut impl Sink) {
        for &byte in bytes {
            if self.length == 0 {
                self.first(byte, sink);
                continue;
            }
            self.event[self.length] = byte;
            self.length += 1;
            if self.length == self.event.len() {
                self.length = 0;
                self.event(sink);
            }
        }
        self.stage.flush(sink);
    }

    fn finish(&mut self, sink: &mut impl Sink) {
        self.anomalies.truncated_bytes += std::mem::take(&mut self.length) as u64;
        self.stage.flush(sink);
    }

    fn restart(&mut self) {
        self.anomalies.truncated_bytes += std::mem::take(&mut self.length) as u64;
        self.restarted = true;
    }

    /// The format comes from files alone and needs no host clock.
    fn hint_host_us(&mut self, _host_us: u64) {}

    fn anomalies(&self) -> Anomalies {
        self.anomalies
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Columns;

    fn bytes(hex: &str) -> Vec<u8> {
        let digits: Vec<u8> = hex.chars().filter_map(|c| c.to_digit(16)).map(|digit| digit as u8).collect();
        digits.chunks(2).map(|pair| pair[0] << 4 | pair[1]).collect()
    }

    fn decoded(file: &[u8]) -> (SensorSize, Columns) {
        let (kind, size, body) = parse_header(file).unwrap();
        let mut columns = Columns::default();
        let mut decoder = EsDecoder::new(kind, size);
        decoder.decode(&file[body..], &mut columns);
        decoder.finish(&mut columns);
        assert!(decoder.anomalies().is_empty());
        (size, columns)
    }

    /// What the encoder of faery 0.7.1 made of events that it was given with rows from the bottom.
    #[test]
    fn files_of_faery_give_its_events() {
        let header = "4576656e742053747265616d 020000 01 4001 f000";
        let body = "0103000400 0a2c01c700 fd07000000 0107000100 ffffffffffff d63f010200 7f0000ef00";
        let (size, columns) = decoded(&bytes(&format!("{header}{body}")));
        assert_eq!((size.width, size.height), (320, 240));
        assert_eq!(columns.t_us, [0, 5, 131, 131, 1000, 1063]);
        assert_eq!(columns.x, [3, 300, 7, 7, 319, 0]);
        assert_eq!(columns.y, [4, 199, 0, 1, 2, 239].map(|row| 239 - row));
        assert_eq!(columns.on, [true, false, true, true, false, true]);
    }

    #[test]
    fn measurements_of_light_are_left_out() {
        let header = "4576656e742053747265616d 020000 02 3001 f000";
        let (_, columns) = decoded(&bytes(&format!("{header} 0601000500 ff2902000600 0303000700 fffdc004000800")));
        assert_eq!((columns.t_us, columns.x), (vec![1, 500], vec![1, 4]));
        assert_eq!((columns.y, columns.on), (vec![234, 231], vec![true, false]));
    }

    #[test]
    fn other_kinds_and_versions_are_refused_by_name() {
        let error = |tail: &str| parse_header(&bytes(&format!("4576656e742053747265616d {tail}"))).unwrap_err().1;
        assert!(error("010000 01 0000 0000").contains("version 1.0.0"));
        assert!(error("020000 04 0000 0000").contains("no polarity"));
        assert!(error("020000").contains("ends inside"));
    }
}
