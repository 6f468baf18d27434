//! Is it an EVK4? Cypress' identifiers are shared by all Prophesee boards on a CX3, whatever the sensor.
//!
//! The maker's way (OpenEB 5.1.1, `tz_libusb_board_command.cpp`, `imx636_tz_device.cpp`): the interface has treuzell's
//! structure, the firmware is recent, the board says that its device 0 is compatible with an IMX636, and two registers
//! of the sensor agree. That admits EVK3 HD, which has the same sensor and sequences. Which board it is the
//! neuromorphic-drivers crate reads from vendor request 0x72 (first byte 0x30: EVK3, 0x31: EVK4); we note it.

use std::{sync::Arc, time::Duration};

use super::{
    MODEL,
    board::{Board, Endpoints, SENSOR},
    treuzell::{self, FrameError, Property},
};
use crate::{
    event::EventError,
    usb::{Control, Transport},
};

/// Oldest firmware that OpenEB talks to.
const OLDEST_FIRMWARE: u32 = 0x3_0800;
/// From this `bcdDevice` on, CX3 firmware takes the selection of an alternate setting.
const SELECTS: u16 = 0x0307;
const COMPATIBLE: [&str; 2] = ["psee,ccam5_imx636", "psee,ccam5_gen42"];
const CHIP_ID: u32 = 0x0014;
const IMX636: u32 = 0xA040_1806;
const CHIP_VARIANT: u32 = 0xF128;

/// What the board says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Found {
    /// Serial number: eight hexadecimal digits or more.
    pub serial: String,
    /// Firmware version: 0x30900 is 3.9.0.
    pub version: u32,
    /// Build date of the firmware, seconds since 1970; 0 where it does not tell.
    pub build_date: u64,
    /// What device 0 is compatible with.
    pub compatible: Vec<String>,
    /// EVK3, EVK4 or unknown.
    pub board: &'static str,
}

impl Found {
    /// The version as it is written.
    pub fn firmware(&self) -> String {
        format!("{}.{}.{}", self.version >> 16, self.version >> 8 & 0xFF, self.version & 0xFF)
    }
}

fn board_kind(transport: &dyn Transport) -> &'static str {
    let control = Control { request_type: 0xC0, request: 0x72, value: 0, index: 0 };
    let mut kind = [0; 2];
    match (transport.control_read(control, &mut kind, Duration::from_secs(1)), kind[0]) {
        (Ok(2), 0x30) => "EVK3",
        (Ok(2), 0x31) => "EVK4",
        _ => "unknown",
    }
}

/// Opens the control endpoints and finds out what the board is. Changes nothing on it.
pub(super) fn identify(transport: Arc<dyn Transport>) -> Result<(Board, Found), EventError> {
    let wrong =
        |found: String| EventError::WrongDevice { device: transport.identity().to_string(), model: MODEL, found };
    let endpoints = Endpoints::find(transport.interfaces())
        .ok_or_else(|| wrong("it has no interface with control and data endpoints of a Prophesee board".into()))?;
    let name = format!("{MODEL} at {}:{}", transport.identity().bus, transport.identity().address);
    let select = transport.identity().version >= SELECTS;
    transport.claim(endpoints.interface, select).map_err(|source| EventError::Transport {
        camera: name,
        step: "take the control interface".into(),
        source,
    })?;
    let board = board_kind(transport.as_ref());
    let mut device = Board::new(Arc::clone(&transport), endpoints);
    let version = device.request("read the firmware's version", Property::ReleaseVersion, &[], |payload| {
        treuzell::word(payload, 0).ok_or(FrameError::TooShort(payload.len()))
    })?;
    let serial = device.request("read the serial number", Property::Serial, &[], treuzell::number)?;
    let serial = format!("{serial:08x}");
    device.name = format!("{MODEL} {serial} at {}:{}", transport.identity().bus, transport.identity().address);
    let compatible =
        device.request("read what the sensor is", Property::DeviceCompatible, &[SENSOR], treuzell::strings)?;
    if !compatible.iter().any(|name| COMPATIBLE.contains(&name.as_str())) {
        return Err(wrong(format!("its sensor is {}", compatible.join(", "))));
    }
    let mut found = Found { serial, version, build_date: 0, compatible, board };
    if version < OLDEST_FIRMWARE {
        return Err(EventError::Firmware {
            camera: device.name.clone(),
            part: "firmware",
            found: found.firmware(),
            needed: "3.8.0 or later",
        });
    }
    let (chip, variant) = (device.read(CHIP_ID)?, device.read(CHIP_VARIANT)?);
    if chip != IMX636 || variant & 0b11 != 0 {
        return Err(wrong(format!(
            "its sensor answers {chip:#010x} and {:#x} where an IMX636 answers {IMX636:#010x} and 0",
            variant & 0b11
        )));
    }
    found.build_date =
        device.request("read the firmware's date", Property::BuildDate, &[], treuzell::number).unwrap_or(0);
    Ok((device, found))
}
