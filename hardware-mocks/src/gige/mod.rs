//! An emulated GigE Vision camera, written from the wire: registers and description behind its control protocol, frames as the
//! packets of its stream. It runs freely on its own crystal, or takes a frame for each pulse of a trigger line.
//!
//! [`GigeCamera`] has no input or output: datagrams and times go in and come out. [`GigeFront`] puts it behind sockets.

mod faults;
mod front;
mod registers;
mod stream;

pub use faults::GigeFaults;
pub use front::GigeFront;

use std::{
    collections::VecDeque,
    net::{Ipv4Addr, SocketAddrV4},
};

use self::registers::{DESCRIPTION, FEATURES, Memory, boot};
use crate::{
    genicam::{
        Camera, CameraOptions, Exposed, Order,
        description::{self, Wire},
        registers::FEATURES_BYTES,
    },
    usb::{TriggerLine, clock::ClockError, scene::FrameScene},
};

const RESEND: u16 = 0x40;
/// So many blocks are kept for those who ask for packets again.
const KEPT_BLOCKS: usize = 4;
/// Ticks of its clock a second: no round number, so that nobody takes ticks for nanoseconds.
const TICK_HZ: u64 = 125_000_000;
const LINK_BYTES_S: u32 = 125_000_000;
const FEATURES_END: u32 = FEATURES + FEATURES_BYTES;

/// How a camera is built and wired.
#[derive(Clone, Debug)]
pub struct GigeOptions {
    /// Serial number, 15 bytes at most.
    pub serial: String,
    /// The name that its user gave it, 15 bytes at most.
    pub name: String,
    /// Columns and rows of its sensor.
    pub sensor: [u32; 2],
    /// Whether its description is in an archive.
    pub zipped: bool,
    /// Whether it keeps blocks for those who ask again.
    pub resends: bool,
    /// If it is triggered: the line, each pulse of which exposes a frame.
    pub trigger: Option<TriggerLine>,
    /// Where its strobe goes, if it is wired: edges at both ends of each exposure.
    pub strobe: Option<TriggerLine>,
    /// Error of its clock.
    pub clock: ClockError,
    /// What goes wrong on the way.
    pub faults: GigeFaults,
}

impl Default for GigeOptions {
    fn default() -> Self {
        Self {
            serial: "GEV00001".into(),
            name: String::new(),
            sensor: [640, 480],
            zipped: true,
            resends: true,
            trigger: None,
            strobe: None,
            clock: ClockError::default(),
            faults: GigeFaults::default(),
        }
    }
}

/// What a camera did so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GigeCounts {
    /// Commands that arrived.
    pub commands: u64,
    /// Frames exposed while it streamed.
    pub frames: u64,
    /// Packets that it was asked for again.
    pub asked: u64,
    /// Packets that it sent again.
    pub resent: u64,
}

/// A block that was sent, for those who ask for packets again.
struct Kept {
    id: u16,
    block: u64,
    packets: Vec<(u32, Vec<u8>)>,
}

/// The camera.
pub struct GigeCamera {
    options: GigeOptions,
    memory: Memory,
    description: Vec<u8>,
    camera: Camera,
    owner: Option<(SocketAddrV4, i64)>,
    /// The last command and what was answered, for a host that did not hear it.
    answered: Option<(SocketAddrV4, u16, Vec<u8>)>,
    kept: VecDeque<Kept>,
    outgoing: VecDeque<(SocketAddrV4, Vec<u8>)>,
    counts: GigeCounts,
    arrived: u64,
    silent_until_ns: i64,
}

impl GigeCamera {
    /// A camera at an address, before a scene.
    #[must_use]
    pub fn new(options: GigeOptions, address: Ipv4Addr, scene: Box<dyn FrameScene>) -> Self {
        let wire = Wire {
            transport: "GigE",
            namespace: "GEV",
            order: Order::Big,
            features: FEATURES.into(),
            strings: [(boot::MAKER, 32), (boot::MODEL, 32), (boot::SERIAL, 16)],
            most_bytes_s: LINK_BYTES_S,
        };
        let text = description::text(&wire, options.sensor);
        let description = if options.zipped { description::archive(&text) } else { text.into_bytes() };
        let more = CameraOptions {
            sensor: options.sensor,
            trigger: options.trigger.clone(),
            strobe: options.strobe.clone(),
            clock: options.clock,
            link_bytes_s: LINK_BYTES_S,
        };
        let mut camera = Self {
            options,
            memory: Memory::new(),
            description,
            camera: Camera::new(more, Order::Big, scene),
            owner: None,
            answered: None,
            kept: VecDeque::new(),
            outgoing: VecDeque::new(),
            counts: GigeCounts::default(),
            arrived: 0,
            silent_until_ns: i64::MIN,
        };
        camera.power_up(address);
        camera
    }

