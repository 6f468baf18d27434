//! Sequences of register writes that bring the IMX636 up, start, stop and shut it down, as data with one interpreter.
//!
//! Source: OpenEB 5.1.1, `hal_psee_plugins/include/devices/imx636/imx636_evk3_issd.h`, which its vendor generates. Most
//! of the registers have no public description. Delays are honoured to the microsecond (OpenEB rounds those below a
//! millisecond to none).

use std::time::Duration;

/// A step of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// Write a value to a register.
    Write(u32, u32),
    /// Change the bits of a mask (third) in a register (first) to those of a value (second).
    Change(u32, u32, u32),
    /// Wait, microseconds.
    Wait(u64),
}

use Op::{Change, Wait, Write};

/// What a sequence is played into.
pub trait Registers {
    /// Why a write failed.
    type Error;
    /// Writes a register.
    ///
    /// # Errors
    /// If the device does not take it.
    fn write(&mut self, address: u32, value: u32) -> Result<(), Self::Error>;
    /// Changes the bits of `mask`.
    ///
    /// # Errors
    /// If the device does not take it.
    fn change(&mut self, address: u32, mask: u32, value: u32) -> Result<(), Self::Error>;
    /// Waits.
    fn wait(&mut self, duration: Duration);
}

/// Plays a sequence.
///
/// # Errors
/// The first error of `registers`; what follows is not written.
pub fn play<R: Registers>(sequence: &[Op], registers: &mut R) -> Result<(), R::Error> {
    for &step in sequence {
        match step {
            Write(address, value) => registers.write(address, value)?,
            Change(address, value, mask) => registers.change(address, mask, value)?,
            Wait(microseconds) => registers.wait(Duration::from_micros(microseconds)),
        }
    }
    Ok(())
}

/// From power-on, or from whatever state [`STOP`] and [`DESTROY`] left, to configured and silent.
#[rustfmt::skip]
pub const INIT: &[Op] = &[
    // Reset.
    Write(0x001C, 0x0000_0001), Wait(1_000_000),
    Write(0x40_0004, 0x0000_0001), Wait(500_000),
    Write(0x40_0004, 0x0000_0000), Wait(1_000_000),
    // MIPI transmitter off.
    Write(0xB000, 0x0000_0158), Wait(300),
    Write(0xB044, 0x0000_0000), Write(0xB004, 0x0000_000A), Write(0xB040, 0x0000_0000), Write(0xB0C8, 0x0000_0000),
    Write(0xB040, 0x0000_0000), Write(0xB040, 0x0000_0000),
    // Clocks.
    Write(0x0000, 0x4F00_6442), Write(0x0000, 0x0F00_6442), Write(0x00B8, 0x0000_0400), Write(0x00B8, 0x0000_0400),
    Write(0xB07C, 0x0000_0000), Write(0xB074, 0x0000_0002), Write(0xB078, 0x0000_00A0),
    Write(0x00C0, 0x0000_0110), Write(0x00C0, 0x0000_0210), Write(0xB120, 0x0000_0001), Write(0xE120, 0x0000_0000),
    Write(0xB068, 0x0000_0004), Write(0xB07C, 0x0000_0001), Wait(10),
    Write(0xB07C, 0x0000_0003), Wait(1000),
    Write(0x00B8, 0x0000_0401), Write(0x00B8, 0x0000_0409), Write(0x0000, 0x4F00_6442), Write(0x0000, 0x4F00_644A),
    // MIPI timing.
    Write(0xB080, 0x0000_0077), Write(0xB084, 0x0000_000F), Write(0xB088, 0x0000_0037), Write(0xB08C, 0x0000_0037),
    Write(0xB090, 0x0000_00DF), Write(0xB094, 0x0000_0057), Write(0xB098, 0x0000_0037), Write(0xB09C, 0x0000_0067),
    Write(0xB0A0, 0x0000_0037), Write(0xB0A4, 0x0000_002F), Write(0xB0AC, 0x0000_0028), Write(0xB0CC, 0x0000_0001),
    Write(0xB000, 0x0000_02F8), Write(0xB004, 0x0000_008A), Write(0xB01C, 0x0000_0030), Write(0xB020, 0x0000_2000),
    Write(0xB02C, 0x0000_00FF), Write(0xB030, 0x0000_3E80), Write(0xB028, 0x0000_0FA0),
    // Analogue supplies.
    Write(0xA000, 0x000B_0501), Wait(200),
    Write(0xA008, 0x0000_2405), Wait(200),
    Write(0xA004, 0x000B_0501), Wait(200),
    Write(0xA020, 0x0000_0150), Wait(200),
    // MIPI transmitter on.
    Write(0xB040, 0x0000_0007), Write(0xB064, 0x0000_0006), Write(0xB040, 0x0000_000F), Wait(100),
    Write(0xB004, 0x0000_008A), Wait(200),
    Write(0xB0C8, 0x0000_0003), Wait(200),
    Write(0xB044, 0x0000_0001), Write(0xB000, 0x0000_02F9),
    // Event pipeline and read-out.
    Write(0x7008, 0x0000_0001), Write(0x7000, 0x0007_0001), Write(0x8000, 0x0001_E085), Write(0x9008, 0x0000_0644),
    Write(0x0004, 0xF000_5042), Write(0x0018, 0x0000_0200), Write(0x1014, 0x11A1_504D), Write(0x9004, 0x0000_0000),
    Wait(1000),
    Write(0x9000, 0x0000_0200),
];

