//! A camera of the USB Video Class with a bulk stream: MJPEG, YUYV, NV12 and GREY, with exposure, gain, brightness and
//! white balance. It runs freely on its own crystal, or takes a frame for each pulse of a trigger line.

mod controls;
mod descriptors;
mod encode;

pub use encode::{Format, FrameTruth};

use std::collections::VecDeque;

use self::{controls::Controls, encode::Encoder};
use super::{
    Faults, Reply, Setup, Speed, TriggerLine, Urb, UsbDevice, clock::Crystal, faults::Jitter, line::LineTap,
    outbox::SharedCounts, scene::FrameScene, standard::Standard,
};

/// The endpoint that streams.
pub const STREAM: u8 = 0x81;
/// Rate of the clock of presentation times, hertz.
pub const CLOCK_HZ: u32 = 48_000_000;
const HEADER_BYTES: usize = 12;
/// How many frames wait for the host at most; what is exposed beyond that is lost.
const QUEUED_FRAMES: usize = 2;
/// Probe and commit of UVC 1.0.
const PROBE_BYTES: usize = 26;

/// How a camera is built and wired.
#[derive(Clone, Debug)]
pub struct UvcOptions {
    /// Vendor.
    pub vendor: u16,
    /// Product.
    pub product: u16,
    /// Name.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// Speed of its bus.
    pub speed: Speed,
    /// Formats, the default first.
    pub formats: Vec<Format>,
    /// Widths and heights, the default first.
    pub sizes: Vec<(u32, u32)>,
    /// Frame rates, hertz, the default first.
    pub rates_hz: Vec<f64>,
    /// From the end of the exposure to the last byte of the frame, nanoseconds.
    pub readout_ns: i64,
    /// If it is triggered: the line, each pulse of which exposes a frame.
    pub trigger: Option<TriggerLine>,
    /// Faults of the camera: crystal, jitter, dropped triggers.
    pub faults: Faults,
}

impl Default for UvcOptions {
    fn default() -> Self {
        Self {
            vendor: 0x1d6b,
            product: 0x0102,
            name: "Emulated camera".into(),
            serial: "UVC00001".into(),
            speed: Speed::High,
            formats: vec![Format::Mjpeg, Format::Yuyv, Format::Nv12, Format::Grey],
            sizes: vec![(640, 480), (320, 240), (1280, 720)],
            rates_hz: vec![30.0, 15.0, 60.0],
            readout_ns: 8_000_000,
            trigger: None,
            faults: Faults::default(),
        }
    }
}

/// What the host has asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Settings {
    format: u8,
    size: u8,
    interval: u32,
}

/// The device.
pub struct Uvc {
    options: UvcOptions,
    standard: Standard,
    controls: Controls,
    probe: Settings,
    commit: Settings,
    scene: Box<dyn FrameScene>,
    encoder: Encoder,
    counts: SharedCounts,
    jitter: Jitter,
    crystal: Option<Crystal>,
    streaming: Option<Streaming>,
    payloads: VecDeque<Payload>,
}

#[derive(Debug)]
struct Streaming {
    began_ns: i64,
    number: u64,
    tap: Option<LineTap>,
    next_ns: Option<i64>,
    frame_id: bool,
}

#[derive(Debug)]
struct Payload {
    ready_ns: i64,
    ends_frame: bool,
    bytes: VecDeque<u8>,
}

impl std::fmt::Debug for Uvc {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Uvc")
            .field("options", &self.options)
            .field("commit", &self.commit)
            .finish_non_exhaustive()
    }
}

impl Uvc {
    /// A camera that looks at something.
    #[must_use]
    pub fn new(options: UvcOptions, scene: Box<dyn FrameScene>) -> Self {
        let interval = descriptors::intervals(&options).first().copied().unwrap_or(333_333);
        let settings = Settings { format: 1, size: 1, interval };
        Self {
            standard: Standard::new(descriptors::descriptors(&options)),
            controls: Controls::new(),
            probe: settings,
            commit: settings,
            scene,
            encoder: Encoder::default(),
            counts: SharedCounts::default(),
            jitter: Jitter::new(&options.faults),
            crystal: None,
            streaming: None,
            payloads: VecDeque::new(),
            options,
        }
    }

    /// What it counts: frames that were exposed (`seen`), sent (`frames`), or lost because the host did not read.
    #[must_use]
    pub fn counts(&self) -> SharedCounts {
        self.counts.clone()
    }

    /// Encodes what the scene knows ahead, in the default format and size, so that no frame is late for it.
    pub fn prepare(&mut self) {
        let (format, width, height) = self.picked();
        for (key, picture) in self.scene.known(width, height) {
            self.encoder.prepare(format, key, &picture);
        }
    }