    fn power_up(&mut self, address: Ipv4Addr) {
        let memory = &mut self.memory;
        *memory = Memory::new();
        memory.put_word(boot::VERSION, 0x0002_0000);
        memory.put_word(boot::MODE, 0x8000_0001);
        memory.put(boot::MAC + 2, &[0x02, 0, 0]);
        memory.put(boot::MAC + 5, &address.octets()[1..]);
        memory.put(boot::ADDRESS, &address.octets());
        memory.put(boot::MASK, &[255, 0, 0, 0]);
        let zip = if self.options.zipped { "zip" } else { "xml" };
        let url = format!("Local:emulated.{zip};{DESCRIPTION:X};{:X}?SchemaVersion=1.1.0", self.description.len());
        for (at, text) in [
            (boot::MAKER, "erfgs"),
            (boot::MODEL, "Emulated GigE"),
            (boot::DEVICE_VERSION, "1.0"),
            (boot::SERIAL, &self.options.serial),
            (boot::NAME, &self.options.name),
            (boot::URL, &url),
        ] {
            memory.put(at, text.as_bytes());
        }
        memory.put_word(boot::STREAMS, 1);
        // Names and serial numbers, who controls it, WRITEMEM, several registers at once; resend if it can.
        let resends = u32::from(self.options.resends) << 2;
        memory.put_word(boot::CAPABILITY, 1 << 31 | 1 << 30 | 1 << 26 | 0b10 | resends);
        memory.put_word(boot::HEARTBEAT_MS, 3000);
        memory.put(boot::TICK_HZ, &TICK_HZ.to_be_bytes());
        memory.put_word(boot::PACKET_SIZE, 1400);
        self.camera.power_up();
    }

    /// What it did so far.
    #[must_use]
    pub fn counts(&self) -> GigeCounts {
        self.counts
    }

    /// Changes what goes wrong on the way.
    pub fn set_faults(&mut self, faults: GigeFaults) {
        self.options.faults = faults;
    }

    /// Loses its power for a time: nobody controls it, and its settings are the maker's, when it is back.
    pub fn restart(&mut self, now_ns: i64, for_ns: i64) {
        let address = self.memory.word(boot::ADDRESS);
        self.owner = None;
        self.answered = None;
        self.kept.clear();
        self.outgoing.clear();
        self.power_up(Ipv4Addr::from_bits(address));
        self.silent_until_ns = now_ns + for_ns;
    }

    /// Another program takes it, as it can when the first was not heard of for too long, or releases it again (`None`).
    pub fn give_to(&mut self, other: Option<SocketAddrV4>, now_ns: i64) {
        self.camera.stop();
        self.set_owner(other.map(|other| (other, now_ns)));
    }

    fn set_owner(&mut self, owner: Option<(SocketAddrV4, i64)>) {
        self.owner = owner;
        let (address, port) = owner.map_or((0, 0), |(owner, _)| (owner.ip().to_bits(), owner.port()));
        self.memory.put_word(boot::CONTROLLER, address);
        self.memory.put_word(boot::CONTROLLER_PORT, port.into());
        if owner.is_none() {
            self.memory.put_word(boot::PRIVILEGE, 0);
            self.memory.put_word(boot::STREAM_PORT, 0);
            self.camera.stop();
        }
    }

