//! The readout of the sensor: what it sees, less what its filters take away, as words in the queue towards the host.

use std::collections::BTreeSet;

use erfgs_events::CdEvent;

use crate::usb::{
    clock::TimeBase,
    faults::Jitter,
    line::LineTap,
    outbox::{Queue, SharedCounts},
    scene::{EventScene, RecordedWords},
};

use super::{
    registers::{Registers, SIZE},
    words::{Encoder, Item},
};

/// The longest stretch that is worked on at once, true nanoseconds.
const SLICE_NS: i64 = 1_000_000;
/// A batch is ready for the host when it is this large, even before its time.
const BATCH_BYTES: usize = 128 * 1024;
/// From one report of the event-rate controller to the next, microseconds of the sensor's clock (our choice: the period
/// of the real sensor's reports is not documented).
const REPORT_US: u64 = 10_000;

/// What the sensor looks at.
pub enum Stimulus {
    /// A scene.
    Scene(Box<dyn EventScene>),
    /// Recorded words, which pass as they are: filters and triggers do not touch them.
    Words(RecordedWords),
}

impl std::fmt::Debug for Stimulus {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(match self {
            Self::Scene(_) => "Scene",
            Self::Words(_) => "Words",
        })
    }
}

/// The readout.
#[derive(Debug)]
pub(super) struct Readout {
    stimulus: Stimulus,
    tap: LineTap,
    dropped_pulses: BTreeSet<u64>,
    jitter: Jitter,
    counts: SharedCounts,
    capacity: usize,
    latency_ns: i64,
    queue: Queue,
    running: Option<Running>,
}

/// The state while it streams.
#[derive(Debug)]
struct Running {
    at_ns: i64,
    frame_end_ns: i64,
    began_us: u64,
    encoder: Encoder,
    masks: u64,
    masked: Option<Vec<bool>>,
    /// Since the last overflow, the decoder must be told everything anew.
    overflowed: bool,
    rate_period: u64,
    rate_left: u64,
    report_at_us: u64,
    counted_in: u32,
    counted_out: u32,
}

impl Readout {
    pub(super) fn new(
        stimulus: Stimulus,
        tap: LineTap,
        dropped_pulses: BTreeSet<u64>,
        jitter: Jitter,
        capacity: usize,
        latency_ns: i64,
    ) -> Self {
        let counts = SharedCounts::default();
        Self {
            stimulus,
            tap,
            dropped_pulses,
            jitter,
            counts,
            capacity,
            latency_ns,
            queue: Queue::default(),
            running: None,
        }
    }

    pub(super) fn counts(&self) -> SharedCounts {
        self.counts.clone()
    }

    /// Power was lost: what was not sent is gone.
    pub(super) fn power_off(&mut self) {
        self.queue.clear();
        self.running = None;
    }

    pub(super) fn take(&mut self, length: usize, now_ns: i64) -> Option<Vec<u8>> {
        self.queue.take(length, now_ns)
    }

    /// When there may be something to take.
    pub(super) fn wake_ns(&self) -> Option<i64> {
        self.queue.ready_ns().or(self.running.as_ref().map(|running| running.frame_end_ns + self.latency_ns))
    }

    /// The registers have changed: starts or stops streaming.
    pub(super) fn follow(&mut self, registers: &Registers, clock: &TimeBase, now_ns: i64) {
        let format = registers.format().filter(|_| registers.is_streaming());
        match (format, &mut self.running) {
            (None, running) => {
                if running.take().is_some() {
                    self.queue.close(now_ns);
                }
            }
            (Some(format), running) => {
                if let Some(running) = running.as_mut().filter(|running| running.encoder.format() == format) {
                    if running.masks != registers.masks() {
                        (running.masks, running.masked) = (registers.masks(), registers.masked());
                    }
                    return;
                }
                // Edges that came while nobody listened are gone.
                self.tap.skip(now_ns);
                match &mut self.stimulus {
                    Stimulus::Scene(scene) => scene.begin(clock, now_ns),
                    Stimulus::Words(words) => words.rewind(),
                }
                let began_us = clock.ticks_us(now_ns);
                *running = Some(Running {
                    at_ns: now_ns,
                    frame_end_ns: now_ns + registers.frame_period_us() * 1000,
                    began_us,
                    encoder: Encoder::new(format),
                    masks: registers.masks(),
                    masked: registers.masked(),
                    overflowed: false,
                    rate_period: 0,
                    rate_left: 0,
                    report_at_us: began_us + REPORT_US,
                    counted_in: 0,
                    counted_out: 0,
                });
            }
        }
    }