    fn picked(&self) -> (Format, u32, u32) {
        let format = self.options.formats.get(usize::from(self.commit.format) - 1).copied().unwrap_or(Format::Mjpeg);
        let (width, height) = self.options.sizes.get(usize::from(self.commit.size) - 1).copied().unwrap_or((640, 480));
        (format, width, height)
    }

    fn start(&mut self, now_ns: i64) {
        let mut tap = self.options.trigger.as_ref().map(TriggerLine::tap);
        if let Some(tap) = &mut tap {
            tap.skip(now_ns);
        }
        self.payloads.clear();
        let next_ns = tap.is_none().then_some(now_ns);
        self.streaming = Some(Streaming { began_ns: now_ns, number: 0, tap, next_ns, frame_id: false });
    }

    fn stop(&mut self) {
        self.streaming = None;
        self.payloads.clear();
    }

    /// True time of the start of the next exposure, if it has begun by `now_ns`.
    fn next_exposure(&mut self, now_ns: i64) -> Option<i64> {
        let streaming = self.streaming.as_mut()?;
        if let Some(tap) = &mut streaming.tap {
            if streaming.next_ns.is_none() {
                let dropped = &self.options.faults.dropped_triggers;
                // Pulses that came during the readout of a frame before are seen one by one all the same.
                streaming.next_ns = tap.next_rise(now_ns, dropped);
            }
            return streaming.next_ns.take();
        }
        let start = streaming.next_ns.filter(|&next| next <= now_ns)?;
        // The crystal says when the next one begins: its error per interval, carried in true time.
        let crystal = self.crystal?;
        let interval_ns = i64::from(self.commit.interval) * 100;
        let target = interval_ns * (streaming.number as i64 + 1);
        let device = |at_ns: i64| crystal.elapsed_ns(at_ns) - crystal.elapsed_ns(streaming.began_ns);
        let mut next = start + interval_ns;
        next += target - device(next);
        streaming.next_ns = Some(next);
        Some(start)
    }

    fn advance(&mut self, now_ns: i64) {
        let faults = &self.options.faults;
        self.crystal.get_or_insert_with(|| Crystal::new(faults.clock, now_ns));
        while let Some(start_ns) = self.next_exposure(now_ns) {
            let exposure_ns = [start_ns, start_ns + self.controls.exposure_ns()];
            self.expose(exposure_ns);
        }
    }

    fn expose(&mut self, exposure_ns: [i64; 2]) {
        let (format, width, height) = self.picked();
        let (Some(streaming), Some(crystal)) = (&mut self.streaming, self.crystal) else { return };
        let number = streaming.number;
        streaming.number += 1;
        let waiting = self.payloads.iter().filter(|payload| payload.ends_frame).count();
        self.counts.update(|counts| {
            counts.seen += 1;
            if waiting >= QUEUED_FRAMES {
                counts.lost += 1;
            } else {
                counts.frames += 1;
            }
        });
        if waiting >= QUEUED_FRAMES {
            return;
        }
        let (key, picture) = self.scene.frame(number, exposure_ns, width, height);
        let frame = self.encoder.encode(format, key, &picture, FrameTruth { number, exposure_ns });
        let ready_ns = exposure_ns[1] + self.options.readout_ns + self.jitter.next_ns();

        // Presentation time: the device's clock at the start of the exposure. Source clock: the same clock, and the
        // bus's frame number (11 bits, a millisecond each), at the time of sending.
        let ticks = |at_ns: i64| (crystal.elapsed_ns(at_ns) as i128 * i128::from(CLOCK_HZ) / 1_000_000_000) as u32;
        let mut header = vec![HEADER_BYTES as u8, 0x8c | u8::from(streaming.frame_id)];
        header.extend(ticks(exposure_ns[0]).to_le_bytes());
        header.extend(ticks(ready_ns).to_le_bytes());
        header.extend((((ready_ns / 1_000_000) & 0x7ff) as u16).to_le_bytes());
        streaming.frame_id = !streaming.frame_id;

        let room = descriptors::payload_bytes(self.options.speed) as usize - HEADER_BYTES;
        let count = frame.len().div_ceil(room);
        for (index, data) in frame.chunks(room).enumerate() {
            let ends_frame = index + 1 == count;
            header[1] = header[1] & !2 | u8::from(ends_frame) << 1;
            let bytes = header.iter().chain(data).copied().collect();
            self.payloads.push_back(Payload { ready_ns, ends_frame, bytes });
        }
    }

