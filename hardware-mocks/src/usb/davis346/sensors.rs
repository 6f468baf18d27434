//! What the sensors of the DAVIS346 put into its stream: events, frames, inertial samples, edges at the external input.

use std::collections::VecDeque;

use erfgs_events::CdEvent;

use super::{
    spi::{Parameters, SIZE},
    words::{COLUMN, Chunk, IMU_BYTE, IMU_TYPE, LEVEL, ROW, special},
};
use crate::usb::scene::FrameScene;

/// How long the readout of a column takes, microseconds (our choice; with 30 MHz and 260 rows it cannot be shorter).
const COLUMN_US: u64 = 10;
/// The level of a pixel after its reset.
const RESET_LEVEL: u16 = 900;

/// The words of events, in order: a row for each time and each change of row, then columns.
pub(super) fn events(events: &[CdEvent], inverted: bool, chunks: &mut Vec<Chunk>) {
    let (width, height) = SIZE;
    for group in events.chunk_by(|a, b| a.t_us == b.t_us) {
        let mut words = Vec::with_capacity(group.len() + 1);
        let mut last = None;
        for event in group.iter().filter(|event| event.x < width && event.y < height) {
            let (row, column) = if inverted { (event.x, event.y) } else { (event.y, event.x) };
            if last != Some(row) {
                words.push(ROW | row);
                last = Some(row);
            }
            words.push((COLUMN + (u16::from(event.on) << 12)) | column);
        }
        chunks.push(Chunk { t_us: group[0].t_us, words });
    }
}

/// Raw values of inertial sample `number`: acceleration along x, y, z, temperature, rotation about x, y, z. Gravity is
/// on the z axis; the others count, so that a receiver can tell the number modulo 1000.
#[must_use]
pub fn imu_sample(number: u64, acceleration_scale: u16) -> [i16; 7] {
    let count = (number % 1000) as i16;
    let gravity = 16384 >> acceleration_scale.min(3);
    // 25 degrees Celsius of a 9250: 21 + value / 333.87.
    [count, -count, gravity, 1335, count / 2, -count / 2, 7]
}

/// The inertial unit.
#[derive(Clone, Debug, Default)]
pub(super) struct Imu {
    next_us: Option<u64>,
    number: u64,
}

impl Imu {
    /// The time starts again.
    pub(super) fn restart(&mut self) {
        self.next_us = None;
    }

    /// The samples up to `end_us`; returns how many.
    pub(super) fn until(&mut self, parameters: &Parameters, end_us: u64, chunks: &mut Vec<Chunk>) -> u64 {
        let [acceleration, rotation, temperature] = parameters.imu_runs();
        if !(acceleration || rotation || temperature) {
            self.next_us = None;
            return 0;
        }
        let mut next = self.next_us.unwrap_or(end_us);
        let mut made = 0;
        while next <= end_us {
            let [acceleration_scale, rotation_scale] = parameters.imu_scales();
            let holds = u16::from(acceleration) << 7 | u16::from(rotation) << 6 | u16::from(temperature) << 5;
            let mut words = vec![special::IMU_START, IMU_TYPE | holds | acceleration_scale << 2 | rotation_scale];
            for (index, value) in imu_sample(self.number, acceleration_scale).into_iter().enumerate() {
                if [acceleration, temperature, rotation][usize::from(index >= 3) + usize::from(index >= 4)] {
                    words.extend(value.to_be_bytes().map(|byte| IMU_BYTE | u16::from(byte)));
                }
            }
            words.push(special::IMU_END);
            chunks.push(Chunk { t_us: next, words });
            next += parameters.imu_period_us();
            self.number += 1;
            made += 1;
        }
        self.next_us = Some(next);
        made
    }
}

/// The frame sensor.
pub(super) struct Frames {
    scene: Box<dyn FrameScene>,
    next_us: Option<u64>,
    number: u64,
    pending: VecDeque<Chunk>,
}

impl std::fmt::Debug for Frames {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Frames").field("number", &self.number).finish_non_exhaustive()
    }
}

impl Frames {
    pub(super) fn new(scene: Box<dyn FrameScene>) -> Self {
        Self { scene, next_us: None, number: 0, pending: VecDeque::new() }
    }

