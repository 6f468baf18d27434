//! A sample of the inertial unit that is being read out: its scales, then 14 bytes, big-endian: acceleration, temperature,
//! rotation. What the scales say is off does not come.

use super::{super::sink::ImuSample, DavisLayout};

const ACCELEROMETER: usize = 0;
const TEMPERATURE: usize = 6;
const GYROSCOPE: usize = 8;

/// A sample that is being read out.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Reading {
    /// Bits 7, 6, 5: acceleration, rotation, temperature are there; bits 3 and 2, 1 and 0: their ranges.
    scales: Option<u8>,
    bytes: [u8; 14],
    /// Bytes that came.
    count: usize,
}

impl Reading {
    pub fn set_scales(&mut self, scales: u8) {
        self.scales = Some(scales);
    }

    fn places(scales: u8) -> impl Iterator<Item = usize> {
        let groups = [(7, ACCELEROMETER..TEMPERATURE), (5, TEMPERATURE..GYROSCOPE), (6, GYROSCOPE..14)];
        groups.into_iter().filter(move |(bit, _)| scales >> bit & 1 == 1).flat_map(|(_, places)| places)
    }

    /// Takes the next byte; `false` if it has no place.
    pub fn byte(&mut self, byte: u8) -> bool {
        let place = self.scales.and_then(|scales| Self::places(scales).nth(self.count));
        self.count += usize::from(place.is_some());
        place.map(|place| self.bytes[place] = byte).is_some()
    }

    /// The sample, if all of its bytes came. What is off is NaN.
    pub fn end(&self, layout: &DavisLayout, t_us: u64) -> Option<ImuSample> {
        let scales = self.scales.filter(|&scales| Self::places(scales).count() == self.count)?;
        let value = |place: usize| f32::from(i16::from_be_bytes([self.bytes[place], self.bytes[place + 1]]));
        let vector = |bit: u8, first: usize, full_scale: f32| {
            std::array::from_fn(|axis| {
                let sign = if layout.imu_flip[axis] { -1.0 } else { 1.0 };
                let there = scales >> bit & 1 == 1;
                if there { sign * value(first + 2 * axis) * full_scale / 32768.0 } else { f32::NAN }
            })
        };
        // InvenSense data sheets, as libcaer rounds them.
        let (slope, offset) = if layout.imu_9250 { (333.87, 21.0) } else { (340.0, 35.0) };
        let temperature = if scales >> 5 & 1 == 1 { value(TEMPERATURE) / slope + offset } else { f32::NAN };
        Some(ImuSample {
            t_us,
            temperature,
            accelerometer: vector(7, ACCELEROMETER, f32::from(2_u16 << (scales >> 2 & 3))),
            gyroscope: vector(6, GYROSCOPE, f32::from(250_u16 << (scales & 3))),
            magnetometer: [0.0; 3],
        })
    }
}