    /// Takes a datagram at its control port, and gives the answer.
    pub fn command(&mut self, datagram: &[u8], from: SocketAddrV4, now_ns: i64) -> Option<Vec<u8>> {
        self.advance(now_ns);
        self.arrived += 1;
        if now_ns < self.silent_until_ns || self.options.faults.lost_commands.contains(&(self.arrived - 1)) {
            return None;
        }
        let (head, data) = datagram.split_first_chunk::<8>()?;
        let [key, flags, command, length, id] = {
            let half = |at: usize| u16::from_be_bytes([head[at], head[at + 1]]);
            [head[0].into(), head[1].into(), half(2), half(4), half(6)]
        };
        if key != 0x42 || usize::from(length) != data.len() || id == 0 {
            return None;
        }
        self.counts.commands += 1;
        if let Some((_, heard_ns)) = self.owner.as_mut().filter(|(owner, _)| *owner == from) {
            *heard_ns = now_ns;
        }
        if command == RESEND {
            self.resend(data);
            return None;
        }
        if let Some((_, _, answer)) = self.answered.as_ref().filter(|(of, known, _)| *of == from && *known == id) {
            return Some(answer.clone());
        }
        let (status, content) = self.execute(command, data, from, now_ns);
        let mut answer = status.to_be_bytes().to_vec();
        for half in [command + 1, content.len() as u16, id] {
            answer.extend(half.to_be_bytes());
        }
        answer.extend(content);
        self.answered = Some((from, id, answer.clone()));
        (flags & 1 == 1).then_some(answer)
    }

    fn execute(&mut self, command: u16, data: &[u8], from: SocketAddrV4, now_ns: i64) -> (u16, Vec<u8>) {
        const INVALID: (u16, Vec<u8>) = (0x8002, Vec::new());
        let word = |at: usize| Some(u32::from_be_bytes(*data.get(at..)?.first_chunk()?));
        match command {
            0x02 => (0, self.memory.bytes(0, 0xf8).map(<[u8]>::to_vec).unwrap_or_default()),
            0x80 => match word(0).map(|at| self.read(at, 4)) {
                Some(Ok(bytes)) => (0, bytes),
                Some(Err(status)) => (status, Vec::new()),
                None => INVALID,
            },
            0x82 => match (word(0), word(4)) {
                (Some(at), Some(value)) => match self.write(at, value, from, now_ns) {
                    0 => (0, vec![0, 0, 0, 1]),
                    // None was written.
                    status => (status, vec![0; 4]),
                },
                _ => INVALID,
            },
            0x84 => match (word(0), word(4).map(|count| count & 0xffff)) {
                (Some(at), Some(count)) if count <= 536 && count.is_multiple_of(4) => {
                    match self.read(at, count as usize) {
                        Ok(bytes) => (0, [&at.to_be_bytes()[..], &bytes].concat()),
                        Err(status) => (status, Vec::new()),
                    }
                }
                _ => INVALID,
            },
            0x86 => {
                let (Some(at), words) = (word(0), data.get(4..).unwrap_or_default().as_chunks::<4>().0) else {
                    return INVALID;
                };
                for (index, word) in words.iter().enumerate() {
                    match self.write(at + 4 * index as u32, u32::from_be_bytes(*word), from, now_ns) {
                        0 => {}
                        status => return (status, [[0, 0], (4 * index as u16).to_be_bytes()].concat()),
                    }
                }
                (0, [[0, 0], (4 * words.len() as u16).to_be_bytes()].concat())
            }
            _ => (0x8001, Vec::new()),
        }
    }

    fn read(&self, at: u32, length: usize) -> Result<Vec<u8>, u16> {
        if !at.is_multiple_of(4) {
            return Err(0x8005);
        }
        if let Some(index) = at.checked_sub(DESCRIPTION) {
            let mut bytes: Vec<u8> = self.description.iter().skip(index as usize).take(length).copied().collect();
            if bytes.is_empty() {
                return Err(0x8003);
            }
            bytes.resize(length, 0);
            return Ok(bytes);
        }
        if let Some(offset) = at.checked_sub(FEATURES) {
            return self.camera.features.bytes(offset, length).ok_or(0x8003);
        }
        self.memory.bytes(at, length).map(<[u8]>::to_vec).ok_or(0x8003)
    }

    fn write(&mut self, at: u32, value: u32, from: SocketAddrV4, now_ns: i64) -> u16 {
        let owns = self.owner.is_some_and(|(owner, _)| owner == from);
        if at == boot::PRIVILEGE {
            return self.claim(value, from, now_ns);
        }
        if !owns {
            return 0x8006;
        }
        match at {
            boot::HEARTBEAT_MS | boot::STREAM_PORT | boot::PACKET_DELAY | boot::STREAM_ADDRESS => {
                self.memory.put_word(at, value);
            }
            boot::PACKET_SIZE => {
                self.memory.put_word(at, value & 0x7fff_ffff);
                if value >> 31 == 1 {
                    self.send_test_packet((value & 0xffff) as usize);
                }
            }
            FEATURES..FEATURES_END => return self.camera.write(at - FEATURES, value, now_ns),
            _ => return 0x8004,
        }
        0
    }

