//! Events with session time.

use super::{EpochCursor, Epochs};
use erfgs_events::{CdEvent, Sink};

/// Hands the events of a stream on to `inner` with session time, microseconds, in which breaks are gaps and not jumps back.
/// Events that nothing dates, and all that is not an event, are left out.
#[derive(Debug)]
pub struct Dated<'a, S> {
    /// Who takes the events.
    pub inner: S,
    cursor: EpochCursor<'a>,
    last_us: u64,
}

impl<'a, S: Sink> Dated<'a, S> {
    /// Of a stream with these epochs.
    pub fn new(epochs: &'a Epochs, inner: S) -> Self {
        Self { inner, cursor: epochs.follow(), last_us: 0 }
    }
}

impl<S: Sink> Sink for Dated<'_, S> {
    fn packet(&mut self, sequence: u64) {
        self.cursor.packet(sequence);
    }

    fn discontinuity(&mut self, _t_us: u64) {
        self.cursor.discontinuity();
    }

    fn event(&mut self, event: CdEvent) {
        // What was seen before the session began is put at its beginning; the clocks of two epochs may overlap by what they
        // are off.
        let Some(t_ns) = self.cursor.session_ns(event.t_us) else { return };
        self.last_us = self.last_us.max(u64::try_from(t_ns / 1000).unwrap_or(0));
        self.inner.event(CdEvent { t_us: self.last_us, ..event });
    }
}
