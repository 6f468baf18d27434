//! The machine-vision camera behind both transports: what it can do, in registers and in its own description, and what it exposes.
//! [`gige`](crate::gige) puts it on Ethernet, [`usb::u3v`](crate::usb::u3v) on USB; what differs there is how registers are read and
//! written, in which order bytes lie, and how frames are sent.

mod camera;
pub(crate) mod description;
pub(crate) mod frame;
pub(crate) mod registers;

pub(crate) use camera::{Camera, Exposed};
pub(crate) use registers::Order;

use crate::usb::{TriggerLine, clock::ClockError};

/// What a camera is, on any transport.
#[derive(Clone, Debug)]
pub(crate) struct CameraOptions {
    /// Columns and rows of its sensor.
    pub sensor: [u32; 2],
    /// If it is triggered: the line, each pulse of which exposes a frame.
    pub trigger: Option<TriggerLine>,
    /// Where its strobe goes, if it is wired: edges at both ends of each exposure.
    pub strobe: Option<TriggerLine>,
    /// Error of its clock.
    pub clock: ClockError,
    /// Bytes a second that its link carries.
    pub link_bytes_s: u32,
}
