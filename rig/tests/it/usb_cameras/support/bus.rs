//! Emulated devices behind the traits that drivers see, in this process.

use std::{
    collections::BTreeSet,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicU8, AtomicUsize, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use erfgs_hardware_mocks::usb::{self as mocks, Reply, Urb, UsbDevice};
use erfgs_rig::usb::{
    Arrival, Bus, Control, Described, Endpoint, Fault, Flight, Identity, Interface, Receiver, Speed, Stream, Transport,
    TransportError,
};

/// What devices and drivers live by.
pub trait Clock: Send + Sync {
    fn now_ns(&self) -> i64;

    /// Lets time pass.
    fn pass(&self, duration: Duration);

    /// Leaves the processor to the test after a transfer without data, which a clock that does not wait would not.
    fn rest(&self) {
        thread::sleep(Duration::from_micros(100));
    }

    /// Whether it offers a stream's transfers by itself; a thread does otherwise.
    fn take_over(&self, _offer: &Arc<Offer>) -> bool {
        false
    }
}

/// What an offer came to.
pub enum Step {
    Moved,
    Idle,
    Ended,
}

/// The transfers of a stream, offered to its device one at a time.
pub struct Offer {
    step: Mutex<Box<dyn FnMut() -> Step + Send>>,
    stopping: AtomicBool,
}

impl Offer {
    pub fn step(&self) -> Step {
        let mut step = lock(&self.step);
        if self.stopping.load(Ordering::SeqCst) { Step::Ended } else { step() }
    }
}

/// A device that a bus and a test share.
pub type Shared = Arc<Mutex<dyn UsbDevice>>;

fn lock<T: ?Sized>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A socket of the bus.
struct Port {
    number: u8,
    device: Shared,
    /// Counts how often the device was found gone, so that it has a new address when it is back.
    times_gone: AtomicU8,
    claimed: Mutex<BTreeSet<u8>>,
}

/// A bus with emulated devices.
pub struct EmulatedBus {
    ports: Mutex<Vec<Arc<Port>>>,
    clock: Arc<dyn Clock>,
    /// How many transfers a stream gets at most.
    pub grants: AtomicUsize,
    /// How often somebody has looked what is plugged in.
    pub looks: AtomicUsize,
}

impl EmulatedBus {
    /// A bus whose devices live by this clock.
    pub fn new(clock: Arc<dyn Clock>) -> Self {
        Self { ports: Mutex::default(), clock, grants: AtomicUsize::new(usize::MAX), looks: AtomicUsize::new(0) }
    }

    /// Adds a socket with a device.
    pub fn add(&self, device: Shared) {
        let mut ports = lock(&self.ports);
        let number = u8::try_from(ports.len() + 1).unwrap();
        ports.push(Arc::new(Port { number, device, times_gone: AtomicU8::new(0), claimed: Mutex::default() }));
    }

    /// The bus's time.
    pub fn now_ns(&self) -> i64 {
        self.clock.now_ns()
    }

    fn identity(&self, port: &Port) -> Option<Identity> {
        let Reply::Data(bytes) = control_in(port, self.now_ns(), 0x80, 6, 0x0100, 0, 18) else { return None };
        let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Some(Identity {
            vendor: word(8),
            product: word(10),
            version: word(12),
            bus: 1,
            address: port.number + 16 * port.times_gone.load(Ordering::SeqCst),
            port: format!("1-{}", port.number),
            speed: match lock(&port.device).speed() {
                mocks::Speed::High => Speed::High,
                mocks::Speed::Super => Speed::Super,
            },
        })
    }
}

fn control_in(port: &Port, now: i64, request_type: u8, request: u8, value: u16, index: u16, length: u16) -> Reply {
    lock(&port.device).submit(&Urb::control_in(request_type, request, value, index, length), now)
}

impl Bus for EmulatedBus {
    fn list(&self) -> Result<Vec<Identity>, TransportError> {
        self.looks.fetch_add(1, Ordering::SeqCst);
        Ok(lock(&self.ports).iter().filter_map(|port| self.identity(port)).collect())
    }

    fn describe(&self, identity: &Identity) -> Result<Described, TransportError> {
        let ports = lock(&self.ports);
        let port = ports.iter().find(|port| self.identity(port).as_ref() == Some(identity));
        let port = port.ok_or_else(|| TransportError::new(identity, "describe", Fault::Gone))?;
        let now = self.now_ns();
        let text = |place: usize| text(port, now, place).unwrap_or_default();
        Ok(Described { interfaces: interfaces(port, now), maker: text(14), product: text(15), serial: text(16) })
    }

    fn open(&self, identity: &Identity) -> Result<Arc<dyn Transport>, TransportError> {
        let gone = || TransportError::new(identity, "open", Fault::Gone);
        let ports = lock(&self.ports);
        let port = ports.iter().find(|port| self.identity(port).as_ref() == Some(identity)).ok_or_else(gone)?;
        let transport = EmulatedTransport {
            port: Arc::clone(port),
            identity: identity.clone(),
            serial: text(port, self.now_ns(), 16),
            interfaces: interfaces(port, self.now_ns()),
            clock: Arc::clone(&self.clock),
            gone: Arc::new(AtomicBool::new(false)),
            ours: Mutex::default(),
            grants: self.grants.load(Ordering::SeqCst),
        };
        // As an operating system does for a device that is new on the bus.
        transport.set(0x00, 9, 1, 0)?;
        Ok(Arc::new(transport))
    }
}

/// A text whose number is at this place of the device's descriptor.
fn text(port: &Port, now: i64, place: usize) -> Option<String> {
    let Reply::Data(device) = control_in(port, now, 0x80, 6, 0x0100, 0, 18) else { return None };
    let index = u16::from(*device.get(place)?);
    if index == 0 {
        return None;
    }
    let Reply::Data(text) = control_in(port, now, 0x80, 6, 0x0300 | index, 0x0409, 255) else { return None };
    let units: Vec<u16> = text.get(2..)?.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    String::from_utf16(&units).ok().filter(|text| !text.is_empty())
}

fn interfaces(port: &Port, now: i64) -> Vec<Interface> {
    let Reply::Data(bytes) = control_in(port, now, 0x80, 6, 0x0200, 0, 4096) else { return Vec::new() };
    let mut found: Vec<Interface> = Vec::new();
    let mut rest = bytes.as_slice();
    let mut counts = false;
    while let [length, kind, ..] = *rest {
        let descriptor = &rest[..usize::from(length).clamp(2, rest.len())];
        match kind {
            4 => {
                counts = descriptor[3] == 0;
                if counts {
                    let class = (descriptor[5], descriptor[6], descriptor[7]);
                    found.push(Interface { number: descriptor[2], class, endpoints: Vec::new() });
                }
            }
            5 if counts => {
                let endpoint = Endpoint { address: descriptor[2], bulk: descriptor[3] & 3 == 2 };
                found.last_mut().unwrap().endpoints.push(endpoint);
            }
            _ => {}
        }
        rest = &rest[descriptor.len()..];
    }
    found
}

struct EmulatedTransport {
    port: Arc<Port>,
    identity: Identity,
    serial: Option<String>,
    interfaces: Vec<Interface>,
    clock: Arc<dyn Clock>,
    /// The device was unplugged while this was open: it stays gone for us when it is plugged in again.
    gone: Arc<AtomicBool>,
    ours: Mutex<BTreeSet<u8>>,
    grants: usize,
}

fn submit(port: &Port, gone: &AtomicBool, clock: &dyn Clock, urb: &Urb) -> Result<Reply, Fault> {
    if gone.load(Ordering::SeqCst) {
        return Err(Fault::Gone);
    }
    match lock(&port.device).submit(urb, clock.now_ns()) {
        Reply::Gone => {
            if !gone.swap(true, Ordering::SeqCst) {
                port.times_gone.fetch_add(1, Ordering::SeqCst);
            }
            Err(Fault::Gone)
        }
        Reply::Stall => Err(Fault::Stall),
        Reply::Overflow => Err(Fault::Overflow),
        other => Ok(other),
    }
}

impl EmulatedTransport {
    fn failed<T>(&self, step: &str, fault: Fault) -> Result<T, TransportError> {
        Err(TransportError::new(&self.identity, step, fault))
    }

    /// Offers a transfer until it is done or time is up.
    fn finish(&self, step: &str, urb: &Urb, timeout: Duration) -> Result<Reply, TransportError> {
        let mut left = timeout.as_millis();
        loop {
            match submit(&self.port, &self.gone, &*self.clock, urb) {
                Ok(Reply::Pending) if left == 0 => return self.failed(step, Fault::Timeout),
                Ok(Reply::Pending) => {
                    left -= 1;
                    self.clock.pass(Duration::from_millis(1));
                }
                Ok(reply) => return Ok(reply),
                Err(fault) => return self.failed(step, fault),
            }
        }
    }

    fn set(&self, request_type: u8, request: u8, value: u16, index: u16) -> Result<(), TransportError> {
        let urb = Urb::control_out(request_type, request, value, index, &[]);
        self.finish("standard request", &urb, Duration::from_secs(1)).map(|_| ())
    }
}

/// Copies what a transfer brought; gives how many bytes.
fn read(reply: &Reply, into: &mut [u8]) -> usize {
    let Reply::Data(bytes) = reply else { return 0 };
    into[..bytes.len()].copy_from_slice(bytes);
    bytes.len()
}

fn taken(reply: &Reply) -> usize {
    if let Reply::Taken(count) = reply { *count } else { 0 }
}

impl Transport for EmulatedTransport {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn serial(&self) -> Option<&str> {
        self.serial.as_deref()
    }

    fn interfaces(&self) -> &[Interface] {
        &self.interfaces
    }

    fn claim(&self, interface: u8, select: bool) -> Result<(), TransportError> {
        if !lock(&self.port.claimed).insert(interface) {
            return self.failed("claim", Fault::Busy);
        }
        lock(&self.ours).insert(interface);
        if select { self.set(0x01, 11, 0, interface.into()) } else { Ok(()) }
    }

    fn control_read(&self, control: Control, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError> {
        let Control { request_type, request, value, index } = control;
        let urb = Urb::control_in(request_type, request, value, index, u16::try_from(into.len()).unwrap());
        Ok(read(&self.finish("control read", &urb, timeout)?, into))
    }

    fn control_write(&self, control: Control, from: &[u8], timeout: Duration) -> Result<usize, TransportError> {
        let Control { request_type, request, value, index } = control;
        let urb = Urb::control_out(request_type, request, value, index, from);
        Ok(taken(&self.finish("control write", &urb, timeout)?))
    }

    fn bulk_read(&self, endpoint: u8, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError> {
        Ok(read(&self.finish("bulk read", &Urb::bulk_in(endpoint, into.len()), timeout)?, into))
    }

    fn bulk_write(&self, endpoint: u8, from: &[u8], timeout: Duration) -> Result<usize, TransportError> {
        Ok(taken(&self.finish("bulk write", &Urb::bulk_out(endpoint, from), timeout)?))
    }

    fn clear_halt(&self, endpoint: u8) -> Result<(), TransportError> {
        self.set(0x02, 1, 0, endpoint.into())
    }

    fn stream(&self, endpoint: u8, flight: Flight, mut receiver: Receiver) -> Result<Box<dyn Stream>, TransportError> {
        let granted = flight.transfers.min(self.grants);
        if granted == 0 {
            return self.failed("stream", Fault::Memory(erfgs_rig::usb::memory_advice()));
        }
        let (port, gone, clock) = (Arc::clone(&self.port), Arc::clone(&self.gone), Arc::clone(&self.clock));
        let of_clock = Arc::clone(&clock);
        let urb = Urb::bulk_in(endpoint, flight.bytes);
        let step = move || match submit(&port, &gone, &*of_clock, &urb) {
            Ok(Reply::Data(bytes)) if !bytes.is_empty() => {
                receiver(Arrival::Data { host_ns: of_clock.now_ns(), bytes: &bytes });
                Step::Moved
            }
            Ok(_) => Step::Idle,
            Err(fault) => {
                receiver(Arrival::Ended(fault));
                Step::Ended
            }
        };
        let offer = Arc::new(Offer { step: Mutex::new(Box::new(step)), stopping: AtomicBool::new(false) });
        let thread = (!clock.take_over(&offer)).then(|| {
            let offer = Arc::clone(&offer);
            thread::spawn(move || {
                loop {
                    match offer.step() {
                        Step::Moved => {}
                        Step::Idle => {
                            clock.pass(Duration::from_millis(1));
                            clock.rest();
                        }
                        Step::Ended => return,
                    }
                }
            })
        });
        Ok(Box::new(Pump { granted, offer, thread }))
    }

    fn wait(&self, duration: Duration) {
        self.clock.pass(duration);
    }
}

impl Drop for EmulatedTransport {
    fn drop(&mut self) {
        let mut claimed = lock(&self.port.claimed);
        for interface in lock(&self.ours).iter() {
            claimed.remove(interface);
        }
    }
}

struct Pump {
    granted: usize,
    offer: Arc<Offer>,
    thread: Option<JoinHandle<()>>,
}

impl Stream for Pump {
    fn granted(&self) -> usize {
        self.granted
    }

    fn stop(&mut self) {
        self.offer.stopping.store(true, Ordering::SeqCst);
        match self.thread.take() {
            Some(thread) => thread.join().unwrap(),
            // One that is under way is over when this is free.
            None => drop(lock(&self.offer.step)),
        }
    }
}

impl Drop for Pump {
    fn drop(&mut self) {
        self.stop();
    }
}
