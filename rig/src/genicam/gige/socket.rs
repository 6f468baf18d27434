//! The sockets of a camera: one for its registers, one for its stream. All input and output of GigE Vision but for the search is here.

use std::{
    io::{self, ErrorKind, IoSliceMut},
    net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket},
    os::fd::{AsFd, AsRawFd},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicU16, Ordering},
    },
    time::Duration,
};

use nix::{
    poll::{PollFd, PollFlags, PollTimeout, poll},
    sys::socket::{
        ControlMessageOwned, MsgFlags, SockaddrIn, recvmsg, setsockopt,
        sockopt::{RcvBuf, RcvBufForce, RxqOvfl},
    },
};

use super::{
    gvcp::{self, Command, Exchange, MOST_BYTES, Status, Step},
    gvsp::Request,
};
use crate::{
    genicam::{GenicamError, Registers},
    host_time::host_ns,
};

/// How often a command is sent, and how long each time waits for its answer.
const TRIES: u32 = 4;
const PATIENCE_NS: i64 = 300_000_000;
/// No register is longer.
const MOST_REGISTER: usize = 1 << 20;
/// A datagram of the largest packet there is.
const MOST_DATAGRAM: usize = 65_536;

/// The channel to a camera's registers.
pub struct Channel {
    socket: UdpSocket,
    camera: Ipv4Addr,
    id: AtomicU16,
    /// One command at a time.
    turn: Mutex<()>,
}

impl Channel {
    /// A channel to the camera at an address, from the address `from` of this machine (any, if that is unspecified).
    ///
    /// # Errors
    /// If the system gives no socket.
    pub fn open(camera: Ipv4Addr, from: Ipv4Addr) -> Result<Self, GenicamError> {
        let open = || {
            let socket = UdpSocket::bind((from, 0))?;
            socket.connect((camera, gvcp::PORT))?;
            Ok(socket)
        };
        let failed = |source| GenicamError::Network { doing: format!("open a socket to {camera}"), source };
        let socket = open().map_err(failed)?;
        Ok(Self { socket, camera, id: AtomicU16::new(0), turn: Mutex::new(()) })
    }

    /// The camera's address.
    #[must_use]
    pub fn camera(&self) -> Ipv4Addr {
        self.camera
    }

    /// This machine's address, as the camera sees it.
    ///
    /// # Errors
    /// If the system does not tell.
    pub fn own_address(&self) -> Result<Ipv4Addr, GenicamError> {
        match self.socket.local_addr() {
            Ok(SocketAddr::V4(address)) => Ok(*address.ip()),
            Ok(SocketAddr::V6(_)) => Err(self.network("find its own address", ErrorKind::Unsupported.into())),
            Err(error) => Err(self.network("find its own address", error)),
        }
    }

    fn network(&self, doing: &str, source: io::Error) -> GenicamError {
        GenicamError::Network { doing: format!("{doing} (camera at {})", self.camera), source }
    }

    fn next_id(&self) -> u16 {
        let next = |id: u16| Some(id.checked_add(1).unwrap_or(1));
        self.id.fetch_update(Ordering::Relaxed, Ordering::Relaxed, next).map_or(1, |id| id.checked_add(1).unwrap_or(1))
    }

