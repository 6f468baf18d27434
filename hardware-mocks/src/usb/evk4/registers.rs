//! The registers of the IMX636, as far as a host can tell their effect. Addresses and fields: OpenEB's register map
//! (`imx636_registermap.h`) and start sequences (`imx636_evk3_issd.h`).

use std::collections::BTreeMap;

use crate::usb::clock::ClockMode;

use super::words::Format;

/// The part of a bias register that is not its value.
const BIAS_FLAGS: u32 = 0x11a1_0000;

/// Factory settings of the biases (`bias_pr` to the ones without a name), by register.
pub const BIASES: [(u32, u8); 13] = [
    (0x1000, 0x7c), // pr
    (0x1004, 0x53), // fo
    (0x100c, 0x00), // hpf
    (0x1010, 0x66), // diff_on
    (0x1014, 0x4d), // diff
    (0x1018, 0x49), // diff_off
    (0x101c, 0x5b), // inv
    (0x1020, 0x14), // refr
    (0x1040, 0x8c), // reqpuy
    (0x1044, 0x7c), // reqpux
    (0x1048, 0x94), // sendreqpdy
    (0x104c, 0x74),
    (0x1050, 0x51),
];

/// How long a pixel is blind after an event, as the sensor measures it, microseconds.
const DEAD_TIME_US: u32 = 20;

/// Columns and rows.
pub const SIZE: (u16, u16) = (1280, 720);

/// The store, with the fields that the model acts upon.
#[derive(Clone, Debug)]
pub(super) struct Registers {
    values: BTreeMap<u32, u32>,
    /// The window masks as they were when the host last had them applied.
    applied: BTreeMap<u32, u32>,
    /// Counts the changes of what is masked.
    masks: u64,
    trim: [i8; 13],
    temperature_c: f64,
}

impl Registers {
    /// After power-on. `trim` is what the factory added to the biases of this unit.
    pub(super) fn new(trim: [i8; 13], temperature_c: f64) -> Self {
        let mut values = BTreeMap::from([
            (0x0014, 0xa040_1806), // chip identification
            (0x0044, 0xccff_fccf), // pads
            (0x0004, 0xf000_5042),
            (0x003c, u32::from(SIZE.1 - 1) << 16 | u32::from(SIZE.0 - 1)), // last row and column of the window
            (0x9008, 0x0000_0644),
            (0x9028, 0x0000_0002),
        ]);
        for ((address, value), trim) in BIASES.into_iter().zip(trim) {
            values.insert(address, BIAS_FLAGS | u32::from(value.saturating_add_signed(trim)));
        }
        Self { values, applied: BTreeMap::new(), masks: 0, trim, temperature_c }
    }

    pub(super) fn reset(&mut self) {
        *self = Self { masks: self.masks + 1, ..Self::new(self.trim, self.temperature_c) };
    }

    /// What is stored; registers that were never written hold zero.
    pub(super) fn stored(&self, address: u32) -> u32 {
        self.values.get(&address).copied().unwrap_or(0)
    }

    fn bit(&self, address: u32, bit: u32) -> bool {
        self.stored(address) >> bit & 1 == 1
    }

    /// What the host reads.
    pub(super) fn read(&self, address: u32) -> u32 {
        match address {
            // Temperature: done after a conversion of the sensor was started (004C: enabled, clocked, started).
            0x0050 if self.stored(0x004c) & 7 == 7 => {
                1 << 11 | (((self.temperature_c + 56.0) / 0.19).round() as u32 & 0x3ff)
            }
            // Illumination: the time of a discharge, valid while the counter runs.
            0x0010 if self.stored(0x000c) & 7 == 7 => 1 << 29 | 12_345,
            // The pixels' dead time: counted, at 200 a microsecond, while the circuit and its counter are on.
            0x0020 if self.stored(0x0020) >> 30 == 0b11 => 0b11 << 30 | 1 << 28 | (200 * DEAD_TIME_US),
            // Initialisation of the filters' memories is done as soon as it is asked for.
            0xc0c4 | 0xd0c4 => self.stored(address) | 1 << 2,
            _ => self.stored(address),
        }
    }

    /// The host writes. Writing 1 to 400004 resets the sensor.
    pub(super) fn write(&mut self, address: u32, value: u32) {
        if address == 0x0040_0004 && value & 1 == 1 {
            self.reset();
        }
        let mut value = value;
        if address == 0x0004 {
            // Bit 5 applies the window masks, and reads back as zero.
            if value >> 5 & 1 == 1 {
                self.applied = self.values.range(0x2000..0x4060).map(|(&address, &value)| (address, value)).collect();
            }
            value &= !(1 << 5);
            self.masks += 1;
        }
        if (0x9100..0x9200).contains(&address) {
            self.masks += 1;
        }
        // Bit 0 makes window masks of the two corners, and bit 1 tells that they are made until it is written.
        if address == 0x0034 && value & !self.stored(address) & 1 == 1 {
            self.make_window();
            value |= 1 << 1;
        }
        match address {
            0x0014 | 0x0050 | 0x0010 | 0xf128 => {}
            _ => {
                self.values.insert(address, value);
            }
        }
    }