    /// Has the scene make what it knows ahead.
    pub(super) fn prepare(&mut self) {
        self.scene.known(u32::from(SIZE.0), u32::from(SIZE.1));
    }

    /// The time starts again; a frame that has begun is given up.
    pub(super) fn restart(&mut self) {
        self.next_us = None;
        self.pending.clear();
    }

    /// The words of frames up to `end_us`, which is the true time `end_ns`; returns how many frames were completed.
    pub(super) fn until(&mut self, parameters: &Parameters, end_us: u64, end_ns: i64, chunks: &mut Vec<Chunk>) -> u64 {
        let Some((exposure_us, period_us)) = parameters.frames_us() else {
            self.restart();
            return 0;
        };
        let mut completed = 0;
        loop {
            while let Some(chunk) = self.pending.pop_front_if(|chunk| chunk.t_us <= end_us) {
                completed += u64::from(chunk.words == [special::FRAME_END]);
                chunks.push(chunk);
            }
            let start = self.next_us.unwrap_or(end_us);
            if !self.pending.is_empty() || start > end_us {
                self.next_us = Some(start);
                return completed;
            }
            let start_ns = end_ns - (end_us - start) as i64 * 1000;
            self.expose(parameters, start, start_ns, exposure_us);
            let end = self.pending.back().map_or(start, |chunk| chunk.t_us);
            self.next_us = Some((start + period_us).max(end + 1));
        }
    }

    /// Takes a frame: the words of its readout.
    fn expose(&mut self, parameters: &Parameters, start_us: u64, start_ns: i64, exposure_us: u64) {
        let (width, height) = SIZE;
        let unit = parameters.unit();
        let inverted = unit.aps_orientation >> 2 & 1 == 1;
        let (columns, rows) = if inverted { (height, width) } else { (width, height) };
        let [left, top, right, bottom] = parameters.frame_region(columns, rows);
        let readout_us = COLUMN_US * u64::from(right.saturating_sub(left) + 1);
        let global = parameters.is_on(super::spi::module::APS, 7);
        // Global: all reset levels, the exposure, all signal levels. Rolling: each column is exposed as long, the first
        // one over the times that are told.
        let open = start_us + if global { readout_us } else { COLUMN_US };
        let close = open + exposure_us;
        let at_ns = |t_us: u64| start_ns + (t_us - start_us) as i64 * 1000;
        let (_, picture) =
            self.scene.frame(self.number, [at_ns(open), at_ns(close)], u32::from(width), u32::from(height));
        self.number += 1;
        let luma = picture.luma();

        let mut chunks = vec![Chunk { t_us: start_us, words: vec![special::FRAME_START + u16::from(!global)] }];
        for (signal, base) in [(false, start_us), (true, close)] {
            for (index, column) in (left..=right).enumerate() {
                let mut words = Vec::with_capacity(usize::from(bottom.saturating_sub(top)) + 3);
                words.push(special::COLUMN_START + u16::from(signal));
                for row in top..=bottom {
                    // Where this level belongs in the picture.
                    let row = if unit.aps_orientation & 1 == 1 { rows - 1 - row } else { row };
                    let column = if unit.aps_orientation >> 1 & 1 == 1 { columns - 1 - column } else { column };
                    let (x, y) = if inverted { (row, column) } else { (column, row) };
                    let bright = u16::from(luma[usize::from(y) * usize::from(width) + usize::from(x)]) * 2;
                    words.push(LEVEL | (RESET_LEVEL - if signal { bright } else { 0 }));
                }
                words.push(special::COLUMN_END);
                chunks.push(Chunk { t_us: base + COLUMN_US * index as u64, words });
            }
        }
        chunks.push(Chunk { t_us: open, words: vec![special::EXPOSURE_START] });
        chunks.push(Chunk { t_us: close, words: vec![special::EXPOSURE_START + 1] });
        chunks.push(Chunk { t_us: close + readout_us, words: vec![special::FRAME_END] });
        chunks.sort_by_key(|chunk| chunk.t_us);
        // The exposure ends before the first column of signal levels is read.
        if let Some(end) = chunks.iter().position(|chunk| chunk.words == [special::EXPOSURE_START + 1]) {
            let first = chunks.iter().position(|chunk| chunk.t_us == close).unwrap_or(end);
            chunks[first..=end].rotate_right(1);
        }
        self.pending.extend(chunks);
    }
}
