//! A USB3 Vision camera, written from the wire: registers and description behind its control protocol (GenCP), frames as the blocks of
//! its stream. It runs freely on its own crystal, or takes a frame for each pulse of a trigger line.

mod descriptors;
mod faults;
mod registers;
mod stream;

pub use descriptors::{ACKNOWLEDGEMENTS, COMMANDS, STREAM};
pub use faults::U3vFaults;

use std::collections::VecDeque;

use self::{
    descriptors::{NAMES, descriptors},
    registers::{DESCRIPTION, FEATURES, MANIFEST, Memory, SBRM, SIRM, SIRM_END, abrm, sirm},
    stream::Outgoing,
};
use super::{
    Reply, Speed, TriggerLine, Urb, UsbDevice, clock::ClockError, outbox::SharedCounts, scene::FrameScene,
    standard::Standard,
};
use crate::genicam::{
    Camera, CameraOptions, Order,
    description::{self, Wire},
    registers::{FEATURES_BYTES, feature},
};

const PREFIX: &[u8; 4] = b"U3VC";
const READ: u16 = 0x0800;
const WRITE: u16 = 0x0802;
const PENDING: u16 = 0x0805;
const NOT_IMPLEMENTED: u16 = 0x8001;
const INVALID_PARAMETER: u16 = 0x8002;
const NO_ADDRESS: u16 = 0x8003;
const WRITE_PROTECTED: u16 = 0x8004;
const INVALID_HEADER: u16 = 0x800e;
/// Largest command and acknowledgement.
const LARGEST: usize = 1024;
/// Sizes of transfers are multiples of 2 to this power.
const ALIGNMENT: u32 = 10;
/// By how much a late answer is put off.
const LATE_MS: u16 = 30;

/// How a camera is built and wired.
#[derive(Clone, Debug)]
pub struct U3vOptions {
    /// Serial number, 63 bytes at most.
    pub serial: String,
    /// The name that its user gave it, 63 bytes at most.
    pub name: String,
    /// Speed of its bus.
    pub speed: Speed,
    /// Columns and rows of its sensor.
    pub sensor: [u32; 2],
    /// Whether its description is in an archive.
    pub zipped: bool,
    /// If it is triggered: the line, each pulse of which exposes a frame.
    pub trigger: Option<TriggerLine>,
    /// Where its strobe goes, if it is wired: edges at both ends of each exposure.
    pub strobe: Option<TriggerLine>,
    /// Error of its clock.
    pub clock: ClockError,
    /// What goes wrong inside.
    pub faults: U3vFaults,
}

impl Default for U3vOptions {
    fn default() -> Self {
        Self {
            serial: "U3V00001".into(),
            name: String::new(),
            speed: Speed::Super,
            sensor: [640, 480],
            zipped: true,
            trigger: None,
            strobe: None,
            clock: ClockError::default(),
            faults: U3vFaults::default(),
        }
    }
}

/// The device.
pub struct U3v {
    options: U3vOptions,
    standard: Standard,
    memory: Memory,
    description: Vec<u8>,
    camera: Camera,
    commands: u64,
    /// Acknowledgements, each from some time on.
    answers: VecDeque<(i64, Vec<u8>)>,
    outgoing: Outgoing,
    counts: SharedCounts,
}

fn link_bytes_s(speed: Speed) -> u32 {
    match speed {
        Speed::High => 40_000_000,
        Speed::Super => 400_000_000,
    }
}

impl U3v {
    /// A camera before a scene.
    #[must_use]
    pub fn new(options: U3vOptions, scene: Box<dyn FrameScene>) -> Self {
        let link_bytes_s = link_bytes_s(options.speed);
        let wire = Wire {
            transport: "U3V",
            namespace: "USB",
            order: Order::Little,
            features: FEATURES,
            strings: [abrm::MAKER, abrm::MODEL, abrm::SERIAL].map(|at| (at as u32, 64)),
            most_bytes_s: link_bytes_s,
        };
        let text = description::text(&wire, options.sensor);
        let description = if options.zipped { description::archive(&text) } else { text.into_bytes() };
        let more = CameraOptions {
            sensor: options.sensor,
            trigger: options.trigger.clone(),
            strobe: options.strobe.clone(),
            clock: options.clock,
            link_bytes_s,
        };
        let mut camera = Self {
            standard: Standard::new(descriptors(&options)),
            memory: Memory::new(),
            description,
            camera: Camera::new(more, Order::Little, scene),
            commands: 0,
            answers: VecDeque::new(),
            outgoing: Outgoing::default(),
            counts: SharedCounts::default(),
            options,
        };
        camera.power_up();
        camera
    }

    /// What it counts: frames that were exposed (`seen`), sent (`frames`), or lost because the host did not read.
    #[must_use]
    pub fn counts(&self) -> SharedCounts {
        self.counts.clone()
    }

