//! The encoder of DAVIS words.

use super::{
    super::{ApsFrame, CdEvent, EncodeError, ImuSample, Mark},
    DavisLayout,
};

/// Encodes the words of a DAVIS whose layout is [`DavisLayout::default`] but for its size.
#[derive(Clone, Debug)]
pub struct DavisEncoder {
    layout: DavisLayout,
    wraps: u64,
    t_us: Option<u64>,
    row: Option<u16>,
}

impl DavisEncoder {
    /// The longest gap between two items, microseconds: about a year.
    pub const MAX_GAP_US: u64 = 1 << 45;
    /// Ranges of the inertial samples: 8 g and 1000 degrees a second.
    const RANGES: u16 = 0b1010;

    /// An encoder at the start of a stream, at time 0.
    #[must_use]
    pub fn new(layout: DavisLayout) -> Self {
        let size = layout.size;
        Self { layout: DavisLayout { size, ..DavisLayout::default() }, wraps: 0, t_us: None, row: None }
    }

    /// Appends an event.
    ///
    /// # Errors
    /// If the event goes back in time, too far forward, or lies outside the sensor.
    pub fn event(&mut self, event: CdEvent, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let CdEvent { t_us, x, y, on } = event;
        let size = self.layout.size;
        if x >= size.width || y >= size.height {
            return Err(EncodeError::Address { x, y, limit: size.width.max(size.height) - 1 });
        }
        self.time(t_us, out)?;
        if self.row != Some(y) {
            word(1, y, out);
            self.row = Some(y);
        }
        word(2 + u16::from(on), x, out);
        Ok(())
    }

    /// Appends a mark: edges of the external input and of the generator, and the reset of the clock, which goes on from
    /// zero. Marks of frames come with [`DavisEncoder::frame`].
    ///
    /// # Errors
    /// If the mark goes back in time or too far forward.
    pub fn mark(&mut self, t_us: u64, mark: Mark, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        self.time(t_us, out)?;
        match mark {
            Mark::TimestampReset => {
                word(0, 1, out);
                (self.wraps, self.t_us, self.row) = (0, Some(0), None);
            }
            Mark::ExternalFalling => word(0, 2, out),
            Mark::ExternalRising => word(0, 3, out),
            Mark::ExternalPulse => word(0, 4, out),
            Mark::GeneratorFalling => word(0, 16, out),
            Mark::GeneratorRising => word(0, 17, out),
            Mark::FrameBegin | Mark::FrameEnd | Mark::ExposureBegin | Mark::ExposureEnd => {}
        }
        Ok(())
    }

    /// Appends an inertial sample, rounded to the steps of ranges of 8 g and 1000 degrees a second. What is NaN is said to be off.
    ///
    /// # Errors
    /// If the sample goes back in time or too far forward.
    pub fn imu(&mut self, sample: ImuSample, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        self.time(sample.t_us, out)?;
        let scale = |value: f32, full_scale: f32| (value / full_scale * 32768.0).round();
        let groups = [
            (7, sample.accelerometer.map(|value| scale(value, 8.0)).to_vec()),
            (5, vec![((sample.temperature - 35.0) * 340.0).round()]),
            (6, sample.gyroscope.map(|value| scale(value, 1000.0)).to_vec()),
        ];
        let measured = || groups.iter().filter(|(_, values)| !values.iter().any(|value| value.is_nan()));
        word(0, 5, out);
        word(5, 3 << 8 | measured().fold(Self::RANGES, |scales, (bit, _)| scales | 1 << bit), out);
        for byte in measured().flat_map(|(_, values)| values).flat_map(|&value| (value as i16).to_be_bytes()) {
            word(5, byte.into(), out);
        }
        word(0, 7, out);
        Ok(())
    }

    /// Appends a frame of grey levels of at most 10 bits that fills the sensor, from its exposure's start to its end.
    ///
    /// # Errors
    /// If the exposure starts before the last item, or the frame is of another size or kind.
    pub fn frame(&mut self, frame: &ApsFrame, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let size = self.layout.size;
        let (width, height) = (usize::from(size.width), usize::from(size.height));
        let fits = (frame.width, frame.height, frame.channels) == (size.width, size.height, 1);
        if !fits || frame.bits > 10 || frame.pixels.len() != width * height {
            return Err(EncodeError::Address { x: frame.width, y: frame.height, limit: size.width.max(size.height) });
        }
        self.time(frame.exposure_start_us, out)?;
        word(0, 8, out);
        word(0, 14, out);
        for _ in 0..width {
            word(0, 11, out);
            (0..height).for_each(|_| word(4, 1023, out));
            word(0, 13, out);
        }
        self.time(frame.exposure_end_us, out)?;
        word(0, 15, out);
        for x in 0..width {
            let levels = (0..height).map(|y| 1023 - frame.pixels[y * width + x].min(1023));
            word(0, 12, out);
            levels.for_each(|level| word(4, level, out));
            word(0, 13, out);
        }
        word(0, 10, out);
        Ok(())
    }

    fn time(&mut self, t_us: u64, out: &mut Vec<u8>) -> Result<(), EncodeError> {
        let before = self.t_us.unwrap_or(0);
        EncodeError::check_time(before, t_us, Self::MAX_GAP_US)?;
        while self.wraps < t_us >> 15 {
            let count = ((t_us >> 15) - self.wraps).min(0xFFF);
            word(7, count as u16, out);
            self.wraps += count;
        }
        if self.t_us != Some(t_us) {
            out.extend((0x8000 | (t_us & 0x7FFF) as u16).to_le_bytes());
            self.t_us = Some(t_us);
        }
        Ok(())
    }
}

fn word(kind: u16, content: u16, out: &mut Vec<u8>) {
    out.extend((kind << 12 | content).to_le_bytes());
}
