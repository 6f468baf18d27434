//! The control protocol of GigE Vision (GVCP), without input or output: commands as datagrams, acknowledges taken apart, and
//! when to repeat a command. All numbers are big-endian.

use std::net::Ipv4Addr;

pub use crate::genicam::status::Status;

/// The port at which cameras listen.
pub const PORT: u16 = 3956;

/// Addresses of the bootstrap registers.
pub mod register {
    /// Strings: maker, model, version, information, serial number, the user's name.
    pub const STRINGS: [(u32, usize); 6] = [(0x48, 32), (0x68, 32), (0x88, 32), (0xa8, 48), (0xd8, 16), (0xe8, 16)];
    /// Where the description lies: two texts of [`URL_BYTES`].
    pub const URLS: [u32; 2] = [0x200, 0x400];
    /// Length of a URL's register.
    pub const URL_BYTES: usize = 512;
    /// What the camera's control protocol can do.
    pub const CAPABILITY: u32 = 0x934;
    /// Bit of the capability: packets can be asked for again.
    pub const CAPABILITY_RESEND: u32 = 1 << 2;
    /// Milliseconds without a command after which the camera takes its controller for gone.
    pub const HEARTBEAT_MS: u32 = 0x938;
    /// Ticks of the camera's clock a second, upper and lower half.
    pub const TICK_HZ: [u32; 2] = [0x93c, 0x940];
    /// Control channel privilege: [`CONTROL`], [`EXCLUSIVE`].
    pub const PRIVILEGE: u32 = 0xa00;
    /// Another may read, only the controller writes.
    pub const CONTROL: u32 = 2;
    /// Nobody else may even read.
    pub const EXCLUSIVE: u32 = 1;
    /// The port of the program that controls it.
    pub const CONTROLLER_PORT: u32 = 0xa04;
    /// Its address.
    pub const CONTROLLER: u32 = 0xa14;
    /// Port that the stream goes to; 0 switches it off.
    pub const STREAM_PORT: u32 = 0xd00;
    /// Bytes of a packet of the stream, headers of IP and UDP included, and two flags.
    pub const PACKET_SIZE: u32 = 0xd04;
    /// Flag of the packet size: send one test packet.
    pub const FIRE_TEST_PACKET: u32 = 1 << 31;
    /// Flag of the packet size: routers may not take packets apart.
    pub const DO_NOT_FRAGMENT: u32 = 1 << 30;
    /// Ticks of pause between two packets.
    pub const PACKET_DELAY: u32 = 0xd08;
    /// Address that the stream goes to.
    pub const STREAM_ADDRESS: u32 = 0xd18;
    /// Port that the stream comes from; not every camera tells it.
    pub const STREAM_SOURCE_PORT: u32 = 0xd1c;
}

/// Most bytes that one command reads or writes.
pub const MOST_BYTES: usize = 512;
const KEY: u8 = 0x42;
const HEADER_BYTES: usize = 8;
const ACKNOWLEDGE: u8 = 1;
/// Of a discovery: the answer may be a broadcast, since an answer from another subnet would not come through.
const ANSWER_BY_BROADCAST: u8 = 0x10;
/// Of a request for packets: block ids are of 64 bits.
const LONG_IDS: u8 = 0x10;
const PACKET_RESEND: u16 = 0x40;
const PENDING: u16 = 0x89;
/// No camera may put off an answer for longer in all.
const LONGEST_PENDING_NS: i64 = 20_000_000_000;

/// A command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// Who is there?
    Discover,
    /// Reads a register.
    ReadRegister(u32),
    /// Writes a register.
    WriteRegister(u32, u32),
    /// Reads memory: address and count, a multiple of 4.
    ReadMemory(u32, u16),
    /// Writes memory, a multiple of 4 bytes.
    WriteMemory(u32, &'a [u8]),
}

impl Command<'_> {
    fn code(self) -> u16 {
        match self {
            Self::Discover => 0x02,
            Self::ReadRegister(_) => 0x80,
            Self::WriteRegister(..) => 0x82,
            Self::ReadMemory(..) => 0x84,
            Self::WriteMemory(..) => 0x86,
        }
    }

    /// The datagram. `id` is not 0.
    #[must_use]
    pub fn datagram(self, id: u16) -> Vec<u8> {
        let (flags, data) = match self {
            Self::Discover => (ACKNOWLEDGE | ANSWER_BY_BROADCAST, Vec::new()),
            Self::ReadRegister(address) => (ACKNOWLEDGE, address.to_be_bytes().to_vec()),
            Self::WriteRegister(address, value) => (ACKNOWLEDGE, [address.to_be_bytes(), value.to_be_bytes()].concat()),
            Self::ReadMemory(address, count) => {
                (ACKNOWLEDGE, [&address.to_be_bytes()[..], &[0, 0], &count.to_be_bytes()].concat())
            }
            Self::WriteMemory(address, bytes) => (ACKNOWLEDGE, [&address.to_be_bytes(), bytes].concat()),
        };
        packet(flags, self.code(), id, &data)
    }

    /// Bytes of the answer's data, where the command tells; `None` where the answer may have any length.
    fn answer_bytes(self) -> Option<usize> {
        match self {
            Self::ReadRegister(_) => Some(4),
            Self::ReadMemory(_, count) => Some(4 + usize::from(count)),
            Self::Discover | Self::WriteRegister(..) | Self::WriteMemory(..) => None,
        }
    }
}

fn packet(flags: u8, command: u16, id: u16, data: &[u8]) -> Vec<u8> {
    let mut packet = vec![KEY, flags];
    for half in [command, data.len() as u16, id] {
        packet.extend(half.to_be_bytes());
    }
    packet.extend(data);
    packet
}

