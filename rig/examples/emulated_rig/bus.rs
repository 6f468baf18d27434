//! Emulated USB devices behind the drivers' traits, in this process and on the wall's clock.

use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering::SeqCst},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use erfgs_hardware_mocks::usb::{Reply, Setup, Speed as WireSpeed, Urb, UsbDevice};
use erfgs_rig::{
    host_time::host_ns,
    usb::{
        Arrival, Bus, Control, Endpoint, Fault, Flight, Identity, Interface, Receiver, Speed, Stream, Transport,
        TransportError,
    },
};

type Device = Arc<Mutex<Box<dyn UsbDevice>>>;

fn lock(device: &Device) -> MutexGuard<'_, Box<dyn UsbDevice>> {
    device.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A bus with one device in each port.
pub struct EmulatedBus(pub Vec<Device>);

fn read(device: &Device, value: u16, index: u16) -> Vec<u8> {
    match lock(device).submit(&Urb::control_in(0x80, 6, value, index, 1024), host_ns()) {
        Reply::Data(bytes) => bytes,
        _ => Vec::new(),
    }
}

impl Bus for EmulatedBus {
    fn list(&self) -> Result<Vec<Identity>, TransportError> {
        let identity = |(number, device): (usize, &Device)| {
            let bytes = read(device, 0x0100, 0);
            let word = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
            let speed = match lock(device).speed() {
                WireSpeed::High => Speed::High,
                WireSpeed::Super => Speed::Super,
            };
            Some(Identity {
                vendor: word(8)?,
                product: word(10)?,
                version: word(12)?,
                bus: 1,
                address: u8::try_from(number + 1).ok()?,
                port: format!("1-{}", number + 1),
                speed,
            })
        };
        Ok(self.0.iter().enumerate().filter_map(identity).collect())
    }

    fn open(&self, identity: &Identity) -> Result<Arc<dyn Transport>, TransportError> {
        let device = self.0.get(usize::from(identity.address) - 1);
        let device = device.ok_or_else(|| TransportError::new(identity, "open", Fault::Gone))?;
        let descriptor = read(device, 0x0100, 0);
        let serial = match descriptor.get(16) {
            Some(&index) if index > 0 => {
                let text = read(device, 0x0300 | u16::from(index), 0x0409);
                let units = text.get(2..).unwrap_or_default().as_chunks::<2>().0;
                Some(String::from_utf16_lossy(&units.iter().map(|pair| u16::from_le_bytes(*pair)).collect::<Vec<_>>()))
            }
            _ => None,
        };
        let transport = Emulated {
            device: Arc::clone(device),
            identity: identity.clone(),
            serial,
            interfaces: interfaces(&read(device, 0x0200, 0)),
        };
        transport.set(0x00, 9, 1, 0)?;
        Ok(Arc::new(transport))
    }
}

fn interfaces(configuration: &[u8]) -> Vec<Interface> {
    let mut found: Vec<Interface> = Vec::new();
    let mut rest = configuration;
    while let [length, kind, ..] = *rest {
        let (descriptor, behind) = rest.split_at(usize::from(length).clamp(2, rest.len()));
        match (kind, descriptor) {
            (4, &[_, _, number, _, _, class, subclass, protocol, ..]) => {
                found.push(Interface { number, class: (class, subclass, protocol), endpoints: Vec::new() });
            }
            (5, &[_, _, address, attributes, ..]) => {
                if let Some(interface) = found.last_mut() {
                    interface.endpoints.push(Endpoint { address, bulk: attributes & 3 == 2 });
                }
            }
            _ => {}
        }
        rest = behind;
    }
    found
}

struct Emulated {
    device: Device,
    identity: Identity,
    serial: Option<String>,
    interfaces: Vec<Interface>,
}

impl Emulated {
    fn failed<T>(&self, step: &str, fault: Fault) -> Result<T, TransportError> {
        Err(TransportError::new(&self.identity, step, fault))
    }

