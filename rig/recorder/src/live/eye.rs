//! What the monitor keeps of one stream: packets that wait to be looked at, what was seen in them, the last picture.

use std::{collections::VecDeque, time::Instant};

use bytes::Bytes;
use erfgs_events::{ApsFrame, CdEvent, Decoder, EventBatch, Sink, StreamDecoder};
use erfgs_session::{
    container::{hand_over, sensor_size},
    source::{Description, Encoding, Packet},
};
use serde::Serialize;

use super::{clock::ClockWatch, frames, picture::Canvas};

/// Bytes of events that may wait to be looked at; what comes beyond is not looked at.
const WAITING: usize = 4 << 20;
/// Length of the window over which the share is taken, seconds.
const WINDOW_S: f64 = 1.0;

/// Packets that wait, filled by the threads of the source.
#[derive(Default)]
pub(super) struct Inbox {
    packets: VecDeque<Packet>,
    bytes: usize,
    offered_bytes: u64,
    skipped: bool,
}

impl Inbox {
    /// Takes a packet if there is room; of frames the latest alone.
    pub fn put(&mut self, encoding: Encoding, packet: &Packet) {
        self.offered_bytes += packet.payload.len() as u64;
        if encoding.is_frames() {
            self.packets.clear();
        } else if self.bytes + packet.payload.len() > WAITING {
            self.skipped = true;
            return;
        }
        self.bytes += packet.payload.len();
        let mut packet = packet.clone();
        packet.discontinuity |= std::mem::take(&mut self.skipped);
        self.packets.push_back(packet);
    }

    /// Moves out what waits.
    pub fn take(&mut self) -> (VecDeque<Packet>, u64) {
        self.bytes = 0;
        (std::mem::take(&mut self.packets), self.offered_bytes)
    }
}

/// What the page is told of a stream's picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Look {
    /// The stream.
    pub id: String,
    /// Counts its pictures; 0 before the first.
    pub version: u64,
    /// Milliseconds between the last two pictures: events are accumulated over that long.
    pub picture_ms: f64,
    /// The last lines of a trigger board.
    pub lines: Vec<String>,
}

/// What was seen of a stream, owned by the monitor's thread but for the moments when others ask.
pub(super) struct Eye {
    description: Description,
    decoder: Option<StreamDecoder>,
    canvas: Canvas,
    clock: ClockWatch,
    frame: Option<Bytes>,
    look: Look,
    jpeg: Option<Vec<u8>>,
    pictured: Option<Instant>,
    window: Window,
}

/// Sums over a window.
struct Window {
    since: Instant,
    offered_before: u64,
    events: u64,
    bytes: u64,
    /// Events for each byte, and the share of the bytes that was decoded, of the last complete window.
    last: Option<[f64; 2]>,
}

impl Eye {
    pub fn new(description: &Description) -> Self {
        let (width, height) = (description.width, description.height);
        let size = sensor_size(description);
        let window = Window { since: Instant::now(), offered_before: 0, events: 0, bytes: 0, last: None };
        let is_events = description.encoding.is_events();
        Self {
            description: description.clone(),
            decoder: description.encoding.events().map(|encoding| StreamDecoder::new(encoding, size)),
            canvas: if is_events { Canvas::new(width.min(2048), height.min(2048)) } else { Canvas::new(0, 0) },
            clock: ClockWatch::default(),
            frame: None,
            look: Look { id: description.id.clone(), ..Look::default() },
            jpeg: None,
            pictured: None,
            window,
        }
    }