    fn claim(&mut self, value: u32, from: SocketAddrV4, now_ns: i64) -> u16 {
        match self.owner {
            Some((owner, _)) if owner != from => return 0x8006,
            _ if value & 3 == 0 => self.set_owner(None),
            _ => self.set_owner(Some((from, now_ns))),
        }
        self.memory.put_word(boot::PRIVILEGE, value);
        0
    }

    fn destination(&self) -> Option<SocketAddrV4> {
        let port = u16::try_from(self.memory.word(boot::STREAM_PORT)).ok().filter(|port| *port != 0)?;
        Some(SocketAddrV4::new(Ipv4Addr::from_bits(self.memory.word(boot::STREAM_ADDRESS)), port))
    }

    fn send_test_packet(&mut self, size: usize) {
        if let Some(to) = self.destination().filter(|_| (64..=9216).contains(&size)) {
            let bytes = size - 28;
            if self.options.faults.passes(bytes) {
                self.outgoing.push_back((to, vec![0; bytes]));
            }
        }
    }

    /// Lets time pass: exposes what is due, and forgets a controller that is not heard of.
    pub fn advance(&mut self, now_ns: i64) {
        let heartbeat_ns = i64::from(self.memory.word(boot::HEARTBEAT_MS)) * 1_000_000;
        if self.owner.is_some_and(|(_, heard_ns)| now_ns - heard_ns > heartbeat_ns) {
            self.set_owner(None);
        }
        while let Some(exposed) = self.camera.exposed(now_ns) {
            self.send(&exposed);
        }
    }

    fn send(&mut self, exposed: &Exposed) {
        self.counts.frames += 1;
        let number = exposed.truth.number;
        let (block, id) = (number + 1, (number % 65_535) as u16 + 1);
        let packet_bytes = self.memory.word(boot::PACKET_SIZE) & 0xffff;
        let packets = stream::packets(&self.camera.features, id, exposed, packet_bytes);
        let Some(to) = self.destination() else { return };
        let sent = self.options.faults.way(block, &packets);
        self.outgoing.extend(sent.into_iter().map(|bytes| (to, bytes)));
        self.kept.push_back(Kept { id, block, packets });
        if self.kept.len() > KEPT_BLOCKS {
            self.kept.pop_front();
        }
    }

    /// Sends packets again, or says that they are gone.
    fn resend(&mut self, data: &[u8]) {
        let word =
            |at: usize| data.get(at..).and_then(|bytes| bytes.first_chunk()).map(|bytes| u32::from_be_bytes(*bytes));
        let (Some(block), Some(first), Some(last), Some(to)) = (word(0), word(4), word(8), self.destination()) else {
            return;
        };
        let (id, [first, last]) = (block as u16, [first, last].map(|packet| packet & 0xff_ffff));
        self.counts.asked += u64::from(last.saturating_sub(first)) + 1;
        if !self.options.resends {
            return;
        }
        let Some(Kept { block, packets, .. }) = self.kept.iter().find(|kept| kept.id == id) else {
            let mut gone = vec![0x80, 0x0c];
            gone.extend(id.to_be_bytes());
            gone.extend((3 << 24 | first).to_be_bytes());
            self.outgoing.push_back((to, gone));
            return;
        };
        let end = packets.len() as u32 - 1;
        for (packet, bytes) in packets.iter().filter(|(packet, _)| (first..=last).contains(packet)) {
            if !self.options.faults.stays_lost(*block, *packet, end) && self.options.faults.passes(bytes.len()) {
                self.counts.resent += 1;
                self.outgoing.push_back((to, [&[1, 0], &bytes[2..]].concat()));
            }
        }
    }

    /// A datagram of the stream that is to be sent, and where to.
    pub fn outgoing(&mut self) -> Option<(SocketAddrV4, Vec<u8>)> {
        self.outgoing.pop_front()
    }

    /// Sets the port that its stream comes from.
    pub fn set_stream_source(&mut self, port: u16) {
        self.memory.put_word(boot::STREAM_SOURCE_PORT, port.into());
    }
}
