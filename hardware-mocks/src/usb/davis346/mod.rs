//! The iniVation DAVIS346: events, frames, inertial samples and external edges in one stream of 16-bit words.
//!
//! Parameters are set by vendor requests (0xBF one, 0xC2 several); endpoint 0x82 streams once time stamps, multiplexer
//! and USB side run. Sources of the protocol: libcaer (BSD-2), neuromorphic-drivers (MIT). The filters of the event
//! sensor are stored and not applied; biases are stored and have no effect.

mod sensors;
pub mod spi;
pub mod words;

pub use sensors::imu_sample;
pub use spi::SIZE;

use self::{
    sensors::{Frames, Imu},
    spi::{Parameters, Unit, module},
    words::{Chunk, Writer, special},
};
use super::{
    Faults, Reply, Speed, TriggerLine, Urb, UsbDevice,
    clock::{ClockMode, Crystal, SyncWire, TimeBase},
    faults::Jitter,
    line::LineTap,
    outbox::{Queue, SharedCounts},
    scene::{EventScene, FrameScene},
    standard::{Descriptors, Identity, Standard, bulk_endpoint, interface, interrupt_endpoint},
};

/// The endpoint that streams.
pub const STREAM: u8 = 0x82;
/// The endpoint for messages of the firmware, which has none.
pub const DEBUG: u8 = 0x81;

/// The longest stretch that is worked on at once, true nanoseconds.
const SLICE_NS: i64 = 1_000_000;

/// How a DAVIS346 is built and wired.
#[derive(Clone, Debug)]
pub struct Davis346Options {
    /// Serial number, as its string descriptor tells it.
    pub serial: String,
    /// Speed of its bus.
    pub speed: Speed,
    /// Version of the firmware (the release of the device descriptor).
    pub firmware: u16,
    /// Version of the logic.
    pub logic_version: u32,
    /// Patch of the logic.
    pub logic_patch: u32,
    /// Rate of the clocks over their nominal rates, thousandths.
    pub deviation: u32,
    /// Orientation of the event sensor: bit 2: rows and columns are exchanged on the wire.
    pub dvs_orientation: u32,
    /// Orientation of the frame sensor: bit 0: rows are mirrored, 1: columns, 2: exchanged.
    pub aps_orientation: u32,
    /// Orientation of the inertial unit: bits 0, 1, 2: z, y, x are mirrored. (Told to the host, not applied.)
    pub imu_orientation: u32,
    /// Whether its clock input is free, so that it is a master. A slave follows [`Davis346Options::sync`].
    pub master: bool,
    /// Whether roll-overs of the time are told together when nothing else is there to tell.
    pub merged_wraps: bool,
    /// How many bytes wait for the host at most.
    pub queue_bytes: usize,
    /// How long what was seen is held back, true nanoseconds: time for the edges of a trigger board that runs in another
    /// process to arrive.
    pub latency_ns: i64,
    /// The wire at its external input.
    pub trigger: TriggerLine,
    /// The chain of clocks.
    pub sync: SyncWire,
    /// Faults of the device: crystal, jitter, dropped triggers. (Faults of transfers are the business of a
    /// [`Plug`](super::Plug).)
    pub faults: Faults,
}

impl Default for Davis346Options {
    fn default() -> Self {
        Self {
            serial: "00000336".into(),
            speed: Speed::Super,
            firmware: 0x0006,
            logic_version: 18,
            logic_patch: 1,
            deviation: 1000,
            dvs_orientation: 0,
            aps_orientation: 0,
            imu_orientation: 0,
            master: true,
            merged_wraps: false,
            queue_bytes: 8 << 20,
            latency_ns: 0,
            trigger: TriggerLine::new(),
            sync: SyncWire::new(),
            faults: Faults::default(),
        }
    }
}

impl Davis346Options {
    fn descriptors(&self) -> Descriptors {
        let identity = Identity {
            vendor: 0x152a,
            product: 0x841a,
            release: self.firmware,
            class: [0, 0, 0],
            maker: "iniVation".into(),
            name: "DAVIS346".into(),
            serial: self.serial.clone(),
        };
        let body = [
            interface(0, 0, 2, [0xff, 0, 0]),
            interrupt_endpoint(self.speed, DEBUG),
            bulk_endpoint(self.speed, STREAM),
        ];
        identity.with_interfaces(self.speed, 1, &body.concat())
    }
}

/// The device.
#[derive(Debug)]
pub struct Davis346 {
    standard: Standard,
    parameters: Parameters,
    events: Events,
    frames: Frames,
    imu: Imu,
    tap: LineTap,
    jitter: Jitter,
    counts: SharedCounts,
    queue: Queue,
    clock: Option<TimeBase>,
    running: Option<Running>,
    options: Davis346Options,
}

struct Events(Box<dyn EventScene>);

impl std::fmt::Debug for Events {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Events")
    }
}

