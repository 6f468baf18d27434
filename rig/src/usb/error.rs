//! What goes wrong on the bus, and what to do about it.

use thiserror::Error;

use super::Identity;

/// A failed transfer or request: which device, what was being done, why, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("USB device {device}: {step}: {fault}")]
pub struct TransportError {
    /// The device: identifiers, bus and address, port.
    pub device: String,
    /// What was being done.
    pub step: String,
    /// Why it failed.
    pub fault: Fault,
}

impl TransportError {
    /// An error of `identity` while `step` was done.
    pub fn new(identity: &Identity, step: impl Into<String>, fault: Fault) -> Self {
        Self { device: identity.to_string(), step: step.into(), fault }
    }
}

/// Why a transfer failed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Fault {
    /// The user may not open the device.
    #[error(
        "permission denied. Install the rules for cameras: copy scripts/udev/60-erfgs.rules to \
         /etc/udev/rules.d/, run `udevadm control --reload` and `udevadm trigger` as root, join the group plugdev, and \
         plug the device in again. One rule reads: SUBSYSTEM==\"usb\", ATTR{{idVendor}}==\"{vendor:04x}\", \
         ATTR{{idProduct}}==\"{product:04x}\", MODE=\"0660\", GROUP=\"plugdev\", TAG+=\"uaccess\""
    )]
    Access {
        /// Vendor.
        vendor: u16,
        /// Product.
        product: u16,
    },
    /// Another program has the interface.
    #[error("another program uses it. Close other viewers and recorders of this camera (one program at a time)")]
    Busy,
    /// The device is unplugged.
    #[error("the device is disconnected. Check the cable and the hub's power, and plug it in again")]
    Gone,
    /// No answer in time.
    #[error("no answer in time. Unplug the device and plug it in again; avoid hubs without their own power")]
    Timeout,
    /// The endpoint is halted, or the request is not supported.
    #[error("the endpoint is halted or the request not supported (stall)")]
    Stall,
    /// The device sent more than was asked for.
    #[error("the device sent more than was asked for (overflow)")]
    Overflow,
    /// The kernel has no memory for transfers.
    #[error("no memory for USB transfers: {0}")]
    Memory(String),
    /// The receiver of a stream failed.
    #[error("the receiver of the stream panicked; this is a defect of erfgs, please report it")]
    Receiver,
    /// Another error of the link.
    #[error("input/output error {0} of libusb. Try another cable or port")]
    Io(i32),
}

impl Fault {
    /// The fault behind an error code of libusb (`libusb_error`), for `identity`.
    pub(super) fn of_code(code: i32, identity: &Identity) -> Self {
        use libusb1_sys::constants as c;
        match code {
            c::LIBUSB_ERROR_ACCESS => Self::Access { vendor: identity.vendor, product: identity.product },
            c::LIBUSB_ERROR_BUSY => Self::Busy,
            c::LIBUSB_ERROR_NO_DEVICE | c::LIBUSB_ERROR_NOT_FOUND => Self::Gone,
            c::LIBUSB_ERROR_TIMEOUT => Self::Timeout,
            c::LIBUSB_ERROR_PIPE => Self::Stall,
            c::LIBUSB_ERROR_OVERFLOW => Self::Overflow,
            c::LIBUSB_ERROR_NO_MEM => Self::Memory(super::budget::memory_advice()),
            other => Self::Io(other),
        }
    }

    /// The fault behind an error of rusb.
    pub(super) fn of_rusb(error: rusb::Error, identity: &Identity) -> Self {
        use libusb1_sys::constants as c;
        let code = match error {
            rusb::Error::Access => c::LIBUSB_ERROR_ACCESS,
            rusb::Error::Busy => c::LIBUSB_ERROR_BUSY,
            rusb::Error::NoDevice => c::LIBUSB_ERROR_NO_DEVICE,
            rusb::Error::NotFound => c::LIBUSB_ERROR_NOT_FOUND,
            rusb::Error::Timeout => c::LIBUSB_ERROR_TIMEOUT,
            rusb::Error::Pipe => c::LIBUSB_ERROR_PIPE,
            rusb::Error::Overflow => c::LIBUSB_ERROR_OVERFLOW,
            rusb::Error::NoMem => c::LIBUSB_ERROR_NO_MEM,
            rusb::Error::Io => c::LIBUSB_ERROR_IO,
            rusb::Error::InvalidParam => c::LIBUSB_ERROR_INVALID_PARAM,
            rusb::Error::Interrupted => c::LIBUSB_ERROR_INTERRUPTED,
            rusb::Error::NotSupported => c::LIBUSB_ERROR_NOT_SUPPORTED,
            _ => c::LIBUSB_ERROR_OTHER,
        };
        Self::of_code(code, identity)
    }
}