/// Starts the time base and the pixels.
#[rustfmt::skip]
pub const START: &[Op] = &[
    Write(0xB000, 0x0000_02F9),
    Write(0x9028, 0x0000_0000),
    Change(0x9008, 0x0000_0001, 0x0000_0001),
    Write(0x002C, 0x0022_C724),
    Change(0x0004, 0x0000_0400, 0x0000_0400),
];

/// Stops the pixels and the time base.
#[rustfmt::skip]
pub const STOP: &[Op] = &[
    Change(0x0004, 0x0000_0000, 0x0000_0400),
    Write(0x002C, 0x0022_C324),
    Write(0x9028, 0x0000_0002), Wait(1000),
    Change(0x9008, 0x0000_0000, 0x0000_0001),
    Write(0xB000, 0x0000_02F8), Wait(300),
];

/// Powers the sensor down.
#[rustfmt::skip]
pub const DESTROY: &[Op] = &[
    Write(0x0070, 0x0040_0008),
    Write(0x006C, 0x0EE4_7114), Wait(500),
    Write(0xA00C, 0x0002_0400), Wait(500),
    Write(0xA010, 0x0000_8068), Wait(200),
    Write(0x1104, 0x0000_0000), Wait(200),
    Write(0xA020, 0x0000_0050), Wait(200),
    Write(0xA004, 0x000B_0500), Wait(200),
    Write(0xA008, 0x0000_2404), Wait(200),
    Write(0xA000, 0x000B_0500),
    Write(0xB044, 0x0000_0000), Write(0xB004, 0x0000_000A), Write(0xB040, 0x0000_000E), Write(0xB0C8, 0x0000_0000),
    Write(0xB040, 0x0000_0006), Write(0xB040, 0x0000_0004),
    Write(0x0000, 0x4F00_6442), Write(0x0000, 0x0F00_6442), Write(0x00B8, 0x0000_0401), Write(0x00B8, 0x0000_0400),
    Write(0xB07C, 0x0000_0000),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::evk4::treuzell::{Property, request};

    #[test]
    fn sequences_have_the_vendors_counts() {
        let count = |sequence: &[Op]| {
            let waits = sequence.iter().filter(|op| matches!(op, Wait(_))).count();
            (sequence.len() - waits, waits)
        };
        assert_eq!(count(INIT), (67, 14));
        assert_eq!(count(START), (5, 0));
        assert_eq!(count(STOP), (5, 2));
        assert_eq!(count(DESTROY), (20, 7));
    }

    /// Turns a sequence into the bytes of its frames; registers read as what was written last, or 0.
    #[derive(Default)]
    struct Wire {
        bytes: Vec<u8>,
        registers: std::collections::BTreeMap<u32, u32>,
        waited: Duration,
    }

    impl Registers for Wire {
        type Error = std::convert::Infallible;
        fn write(&mut self, address: u32, value: u32) -> Result<(), Self::Error> {
            self.registers.insert(address, value);
            self.bytes.extend(request(Property::WriteRegisters, &[0, address, value]));
            Ok(())
        }
        fn change(&mut self, address: u32, mask: u32, value: u32) -> Result<(), Self::Error> {
            let before = self.registers.get(&address).copied().unwrap_or(0);
            self.write(address, before & !mask | value & mask)
        }
        fn wait(&mut self, duration: Duration) {
            self.waited += duration;
        }
    }

    #[test]
    fn start_and_stop_after_init_send_these_bytes() {
        let mut wire = Wire::default();
        let Ok(()) = play(INIT, &mut wire);
        assert_eq!(wire.bytes.len(), 67 * 20);
        assert_eq!(wire.waited, Duration::from_micros(2_503_610));
        let expect = |frames: &[[u32; 2]]| -> Vec<u8> {
            let head = [2, 1, 1, 0x40, 12, 0, 0, 0, 0, 0, 0, 0];
            let frame =
                |[address, value]: &[u32; 2]| [head.as_slice(), &address.to_le_bytes(), &value.to_le_bytes()].concat();
            frames.iter().flat_map(frame).collect()
        };
        wire.bytes.clear();
        let Ok(()) = play(START, &mut wire);
        let on = [[0xB000, 0x2F9], [0x9028, 0], [0x9008, 0x645], [0x2C, 0x22_C724], [0x4, 0xF000_5442]];
        assert_eq!(wire.bytes, expect(&on));
        wire.bytes.clear();
        let Ok(()) = play(STOP, &mut wire);
        let off = [[0x4, 0xF000_5042], [0x2C, 0x22_C324], [0x9028, 2], [0x9008, 0x644], [0xB000, 0x2F8]];
        assert_eq!(wire.bytes, expect(&off));
    }

    #[test]
    fn every_frame_of_init_and_destroy_is_pinned() {
        // FNV-1a of the bytes on the wire. A change here is a change of what the camera is told.
        let digest = |sequence| {
            let mut wire = Wire::default();
            let Ok(()) = play(sequence, &mut wire);
            wire.bytes
                .iter()
                .fold(0xCBF2_9CE4_8422_2325_u64, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
        };
        assert_eq!(digest(INIT), INIT_DIGEST);
        assert_eq!(digest(DESTROY), DESTROY_DIGEST);
    }

    const INIT_DIGEST: u64 = 0xE7C3_D582_C583_1956;
    const DESTROY_DIGEST: u64 = 0x651E_5978_F6E7_48EE;
}