    /// Changes what goes wrong inside.
    pub fn set_faults(&mut self, faults: U3vFaults) {
        self.options.faults = faults;
    }

    fn power_up(&mut self) {
        self.camera.power_up();
        self.commands = 0;
        self.answers.clear();
        self.outgoing.clear();
        let memory = &mut self.memory;
        *memory = Memory::new();
        memory.put_word(abrm::VERSION, 0x0001_0001);
        for (at, text) in [
            (abrm::MAKER, NAMES[0]),
            (abrm::MODEL, NAMES[1]),
            (abrm::FAMILY, "Emulated"),
            (abrm::DEVICE_VERSION, "1.0"),
            (abrm::SERIAL, &self.options.serial),
            (abrm::NAME, &self.options.name),
        ] {
            memory.put(at, text.as_bytes());
        }
        // User's name, timestamp, family, SBRM, length of what was written.
        memory.put_double(abrm::CAPABILITY, 1 | 1 << 3 | 1 << 8 | 1 << 9 | 1 << 11);
        memory.put_word(abrm::RESPONSE_MS, 100);
        memory.put_double(abrm::MANIFEST, MANIFEST);
        memory.put_double(abrm::SBRM, SBRM);
        memory.put_double(abrm::INCREMENT, 1);
        memory.put_word(SBRM, 0x0001_0000);
        memory.put_double(SBRM + 0x04, 1);
        memory.put_word(SBRM + 0x14, LARGEST as u32);
        memory.put_word(SBRM + 0x18, LARGEST as u32);
        memory.put_word(SBRM + 0x1c, 1);
        memory.put_double(SBRM + 0x20, SIRM);
        memory.put_word(SBRM + 0x28, (SIRM_END - SIRM) as u32);
        memory.put_word(SBRM + 0x40, if self.options.speed == Speed::Super { 8 } else { 4 });
        memory.put_word(SIRM + sirm::INFO, ALIGNMENT << 24);
        memory.put_word(SIRM + sirm::LEADER, stream::LEADER_BYTES);
        memory.put_word(SIRM + sirm::TRAILER, stream::TRAILER_BYTES);
        memory.put_double(MANIFEST, 1);
        // Version 1.0.0 of the file, schema 1.1, and whether it is in an archive.
        memory.put_word(MANIFEST + 8, 0x0100_0000);
        memory.put_word(MANIFEST + 12, 1 << 24 | 1 << 16 | u32::from(self.options.zipped) << 10);
        memory.put_double(MANIFEST + 16, DESCRIPTION);
        memory.put_double(MANIFEST + 24, self.description.len() as u64);
        self.settle();
    }

    /// What follows from the settings.
    fn settle(&mut self) {
        let payload = self.camera.features.get(feature::PAYLOAD);
        self.memory.put_double(SIRM + sirm::PAYLOAD, payload.into());
    }

    /// Takes a command, and queues what is answered.
    fn command(&mut self, bytes: &[u8], now_ns: i64) {
        let half = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
        let (Some(command), Some(length), Some(id)) = (half(6), half(8), half(10)) else { return };
        if !bytes.starts_with(PREFIX) {
            return;
        }
        let number = self.commands;
        self.commands += 1;
        if self.options.faults.lost_answers.contains(&number) {
            return;
        }
        let data = &bytes[12..];
        let (status, content) = match data.len() == usize::from(length) && bytes.len() <= LARGEST {
            true => self.execute(command, data, now_ns),
            false => (INVALID_HEADER, Vec::new()),
        };
        let mut ready_ns = now_ns;
        if self.options.faults.late_answers.contains(&number) {
            let wait = [[0, 0], LATE_MS.to_le_bytes()].concat();
            self.answers.push_back((now_ns, packet(0, PENDING, id, &wait)));
            ready_ns += i64::from(LATE_MS) * 1_000_000;
        }
        self.answers.push_back((ready_ns, packet(status, command | 1, id, &content)));
    }

    fn execute(&mut self, command: u16, data: &[u8], now_ns: i64) -> (u16, Vec<u8>) {
        let address = data.first_chunk().map(|bytes| u64::from_le_bytes(*bytes));
        match (command, address) {
            (READ, Some(address)) if data.len() == 12 => {
                let count = usize::from(u16::from_le_bytes([data[10], data[11]]));
                if count + 12 > LARGEST {
                    return (INVALID_PARAMETER, Vec::new());
                }
                self.read(address, count).map_or((NO_ADDRESS, Vec::new()), |bytes| (0, bytes))
            }
            (WRITE, Some(address)) => match self.write(address, &data[8..], now_ns) {
                0 => (0, [[0, 0], (data.len() as u16 - 8).to_le_bytes()].concat()),
                status => (status, Vec::new()),
            },
            (READ, _) => (INVALID_PARAMETER, Vec::new()),
            _ => (NOT_IMPLEMENTED, Vec::new()),
        }
    }