    /// Gives a command, and waits for its answer.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn ask(&self, command: Command<'_>, doing: impl Fn() -> String) -> Result<Vec<u8>, GenicamError> {
        // Nothing is left half done by who panics: the next command has an id of its own.
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let mut exchange = Exchange::new(command, self.next_id(), TRIES, PATIENCE_NS);
        let mut buffer = [0; 2048];
        loop {
            match exchange.step(host_ns()) {
                Step::Silent => return Err(GenicamError::Silent { address: self.camera, doing: doing() }),
                // What is said of the datagram before: nothing listens at the port, since the camera is being restarted.
                Step::Send => match self.socket.send(exchange.datagram()) {
                    Err(error) if error.kind() != ErrorKind::ConnectionRefused => {
                        return Err(self.network(&doing(), error));
                    }
                    _ => {}
                },
                Step::WaitUntil(until_ns) => {
                    let wait = u64::try_from(until_ns - host_ns()).unwrap_or(0).max(1_000_000);
                    let timeout = self.socket.set_read_timeout(Some(Duration::from_nanos(wait)));
                    timeout.map_err(|error| self.network(&doing(), error))?;
                    let count = match self.socket.recv(&mut buffer) {
                        Ok(count) => count,
                        Err(error) => {
                            // It is refused at once; the camera has its time all the same.
                            if error.kind() == ErrorKind::ConnectionRefused {
                                std::thread::sleep(Duration::from_nanos(wait));
                            }
                            continue;
                        }
                    };
                    match exchange.take(&buffer[..count], host_ns()) {
                        Some(Ok(data)) => return Ok(data),
                        Some(Err(status)) => return Err(GenicamError::Refused { doing: doing(), status }),
                        None => {}
                    }
                }
            }
        }
    }

    /// Reads a register.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn register(&self, address: u32) -> Result<u32, GenicamError> {
        let data = self.ask(Command::ReadRegister(address), || format!("read its register {address:#x}"))?;
        Ok(data.first_chunk().map_or(0, |bytes| u32::from_be_bytes(*bytes)))
    }

    /// Writes a register.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn set_register(&self, address: u32, value: u32) -> Result<(), GenicamError> {
        let command = Command::WriteRegister(address, value);
        self.ask(command, || format!("write {value:#x} into its register {address:#x}")).map(drop)
    }

    /// Reads memory.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn memory(&self, address: u32, length: usize) -> Result<Vec<u8>, GenicamError> {
        let mut bytes = Vec::new();
        while bytes.len() < length {
            let part = (length - bytes.len()).min(MOST_BYTES).next_multiple_of(4);
            let at = address.wrapping_add(bytes.len() as u32);
            let data = self.ask(Command::ReadMemory(at, part as u16), || format!("read its memory at {at:#x}"))?;
            bytes.extend(&data[4..]);
        }
        bytes.truncate(length);
        Ok(bytes)
    }

    /// Writes memory, a multiple of 4 bytes.
    ///
    /// # Errors
    /// If the camera does not answer, or says no.
    pub fn set_memory(&self, address: u32, data: &[u8]) -> Result<(), GenicamError> {
        for (index, part) in data.chunks(MOST_BYTES).enumerate() {
            let at = address.wrapping_add((index * MOST_BYTES) as u32);
            self.ask(Command::WriteMemory(at, part), || format!("write its memory at {at:#x}"))?;
        }
        Ok(())
    }

    /// Asks for packets of the stream; they come by the stream, or do not.
    pub fn ask_again(&self, request: &Request) {
        let datagram = gvcp::ask_again(self.next_id(), request.block, request.packets, request.long_ids);
        if let Err(error) = self.socket.send(&datagram) {
            tracing::debug!("camera at {}: cannot ask for packets: {error}", self.camera);
        }
    }
}

impl Registers for std::sync::Arc<Channel> {
    fn read(&self, address: u64, length: usize) -> Result<Vec<u8>, GenicamError> {
        let address = within(address)?;
        if length > MOST_REGISTER {
            let reason = format!("it has a register of {length} bytes at {address:#x}");
            return Err(GenicamError::Description { reason });
        }
        // Some cameras know their registers by this command alone.
        if length == 4 && address.is_multiple_of(4) {
            return Ok(self.register(address)?.to_be_bytes().to_vec());
        }
        let start = address & !3;
        let before = (address - start) as usize;
        let bytes = self.memory(start, before + length)?;
        Ok(bytes[before..].to_vec())
    }

    fn write(&self, address: u64, data: &[u8]) -> Result<(), GenicamError> {
        let address = within(address)?;
        match <[u8; 4]>::try_from(data) {
            Ok(word) if address.is_multiple_of(4) => self.set_register(address, u32::from_be_bytes(word)),
            _ if address.is_multiple_of(4) && data.len().is_multiple_of(4) => self.set_memory(address, data),
            _ => Err(GenicamError::Refused {
                doing: format!("write {} bytes at {address:#x}, which is not aligned to 4", data.len()),
                status: Status(0x8005),
            }),
        }
    }
}

fn within(address: u64) -> Result<u32, GenicamError> {
    u32::try_from(address).map_err(|_| GenicamError::Description {
        reason: format!("it has a register at {address:#x}, which GigE Vision cannot reach"),
    })
}