    /// Reads the sensor out up to `now_ns` (less the latency of the pipeline).
    pub(super) fn advance(&mut self, registers: &Registers, clock: &TimeBase, now_ns: i64) {
        let Some(mut running) = self.running.take() else { return };
        let until_ns = now_ns - self.latency_ns;
        let (mut items, mut out) = (Vec::new(), Vec::new());
        while running.at_ns < until_ns {
            let end = (running.at_ns + SLICE_NS).min(running.frame_end_ns).min(until_ns);
            self.slice(&mut running, registers, clock, end, &mut items, &mut out);
            running.at_ns = end;
            if end == running.frame_end_ns {
                self.queue.close(end + self.latency_ns + self.jitter.next_ns());
                running.frame_end_ns += registers.frame_period_us() * 1000;
            } else if self.queue.open() >= BATCH_BYTES {
                self.queue.close(end + self.latency_ns);
            }
        }
        self.running = Some(running);
    }

    fn slice(
        &mut self,
        running: &mut Running,
        registers: &Registers,
        clock: &TimeBase,
        end_ns: i64,
        items: &mut Vec<Item>,
        out: &mut Vec<u8>,
    ) {
        let end_us = clock.ticks_us(end_ns);
        let edges = self.tap.until(end_ns);
        let scene = match &mut self.stimulus {
            Stimulus::Scene(scene) => scene,
            Stimulus::Words(words) => {
                let bytes = words.until(end_us.saturating_sub(running.began_us));
                if self.queue.len() + bytes.len() <= self.capacity {
                    self.queue.push(bytes);
                }
                return;
            }
        };
        let mut events = Vec::new();
        scene.until(clock, end_ns, &mut events);
        let seen = events.len() as u64;
        running.filter(&mut events, registers);
        let kept = events.len() as u64;

        items.clear();
        items.extend(events.into_iter().map(Item::Event));
        let mut sent_edges = 0;
        if registers.trigger_enabled() {
            let arrived = edges.into_iter().filter(|edge| !self.dropped_pulses.contains(&edge.pulse));
            for edge in arrived {
                items.push(Item::Edge { t_us: clock.ticks_us(edge.at_ns), rising: edge.rising });
                sent_edges += 1;
            }
        }
        running.count(seen, kept, registers);
        while registers.counts_rate() && running.report_at_us <= end_us {
            let t_us = running.report_at_us;
            items.push(Item::Monitor { t_us, subtype: 0x14, value: std::mem::take(&mut running.counted_in) });
            items.push(Item::Monitor { t_us, subtype: 0x16, value: std::mem::take(&mut running.counted_out) });
            running.report_at_us += REPORT_US;
        }
        // A stable sort: what happens at one time stays in the order of the scene.
        items.sort_by_key(Item::t_us);

        out.clear();
        if running.overflowed {
            running.encoder.restart();
        }
        running.encoder.encode(items, end_us, out);
        running.overflowed = self.queue.len() + out.len() > self.capacity;
        if !running.overflowed {
            self.queue.push(out);
        }
        let overflowed = running.overflowed;
        self.counts.update(|counts| {
            counts.seen += seen;
            counts.filtered += seen - kept;
            if overflowed {
                counts.lost += kept;
            } else {
                counts.sent += kept;
                counts.edges += sent_edges;
            }
        });
    }
}

impl Running {
    fn filter(&mut self, events: &mut Vec<CdEvent>, registers: &Registers) {
        let (width, height) = SIZE;
        events.retain(|event| event.x < width && event.y < height);
        if let Some(masked) = &self.masked {
            events.retain(|event| !masked[usize::from(event.y) * usize::from(width) + usize::from(event.x)]);
        }
        if let Some((period_us, target)) = registers.rate_control() {
            events.retain(|event| {
                let period = event.t_us / period_us;
                if period != self.rate_period {
                    (self.rate_period, self.rate_left) = (period, target);
                }
                let kept = self.rate_left > 0;
                self.rate_left = self.rate_left.saturating_sub(1);
                kept
            });
        }
    }

    fn count(&mut self, seen: u64, kept: u64, registers: &Registers) {
        if registers.counts_rate() {
            self.counted_in += seen as u32;
            self.counted_out += kept as u32;
        }
    }
}