    fn read(&self, address: u64, count: usize) -> Option<Vec<u8>> {
        if let Some(offset) = address.checked_sub(DESCRIPTION) {
            let offset = usize::try_from(offset).ok()?;
            return Some(self.description.get(offset..offset.checked_add(count)?)?.to_vec());
        }
        match address.checked_sub(FEATURES) {
            Some(offset) => self.camera.features.bytes(u32::try_from(offset).ok()?, count),
            None => self.memory.bytes(address, count).map(<[u8]>::to_vec),
        }
    }

    fn write(&mut self, address: u64, bytes: &[u8], now_ns: i64) -> u16 {
        const FEATURES_END: u64 = FEATURES + FEATURES_BYTES as u64;
        let word = <[u8; 4]>::try_from(bytes).ok().map(u32::from_le_bytes);
        match (address, word) {
            (abrm::LATCH, Some(_)) => {
                let clock_ns = self.camera.clock_ns(now_ns);
                self.memory.put_double(abrm::TIMESTAMP, clock_ns);
            }
            (FEATURES..FEATURES_END, Some(value)) => {
                let status = self.camera.write((address - FEATURES) as u32, value, now_ns);
                self.settle();
                return status;
            }
            (at, Some(value)) if at == SIRM + sirm::CONTROL => return self.stream(value),
            (at, Some(value)) if sirm::SIZES.iter().any(|size| SIRM + size == at) => self.memory.put_word(at, value),
            _ if self.memory.bytes(address, bytes.len()).is_none() => return NO_ADDRESS,
            _ => return WRITE_PROTECTED,
        }
        0
    }

    /// Switches the stream on or off.
    fn stream(&mut self, value: u32) -> u16 {
        let status = if value & 1 == 1 { stream::status(&self.memory, 1 << ALIGNMENT) } else { 0 };
        if status == 0 {
            self.memory.put_word(SIRM + sirm::CONTROL, value & 1);
            self.outgoing.clear();
        }
        status
    }

    fn packet_bytes(&self) -> usize {
        match self.options.speed {
            Speed::High => 512,
            Speed::Super => 1024,
        }
    }

    fn advance(&mut self, now_ns: i64) {
        while let Some(exposed) = self.camera.exposed(now_ns) {
            let streams = self.memory.word(SIRM + sirm::CONTROL) & 1 == 1;
            let takes = streams && self.outgoing.has_room();
            self.counts.update(|counts| {
                counts.seen += 1;
                counts.frames += u64::from(takes);
                counts.lost += u64::from(!takes);
            });
            if takes {
                let packet = self.packet_bytes();
                let faults = &self.options.faults;
                self.outgoing.push(stream::block(&self.memory, &self.camera.features, &exposed, packet, faults));
            }
        }
    }

    fn control(&mut self, urb: &Urb) -> Reply {
        let Some(setup) = urb.setup else { return Reply::Stall };
        // A host that halts the stream's endpoint, and one that ends the halt, want nothing of what was.
        if setup.request_type == 0x02 && setup.index == u16::from(STREAM) {
            self.outgoing.clear();
        }
        self.standard.answer(&setup, urb.data.len()).unwrap_or(Reply::Stall)
    }
}

/// An acknowledgement.
fn packet(status: u16, command: u16, id: u16, data: &[u8]) -> Vec<u8> {
    let mut packet = PREFIX.to_vec();
    for half in [status, command, data.len() as u16, id] {
        packet.extend(half.to_le_bytes());
    }
    packet.extend(data);
    packet
}

impl UsbDevice for U3v {
    fn speed(&self) -> Speed {
        self.options.speed
    }

    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        self.advance(now_ns);
        match urb.endpoint {
            0 => self.control(urb),
            endpoint if self.standard.is_halted(endpoint) => Reply::Stall,
            COMMANDS => {
                self.command(&urb.data, now_ns);
                Reply::Taken(urb.data.len())
            }
            ACKNOWLEDGEMENTS => match self.answers.pop_front_if(|(ready_ns, _)| *ready_ns <= now_ns) {
                None => Reply::Pending,
                Some((_, answer)) if answer.len() > urb.length => Reply::Overflow,
                Some((_, answer)) => Reply::Data(answer),
            },
            STREAM if !urb.length.is_multiple_of(self.packet_bytes()) => Reply::Overflow,
            STREAM => self.outgoing.fill(urb.length).map_or(Reply::Pending, Reply::Data),
            _ => Reply::Stall,
        }
    }

    fn reset(&mut self) {
        self.standard.reset();
        self.power_up();
    }
}