    /// Answers probe and commit.
    fn negotiate(&mut self, setup: &Setup, data: &[u8], now_ns: i64) -> Reply {
        let selector = setup.value.to_le_bytes()[1];
        let reply = |bytes: &[u8]| Reply::Data(bytes[..bytes.len().min(usize::from(setup.length))].to_vec());
        match (selector, setup.request) {
            (1 | 2, 0x01) if data.len() >= 8 => {
                self.probe = self.nearest(data);
                if selector == 2 {
                    self.commit = self.probe;
                    self.start(now_ns);
                }
                Reply::Taken(data.len())
            }
            (1 | 2, 0x85) => reply(&(PROBE_BYTES as u16).to_le_bytes()),
            (1 | 2, 0x86) => reply(&[3]),
            (1, 0x81..=0x83 | 0x87) => reply(&self.describe(self.probe)),
            (2, 0x81) => reply(&self.describe(self.commit)),
            _ => Reply::Stall,
        }
    }

    /// What the camera makes of the host's wish.
    fn nearest(&self, data: &[u8]) -> Settings {
        let count = |count: usize| count.max(1) as u8;
        let asked = u32::from_le_bytes([data[4], data[5], data[6], data[7]]);
        let interval = descriptors::intervals(&self.options)
            .into_iter()
            .min_by_key(|&interval| interval.abs_diff(if asked == 0 { self.commit.interval } else { asked }))
            .unwrap_or(self.commit.interval);
        Settings {
            format: data[2].clamp(1, count(self.options.formats.len())),
            size: data[3].clamp(1, count(self.options.sizes.len())),
            interval,
        }
    }

    fn describe(&self, settings: Settings) -> Vec<u8> {
        let format = self.options.formats.get(usize::from(settings.format) - 1).copied().unwrap_or(Format::Mjpeg);
        let (width, height) = self.options.sizes.get(usize::from(settings.size) - 1).copied().unwrap_or((640, 480));
        let mut bytes = vec![1, 0, settings.format, settings.size];
        bytes.extend(settings.interval.to_le_bytes());
        // Key frames, compression quality and window, delay: not used.
        bytes.extend([0; 10]);
        bytes.extend(format.largest_frame(width, height).to_le_bytes());
        bytes.extend(descriptors::payload_bytes(self.options.speed).to_le_bytes());
        bytes
    }

    fn control(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        let Some(setup) = urb.setup else { return Reply::Stall };
        // A host stops a bulk stream by clearing its endpoint's halt.
        let stops = (setup.request_type, setup.request, setup.index) == (0x02, 1, u16::from(STREAM))
            || (setup.request_type, setup.request, setup.index) == (0x01, 11, 1)
            || (setup.request_type, setup.request) == (0x00, 9);
        if stops {
            self.stop();
        }
        if let Some(reply) = self.standard.answer(&setup, urb.data.len()) {
            return reply;
        }
        match (setup.request_type & 0x7f, setup.index.to_le_bytes()[0]) {
            (0x21, 0) => self.controls.answer(&setup, &urb.data),
            (0x21, 1) => self.negotiate(&setup, &urb.data, now_ns),
            _ => Reply::Stall,
        }
    }
}

impl UsbDevice for Uvc {
    fn speed(&self) -> Speed {
        self.options.speed
    }

    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        self.advance(now_ns);
        if urb.endpoint != 0 && self.standard.is_halted(urb.endpoint) {
            return Reply::Stall;
        }
        match urb.endpoint {
            0 => self.control(urb, now_ns),
            STREAM => match self.payloads.front_mut().filter(|payload| payload.ready_ns <= now_ns) {
                None => Reply::Pending,
                Some(payload) => {
                    let count = urb.length.min(payload.bytes.len());
                    let data = payload.bytes.drain(..count).collect();
                    if payload.bytes.is_empty() {
                        self.payloads.pop_front();
                    }
                    Reply::Data(data)
                }
            },
            _ => Reply::Stall,
        }
    }

    fn reset(&mut self) {
        self.standard.reset();
        self.controls = Controls::new();
        self.crystal = None;
        self.stop();
    }

    fn wake_ns(&mut self, now_ns: i64) -> i64 {
        let ready = self.payloads.front().map(|payload| payload.ready_ns);
        // A pulse may come at any time, and nothing is due before the readout that follows it.
        let look_ns = (self.options.readout_ns / 2).max(1_000_000);
        let next = self.streaming.as_ref().map(|streaming| streaming.next_ns.unwrap_or(now_ns + look_ns));
        ready.or(next).unwrap_or(now_ns + 5_000_000).max(now_ns)
    }
}
