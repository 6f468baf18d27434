//! The Prophesee EVK4: an IMX636 event sensor behind a USB bridge.
//!
//! Endpoint 0x02 takes request frames, 0x82 gives their replies, 0x81 streams words once the start sequence has been
//! written to the sensor's registers. Source of the protocol: OpenEB 5.1.1 (HAL plugin, Apache-2.0). What no public source
//! tells is chosen and marked so where it is: the size of the queue towards the host, the period of the rate reports,
//! what the illumination counter reads.

mod readout;
mod registers;
mod treuzell;
mod words;

pub use readout::Stimulus;
pub use registers::{BIASES, SIZE};

use std::collections::VecDeque;

use self::{
    readout::Readout,
    registers::Registers,
    treuzell::{Board, LONGEST},
};
use super::{
    Faults, Reply, Speed, TriggerLine, Urb, UsbDevice,
    clock::{Crystal, SyncWire, TimeBase},
    faults::Jitter,
    outbox::SharedCounts,
    standard::{Descriptors, Identity, Standard, bulk_endpoint, interface},
};

/// The endpoint that takes requests.
pub const REQUESTS: u8 = 0x02;
/// The endpoint that gives replies.
pub const REPLIES: u8 = 0x82;
/// The endpoint that streams.
pub const STREAM: u8 = 0x81;

/// How an EVK4 is built and wired.
#[derive(Clone, Debug)]
pub struct Evk4Options {
    /// Serial number, shown as 8 hexadecimal digits.
    pub serial: u32,
    /// Speed of its bus.
    pub speed: Speed,
    /// Release of the firmware, as requests tell it: 0x30900 is 3.9.0.
    pub release: u32,
    /// Offsets of the biases that the factory set in this unit, in the order of [`BIASES`].
    pub trim: [i8; 13],
    /// Temperature of the sensor, degrees Celsius.
    pub temperature_c: f64,
    /// Whether one request can write several registers.
    pub burst_writes: bool,
    /// How many bytes wait for the host at most; what the sensor sees beyond that is lost.
    pub queue_bytes: usize,
    /// How long the sensor holds back what it has seen, true nanoseconds: time for the edges of a trigger board that
    /// runs in another process to arrive.
    pub latency_ns: i64,
    /// The wire at its trigger input.
    pub trigger: TriggerLine,
    /// The wire at its synchronisation pins.
    pub sync: SyncWire,
    /// Faults of the sensor: crystal, jitter, dropped triggers. (Faults of transfers are the business of a
    /// [`Plug`](super::Plug).)
    pub faults: Faults,
}

impl Default for Evk4Options {
    fn default() -> Self {
        Self {
            serial: 0x0005_1234,
            speed: Speed::Super,
            release: 0x3_0900,
            trim: [0, -2, 0, 3, 1, -4, 0, 2, 0, 0, 0, 0, 0],
            temperature_c: 42.0,
            burst_writes: true,
            queue_bytes: 4 << 20,
            latency_ns: 0,
            trigger: TriggerLine::new(),
            sync: SyncWire::new(),
            faults: Faults::default(),
        }
    }
}

impl Evk4Options {
    fn descriptors(&self) -> Descriptors {
        let identity = Identity {
            vendor: 0x04b4,
            product: 0x00f5,
            release: 0x0309,
            class: [0, 0, 0],
            maker: "Prophesee".into(),
            name: "EVK4".into(),
            serial: String::new(),
        };
        let mut body = interface(0, 0, 3, [0xff, 0x19, 0]);
        for endpoint in [REPLIES, REQUESTS, STREAM] {
            body.extend(bulk_endpoint(self.speed, endpoint));
        }
        identity.with_interfaces(self.speed, 1, &body)
    }
}

/// The device.
#[derive(Debug)]
pub struct Evk4 {
    options: Evk4Options,
    standard: Standard,
    registers: Registers,
    replies: VecDeque<Vec<u8>>,
    readout: Readout,
    clock: Option<TimeBase>,
}