#[derive(Debug, Default)]
struct Running {
    at_ns: i64,
    packet_end_ns: i64,
    zero_ns: Option<i64>,
    writer: Writer,
    sees_events: bool,
    /// Edges that wait because there was no room for them.
    held: Vec<bool>,
}

impl Davis346 {
    /// A device that looks at something.
    #[must_use]
    pub fn new(options: Davis346Options, events: Box<dyn EventScene>, frames: Box<dyn FrameScene>) -> Self {
        let unit = Unit {
            master: options.master,
            logic_version: options.logic_version,
            logic_patch: options.logic_patch,
            deviation: options.deviation,
            dvs_orientation: options.dvs_orientation,
            aps_orientation: options.aps_orientation,
            imu_orientation: options.imu_orientation,
        };
        Self {
            standard: Standard::new(options.descriptors()),
            parameters: Parameters::new(unit),
            events: Events(events),
            frames: Frames::new(frames),
            imu: Imu::default(),
            tap: options.trigger.tap(),
            jitter: Jitter::new(&options.faults),
            counts: SharedCounts::default(),
            queue: Queue::default(),
            clock: None,
            running: None,
            options,
        }
    }

    /// What it counts.
    #[must_use]
    pub fn counts(&self) -> SharedCounts {
        self.counts.clone()
    }

    /// Has the scene make its pictures now, so that no transfer waits for them.
    pub fn prepare(&mut self) {
        self.frames.prepare();
    }

    /// What a parameter holds, for tests of drivers.
    #[must_use]
    pub fn parameter(&self, module: u8, parameter: u8) -> u32 {
        self.parameters.read(module, parameter)
    }

    fn read(&self, module: u8, parameter: u8) -> u32 {
        // Statistics: 64 bits, the upper half first: edges and events that were dropped.
        match (module, parameter) {
            (module::MULTIPLEXER, 83) => (self.counts.get().lost >> 32) as u32,
            (module::MULTIPLEXER, 84) => self.counts.get().lost as u32,
            _ => self.parameters.read(module, parameter),
        }
    }

    fn write(&mut self, module: u8, parameter: u8, value: u32, now_ns: i64) {
        self.advance(now_ns);
        let ran = self.parameters.is_on(module::MULTIPLEXER, 1);
        let was_reset = self.parameters.is_on(module::MULTIPLEXER, 2);
        self.parameters.write(module, parameter, value);
        let mode = if self.options.master { ClockMode::Master } else { ClockMode::Slave };
        let runs = self.parameters.is_on(module::MULTIPLEXER, 1);
        // A reset of the time stamps is the master's to give; it reaches the slaves over the chain.
        let reset = self.options.master && !was_reset && self.parameters.is_on(module::MULTIPLEXER, 2);
        if let Some(clock) = &mut self.clock {
            match (runs, ran) {
                (true, false) => clock.start(mode, now_ns),
                (false, true) => clock.stop(),
                (true, true) if reset => clock.start(mode, now_ns),
                _ => {}
            }
        }
        self.follow(now_ns);
    }

    /// The parameters have changed: starts or stops streaming, and the event sensor.
    fn follow(&mut self, now_ns: i64) {
        let Some(clock) = &self.clock else { return };
        if !self.parameters.is_streaming() {
            if self.running.take().is_some() {
                self.queue.close(now_ns);
                self.frames.restart();
                self.imu.restart();
            }
            return;
        }
        if self.running.is_none() {
            self.tap.skip(now_ns);
        }
        let packet_end_ns = now_ns + self.parameters.packet_period_us() * 1000;
        let running = self.running.get_or_insert_with(|| Running {
            at_ns: now_ns,
            packet_end_ns,
            zero_ns: clock.zero_ns(),
            ..Running::default()
        });
        let sees = self.parameters.chip_runs() && self.parameters.is_on(module::DVS, 3);
        if sees && !running.sees_events {
            self.events.0.begin(clock, now_ns);
        }
        running.sees_events = sees;
    }

    fn advance(&mut self, now_ns: i64) {
        let options = &self.options;
        let clock = self
            .clock
            .get_or_insert_with(|| TimeBase::new(Crystal::new(options.faults.clock, now_ns), options.sync.clone()))
            .clone();
        let Some(mut running) = self.running.take() else { return };
        let until_ns = now_ns - self.options.latency_ns;
        while running.at_ns < until_ns {
            let end = (running.at_ns + SLICE_NS).min(running.packet_end_ns).min(until_ns);
            self.slice(&mut running, &clock, end);
            running.at_ns = end;
            if end == running.packet_end_ns {
                self.queue.close(end + self.options.latency_ns + self.jitter.next_ns());
                running.packet_end_ns += self.parameters.packet_period_us() * 1000;
            }
        }
        self.running = Some(running);
    }

