//! Where decoders put what they find.

/// A change detected: at device time `t_us` the log intensity of pixel (`x`, `y`) rose (`on`) or fell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CdEvent {
    /// Device time without roll-overs, microseconds.
    pub t_us: u64,
    /// Column, 0 at the left.
    pub x: u16,
    /// Row, 0 at the top.
    pub y: u16,
    /// Whether the intensity rose.
    pub on: bool,
}

/// An edge at a trigger input of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Device time, microseconds.
    pub t_us: u64,
    /// The input; 0 where there is one.
    pub channel: u8,
    /// Whether the input rose.
    pub rising: bool,
}

/// A sample of the inertial unit, in the units of AEDAT4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Device time, microseconds.
    pub t_us: u64,
    /// Temperature, degrees Celsius.
    pub temperature: f32,
    /// Acceleration along x, y, z, in g.
    pub accelerometer: [f32; 3],
    /// Rotation about x, y, z, degrees per second.
    pub gyroscope: [f32; 3],
}

/// A frame of the sensor's own pixels, exposed on the same clock as its events.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ApsFrame {
    /// Start of the exposure, device time, microseconds.
    pub exposure_start_us: u64,
    /// End of the exposure, device time, microseconds.
    pub exposure_end_us: u64,
    /// Columns.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Grey levels row by row; [`ApsFrame::bits`] of them count.
    pub pixels: Vec<u16>,
    /// Significant bits of a pixel: 8, 10 or 16.
    pub bits: u8,
}

/// Where a decoder puts what it finds, in the order of the stream. What a sink does not name it ignores.
pub trait Sink {
    /// A change was detected.
    fn event(&mut self, event: CdEvent);

    /// A trigger input changed.
    fn edge(&mut self, _edge: Edge) {}

    /// The inertial unit was read.
    fn imu(&mut self, _sample: ImuSample) {}

    /// A frame is complete.
    fn frame(&mut self, _frame: ApsFrame) {}

    /// The sensor reported on itself: a vendor subtype (EVT3 `OTHERS`: 0x014 events before, 0x016 events after the
    /// event-rate controller) and its payload.
    fn monitor(&mut self, _t_us: u64, _subtype: u16, _payload: u64) {}

    /// Time is not continuous from here on: data was lost, or the device restarted its clock. What follows starts at
    /// `t_us`, and how long the gap was is unknown.
    fn discontinuity(&mut self, _t_us: u64) {}
}
