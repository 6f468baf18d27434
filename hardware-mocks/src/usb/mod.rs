//! Emulated USB devices, written from the protocol. A device answers one transfer at a time; front ends carry the
//! transfers: in-process, through umockdev on the host, or through the kernel's `vhci_hcd` in a QEMU guest.

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
}