/// The socket that a camera's stream comes in at.
pub struct StreamSocket {
    socket: UdpSocket,
    camera: Ipv4Addr,
    buffer: Vec<u8>,
    control: Vec<u8>,
    /// Datagrams that the kernel had no room for, as it counts them.
    dropped: u32,
    room_bytes: usize,
}

impl StreamSocket {
    /// A socket for the stream of a camera, with room for so many bytes in the kernel, or what it gives.
    ///
    /// # Errors
    /// If the system gives none.
    pub fn open(camera: Ipv4Addr, own: Ipv4Addr, room_bytes: usize) -> Result<Self, GenicamError> {
        let open = || {
            let socket = UdpSocket::bind((own, 0))?;
            socket.set_nonblocking(true)?;
            // More than the system's limit takes a privilege.
            if setsockopt(&socket, RcvBufForce, &room_bytes).is_err() {
                setsockopt(&socket, RcvBuf, &room_bytes)?;
            }
            setsockopt(&socket, RxqOvfl, &1)?;
            // The kernel tells twice what it gives.
            let room_bytes = nix::sys::socket::getsockopt(&socket, RcvBuf)? / 2;
            let (buffer, control) = (vec![0; MOST_DATAGRAM], nix::cmsg_space!(u32));
            Ok(Self { socket, camera, buffer, control, dropped: 0, room_bytes })
        };
        let failed = |source| GenicamError::Network { doing: "open a socket for the stream".into(), source };
        open().map_err(failed)
    }

    /// The port.
    ///
    /// # Errors
    /// If the system does not tell.
    pub fn port(&self) -> Result<u16, GenicamError> {
        let failed = |source| GenicamError::Network { doing: "find the port of the stream".into(), source };
        self.socket.local_addr().map(|address| address.port()).map_err(failed)
    }

    /// Bytes that the kernel holds for us.
    #[must_use]
    pub fn room_bytes(&self) -> usize {
        self.room_bytes
    }

    /// Datagrams that the kernel had no room for, so far.
    #[must_use]
    pub fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Sends a datagram that opens firewalls which let in what was asked for.
    pub fn knock(&self, port: u16) {
        if let Err(error) = self.socket.send_to(&[], SocketAddrV4::new(self.camera, port)) {
            tracing::debug!("camera at {}: {error}", self.camera);
        }
    }

    /// Throws away what is there.
    pub fn drain(&mut self) {
        for _ in 0..1_000_000 {
            if self.socket.recv(&mut self.buffer).is_err() {
                return;
            }
        }
    }

    /// Waits for datagrams of the camera, `patience` at most, and hands over those that are there (not for ever: a stream may be
    /// faster than whoever takes it).
    ///
    /// # Errors
    /// If the socket fails.
    pub fn receive(&mut self, patience: Duration, mut take: impl FnMut(&[u8], i64)) -> io::Result<()> {
        let timeout = PollTimeout::try_from(patience.as_millis().max(1)).unwrap_or(PollTimeout::MAX);
        match poll(&mut [PollFd::new(self.socket.as_fd(), PollFlags::POLLIN)], timeout) {
            Ok(0) | Err(nix::errno::Errno::EINTR) => return Ok(()),
            Ok(_) => {}
            Err(error) => return Err(error.into()),
        }
        for _ in 0..256 {
            let mut slices = [IoSliceMut::new(&mut self.buffer)];
            let (fd, flags) = (self.socket.as_raw_fd(), MsgFlags::empty());
            let message = match recvmsg::<SockaddrIn>(fd, &mut slices, Some(&mut self.control), flags) {
                Ok(message) => message,
                Err(nix::errno::Errno::EAGAIN) => return Ok(()),
                Err(nix::errno::Errno::EINTR | nix::errno::Errno::ECONNREFUSED) => continue,
                Err(error) => return Err(error.into()),
            };
            let now_ns = host_ns();
            let dropped = message.cmsgs().into_iter().flatten().find_map(|message| match message {
                ControlMessageOwned::RxqOvfl(dropped) => Some(dropped),
                _ => None,
            });
            let (count, from) = (message.bytes, message.address.map(|address| address.ip()));
            self.dropped = dropped.unwrap_or(self.dropped);
            if from == Some(self.camera) {
                take(&self.buffer[..count], now_ns);
            }
        }
        Ok(())
    }
}
