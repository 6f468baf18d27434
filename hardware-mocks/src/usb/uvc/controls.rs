//! The controls of the camera terminal and the processing unit (UVC 1.0, sections 4.2.2.1 and 4.2.2.3).

use std::collections::BTreeMap;

use crate::usb::{Reply, Setup};

use super::descriptors::{CAMERA, PROCESSING};

const SET_CUR: u8 = 0x01;
const AE_MODE: (u8, u8) = (CAMERA, 2);
const EXPOSURE: (u8, u8) = (CAMERA, 4);
const WHITE_BALANCE: (u8, u8) = (PROCESSING, 10);
const AUTO_WHITE_BALANCE: (u8, u8) = (PROCESSING, 11);

/// Manual exposure, in the bitmap of the exposure mode; 8 is the automatic mode of this camera (aperture priority).
const MANUAL: i32 = 1;

/// The last error of a control, as the host may ask for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Error {
    None = 0,
    WrongState = 2,
    OutOfRange = 4,
    InvalidUnit = 5,
    InvalidControl = 6,
    InvalidRequest = 7,
}

#[derive(Clone, Copy, Debug)]
struct Control {
    bytes: usize,
    least: i32,
    most: i32,
    step: i32,
    default: i32,
    value: i32,
}

/// The controls with their values.
#[derive(Clone, Debug)]
pub(super) struct Controls {
    controls: BTreeMap<(u8, u8), Control>,
    error: Error,
}

impl Controls {
    pub(super) fn new() -> Self {
        let control = |bytes, least, most, step, default| Control { bytes, least, most, step, default, value: default };
        Self {
            controls: BTreeMap::from([
                // The resolution of the mode is the bitmap of the modes that exist.
                (AE_MODE, control(1, 1, 8, MANUAL | 8, 8)),
                (EXPOSURE, control(4, 1, 10_000, 1, 156)),
                ((PROCESSING, 2), control(2, -64, 64, 1, 0)), // brightness
                ((PROCESSING, 4), control(2, 0, 255, 1, 64)), // gain
                (WHITE_BALANCE, control(2, 2800, 6500, 10, 4600)),
                (AUTO_WHITE_BALANCE, control(1, 0, 1, 1, 1)),
            ]),
            error: Error::None,
        }
    }

    fn value(&self, control: (u8, u8)) -> i32 {
        self.controls.get(&control).map_or(0, |control| control.value)
    }

    /// The exposure time, nanoseconds. The automatic exposure of this camera always finds its default right.
    pub(super) fn exposure_ns(&self) -> i64 {
        let manual = self.value(AE_MODE) == MANUAL;
        let units = if manual { self.value(EXPOSURE) } else { 156 };
        i64::from(units) * 100_000
    }

    fn is_automatic(&self, control: (u8, u8)) -> bool {
        match control {
            EXPOSURE => self.value(AE_MODE) != MANUAL,
            WHITE_BALANCE => self.value(AUTO_WHITE_BALANCE) == 1,
            _ => false,
        }
    }

    /// Answers a class request to the control interface.
    pub(super) fn answer(&mut self, setup: &Setup, data: &[u8]) -> Reply {
        let [selector, unit] = [setup.value.to_le_bytes()[1], setup.index.to_le_bytes()[1]];
        if (unit, selector, setup.request) == (0, 2, 0x81) {
            let error = std::mem::replace(&mut self.error, Error::None);
            return Reply::Data(vec![error as u8]);
        }
        match self.control((unit, selector), setup, data) {
            Ok(reply) => {
                self.error = Error::None;
                reply
            }
            Err(error) => {
                self.error = error;
                Reply::Stall
            }
        }
    }

    fn control(&mut self, id: (u8, u8), setup: &Setup, data: &[u8]) -> Result<Reply, Error> {
        if !matches!(id.0, CAMERA | PROCESSING) {
            return Err(Error::InvalidUnit);
        }
        let automatic = self.is_automatic(id);
        let control = self.controls.get_mut(&id).ok_or(Error::InvalidControl)?;
        let bytes = |value: i32| {
            let bytes = value.to_le_bytes();
            Ok(Reply::Data(bytes[..control.bytes.min(usize::from(setup.length))].to_vec()))
        };
        match setup.request {
            SET_CUR if setup.request_type & 0x80 == 0 => {
                if automatic {
                    return Err(Error::WrongState);
                }
                let mut value = [0; 4];
                let given = data.get(..control.bytes).ok_or(Error::OutOfRange)?;
                value[..control.bytes].copy_from_slice(given);
                let value = match control.bytes {
                    2 => i32::from(i16::from_le_bytes([value[0], value[1]])),
                    _ => i32::from_le_bytes(value),
                };
                let offered = id != AE_MODE || (value & control.step == value && value.count_ones() == 1);
                if !(control.least..=control.most).contains(&value) || !offered {
                    return Err(Error::OutOfRange);
                }
                control.value = value;
                Ok(Reply::Taken(data.len()))
            }
            0x81 => bytes(control.value),
            0x82 => bytes(control.least),
            0x83 => bytes(control.most),
            0x84 => bytes(control.step),
            0x85 => Ok(Reply::Data((control.bytes as u16).to_le_bytes().to_vec())),
            // Can be read and written; bit 2: not now, an automatism has it.
            0x86 => Ok(Reply::Data(vec![3 | u8::from(automatic) << 2])),
            0x87 => bytes(control.default),
            _ => Err(Error::InvalidRequest),
        }
    }
}