    /// Masks all columns and rows but those of the window, whose last ones belong to it: so the register of the end says
    /// before anybody writes to it.
    fn make_window(&mut self) {
        let [start, end] = [0x0038, 0x003c].map(|address| self.stored(address));
        for (base, length, at, field) in [(0x2000, SIZE.0, 0, 0x7ff), (0x4000, SIZE.1, 16, 0x3ff)] {
            let kept = (start >> at & field)..=(end >> at & field);
            for word in 0..u32::from(length).div_ceil(32) {
                let mask = (0..32).fold(0, |bits, bit| bits | u32::from(!kept.contains(&(32 * word + bit))) << bit);
                self.values.insert(base + 4 * word, mask);
            }
        }
    }

    /// Whether pixels are read out and words leave the sensor: clocks up, link up, readout not held in reset.
    pub(super) fn is_streaming(&self) -> bool {
        self.bit(0x0004, 10)
            && self.bit(0x002c, 10)
            && self.bit(0x9008, 0)
            && !self.bit(0x9028, 1)
            && self.stored(0xb000) & 0x3ff == 0x2f9
            && self.bit(0xa000, 0)
            && self.bit(0xb044, 0)
    }

    /// How the counter of time runs, if it does.
    pub(super) fn clock(&self) -> Option<ClockMode> {
        let control = self.stored(0x9008);
        // Bits 0 to 3: enable, external, master, external enable. A pulse of the base clock is 1 us at 100 (bits 4-10).
        let enabled = control & 1 == 1 && control >> 4 & 0x7f == 100;
        let master_pad = self.stored(0x0044) >> 16 & 0xf == 0b1100;
        enabled.then_some(match control >> 1 & 7 {
            0b111 if master_pad => ClockMode::Master,
            0b101 => ClockMode::Slave,
            _ => ClockMode::Standalone,
        })
    }

    /// The output format; `None` for settings that give none.
    pub(super) fn format(&self) -> Option<Format> {
        match (self.bit(0x7000, 1), self.stored(0x8000) >> 6 & 3) {
            (false, 2) => Some(Format::Evt3),
            (true, 0) => Some(Format::Evt21Legacy),
            _ => None,
        }
    }

    /// Whether edges at the trigger input enter the stream.
    pub(super) fn trigger_enabled(&self) -> bool {
        self.bit(0x7004, 10)
    }

    /// From one packet on the link to the next at least, microseconds.
    pub(super) fn frame_period_us(&self) -> i64 {
        i64::from(self.stored(0xb028)).clamp(100, 1_000_000)
    }

    /// The event-rate controller: period in microseconds, and events per period.
    pub(super) fn rate_control(&self) -> Option<(u64, u64)> {
        let on = self.counts_rate() && self.bit(0x6050, 0);
        on.then(|| (u64::from(self.stored(0x6008) & 0x3ff).max(1), u64::from(self.stored(0x600c) & 0x3f_ffff)))
    }

    /// Whether the event-rate controller's block runs, and reports what it counts.
    pub(super) fn counts_rate(&self) -> bool {
        self.bit(0x6000, 0)
    }

    /// Changes whenever what is masked may have changed.
    pub(super) fn masks(&self) -> u64 {
        self.masks
    }

    /// Which pixels are switched off, row by row: the window masks and the slots of hot pixels. Rows of the registers
    /// count from the bottom. `None` if there are none.
    pub(super) fn masked(&self) -> Option<Vec<bool>> {
        let (width, height) = (u32::from(SIZE.0), u32::from(SIZE.1));
        let slots: Vec<u32> =
            (0..64).map(|index| self.stored(0x9100 + 4 * index)).filter(|slot| slot >> 31 == 1).collect();
        // Bit 1: whether the window masks count.
        let windows = self.bit(0x0004, 1) && self.applied.values().any(|&word| word != 0);
        if slots.is_empty() && !windows {
            return None;
        }
        let flag = |base: u32, index: u32| {
            windows && self.applied.get(&(base + index / 32 * 4)).is_some_and(|word| word >> (index % 32) & 1 == 1)
        };
        let columns: Vec<bool> = (0..width).map(|x| flag(0x2000, x)).collect();
        // Bit 6: a pixel is off if its column or its row is; otherwise if both are.
        let either = self.bit(0x0004, 6);
        let off = |row: bool, column: bool| if either { row || column } else { row && column };
        let mut masked: Vec<bool> = (0..height)
            .map(|y| flag(0x4000, height - 1 - y))
            .flat_map(|row| columns.iter().map(move |&column| off(row, column)))
            .collect();
        for slot in slots {
            let (x, y) = (slot & 0x7ff, slot >> 16 & 0x3ff);
            if x < width && y < height {
                masked[((height - 1 - y) * width + x) as usize] = true;
            }
        }
        masked.contains(&true).then_some(masked)
    }
}