    /// Looks at packets; `offered` bytes arrived since the start.
    pub fn see(&mut self, packets: VecDeque<Packet>, offered: u64) {
        for packet in packets {
            match self.description.encoding {
                Encoding::TriggerLines => self.lines(&packet.payload),
                encoding if encoding.is_frames() => self.frame(packet),
                _ => self.events(&packet),
            }
        }
        let seconds = self.window.since.elapsed().as_secs_f64();
        if seconds >= WINDOW_S {
            let window = &mut self.window;
            let arrived = offered - window.offered_before;
            window.last = (window.bytes > 0).then(|| {
                [window.events as f64 / window.bytes as f64, (window.bytes as f64 / arrived.max(1) as f64).min(1.0)]
            });
            *window = Window { since: Instant::now(), offered_before: offered, events: 0, bytes: 0, last: window.last };
        }
    }

    fn events(&mut self, packet: &Packet) {
        let Some(decoder) = &mut self.decoder else { return };
        hand_over(decoder, packet, true);
        let mut seen = Seen { canvas: &mut self.canvas, events: 0, last_us: None };
        decoder.decode(&packet.payload, &mut seen);
        let (events, last_us) = (seen.events, seen.last_us);
        self.window.events += events;
        self.window.bytes += packet.payload.len() as u64;
        if let Some(last_us) = last_us {
            self.clock.sample(last_us.cast_signed().saturating_mul(1000), packet.host_ns);
        }
    }

    fn frame(&mut self, packet: Packet) {
        if let Some(stamp) = packet.stamp {
            self.clock.sample(stamp.kernel_ns, packet.host_ns);
        }
        if !packet.damaged {
            self.frame = Some(packet.payload);
        }
    }

    fn lines(&mut self, payload: &Bytes) {
        for line in payload.split(|&byte| byte == b'\n').filter(|line| !line.is_empty()) {
            if self.look.lines.len() == 3 {
                self.look.lines.remove(0);
            }
            let text: String = String::from_utf8_lossy(line).chars().filter(|c| !c.is_control()).take(100).collect();
            self.look.lines.push(text);
        }
    }

    /// Makes a new picture of what was seen since the last one.
    pub fn draw(&mut self) {
        let encoding = self.description.encoding;
        let picture = if encoding.is_events() {
            Some(self.canvas.render())
        } else {
            let frame = self.frame.take();
            frame.and_then(|frame| frames::picture(&self.description, &frame))
        };
        let Some(jpeg) = picture.and_then(|picture| picture.jpeg()) else { return };
        self.jpeg = Some(jpeg);
        self.look.version += 1;
        let now = Instant::now();
        if let Some(before) = self.pictured.replace(now) {
            self.look.picture_ms = (now - before).as_secs_f64() * 1e3;
        }
    }

    pub fn look(&self) -> Look {
        self.look.clone()
    }

    pub fn jpeg(&self) -> Option<Vec<u8>> {
        self.jpeg.clone()
    }

    /// Events for each byte and the share of the bytes decoded, of the last window.
    pub fn events_per_byte(&self) -> Option<[f64; 2]> {
        self.window.last.filter(|_| self.description.encoding.is_events())
    }

    pub fn clock(&self) -> Option<crate::ClockStatus> {
        let encoding = self.description.encoding;
        self.clock.status(if encoding.is_events() { "arrival of event data" } else { "kernel stamp to arrival" })
    }
}

/// Counts and draws events.
struct Seen<'a> {
    canvas: &'a mut Canvas,
    events: u64,
    last_us: Option<u64>,
}

impl Sink for Seen<'_> {
    fn event(&mut self, event: CdEvent) {
        self.events += 1;
        self.last_us = Some(event.t_us);
        self.canvas.add(event.x, event.y, event.on);
    }

    fn events(&mut self, batch: EventBatch<'_>) {
        self.events += batch.t_us.len() as u64;
        self.last_us = batch.t_us.last().copied().or(self.last_us);
        for ((&x, &y), &on) in batch.x.iter().zip(batch.y).zip(batch.on) {
            self.canvas.add(x, y, on);
        }
    }

    fn frame(&mut self, frame: ApsFrame) {
        self.canvas.lay_under(frame.width, frame.height, &frame.pixels, frame.bits);
    }
}
