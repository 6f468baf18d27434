//! The configuration of the DAVIS346: 32-bit parameters in modules (libcaer: `davis.h`, `davis_common.h`).

use std::collections::BTreeMap;

/// Modules.
pub mod module {
    /// Multiplexer: time stamps, streams, statistics.
    pub const MULTIPLEXER: u8 = 0;
    /// Event sensor.
    pub const DVS: u8 = 1;
    /// Frame sensor.
    pub const APS: u8 = 2;
    /// Inertial unit.
    pub const IMU: u8 = 3;
    /// External input.
    pub const INPUT: u8 = 4;
    /// Biases and switches of the chip.
    pub const CHIP: u8 = 5;
    /// What the device is.
    pub const SYSTEM: u8 = 6;
    /// The USB side.
    pub const USB: u8 = 9;
}

use module::{APS, DVS, IMU, INPUT, MULTIPLEXER, SYSTEM, USB};

/// Columns and rows.
pub const SIZE: (u16, u16) = (346, 260);
/// Logic, ADC and USB clocks, megahertz.
pub const CLOCKS_MHZ: [u32; 3] = [90, 30, 80];

/// What a unit says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Unit {
    pub master: bool,
    pub logic_version: u32,
    pub logic_patch: u32,
    /// True rate of the clocks over the nominal one, thousandths.
    pub deviation: u32,
    pub dvs_orientation: u32,
    pub aps_orientation: u32,
    pub imu_orientation: u32,
}

/// The store, with the fields that the model acts upon.
#[derive(Clone, Debug)]
pub(super) struct Parameters {
    values: BTreeMap<(u8, u8), u32>,
    unit: Unit,
}

impl Parameters {
    /// After power-on.
    pub(super) fn new(unit: Unit) -> Self {
        let (width, height) = (u32::from(SIZE.0), u32::from(SIZE.1));
        // The region of frames is in columns and rows of the readout, which may be exchanged.
        let (columns, rows) = if unit.aps_orientation >> 2 & 1 == 1 { (height, width) } else { (width, height) };
        let values = BTreeMap::from([
            ((MULTIPLEXER, 80), 1), // statistics are there
            ((DVS, 0), width),
            ((DVS, 1), height),
            ((DVS, 2), unit.dvs_orientation),
            // Filters that the logic has: pixels, background activity, region, skipping, polarity.
            ((DVS, 10), 1),
            ((DVS, 30), 1),
            ((DVS, 40), 1),
            ((DVS, 50), 1),
            ((DVS, 60), 1),
            ((APS, 0), width),
            ((APS, 1), height),
            ((APS, 2), unit.aps_orientation),
            ((APS, 6), 1), // has a global shutter
            ((APS, 7), 1),
            ((APS, 10), columns - 1),
            ((APS, 11), rows - 1),
            ((APS, 12), 4000 * CLOCKS_MHZ[1]),
            ((APS, 13), 40_000 * CLOCKS_MHZ[1]),
            ((IMU, 0), 2), // InvenSense 9250
            ((IMU, 1), unit.imu_orientation),
            ((SYSTEM, 0), unit.logic_version),
            ((SYSTEM, 1), 5), // the chip: a DAVIS346
            ((SYSTEM, 2), u32::from(unit.master)),
            ((SYSTEM, 3), CLOCKS_MHZ[0]),
            ((SYSTEM, 4), CLOCKS_MHZ[1]),
            ((SYSTEM, 5), CLOCKS_MHZ[2]),
            ((SYSTEM, 6), unit.deviation),
            ((SYSTEM, 7), unit.logic_patch),
            ((USB, 1), 8 * 125 * CLOCKS_MHZ[2]),
        ]);
        Self { values, unit }
    }

    pub(super) fn reset(&mut self) {
        *self = Self::new(self.unit);
    }

    pub(super) fn unit(&self) -> Unit {
        self.unit
    }

    /// What is stored; parameters that were never written hold zero.
    pub(super) fn read(&self, module: u8, parameter: u8) -> u32 {
        self.values.get(&(module, parameter)).copied().unwrap_or(0)
    }

    pub(super) fn is_on(&self, module: u8, parameter: u8) -> bool {
        self.read(module, parameter) & 1 == 1
    }

    /// The host writes. What tells what the device is cannot be written.
    pub(super) fn write(&mut self, module: u8, parameter: u8, value: u32) {
        let fixed = match module {
            SYSTEM => true,
            MULTIPLEXER => parameter >= 80,
            DVS => matches!(parameter, 0..=2 | 10 | 30 | 40 | 50 | 60),
            APS => matches!(parameter, 0..=2 | 6),
            IMU => parameter <= 1,
            _ => false,
        };
        if !fixed {
            self.values.insert((module, parameter), value);
        }
    }

    /// Whether words leave the device.
    pub(super) fn is_streaming(&self) -> bool {
        self.is_on(MULTIPLEXER, 0) && self.is_on(MULTIPLEXER, 1) && self.is_on(USB, 0)
    }

    pub(super) fn chip_runs(&self) -> bool {
        self.is_on(MULTIPLEXER, 3)
    }

    fn microseconds(&self, cycles: u32, clock_mhz: u32) -> u64 {
        let mhz = f64::from(clock_mhz) * f64::from(self.unit.deviation.max(1)) / 1000.0;
        (f64::from(cycles) / mhz).round() as u64
    }

    /// From one packet on the bus to the next at most, microseconds.
    pub(super) fn packet_period_us(&self) -> i64 {
        self.microseconds(self.read(USB, 1), CLOCKS_MHZ[2]).clamp(125, 100_000) as i64
    }

    /// Exposure and period of frames, microseconds, if frames are taken.
    pub(super) fn frames_us(&self) -> Option<(u64, u64)> {
        let on = self.chip_runs() && self.is_on(APS, 4);
        let us = |parameter| self.microseconds(self.read(APS, parameter), CLOCKS_MHZ[1]);
        on.then(|| (us(12), us(13).max(1)))
    }

    /// First and last column and row of frames, in the readout's own order.
    pub(super) fn frame_region(&self, columns: u16, rows: u16) -> [u16; 4] {
        let within = |parameter, count: u16| (self.read(APS, parameter).min(u32::from(count) - 1)) as u16;
        [within(8, columns), within(9, rows), within(10, columns), within(11, rows)]
    }

    pub(super) fn input_runs(&self) -> bool {
        self.is_on(INPUT, 0)
    }

    /// Which parts of the inertial unit run: acceleration, rotation, temperature.
    pub(super) fn imu_runs(&self) -> [bool; 3] {
        [self.is_on(IMU, 2), self.is_on(IMU, 3), self.is_on(IMU, 4)]
    }

    /// From one inertial sample to the next, microseconds.
    pub(super) fn imu_period_us(&self) -> u64 {
        1000 * (1 + u64::from(self.read(IMU, 5) & 0xff))
    }

    /// Codes of the full scales of acceleration (2, 4, 8, 16 g) and rotation (250, 500, 1000, 2000 degrees a second).
    pub(super) fn imu_scales(&self) -> [u16; 2] {
        [(self.read(IMU, 7) & 3) as u16, (self.read(IMU, 10) & 3) as u16]
    }
}
