//! Emulated USB devices, written from the protocol. A device answers one transfer at a time; front ends carry the
//! transfers: in-process, through umockdev on the host, or through the kernel's `vhci_hcd` in a QEMU guest.
//!
//! | module | what it knows |
//! |---|---|
//! | [`evk4`] | the Prophesee EVK4: treuzell requests, registers of the IMX636, EVT3 and EVT2.1 words |
//! | [`davis346`] | the iniVation DAVIS346: SPI registers, words of events, frames, inertial samples and edges |
//! | [`uvc`] | a camera of the USB Video Class: MJPEG, YUYV, NV12, GREY |
//! | [`u3v`] | a USB3 Vision camera: registers behind GenCP, blocks of a stream |
//! | [`scene`] | what the sensors see: a pattern whose every event is known, the stage, a recorded file |
//! | [`clock`] | crystals that are off and drift, and the wire that makes sensors share one |
//! | [`line`](mod@line) | the wire from a trigger board to the sensors' trigger inputs |
//! | [`outbox`] | what waits for the host, and what the sensors count |
//! | [`faults`] | what goes wrong on demand, and the account of every byte that left a device |
//! | [`front`] | USB/IP over a socket: the kernel's `vhci_hcd`, the umockdev bridge |
//! | [`rigfile`] | a rig of emulated devices in TOML |
//! | [`standard`] | descriptors and the requests that every USB device answers |

pub mod clock;
pub mod davis346;
pub mod evk4;
pub mod faults;
pub mod front;
pub mod line;
pub mod outbox;
pub mod rigfile;
pub mod scene;
pub mod standard;
pub mod u3v;
pub mod uvc;

pub use davis346::{Davis346, Davis346Options};
pub use evk4::{Evk4, Evk4Options};
pub use faults::{Fault, FaultKind, Faults, Ledger, Plug};
pub use line::TriggerLine;
pub use outbox::{SensorCounts, SharedCounts};
pub use u3v::{U3v, U3vFaults, U3vOptions};
pub use uvc::{Uvc, UvcOptions};

/// The setup packet of a control transfer (USB 2.0, table 9-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Direction, type and recipient; bit 7 set: device to host.
    pub request_type: u8,
    /// The request.
    pub request: u8,
    /// Its value.
    pub value: u16,
    /// Its index.
    pub index: u16,
    /// Bytes of the data stage.
    pub length: u16,
}

/// One transfer from the host's side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Urb {
    /// Endpoint address with the direction in bit 7; 0x00 for control transfers of both directions.
    pub endpoint: u8,
    /// The setup packet of a control transfer.
    pub setup: Option<Setup>,
    /// What the host sends; empty for transfers to the host.
    pub data: Vec<u8>,
    /// How many bytes the host takes at most; 0 for transfers from the host.
    pub length: usize,
}

/// What a device does with a transfer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Done: the bytes for the host (to-host transfers; may be short or empty).
    Data(Vec<u8>),
    /// Done: the device took this many bytes (from-host transfers).
    Taken(usize),
    /// Not yet (NAK): offer the transfer again later.
    Pending,
    /// The endpoint is halted (or the control request is not supported).
    Stall,
    /// The device sent more than the host takes.
    Overflow,
    /// The device is unplugged.
    Gone,
}

/// Bus speeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Speed {
    /// 480 Mbit/s.
    High,
    /// 5 Gbit/s.
    Super,
}

/// A device on the bus. Time is the front end's: real in a guest, virtual in tests.
pub trait UsbDevice: Send {
    /// The bus speed.
    fn speed(&self) -> Speed;

    /// Answers a transfer at `now_ns`. Standard requests (descriptors, configuration, interfaces, halts) included.
    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply;

    /// The bus was reset: the state is that after power-on.
    fn reset(&mut self);

    /// Whether the device is on the bus at `now_ns`. Only a [`Plug`] ever leaves it.
    fn plugged(&mut self, _now_ns: i64) -> bool {
        true
    }

    /// When to offer a pending transfer again, at the latest.
    fn wake_ns(&mut self, now_ns: i64) -> i64 {
        now_ns + 1_000_000
    }
}

impl<D: UsbDevice + ?Sized> UsbDevice for Box<D> {
    fn speed(&self) -> Speed {
        (**self).speed()
    }

    fn submit(&mut self, urb: &Urb, now_ns: i64) -> Reply {
        (**self).submit(urb, now_ns)
    }

    fn reset(&mut self) {
        (**self).reset();
    }

    fn plugged(&mut self, now_ns: i64) -> bool {
        (**self).plugged(now_ns)
    }

    fn wake_ns(&mut self, now_ns: i64) -> i64 {
        (**self).wake_ns(now_ns)
    }
}

impl Urb {
    /// A control transfer to the host.
    #[must_use]
    pub fn control_in(request_type: u8, request: u8, value: u16, index: u16, length: u16) -> Self {
        let setup = Setup { request_type, request, value, index, length };
        Self { endpoint: 0, setup: Some(setup), data: Vec::new(), length: usize::from(length) }
    }

    /// A control transfer from the host.
    ///
    /// # Panics
    /// If the data is longer than a control transfer can be (65,535 bytes).
    #[must_use]
    pub fn control_out(request_type: u8, request: u8, value: u16, index: u16, data: &[u8]) -> Self {
        let length = u16::try_from(data.len()).expect("a control transfer has at most 65,535 bytes");
        let setup = Setup { request_type, request, value, index, length };
        Self { endpoint: 0, setup: Some(setup), data: data.to_vec(), length: 0 }
    }

    /// A bulk transfer to the host: up to `length` bytes from an endpoint with bit 7 set.
    #[must_use]
    pub fn bulk_in(endpoint: u8, length: usize) -> Self {
        Self { endpoint, setup: None, data: Vec::new(), length }
    }

    /// A bulk transfer from the host.
    #[must_use]
    pub fn bulk_out(endpoint: u8, data: &[u8]) -> Self {
        Self { endpoint, setup: None, data: data.to_vec(), length: 0 }
    }
}
