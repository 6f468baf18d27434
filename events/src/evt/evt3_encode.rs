//! The encoder of EVT 3.0.

use super::super::{CdEvent, Edge, EncodeError, encode::Vector};

/// Encodes EVT 3.0. Events that vectors can hold are gathered, so that [`Evt3Encoder::finish`] must be called last.
///
/// The format's clock rolls over every 16.777 s, and decoders count the rounds. Therefore every value of the high time
/// word is written, as a sensor does, also where there are no events; and a gap that would take more than
/// [`Evt3Encoder::MAX_GAP_US`] of such words is refused.
#[derive(Clone, Debug, Default)]
pub struct Evt3Encoder {
    high: Option<u64>,
    low: Option<u16>,
    row: Option<u16>,
    pending: Option<Vector>,
}

impl Evt3Encoder {
    /// The longest gap between two events, microseconds: 4 h 46 min, which takes 8 MiB of time words.
    pub const MAX_GAP_US: u64 = 1 << 34;

    /// Appends an event.
    ///
    /// # Errors
    /// If the event goes back in time, or too far forward, or cannot be addressed.
    pub fn event(&mut self, event: CdEvent, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        EncodeError::check_address(event.x, event.y, 0x7FF)?;
        if self.pending.as_mut().is_some_and(|vector| vector.extend(event)) {
            return Ok(());
        }
        self.finish(out);
        self.time(event.t_us, out)?;
        // Aligned as a sensor aligns them: a vector never reaches past the last column, where OpenEB would drop it.
        self.pending = Some(Vector::new(event, 32));
        Ok(())
    }

    /// Appends an edge at a trigger input.
    ///
    /// # Errors
    /// As [`Evt3Encoder::event`]; channels end at 15.
    pub fn edge(&mut self, edge: Edge, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        EncodeError::check_channel(edge.channel, 15)?;
        self.finish(out);
        self.time(edge.t_us, out)?;
        word(10, u16::from(edge.channel) << 8 | u16::from(edge.rising), out);
        Ok(())
    }

    /// Appends what is gathered.
    pub fn finish(&mut self, out: &mut Vec<u8>) {
        let Some(Vector { y, on, base, mask, .. }) = self.pending.take() else { return };
        if self.row != Some(y) {
            word(0, y, out);
            self.row = Some(y);
        }
        let polarity = u16::from(on) << 11;
        // A vector takes four words.
        if mask.count_ones() > 4 {
            word(3, polarity | base, out);
            word(4, (mask & 0xFFF) as u16, out);
            word(4, (mask >> 12 & 0xFFF) as u16, out);
            word(5, (mask >> 24) as u16, out);
        } else {
            let columns = (0..32).filter(|column| mask >> column & 1 == 1);
            columns.for_each(|column| word(2, polarity | (base + column), out));
        }
    }

    fn time(&mut self, t_us: u64, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let (high, low) = (t_us >> 12, (t_us & 0xFFF) as u16);
        let before = self.high.map_or(t_us, |high| high << 12 | u64::from(self.low.unwrap_or(0)));
        EncodeError::check_time(before, t_us, Self::MAX_GAP_US)?;
        if self.high != Some(high) {
            let first = self.high.map_or(high, |before| before + 1);
            (first..=high).for_each(|high| word(8, (high & 0xFFF) as u16, out));
            self.high = Some(high);
            self.low = None;
        }
        if self.low != Some(low) {
            word(6, low, out);
            self.low = Some(low);
        }
        Ok(())
    }
}

fn word(kind: u16, content: u16, out: &mut Vec<u8>) {
    out.extend((kind << 12 | content).to_le_bytes());
}
