//! USB transport: control and bulk transfers, and a stream of asynchronous ones.
//!
//! Drivers know a device through [`Transport`] alone and find it through [`Bus`]. On a real machine these are
//! [`LibusbBus`] and its transports; tests put emulated devices behind the same two traits.

mod asynchronous;
mod budget;
pub(crate) mod cameras;
mod error;
mod libusb;

use std::{
    fmt,
    sync::Arc,
    time::{Duration, Instant},
};

pub use budget::{Budget, memory_advice};
pub use error::{Fault, TransportError};
pub use libusb::LibusbBus;

/// Bus speeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Speed {
    /// Not reported.
    Unknown,
    /// 12 Mbit/s or less.
    Full,
    /// 480 Mbit/s.
    High,
    /// 5 Gbit/s or more.
    Super,
}

impl Speed {
    /// What to do about a link that is too slow for a camera.
    #[must_use]
    pub fn advice(self) -> Option<String> {
        matches!(self, Self::Full | Self::High)
            .then(|| format!("linked at {self} only: use a USB 3 port and cable, or data will be lost"))
    }
}

impl fmt::Display for Speed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unknown => "unknown speed",
            Self::Full => "12 Mbit/s",
            Self::High => "480 Mbit/s",
            Self::Super => "5 Gbit/s",
        })
    }
}

/// A device as the bus shows it before it is opened.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Identity {
    /// Vendor.
    pub vendor: u16,
    /// Product.
    pub product: u16,
    /// Release number of the device (`bcdDevice`): 0x0307 is 3.07.
    pub version: u16,
    /// Number of the bus.
    pub bus: u8,
    /// Address on the bus; a device that is plugged in again gets a new one.
    pub address: u8,
    /// The port it is plugged into, as the kernel names it ("2-1.3"); stays the same when it is plugged in again.
    pub port: String,
    /// Speed of its link.
    pub speed: Speed,
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04x}:{:04x} at {}:{} (port {})", self.vendor, self.product, self.bus, self.address, self.port)
    }
}

/// An endpoint of an interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Its address; bit 7 set: device to host.
    pub address: u8,
    /// Whether its transfers are bulk.
    pub bulk: bool,
}

/// An interface of the active configuration (alternate setting 0).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Its number.
    pub number: u8,
    /// Class, subclass, protocol.
    pub class: (u8, u8, u8),
    /// Endpoints in the order of the descriptor.
    pub endpoints: Vec<Endpoint>,
}

/// What the system tells of a device before it is opened.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Described {
    /// The interfaces of its active configuration.
    pub interfaces: Vec<Interface>,
    /// Maker; empty where the system does not say.
    pub maker: String,
    /// Product; likewise.
    pub product: String,
    /// Serial number; likewise.
    pub serial: String,
}

/// The fixed part of a control transfer (USB 2.0, table 9-2, without the length).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Control {
    /// Direction, type and recipient; bit 7 set: device to host.
    pub request_type: u8,
    /// The request.
    pub request: u8,
    /// Its value.
    pub value: u16,
    /// Its index.
    pub index: u16,
}

/// What a stream hands to its receiver.
#[derive(Debug)]
pub enum Arrival<'a> {
    /// A transfer arrived.
    Data {
        /// Host time, taken first thing on arrival.
        host_ns: i64,
        /// Its bytes; never empty.
        bytes: &'a [u8],
    },
    /// The stream broke; nothing follows. Not delivered for a stream that was stopped.
    Ended(Fault),
}

/// Takes what a stream delivers. It is called from a thread of the stream's own and must return soon: while it runs no
/// transfer is given back to the device.
pub type Receiver = Box<dyn FnMut(Arrival<'_>) + Send>;

/// How many transfers are kept in flight, and how large they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flight {
    /// Transfers in flight.
    pub transfers: usize,
    /// Bytes of each; a multiple of the endpoint's packet size.
    pub bytes: usize,
}

/// A running stream. Dropping it stops it.
pub trait Stream: Send {
    /// Transfers really in flight; fewer than asked for where the kernel refused memory.
    fn granted(&self) -> usize;