    fn slice(&mut self, running: &mut Running, clock: &TimeBase, end_ns: i64) {
        let end_us = clock.ticks_us(end_ns);
        let mut out = Vec::new();
        if running.zero_ns != clock.zero_ns() {
            running.zero_ns = clock.zero_ns();
            running.writer.reset(&mut out);
            self.imu.restart();
            self.frames.restart();
            if running.sees_events {
                // The scene goes on from the zero of the new time.
                self.events.0.begin(clock, running.zero_ns.unwrap_or(end_ns));
            }
        }
        let mut chunks = Vec::new();
        let edges = self.edges(running, clock, end_ns, &mut chunks);
        let mut events = Vec::new();
        if running.sees_events {
            self.events.0.until(clock, end_ns, &mut events);
        }
        sensors::events(&events, self.options.dvs_orientation >> 2 & 1 == 1, &mut chunks);
        let imu = self.imu.until(&self.parameters, end_us, &mut chunks);
        let frames = self.frames.until(&self.parameters, end_us, end_ns, &mut chunks);
        chunks.sort_by_key(|chunk| chunk.t_us);

        let mut writer = running.writer.clone();
        for chunk in &chunks {
            writer.write(chunk, &mut out);
        }
        if !self.options.merged_wraps {
            writer.wrap(end_us, &mut out);
        }
        let seen = events.len() as u64;
        let lost = self.queue.len() + out.len() > self.options.queue_bytes;
        if lost {
            // Roll-overs are never lost, and edges only where the host has said so.
            if !self.parameters.is_on(module::MULTIPLEXER, 4) {
                running.held.extend(edges.iter().copied());
            }
        } else {
            running.writer = writer;
            self.queue.push(&out);
        }
        self.counts.update(|counts| {
            counts.seen += seen;
            if lost {
                counts.lost += seen;
            } else {
                counts.sent += seen;
                counts.edges += edges.len() as u64;
                counts.imu += imu;
                counts.frames += frames;
            }
        });
    }

    /// The edges of a stretch of time, after those that had to wait; returns them.
    fn edges(&mut self, running: &mut Running, clock: &TimeBase, end_ns: i64, chunks: &mut Vec<Chunk>) -> Vec<bool> {
        let arrived = self.tap.until(end_ns);
        if !self.parameters.input_runs() {
            running.held.clear();
            return Vec::new();
        }
        let wanted = [self.parameters.is_on(module::INPUT, 2), self.parameters.is_on(module::INPUT, 1)];
        let first_us = clock.ticks_us(running.at_ns);
        let held = running.held.drain(..).map(|rising| (first_us, rising));
        let dropped = &self.options.faults.dropped_triggers;
        let arrived = arrived
            .into_iter()
            .filter(|edge| !dropped.contains(&edge.pulse) && wanted[usize::from(edge.rising)])
            .map(|edge| (clock.ticks_us(edge.at_ns), edge.rising));
        let edges: Vec<(u64, bool)> = held.chain(arrived).collect();
        chunks.extend(edges.iter().map(|&(t_us, rising)| {
            let word = if rising { special::INPUT_RISING } else { special::INPUT_FALLING };
            Chunk { t_us, words: vec![word] }
        }));
        edges.into_iter().map(|(_, rising)| rising).collect()
    }

    fn control(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        let Some(setup) = urb.setup else { return Reply::Stall };
        if let Some(reply) = self.standard.answer(&setup, urb.data.len()) {
            return reply;
        }
        let parts = (u8::try_from(setup.value), u8::try_from(setup.index));
        match (setup.request_type, setup.request, parts) {
            (0xc0, 0xbf, (Ok(module), Ok(parameter))) if setup.length == 4 => {
                Reply::Data(self.read(module, parameter).to_be_bytes().to_vec())
            }
            (0x40, 0xbf, (Ok(module), Ok(parameter))) => match urb.data.first_chunk::<4>() {
                Some(&value) if urb.data.len() == 4 => {
                    self.write(module, parameter, u32::from_be_bytes(value), now_ns);
                    Reply::Taken(4)
                }
                _ => Reply::Stall,
            },
            (0x40, 0xc2, _) if setup.index == 0 && urb.data.len() == usize::from(setup.value) * 6 => {
                for &[module, parameter, a, b, c, d] in urb.data.as_chunks::<6>().0 {
                    self.write(module, parameter, u32::from_be_bytes([a, b, c, d]), now_ns);
                }
                Reply::Taken(urb.data.len())
            }
            _ => Reply::Stall,
        }
    }
}

impl UsbDevice for Davis346 {
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
            STREAM => self.queue.take(urb.length, now_ns).map_or(Reply::Pending, Reply::Data),
            DEBUG => Reply::Pending,
            _ => Reply::Stall,
        }
    }

    fn reset(&mut self) {
        self.standard.reset();
        self.parameters.reset();
        self.queue.clear();
        self.running = None;
        self.frames.restart();
        self.imu.restart();
        if let Some(mut clock) = self.clock.take() {
            clock.stop();
        }
    }

    fn wake_ns(&mut self, now_ns: i64) -> i64 {
        let packet = self.running.as_ref().map(|running| running.packet_end_ns + self.options.latency_ns);
        self.queue.ready_ns().or(packet).unwrap_or(now_ns + 5_000_000).max(now_ns)
    }
}
