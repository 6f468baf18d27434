//! Registers of a DAVIS: modules and parameters behind vendor requests.
//!
//! Sources: libcaer `src/usb_utils.h` (requests), `include/libcaer/devices/davis.h` (modules and parameters).

use std::{sync::Arc, time::Duration};

use crate::{
    event::EventError,
    usb::{Control, Transport, TransportError},
};

/// One parameter.
const SINGLE: u8 = 0xBF;
/// Several parameters in one request, in order.
const SEVERAL: u8 = 0xC2;
const TIMEOUT: Duration = Duration::from_secs(1);

/// A parameter of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Parameter(pub u8, pub u8);

macro_rules! parameters {
    ($($(#[$meta:meta])* $name:ident = $module:literal / $parameter:literal;)*) => {
        $($(#[$meta])* pub const $name: Parameter = Parameter($module, $parameter);)*
    };
}

parameters! {
    /// Multiplexer: sends.
    MUX_RUN = 0 / 0;
    /// Multiplexer: time stamps count.
    MUX_TIMESTAMP_RUN = 0 / 1;
    /// Multiplexer: 1, then 0, resets time stamps here and in chained slaves.
    MUX_TIMESTAMP_RESET = 0 / 2;
    /// Multiplexer: the chip is powered.
    MUX_CHIP_RUN = 0 / 3;
    /// Multiplexer: drop edges of the external input while USB stalls.
    MUX_DROP_EXTERNAL = 0 / 4;
    /// Multiplexer: drop events while USB stalls.
    MUX_DROP_EVENTS = 0 / 5;
    /// Multiplexer: has drop counters.
    MUX_HAS_STATISTICS = 0 / 80;
    /// Multiplexer: edges dropped, upper half; the lower half follows.
    MUX_EXTERNAL_DROPPED = 0 / 81;
    /// Multiplexer: events dropped, upper half; the lower half follows.
    MUX_EVENTS_DROPPED = 0 / 83;

    /// Events: columns of the chip.
    DVS_COLUMNS = 1 / 0;
    /// Events: rows of the chip.
    DVS_ROWS = 1 / 1;
    /// Events: bit 2 set: rows and columns are exchanged.
    DVS_ORIENTATION = 1 / 2;
    /// Events: run.
    DVS_RUN = 1 / 3;
    /// Events: wait while USB stalls (rather than drop).
    DVS_WAIT = 1 / 4;
    /// Events: the address bus is acknowledged by somebody else.
    DVS_EXTERNAL_CONTROL = 1 / 5;
    /// Events: has a mask of eight pixels.
    DVS_HAS_MASK = 1 / 10;
    /// Events: row of the first masked pixel; its column, the second row and so on follow.
    DVS_MASK = 1 / 11;
    /// Events: has a filter of background activity.
    DVS_HAS_ACTIVITY = 1 / 30;
    /// Events: background activity is dropped.
    DVS_ACTIVITY = 1 / 31;
    /// Events: its time, 250 µs.
    DVS_ACTIVITY_TIME = 1 / 32;
    /// Events: refractory period.
    DVS_REFRACTORY = 1 / 33;
    /// Events: its time, 250 µs.
    DVS_REFRACTORY_TIME = 1 / 34;
    /// Events: has a region.
    DVS_HAS_REGION = 1 / 40;
    /// Events: first column of the region; first row, last column, last row follow.
    DVS_REGION = 1 / 41;
    /// Events: has a filter that skips events.
    DVS_HAS_SKIP = 1 / 50;
    /// Events: skip.
    DVS_SKIP = 1 / 51;
    /// Events: has a filter of polarities.
    DVS_HAS_POLARITY = 1 / 60;
    /// Events: all polarities are sent as off; suppress, suppressed polarity follow.
    DVS_POLARITY = 1 / 61;

    /// Frames: bit 2 set: rows and columns are exchanged.
    APS_ORIENTATION = 2 / 2;
    /// Frames: run.
    APS_RUN = 2 / 4;
    /// Frames: wait while USB stalls.
    APS_WAIT = 2 / 5;
    /// Frames: has a global shutter.
    APS_HAS_GLOBAL = 2 / 6;
    /// Frames: global shutter.
    APS_GLOBAL = 2 / 7;
    /// Frames: first column; first row, last column, last row follow.
    APS_REGION = 2 / 8;
    /// Frames: exposure, cycles of the ADC's clock.
    APS_EXPOSURE = 2 / 12;
    /// Frames: interval, cycles of the ADC's clock.
    APS_INTERVAL = 2 / 13;

    /// Inertial unit: 0 none, 1 InvenSense 6050 or 6150, 2 InvenSense 9250.
    IMU_TYPE = 3 / 0;
    /// Inertial unit: flips of z, y, x in bits 0 to 2.
    IMU_ORIENTATION = 3 / 1;
    /// Inertial unit: accelerometer runs.
    IMU_ACCELEROMETER = 3 / 2;
    /// Inertial unit: gyroscope runs.
    IMU_GYROSCOPE = 3 / 3;
    /// Inertial unit: thermometer runs.
    IMU_THERMOMETER = 3 / 4;
    /// Inertial unit: its rate is divided by this plus 1.
    IMU_DIVIDER = 3 / 5;
    /// Inertial unit: low-pass filter of the accelerometer (type 1: of both).
    IMU_LOW_PASS = 3 / 6;
    /// Inertial unit: range of the accelerometer.
    IMU_ACCELEROMETER_RANGE = 3 / 7;
    /// Inertial unit: low-pass filter of the gyroscope (type 2).
    IMU_GYROSCOPE_LOW_PASS = 3 / 9;
    /// Inertial unit: range of the gyroscope.
    IMU_GYROSCOPE_RANGE = 3 / 10;

    /// External input: detector runs.
    EXTERNAL_RUN = 4 / 0;
    /// External input: rising edges are sent.
    EXTERNAL_RISING = 4 / 1;
    /// External input: falling edges are sent.
    EXTERNAL_FALLING = 4 / 2;
    /// External input: pulses are sent.
    EXTERNAL_PULSES = 4 / 3;
    /// External input: generator of pulses runs.
    EXTERNAL_GENERATOR = 4 / 11;

    /// Chip: global shutter.
    CHIP_GLOBAL = 5 / 142;

    /// System: version of the logic.
    SYSTEM_LOGIC = 6 / 0;
    /// System: 1 if time stamps are its own, 0 if they come from a chained master.
    SYSTEM_MASTER = 6 / 2;
    /// System: clock of the logic, MHz.
    SYSTEM_LOGIC_CLOCK = 6 / 3;
    /// System: clock of the ADC, MHz.
    SYSTEM_ADC_CLOCK = 6 / 4;
    /// System: clock of the USB interface, MHz.
    SYSTEM_USB_CLOCK = 6 / 5;
    /// System: true over nominal clock, thousandths.
    SYSTEM_DEVIATION = 6 / 6;
    /// System: patch level of the logic.
    SYSTEM_PATCH = 6 / 7;

    /// USB: sends.
    USB_RUN = 9 / 0;
    /// USB: an unfinished transfer is sent after this long, cycles of the USB interface's clock.
    USB_DELAY = 9 / 1;
}

impl Parameter {
    /// The parameter `offset` places after this one.
    pub const fn after(self, offset: u8) -> Self {
        Self(self.0, self.1 + offset)
    }
}

/// Registers of one camera.
pub(super) struct Spi {
    pub transport: Arc<dyn Transport>,
    /// Model, serial number, bus and address, for messages.
    pub name: String,
}

/// The bytes of several parameters in one request: module, parameter, value (most significant byte first).
fn several(entries: &[(Parameter, u32)]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(6 * entries.len());
    for (Parameter(module, parameter), value) in entries {
        bytes.extend([*module, *parameter]);
        bytes.extend(value.to_be_bytes());
    }
    bytes
}

impl Spi {
    fn failed(&self, step: String) -> impl FnOnce(TransportError) -> EventError {
        let camera = self.name.clone();
        move |source| EventError::Transport { camera, step, source }
    }

    fn short(&self, step: String, count: usize, wanted: usize) -> EventError {
        let problem = format!("{count} bytes were transferred of {wanted}");
        EventError::Answer { camera: self.name.clone(), step, problem }
    }

    /// Reads a parameter.
    pub(super) fn read(&self, Parameter(module, parameter): Parameter) -> Result<u32, EventError> {
        let step = format!("read parameter {module}/{parameter}");
        let control = Control { request_type: 0xC0, request: SINGLE, value: module.into(), index: parameter.into() };
        let mut bytes = [0; 4];
        match self.transport.control_read(control, &mut bytes, TIMEOUT) {
            Ok(4) => Ok(u32::from_be_bytes(bytes)),
            Ok(count) => Err(self.short(step, count, 4)),
            Err(source) => Err(self.failed(step)(source)),
        }
    }

    /// Reads a counter of 64 bits.
    pub(super) fn read_long(&self, upper: Parameter) -> Result<u64, EventError> {
        // The upper half is read again, so that a carry between the two reads does not make a wrong number.
        loop {
            let (high, low) = (self.read(upper)?, self.read(upper.after(1))?);
            if self.read(upper)? == high {
                return Ok(u64::from(high) << 32 | u64::from(low));
            }
        }
    }

    /// Whether a capability or state is set.
    pub(super) fn has(&self, parameter: Parameter) -> Result<bool, EventError> {
        Ok(self.read(parameter)? == 1)
    }

    /// Writes a parameter.
    pub(super) fn write(&self, Parameter(module, parameter): Parameter, value: u32) -> Result<(), EventError> {
        let step = format!("write {value} to parameter {module}/{parameter}");
        let control = Control { request_type: 0x40, request: SINGLE, value: module.into(), index: parameter.into() };
        match self.transport.control_write(control, &value.to_be_bytes(), TIMEOUT) {
            Ok(4) => Ok(()),
            Ok(count) => Err(self.short(step, count, 4)),
            Err(source) => Err(self.failed(step)(source)),
        }
    }

    /// Writes parameters one after the other.
    pub(super) fn write_each(&self, entries: &[(Parameter, u32)]) -> Result<(), EventError> {
        entries.iter().try_for_each(|&(parameter, value)| self.write(parameter, value))
    }

    /// Writes parameters in one request, which the camera executes without a gap. The request's value is the number of
    /// entries (libcaer, `spiConfigSendMultiple`).
    pub(super) fn write_together(&self, entries: &[(Parameter, u32)]) -> Result<(), EventError> {
        let step = format!("write {} parameters together", entries.len());
        let bytes = several(entries);
        let value = u16::try_from(entries.len()).unwrap_or(u16::MAX);
        let control = Control { request_type: 0x40, request: SEVERAL, value, index: 0 };
        match self.transport.control_write(control, &bytes, TIMEOUT) {
            Ok(count) if count == bytes.len() => Ok(()),
            Ok(count) => Err(self.short(step, count, bytes.len())),
            Err(source) => Err(self.failed(step)(source)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_parameters_have_these_bytes() {
        assert_eq!(
            several(&[(MUX_TIMESTAMP_RESET, 1), (CHIP_GLOBAL, 0x0102_0304)]),
            [0, 2, 0, 0, 0, 1, 5, 142, 1, 2, 3, 4]
        );
    }
}
