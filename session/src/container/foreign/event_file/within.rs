//! What of a file lies within a span of time.

use std::cell::Cell;

use erfgs_events::{ApsFrame, CdEvent, Edge, ImuSample, Mark, Sink};

use super::host_clock::HostClock;

/// Hands on what lies within a window of host time.
pub(super) struct Within<'a, S> {
    sink: &'a mut S,
    clock: HostClock,
    window: [i64; 2],
    /// Whether the window is over.
    over: &'a Cell<bool>,
}

impl<'a, S: Sink> Within<'a, S> {
    pub fn new(sink: &'a mut S, clock: HostClock, window: [i64; 2], over: &'a Cell<bool>) -> Self {
        Self { sink, clock, window, over }
    }

    fn holds(&mut self, t_us: u64) -> bool {
        let host_ns = self.clock.host_ns(t_us);
        self.over.set(host_ns > self.window[1]);
        (self.window[0]..=self.window[1]).contains(&host_ns)
    }
}

impl<S: Sink> Sink for Within<'_, S> {
    fn event(&mut self, event: CdEvent) {
        if self.holds(event.t_us) {
            self.sink.event(event);
        }
    }

    fn mark(&mut self, t_us: u64, mark: Mark) {
        if self.holds(t_us) {
            self.sink.mark(t_us, mark);
        }
    }

    fn edge(&mut self, edge: Edge) {
        if self.holds(edge.t_us) {
            self.sink.edge(edge);
        }
    }

    fn imu(&mut self, sample: ImuSample) {
        if self.holds(sample.t_us) {
            self.sink.imu(sample);
        }
    }

    fn frame(&mut self, frame: ApsFrame) {
        if self.holds(frame.exposure_end_us) {
            self.sink.frame(frame);
        }
    }

    fn discontinuity(&mut self, t_us: u64) {
        self.clock.discontinuity(t_us);
        self.sink.discontinuity(t_us);
    }
}
