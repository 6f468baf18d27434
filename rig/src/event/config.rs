//! Settings that all event cameras have.

use serde::{Deserialize, Serialize};

use super::EventError;
use crate::usb::Flight;

/// How the data of a camera is fetched over USB.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StreamConfig {
    /// Transfers kept in flight, 2 to 256. More bridge longer pauses of this program; all cameras together must fit
    /// the kernel's limit (`usbfs_memory_mb`, 16 MiB unless raised), to which this number is cut.
    pub transfers: usize,
    /// Bytes of a transfer, 1 KiB to 4 MiB, a multiple of 1 KiB. The camera ends one early when it has nothing more to
    /// send.
    pub transfer_bytes: usize,
}

impl Default for StreamConfig {
    /// 32 transfers of 128 KiB: 4 MiB, 20 ms of an EVK4 at its highest rate.
    fn default() -> Self {
        Self { transfers: 32, transfer_bytes: 128 << 10 }
    }
}

impl StreamConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`EventError::Setting`] names the value that is out of range.
    pub fn validate(&self) -> Result<(), EventError> {
        EventError::check("stream.transfers", self.transfers, 2..=256)?;
        if !self.transfer_bytes.is_multiple_of(1024) {
            return Err(EventError::setting("stream.transfer_bytes", self.transfer_bytes, "a multiple of 1024"));
        }
        EventError::check("stream.transfer_bytes", self.transfer_bytes, 1 << 10..=4 << 20)
    }

    /// As the transport takes it.
    #[must_use]
    pub fn flight(&self) -> Flight {
        Flight { transfers: self.transfers, bytes: self.transfer_bytes }
    }
}

/// A window of the sensor, pixels; (0, 0) is the upper left one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Left column.
    pub x: u16,
    /// Upper row.
    pub y: u16,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
}
