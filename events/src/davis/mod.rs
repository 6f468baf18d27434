//! The stream of a DAVIS: 16-bit little-endian words. (libcaer, `davis_common.h`, for the meaning of the words.)
//!
//! | bits 15 to 12 | content |
//! |---|---|
//! | 1xxx | low 15 bits of the time, microseconds |
//! | 0 | special: 1 clock reset; 2, 3, 4 input falls, rises, pulses; 5, 7 inertial sample begins, ends; 8, 9 frame begins (global, rolling shutter); 10 frame ends; 11, 12 column of reset, signal levels begins; 13 column ends; 14, 15 exposure begins, ends; 16, 17 generator falls, rises |
//! | 1 | row of the events that follow |
//! | 2, 3 | column: one event, OFF or ON |
//! | 4 | level of the frame's next pixel |
//! | 5 | sub-code in bits 8 to 11: 0 a byte of an inertial sample, 3 its scales |
//! | 6 | auto-exposure statistics; ignored |
//! | 7 | the low time rolled over this many times |

mod decode;
mod encode;
mod frame;
mod imu;

pub use decode::DavisDecoder;
pub use encode::DavisEncoder;

use super::SensorSize;

/// How a sensor is mounted on its chip and read out, as the device's registers say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DavisLayout {
    /// Size of the sensor.
    pub size: SensorSize,
    /// Events come with rows and columns exchanged (register 1/2, bit 2).
    pub events_transposed: bool,
    /// Frames come with rows and columns exchanged (register 2/2, bit 2).
    pub frames_transposed: bool,
    /// Frames come from right to left (register 2/2, bit 1).
    pub frames_flip_x: bool,
    /// Frames come from bottom to top (register 2/2, bit 0).
    pub frames_flip_y: bool,
    /// Axes of the inertial unit that point the other way (register 3/1, bits 2, 1 and 0).
    pub imu_flip: [bool; 3],
    /// The inertial unit is an InvenSense 9250 (register 3/0 is 2) and not a 6050 or 6150.
    pub imu_9250: bool,
}

impl Default for DavisLayout {
    /// A DAVIS346 whose registers are all zero.
    fn default() -> Self {
        Self {
            size: SensorSize { width: 346, height: 260 },
            events_transposed: false,
            frames_transposed: false,
            frames_flip_x: false,
            frames_flip_y: false,
            imu_flip: [false; 3],
            imu_9250: false,
        }
    }
}

impl DavisLayout {
    /// The layout that registers 1/2 (events), 2/2 (frames), 3/1 (inertial axes) and 3/0 (inertial type) tell.
    #[must_use]
    pub fn from_registers(size: SensorSize, events: u32, frames: u32, imu: u32, imu_type: u32) -> Self {
        let bit = |register: u32, bit: u32| register >> bit & 1 == 1;
        Self {
            size,
            events_transposed: bit(events, 2),
            frames_transposed: bit(frames, 2),
            frames_flip_x: bit(frames, 1),
            frames_flip_y: bit(frames, 0),
            imu_flip: [bit(imu, 2), bit(imu, 1), bit(imu, 0)],
            imu_9250: imu_type == 2,
        }
    }
}
