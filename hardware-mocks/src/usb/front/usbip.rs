//! Serves a device over a stream socket in the messages of USB/IP 1.1.1 (Linux: `Documentation/usb/usbip_protocol.rst`):
//! SUBMIT and UNLINK in, their replies out. The kernel's `vhci_hcd` speaks them, and so does the umockdev bridge.
//!
//! One lock guards the device, the transfers that wait and the sending side: a transfer is answered and forgotten in
//! one step, so that an UNLINK never overtakes the reply to what it unlinks (the kernel would drop the device).

use std::{
    collections::VecDeque,
    io::{self, Read, Write},
    net::Shutdown,
    os::unix::net::UnixStream,
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use super::monotonic_ns;
use crate::usb::{Plug, Reply, Setup, Urb, UsbDevice};

const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMIT_REPLY: u32 = 3;
const UNLINK_REPLY: u32 = 4;
const HEADER: usize = 48;
/// The longest transfer that is taken from a host.
const LONGEST: usize = 16 << 20;

const EPIPE: i32 = -32;
const EOVERFLOW: i32 = -75;
const ECONNRESET: i32 = -104;

/// A device that is plugged in, somewhere.
pub type Device = Plug<Box<dyn UsbDevice>>;

struct Waiting {
    sequence: u32,
    urb: Urb,
}

struct State {
    device: Device,
    waiting: VecDeque<Waiting>,
    out: Option<UnixStream>,
}

/// A device with its transfers. Clones are the same device.
#[derive(Clone)]
pub struct Server {
    state: Arc<(Mutex<State>, Condvar)>,
}

impl Server {
    /// Serves a device to whoever connects.
    #[must_use]
    pub fn new(device: Device) -> Self {
        Self { state: Arc::new((Mutex::new(State { device, waiting: VecDeque::new(), out: None }), Condvar::new())) }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does something to the device, between transfers.
    pub fn with_device<T>(&self, act: impl FnOnce(&mut Device) -> T) -> T {
        let mut state = self.lock();
        let result = act(&mut state.device);
        if !state.device.plugged(monotonic_ns()) {
            state.disconnect();
        }
        self.state.1.notify_all();
        result
    }

    /// Serves one connection until the host is gone or the device unplugged. The device is freshly powered.
    ///
    /// # Errors
    /// If the socket fails, or what comes over it is no USB/IP.
    pub fn serve(&self, stream: UnixStream) -> io::Result<()> {
        {
            let mut state = self.lock();
            state.disconnect();
            state.out = Some(stream.try_clone()?);
            state.device.reset();
        }
        let pump = self.clone();
        let pumping = std::thread::spawn(move || pump.pump());
        let result = self.read(stream);
        self.lock().disconnect();
        self.state.1.notify_all();
        // The pump ends with the connection; if it panicked, the device is lost and the error is the panic's.
        pumping.join().map_err(|_| io::Error::other("the emulated device failed"))?;
        match result {
            Err(error) if matches!(error.kind(), io::ErrorKind::UnexpectedEof | io::ErrorKind::ConnectionReset) => {
                Ok(())
            }
            result => result,
        }
    }

    /// Offers waiting transfers to the device when it may have something for them.
    fn pump(&self) {
        let mut state = self.lock();
        while state.out.is_some() {
            state.offer();
            let now = monotonic_ns();
            let wake = state.device.wake_ns(now).min(now + 50_000_000) - now;
            // A device that has data that nobody asks for waits for the next request.
            let wake = if state.waiting.is_empty() { 20_000_000 } else { wake.max(100_000) };
            let wait = Duration::from_nanos(wake as u64);
            state = self.state.1.wait_timeout(state, wait).map_or_else(|error| error.into_inner().0, |woken| woken.0);
        }
    }

    fn read(&self, mut stream: UnixStream) -> io::Result<()> {
        let mut header = [0; HEADER];
        loop {
            stream.read_exact(&mut header)?;
            let word = |at: usize| u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
            let (command, sequence) = (word(0), word(4));
            match command {
                SUBMIT => {
                    let to_host = word(12) == 1;
                    let length = word(24) as usize;
                    if length > LONGEST {
                        return Err(io::Error::other(format!("a transfer of {length} bytes")));
                    }
                    let mut data = vec![0; if to_host { 0 } else { length }];
                    stream.read_exact(&mut data)?;
                    let number = (word(16) & 0xf) as u8;
                    let endpoint = if number == 0 { 0 } else { number | u8::from(to_host) << 7 };
                    let setup = (number == 0).then(|| Setup {
                        request_type: header[40],
                        request: header[41],
                        value: u16::from_le_bytes([header[42], header[43]]),
                        index: u16::from_le_bytes([header[44], header[45]]),
                        length: u16::from_le_bytes([header[46], header[47]]),
                    });
                    let urb = Urb { endpoint, setup, data, length: if to_host { length } else { 0 } };
                    let mut state = self.lock();
                    state.waiting.push_back(Waiting { sequence, urb });
                    state.offer();
                    self.state.1.notify_all();
                }
                UNLINK => {
                    let unlinked = word(20);
                    let mut state = self.lock();
                    let place = state.waiting.iter().position(|waiting| waiting.sequence == unlinked);
                    let status = if let Some(place) = place {
                        state.waiting.remove(place);
                        ECONNRESET
                    } else {
                        0
                    };
                    state.send(&reply(UNLINK_REPLY, sequence, status, 0), &[]);
                }
                other => return Err(io::Error::other(format!("message {other} is no USB/IP"))),
            }
        }
    }
}

impl State {
    fn disconnect(&mut self) {
        self.waiting.clear();
        if let Some(out) = self.out.take() {
            // Fails if the other side is gone already.
            let _ = out.shutdown(Shutdown::Both);
        }
    }

    fn send(&mut self, header: &[u8], data: &[u8]) {
        let Some(out) = &mut self.out else { return };
        let message = [header, data].concat();
        if out.write_all(&message).is_err() {
            self.disconnect();
        }
    }

    /// Offers every waiting transfer that is first of its endpoint, until all of those must wait.
    fn offer(&mut self) {
        let mut blocked = 0_u32;
        let mut index = 0;
        while let Some(waiting) = self.waiting.get(index) {
            let endpoint = waiting.urb.endpoint;
            let bit = 1 << (u32::from(endpoint & 0xf) + u32::from(endpoint >> 7) * 16);
            if blocked & bit != 0 {
                index += 1;
                continue;
            }
            let (status, count, data) = match self.device.submit(&waiting.urb, monotonic_ns()) {
                Reply::Pending => {
                    blocked |= bit;
                    index += 1;
                    continue;
                }
                Reply::Gone => return self.disconnect(),
                Reply::Data(data) => (0, data.len(), data),
                Reply::Taken(count) => (0, count, Vec::new()),
                Reply::Stall => (EPIPE, 0, Vec::new()),
                Reply::Overflow => (EOVERFLOW, 0, Vec::new()),
            };
            let sequence = waiting.sequence;
            self.waiting.remove(index);
            self.send(&reply(SUBMIT_REPLY, sequence, status, count as u32), &data);
            if self.out.is_none() {
                return;
            }
        }
    }
}

fn reply(kind: u32, sequence: u32, status: i32, count: u32) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    header[..4].copy_from_slice(&kind.to_be_bytes());
    header[4..8].copy_from_slice(&sequence.to_be_bytes());
    header[20..24].copy_from_slice(&status.to_be_bytes());
    header[24..28].copy_from_slice(&count.to_be_bytes());
    if kind == SUBMIT_REPLY {
        // The number of isochronous packets: this is no isochronous transfer.
        header[32..36].copy_from_slice(&u32::MAX.to_be_bytes());
    }
    header
}