/// Asks for packets of a block again. No acknowledge follows; the packets do.
#[must_use]
pub fn ask_again(id: u16, block: u64, packets: [u32; 2], long_ids: bool) -> Vec<u8> {
    let flags = if long_ids { LONG_IDS } else { 0 };
    let short = if long_ids { 0 } else { block as u16 };
    let mut data = [[0; 2], short.to_be_bytes()].concat();
    let bits = if long_ids { u32::MAX } else { 0xff_ffff };
    for packet in packets {
        data.extend((packet & bits).to_be_bytes());
    }
    if long_ids {
        data.extend(block.to_be_bytes());
    }
    packet(flags, PACKET_RESEND, id, &data)
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

/// What is to be done for a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Its datagram is to be sent, and [`Exchange::step`] asked again.
    Send,
    /// The camera has until this moment to answer.
    WaitUntil(i64),
    /// It has not answered, as often as it was asked.
    Silent,
}

/// One command, from its first sending to its answer.
#[derive(Clone, Debug)]
pub struct Exchange {
    datagram: Vec<u8>,
    code: u16,
    id: u16,
    answer_bytes: Option<usize>,
    tries: u32,
    patience_ns: i64,
    until_ns: Option<i64>,
    pending_ns: i64,
}

impl Exchange {
    /// A command that is sent up to `tries` times, with `patience_ns` for each answer. The id stays the same, so that a camera
    /// that has done it does not do it twice.
    #[must_use]
    pub fn new(command: Command<'_>, id: u16, tries: u32, patience_ns: i64) -> Self {
        Self {
            datagram: command.datagram(id),
            code: command.code(),
            id,
            answer_bytes: command.answer_bytes(),
            tries,
            patience_ns,
            until_ns: None,
            pending_ns: 0,
        }
    }

    /// The datagram to send.
    #[must_use]
    pub fn datagram(&self) -> &[u8] {
        &self.datagram
    }

    /// What is to be done now.
    pub fn step(&mut self, now_ns: i64) -> Step {
        match self.until_ns {
            Some(until_ns) if now_ns < until_ns => Step::WaitUntil(until_ns),
            _ if self.tries == 0 => Step::Silent,
            _ => {
                self.tries -= 1;
                self.until_ns = Some(now_ns.saturating_add(self.patience_ns));
                Step::Send
            }
        }
    }

    /// Takes a datagram from the camera: the answer's data, or the status with which it refuses. `None` if it is no answer to
    /// this command, or puts the answer off.
    pub fn take(&mut self, datagram: &[u8], now_ns: i64) -> Option<Result<Vec<u8>, Status>> {
        let (status, code, length) = (half(datagram, 0)?, half(datagram, 2)?, half(datagram, 4)?);
        if half(datagram, 6)? != self.id {
            return None;
        }
        let data = datagram.get(HEADER_BYTES..HEADER_BYTES + usize::from(length))?;
        if code == PENDING {
            let wait_ns = i64::from(half(data, 2)?) * 1_000_000;
            let left_ns = LONGEST_PENDING_NS - self.pending_ns;
            self.pending_ns += wait_ns.min(left_ns);
            self.until_ns = Some(now_ns.saturating_add(wait_ns.min(left_ns)));
            return None;
        }
        if code != self.code + 1 {
            return None;
        }
        if status & 0x8000 != 0 {
            return Some(Err(Status(status)));
        }
        // An answer of another length would be read as what it is not.
        (self.answer_bytes.is_none_or(|bytes| bytes == data.len())).then(|| Ok(data.to_vec()))
    }
}

/// What a camera tells of itself when it is discovered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Hardware address.
    pub mac: [u8; 6],
    /// Its address, netmask and gateway.
    pub address: Ipv4Addr,
    /// Netmask.
    pub mask: Ipv4Addr,
    /// Maker.
    pub maker: String,
    /// Model.
    pub model: String,
    /// Serial number; may be empty.
    pub serial: String,
    /// The name that a user gave it; mostly empty.
    pub name: String,
}

impl Identity {
    /// Reads the answer to a discovery with this id, as a whole datagram.
    #[must_use]
    pub fn of_answer(datagram: &[u8], id: u16) -> Option<Self> {
        let mut exchange = Exchange::new(Command::Discover, id, 1, 0);
        Self::of_registers(&exchange.take(datagram, 0)?.ok()?)
    }

    /// Reads the registers from 0 on, as the answer to a discovery holds them.
    #[must_use]
    pub fn of_registers(data: &[u8]) -> Option<Self> {
        let [maker, model, _, _, serial, name] = register::STRINGS
            .map(|(at, length)| data.get(at as usize..at as usize + length).map(text))
            .map(Option::unwrap_or_default);
        let mut mac = [0; 6];
        mac.copy_from_slice(data.get(0x0a..0x10)?);
        Some(Self {
            mac,
            address: word(data, 0x24)?.into(),
            mask: word(data, 0x34)?.into(),
            maker,
            model,
            serial,
            name,
        })
    }

    /// The hardware address as people write it.
    #[must_use]
    pub fn mac_text(&self) -> String {
        self.mac.map(|byte| format!("{byte:02x}")).join(":")
    }

    /// Maker and model.
    #[must_use]
    pub fn label(&self) -> String {
        // Many models begin with their maker's name.
        if self.model.to_lowercase().starts_with(&self.maker.to_lowercase()) {
            self.model.clone()
        } else {
            format!("{} {}", self.maker, self.model)
        }
    }
}

/// A text up to its first NUL. What is no printable character would end up on a terminal.
#[must_use]
pub fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().chars().map(|c| if c.is_control() { '?' } else { c }).collect()
}

#[cfg(test)]
#[path = "gvcp_tests.rs"]
mod tests;