    fn finish(&self, step: &str, urb: &Urb, timeout: Duration) -> Result<Reply, TransportError> {
        let until = Instant::now() + timeout;
        loop {
            let reply = lock(&self.device).submit(urb, host_ns());
            match reply {
                Reply::Pending if Instant::now() >= until => return self.failed(step, Fault::Timeout),
                Reply::Pending => thread::sleep(Duration::from_micros(200)),
                Reply::Stall => return self.failed(step, Fault::Stall),
                Reply::Overflow => return self.failed(step, Fault::Overflow),
                Reply::Gone => return self.failed(step, Fault::Gone),
                done => return Ok(done),
            }
        }
    }

    fn set(&self, request_type: u8, request: u8, value: u16, index: u16) -> Result<(), TransportError> {
        let urb = Urb::control_out(request_type, request, value, index, &[]);
        self.finish("standard request", &urb, Duration::from_secs(1)).map(drop)
    }

    fn data(reply: Reply, into: &mut [u8]) -> usize {
        let Reply::Data(bytes) = reply else { return 0 };
        let count = bytes.len().min(into.len());
        into[..count].copy_from_slice(&bytes[..count]);
        count
    }

    fn taken(reply: &Reply) -> usize {
        if let Reply::Taken(count) = reply { *count } else { 0 }
    }
}

impl Transport for Emulated {
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
        if select { self.set(0x01, 11, 0, interface.into()) } else { Ok(()) }
    }

    fn control_read(&self, control: Control, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError> {
        let Control { request_type, request, value, index } = control;
        let length = u16::try_from(into.len()).unwrap_or(u16::MAX);
        let setup = Setup { request_type, request, value, index, length };
        let urb = Urb { endpoint: 0, setup: Some(setup), data: Vec::new(), length: length.into() };
        Ok(Self::data(self.finish("control read", &urb, timeout)?, into))
    }

    fn control_write(&self, control: Control, from: &[u8], timeout: Duration) -> Result<usize, TransportError> {
        let Control { request_type, request, value, index } = control;
        let urb = Urb::control_out(request_type, request, value, index, from);
        Ok(Self::taken(&self.finish("control write", &urb, timeout)?))
    }

    fn bulk_read(&self, endpoint: u8, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError> {
        let urb = Urb::bulk_in(endpoint, into.len());
        Ok(Self::data(self.finish("bulk read", &urb, timeout)?, into))
    }

    fn bulk_write(&self, endpoint: u8, from: &[u8], timeout: Duration) -> Result<usize, TransportError> {
        Ok(Self::taken(&self.finish("bulk write", &Urb::bulk_out(endpoint, from), timeout)?))
    }

    fn clear_halt(&self, endpoint: u8) -> Result<(), TransportError> {
        self.set(0x02, 1, 0, endpoint.into())
    }

    fn stream(&self, endpoint: u8, flight: Flight, mut receiver: Receiver) -> Result<Box<dyn Stream>, TransportError> {
        let device = Arc::clone(&self.device);
        let stop = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let urb = Urb::bulk_in(endpoint, flight.bytes);
            while !told.load(SeqCst) {
                let reply = lock(&device).submit(&urb, host_ns());
                match reply {
                    Reply::Data(bytes) if !bytes.is_empty() => {
                        receiver(Arrival::Data { host_ns: host_ns(), bytes: &bytes });
                    }
                    Reply::Stall => return receiver(Arrival::Ended(Fault::Stall)),
                    Reply::Overflow => return receiver(Arrival::Ended(Fault::Overflow)),
                    Reply::Gone => return receiver(Arrival::Ended(Fault::Gone)),
                    // A camera of this kind hands data over every few milliseconds.
                    _ => thread::sleep(Duration::from_millis(2)),
                }
            }
        });
        Ok(Box::new(Pump { granted: flight.transfers, stop, thread: Some(thread) }))
    }
}

struct Pump {
    granted: usize,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Stream for Pump {
    fn granted(&self) -> usize {
        self.granted
    }

    fn stop(&mut self) {
        self.stop.store(true, SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Pump {
    fn drop(&mut self) {
        self.stop();
    }
}
