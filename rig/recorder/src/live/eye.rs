//! What the monitor keeps of one stream: packets that wait to be looked at, what was seen in them, the last picture.

use std::{collections::VecDeque, time::Instant};

use bytes::Bytes;
use erfgs_events::{Decoder, SensorSize, StreamDecoder};
use erfgs_session::{
    EventPicture,
    container::{hand_over, sensor_size},
    source::{Description, Encoding, Packet},
};
use serde::{Deserialize, Serialize};

use super::{
    clock::ClockWatch,
    frames,
    picture::{Picture, WIDEST, WIDEST_LARGE},
};

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
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// The stream.
    pub id: String,
    /// Counts its pictures; 0 before the first.
    pub version: u64,
    /// The last lines of a trigger board.
    pub lines: Vec<String>,
}

/// What was seen of a stream, owned by the monitor's thread but for the moments when others ask.
pub(super) struct Eye {
    description: Description,
    decoder: Option<StreamDecoder>,
    events: EventPicture,
    /// When the newest event was looked at.
    seen: Instant,
    clock: ClockWatch,
    frame: Option<Bytes>,
    look: Look,
    /// The picture as it is shown among others, and enlarged.
    jpegs: [Option<Vec<u8>>; 2],
    /// Packets that were looked at; and of the last picture: how many there were, its span, and whether it was enlarged.
    looked: u64,
    drawn: Option<(u64, u64, bool)>,
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
        let size = sensor_size(description);
        let window = Window { since: Instant::now(), offered_before: 0, events: 0, bytes: 0, last: None };
        Self {
            description: description.clone(),
            decoder: description.encoding.events().map(|encoding| StreamDecoder::new(encoding, size)),
            events: EventPicture::new(
                size.filter(|_| description.encoding.is_events()).unwrap_or(SensorSize { width: 0, height: 0 }),
            ),
            seen: Instant::now(),
            clock: ClockWatch::default(),
            frame: None,
            look: Look { id: description.id.clone(), ..Look::default() },
            jpegs: [None, None],
            looked: 0,
            drawn: None,
            window,
        }
    }

    /// Looks at packets; `offered` bytes arrived since the start.
    pub fn see(&mut self, packets: VecDeque<Packet>, offered: u64) {
        self.looked += packets.len() as u64;
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
        if packet.discontinuity {
            self.events.clear();
        }
        let before = self.events.events();
        decoder.decode(&packet.payload, &mut self.events);
        let events = self.events.events() - before;
        self.window.events += events;
        self.window.bytes += packet.payload.len() as u64;
        if let Some(newest_us) = self.events.newest_us().filter(|_| events > 0) {
            self.seen = Instant::now();
            self.clock.sample(newest_us.cast_signed().saturating_mul(1000), packet.host_ns, packet.discontinuity);
        }
    }

    fn frame(&mut self, packet: Packet) {
        if let Some(stamp) = packet.stamp {
            self.clock.sample(stamp.kernel_ns, packet.host_ns, packet.discontinuity);
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

    /// Makes a new picture: of the latest frame, or of the events of the last `span_us`. With `flows` time goes on where no
    /// events come; without, as where a playback stands, it does not. With `large` there is an enlarged one, too.
    pub fn draw(&mut self, span_us: u64, flows: bool, large: bool) {
        let is_events = self.description.encoding.is_events();
        let drawn = (self.looked, span_us, large);
        if self.drawn == Some(drawn) && !(is_events && flows) {
            return;
        }
        let picture = |widest: u32| {
            if !is_events {
                return frames::picture(&self.description, self.frame.as_ref()?, widest);
            }
            let [width, height] = self.events.size();
            let step = width.div_ceil(widest).max(1);
            let since_us = if flows { self.seen.elapsed().as_micros() as u64 } else { 0 };
            let now_us = self.events.newest_us().unwrap_or(0).saturating_add(since_us);
            let rgb = self.events.render(now_us, span_us, step as u16);
            Some(Picture { width: width / step, height: height / step, rgb })
        };
        let jpeg = |widest| picture(widest).and_then(|picture| picture.jpeg());
        let Some(small) = jpeg(WIDEST) else { return };
        let large = if large { jpeg(WIDEST_LARGE) } else { None };
        self.jpegs = [Some(small), large];
        self.drawn = Some(drawn);
        self.look.version += 1;
    }

    pub fn look(&self) -> Look {
        self.look.clone()
    }

    /// The last picture; the enlarged one where there is one and it is asked for.
    pub fn jpeg(&self, large: bool) -> Option<Vec<u8>> {
        let [small, enlarged] = &self.jpegs;
        if large { enlarged.as_ref().or(small.as_ref()).cloned() } else { small.clone() }
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
