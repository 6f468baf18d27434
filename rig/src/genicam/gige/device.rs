//! A camera under control: taken, described, kept by a heartbeat, its stream prepared.

use std::{
    sync::{Arc, Condvar, Mutex, PoisonError},
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use super::{
    find::{Found, Reach, controller},
    gvcp::{Status, register},
    gvsp::{NETWORK_BYTES, Plan, Timing},
    socket::{Channel, StreamSocket},
    url,
};
use crate::genicam::{Features, GenicamConfig, GenicamError, block::block_bytes, description, gige::gvcp, settings};

/// Sizes of packets that are tried, the largest first: jumbo frames of several kinds, then what passes everywhere.
const PACKET_SIZES: [u32; 6] = [9000, 8228, 4000, 1500, 1400, 576];
/// How long a test packet may take.
const TEST_PATIENCE: Duration = Duration::from_millis(60);
/// Room of the kernel for a stream, at least.
const LEAST_ROOM: usize = 8 << 20;
/// What a camera without a clock rate counts: nanoseconds (PTP).
const NANOSECONDS_HZ: u64 = 1_000_000_000;

/// A camera that we control.
pub struct Device {
    /// Its registers.
    pub channel: Arc<Channel>,
    /// What it can do.
    pub features: Features,
    /// Ticks of its clock a second.
    pub tick_hz: u64,
    can_resend: bool,
    heartbeat: Heartbeat,
}

/// A stream that is ready to begin.
pub struct Stream {
    /// Where it comes in.
    pub socket: StreamSocket,
    /// What it looks like.
    pub plan: Plan,
    /// Bytes of a packet, headers of the network included.
    pub packet_bytes: u32,
    /// Room that was wanted in the kernel.
    pub wanted_room: usize,
}

impl Device {
    /// Takes control of a camera and reads its description.
    ///
    /// # Errors
    /// If another program has it, it does not answer, or its description cannot be used.
    pub fn open(found: &Found, config: &GenicamConfig) -> Result<Self, GenicamError> {
        if let Some(problem) = found.wrong_subnet() {
            return Err(GenicamError::WrongSubnet(problem));
        }
        let Reach::From(own) = found.reach else { return Err(GenicamError::ControlLost) };
        let channel = Arc::new(Channel::open(found.identity.address, own)?);
        take_control(&channel)?;
        // Some cameras have a heartbeat of their own, which cannot be changed.
        match channel.set_register(register::HEARTBEAT_MS, config.heartbeat_ms) {
            Ok(()) | Err(GenicamError::Refused { .. }) => {}
            Err(error) => return Err(error),
        }
        let heartbeat_ms = channel.register(register::HEARTBEAT_MS).unwrap_or(config.heartbeat_ms);
        // From here on the camera is given back whatever happens.
        let heartbeat = Heartbeat::start(Arc::clone(&channel), heartbeat_ms.clamp(200, config.heartbeat_ms))?;
        let features = Features::new(&read_description(&channel)?, Arc::clone(&channel))?;
        let [high, low] = register::TICK_HZ.map(|at| channel.register(at).unwrap_or(0));
        let tick_hz = match u64::from(high) << 32 | u64::from(low) {
            0 => NANOSECONDS_HZ,
            hz => hz,
        };
        let capability = channel.register(register::CAPABILITY).unwrap_or(0);
        let can_resend = capability & register::CAPABILITY_RESEND != 0;
        Ok(Self { channel, features, tick_hz, can_resend, heartbeat })
    }

    /// Why the camera is no longer ours, if it is not.
    #[must_use]
    pub fn lost(&self) -> Option<String> {
        self.heartbeat.lost()
    }

    /// What tells whether the camera is lost, for another thread.
    #[must_use]
    pub fn pulse(&self) -> Pulse {
        Pulse(Arc::clone(&self.heartbeat.shared))
    }

    /// Opens a socket for the stream, tells the camera of it, and finds the largest packet that passes.
    ///
    /// # Errors
    /// If the camera does not take it, packets of the size asked for do not pass, or the camera's frames cannot be.
    pub fn prepare(&self, config: &GenicamConfig, frame_bytes: usize) -> Result<Stream, GenicamError> {
        self.features.refresh();
        let block_bytes = block_bytes("PayloadSize", self.features.integer("PayloadSize")?.into(), frame_bytes)?;
        let wanted_room = match config.receive_buffer_mib {
            Some(mib) => (mib as usize) << 20,
            None => (2 * block_bytes).max(LEAST_ROOM),
        };
        let own = self.channel.own_address()?;
        let mut socket = StreamSocket::open(self.channel.camera(), own, wanted_room)?;
        self.channel.set_register(register::STREAM_ADDRESS, own.to_bits())?;
        self.channel.set_register(register::STREAM_PORT, socket.port()?.into())?;
        // A firewall that lets in what was asked for lets the stream in then.
        if let Some(port) =
            self.channel.register(register::STREAM_SOURCE_PORT).ok().and_then(|port| u16::try_from(port).ok())
            && port != 0
        {
            socket.knock(port);
        }
        let packet_bytes = self.choose_packet_size(&mut socket, config.packet_bytes)?;
        if config.packet_delay_ns > 0 || self.channel.register(register::PACKET_DELAY).is_ok_and(|delay| delay != 0) {
            let ticks = u128::from(config.packet_delay_ns) * u128::from(self.tick_hz) / 1_000_000_000;
            self.channel.set_register(register::PACKET_DELAY, u32::try_from(ticks).unwrap_or(u32::MAX))?;
        }
        let plan = Plan {
            datagram_bytes: packet_bytes as usize - NETWORK_BYTES,
            block_bytes,
            resend: config.resend && self.can_resend,
            timing: Timing::default(),
        };
        Ok(Stream { socket, plan, packet_bytes, wanted_room })
    }

    /// The packet size asked for if it passes, or the largest that does.
    fn choose_packet_size(&self, socket: &mut StreamSocket, asked: Option<u32>) -> Result<u32, GenicamError> {
        if let Some(asked) = asked {
            if self.passes(socket, asked)? {
                return self.set_packet_size(asked);
            }
            // A camera may know no test packets; then nothing passes, and what was asked for holds.
            return match PACKET_SIZES.into_iter().filter(|size| *size < asked).find_map(|size| self.tried(socket, size))
            {
                Some(passing) => Err(GenicamError::PacketSize { asked, passing: passing? }),
                None => self.set_packet_size(asked),
            };
        }
        match PACKET_SIZES.into_iter().find_map(|size| self.tried(socket, size)) {
            Some(size) => self.set_packet_size(size?),
            None => self.set_packet_size(1400),
        }
    }

    fn tried(&self, socket: &mut StreamSocket, size: u32) -> Option<Result<u32, GenicamError>> {
        self.passes(socket, size).map(|passes| passes.then_some(size)).transpose()
    }

    /// Whether a test packet of a size comes through.
    fn passes(&self, socket: &mut StreamSocket, size: u32) -> Result<bool, GenicamError> {
        let flags = register::FIRE_TEST_PACKET | register::DO_NOT_FRAGMENT;
        match self.channel.set_register(register::PACKET_SIZE, size | flags) {
            Ok(()) => {}
            // Larger than the camera can.
            Err(GenicamError::Refused { .. }) => return Ok(false),
            Err(error) => return Err(error),
        }
        let began = Instant::now();
        let mut came = false;
        while !came && began.elapsed() < TEST_PATIENCE {
            let bytes = size as usize - NETWORK_BYTES;
            let received = socket.receive(TEST_PATIENCE / 4, |datagram, _| came |= datagram.len() == bytes);
            received.map_err(|source| GenicamError::Network { doing: "receive a test packet".into(), source })?;
        }
        Ok(came)
    }

    /// Sets a packet size, and gives what the camera took.
    fn set_packet_size(&self, size: u32) -> Result<u32, GenicamError> {
        self.channel.set_register(register::PACKET_SIZE, size | register::DO_NOT_FRAGMENT)?;
        let taken = self.channel.register(register::PACKET_SIZE)? & 0xffff;
        if taken < 64 {
            let reason = format!("it has packets of {taken} bytes where {size} were asked for");
            return Err(GenicamError::Feature { name: "GevSCPSPacketSize".into(), reason });
        }
        Ok(taken)
    }

    /// Begins to stream.
    ///
    /// # Errors
    /// If the camera does not.
    pub fn begin(&mut self, stream: &mut Stream) -> Result<(), GenicamError> {
        // Test packets, and what was under way when an acquisition before was ended.
        stream.socket.drain();
        settings::begin(&mut self.features)
    }

    /// Ends the stream.
    ///
    /// # Errors
    /// If the camera does not take it.
    pub fn end(&mut self) -> Result<(), GenicamError> {
        settings::end(&mut self.features)
    }
}

/// Takes control, and waits for as long as a program that has crashed keeps it.
fn take_control(channel: &Channel) -> Result<(), GenicamError> {
    let began = Instant::now();
    let mut patience = None;
    loop {
        match channel.set_register(register::PRIVILEGE, register::CONTROL) {
            Err(GenicamError::Refused { status: Status::ACCESS_DENIED | Status::BUSY, .. }) => {}
            other => return other,
        }
        let ms = *patience.get_or_insert_with(|| channel.register(register::HEARTBEAT_MS).unwrap_or(3000).min(60_000));
        if began.elapsed() > Duration::from_millis(u64::from(ms) + 500) {
            return Err(GenicamError::Held { by: controller(channel), seconds: f64::from(ms) / 1000.0 });
        }
        thread::sleep(Duration::from_millis(100));
    }
}

fn read_description(channel: &Channel) -> Result<String, GenicamError> {
    let read = |at| {
        let url = gvcp::text(&channel.memory(at, register::URL_BYTES)?);
        let place = url::place(&url)?;
        description::text(&channel.memory(place.address, place.length)?)
    };
    let [first, second] = register::URLS;
    // The second is there for cameras whose first is a file on a disk, or damaged; what is said is of the first.
    read(first).or_else(|error| read(second).map_err(|_| error))
}

/// Whether a camera is still ours.
#[derive(Clone)]
pub struct Pulse(Arc<Shared>);

impl Pulse {
    /// Why it is not, if it is not.
    #[must_use]
    pub fn lost(&self) -> Option<String> {
        self.0.state().lost.clone()
    }
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    ended: Condvar,
}

#[derive(Default)]
struct State {
    ended: bool,
    lost: Option<String>,
}

impl Shared {
    fn state(&self) -> std::sync::MutexGuard<'_, State> {
        // What another thread left is whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Reads the privilege often enough for the camera to know that we are there, and notices when it is no longer ours. Gives the
/// camera back when it is dropped.
struct Heartbeat {
    shared: Arc<Shared>,
    channel: Arc<Channel>,
    thread: Option<JoinHandle<()>>,
}

impl Heartbeat {
    fn start(channel: Arc<Channel>, heartbeat_ms: u32) -> Result<Self, GenicamError> {
        let shared = Arc::new(Shared::default());
        let every = Duration::from_millis(u64::from(heartbeat_ms) / 4);
        let (beating, beaten) = (Arc::clone(&shared), Arc::clone(&channel));
        // Of cameras that tell, who controls it: another who takes it looks like us otherwise.
        let owner = owner(&channel);
        let thread = thread::Builder::new()
            .name("heartbeat".into())
            .spawn(move || beat(&beaten, &beating, every, owner))
            .map_err(|source| GenicamError::Network { doing: "start the heartbeat".into(), source })?;
        Ok(Self { shared, channel, thread: Some(thread) })
    }

    fn lost(&self) -> Option<String> {
        self.shared.state().lost.clone()
    }
}

/// Address and port of the program that controls the camera, if it tells.
fn owner(channel: &Channel) -> Option<(std::net::Ipv4Addr, u32)> {
    Some((controller(channel)?, channel.register(register::CONTROLLER_PORT).ok()?))
}

fn beat(channel: &Channel, shared: &Shared, every: Duration, owned: Option<(std::net::Ipv4Addr, u32)>) {
    loop {
        let waited = shared.ended.wait_timeout_while(shared.state(), every, |state| !state.ended);
        if waited.map_or(true, |(state, _)| state.ended) {
            return;
        }
        let lost = match channel.register(register::PRIVILEGE) {
            Ok(privilege) if privilege & (register::CONTROL | register::EXCLUSIVE) != 0 => match owned {
                Some(owned) if owner(channel).is_some_and(|now| now != owned) => GenicamError::ControlLost,
                _ => continue,
            },
            Ok(_) | Err(GenicamError::Refused { .. }) => GenicamError::ControlLost,
            Err(error) => error,
        };
        shared.state().lost = Some(lost.to_string());
        return;
    }
}

impl Drop for Heartbeat {
    fn drop(&mut self) {
        self.shared.state().ended = true;
        self.shared.ended.notify_all();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::warn!("the heartbeat of the camera at {} has panicked", self.channel.camera());
        }
        if self.lost().is_some() {
            return;
        }
        for (register, value) in [(register::STREAM_PORT, 0), (register::PRIVILEGE, 0)] {
            if let Err(error) = self.channel.set_register(register, value) {
                tracing::debug!("camera at {}: {error}", self.channel.camera());
            }
        }
    }
}