impl Evk4 {
    /// A device that looks at something.
    #[must_use]
    pub fn new(options: Evk4Options, stimulus: Stimulus) -> Self {
        let readout = Readout::new(
            stimulus,
            options.trigger.tap(),
            options.faults.dropped_triggers.clone(),
            Jitter::new(&options.faults),
            options.queue_bytes,
            options.latency_ns,
        );
        Self {
            standard: Standard::new(options.descriptors()),
            registers: Registers::new(options.trim, options.temperature_c),
            replies: VecDeque::new(),
            readout,
            clock: None,
            options,
        }
    }

    /// What it counts.
    #[must_use]
    pub fn counts(&self) -> SharedCounts {
        self.readout.counts()
    }

    /// What a register holds, for tests of drivers.
    #[must_use]
    pub fn register(&self, address: u32) -> u32 {
        self.registers.stored(address)
    }

    /// The time base; the crystal starts with the first transfer after power-on.
    fn clock(&mut self, now_ns: i64) -> &mut TimeBase {
        let options = &self.options;
        self.clock
            .get_or_insert_with(|| TimeBase::new(Crystal::new(options.faults.clock, now_ns), options.sync.clone()))
    }

    fn advance(&mut self, now_ns: i64) {
        self.clock(now_ns);
        if let Some(clock) = &self.clock {
            self.readout.advance(&self.registers, clock, now_ns);
        }
    }

    fn request(&mut self, frame: &[u8], now_ns: i64) -> Reply {
        self.advance(now_ns);
        let before = self.registers.clock();
        let mut board = Board {
            registers: &mut self.registers,
            serial: self.options.serial,
            release: self.options.release,
            build_unix_s: 1_670_000_000,
            burst_writes: self.options.burst_writes,
        };
        let reply = treuzell::answer(&mut board, frame);
        self.replies.push_back(reply);
        let mode = self.registers.clock();
        if mode != before {
            match mode {
                Some(mode) => self.clock(now_ns).start(mode, now_ns),
                None => self.clock(now_ns).stop(),
            }
        }
        if let Some(clock) = &self.clock {
            self.readout.follow(&self.registers, clock, now_ns);
        }
        Reply::Taken(frame.len())
    }

    fn control(&mut self, urb: &Urb) -> Reply {
        let Some(setup) = urb.setup else { return Reply::Stall };
        if let Some(reply) = self.standard.answer(&setup, urb.data.len()) {
            return reply;
        }
        match (setup.request_type, setup.request) {
            // The type of the system behind the bridge: 0x31 with an IMX636.
            (0xc0, 0x72) => Reply::Data(vec![0x31, 0x00][..usize::from(setup.length).min(2)].to_vec()),
            _ => Reply::Stall,
        }
    }
}

impl UsbDevice for Evk4 {
    fn speed(&self) -> Speed {
        self.options.speed
    }

    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        if urb.endpoint != 0 && self.standard.is_halted(urb.endpoint) {
            return Reply::Stall;
        }
        match urb.endpoint {
            0 => self.control(urb),
            REQUESTS if urb.data.len() > LONGEST => Reply::Stall,
            REQUESTS => self.request(&urb.data, now_ns),
            REPLIES => match self.replies.front() {
                None => Reply::Pending,
                Some(reply) if reply.len() > urb.length => {
                    self.replies.pop_front();
                    Reply::Overflow
                }
                Some(_) => self.replies.pop_front().map_or(Reply::Pending, Reply::Data),
            },
            STREAM => {
                self.advance(now_ns);
                self.readout.take(urb.length, now_ns).map_or(Reply::Pending, Reply::Data)
            }
            _ => Reply::Stall,
        }
    }

    fn reset(&mut self) {
        self.standard.reset();
        self.registers.reset();
        self.replies.clear();
        self.readout.power_off();
        if let Some(mut clock) = self.clock.take() {
            clock.stop();
        }
    }

    fn wake_ns(&mut self, now_ns: i64) -> i64 {
        self.readout.wake_ns().unwrap_or(now_ns + 5_000_000).max(now_ns)
    }
}