    /// Cancels what is in flight and returns when the receiver will not be called again. Stopping twice does nothing.
    fn stop(&mut self);
}

/// An opened device.
pub trait Transport: Send + Sync {
    /// The device.
    fn identity(&self) -> &Identity;

    /// The serial number of its device descriptor, where it has one and tells it.
    fn serial(&self) -> Option<&str>;

    /// The interfaces of its active configuration.
    fn interfaces(&self) -> &[Interface];

    /// Takes an interface for ourselves; with `select`, also selects its alternate setting 0, which resets its
    /// endpoints.
    ///
    /// # Errors
    /// If another program has it, or the device is gone.
    fn claim(&self, interface: u8, select: bool) -> Result<(), TransportError>;

    /// Reads through endpoint 0; returns how many bytes came.
    ///
    /// # Errors
    /// If the device refuses (a stall), does not answer in time or is gone.
    fn control_read(&self, control: Control, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError>;

    /// Writes through endpoint 0; returns how many bytes were taken.
    ///
    /// # Errors
    /// If the device refuses (a stall), does not answer in time or is gone.
    fn control_write(&self, control: Control, from: &[u8], timeout: Duration) -> Result<usize, TransportError>;

    /// Reads once from a bulk endpoint; returns how many bytes came, which may be none.
    ///
    /// # Errors
    /// If the endpoint is halted, nothing comes in time or the device is gone.
    fn bulk_read(&self, endpoint: u8, into: &mut [u8], timeout: Duration) -> Result<usize, TransportError>;

    /// Writes to a bulk endpoint; returns how many bytes were taken.
    ///
    /// # Errors
    /// If the endpoint is halted, the device does not take them in time or is gone.
    fn bulk_write(&self, endpoint: u8, from: &[u8], timeout: Duration) -> Result<usize, TransportError>;

    /// Ends the halt of an endpoint and resets its data toggle.
    ///
    /// # Errors
    /// If the device refuses or is gone.
    fn clear_halt(&self, endpoint: u8) -> Result<(), TransportError>;

    /// Keeps transfers from a bulk endpoint in flight and hands what arrives to `receiver`, in order.
    ///
    /// # Errors
    /// If no transfer can be submitted.
    fn stream(&self, endpoint: u8, flight: Flight, receiver: Receiver) -> Result<Box<dyn Stream>, TransportError>;

    /// Waits as the device asks to between two commands. An emulated device moves its own clock instead.
    fn wait(&self, duration: Duration) {
        std::thread::sleep(duration);
    }
}

/// Where devices are found.
pub trait Bus: Send + Sync {
    /// The devices present now.
    ///
    /// # Errors
    /// If the system does not tell.
    fn list(&self) -> Result<Vec<Identity>, TransportError>;

    /// What the system tells of one, which needs no permission.
    ///
    /// # Errors
    /// If it is gone, or its descriptors cannot be read.
    fn describe(&self, identity: &Identity) -> Result<Described, TransportError>;

    /// Opens one.
    ///
    /// # Errors
    /// If it is gone or the user may not open it.
    fn open(&self, identity: &Identity) -> Result<Arc<dyn Transport>, TransportError>;
}

/// Reads a bulk endpoint until it stays silent for `silence`, so that what a device kept from an earlier run does not
/// reach the next one. Gives up after `limit`; returns how many bytes it threw away.
///
/// # Errors
/// Any error but a time-out.
pub fn drain(
    transport: &dyn Transport,
    endpoint: u8,
    silence: Duration,
    limit: Duration,
) -> Result<usize, TransportError> {
    let begun = Instant::now();
    let mut buffer = vec![0; 1 << 17];
    let mut total = 0;
    while begun.elapsed() < limit {
        match transport.bulk_read(endpoint, &mut buffer, silence) {
            Ok(0) => break,
            Ok(count) => total += count,
            Err(error) if error.fault == Fault::Timeout => break,
            Err(error) => return Err(error),
        }
    }
    Ok(total)
}
