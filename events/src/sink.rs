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

/// A sample of the inertial unit, in the units of AEDAT4. What was switched off is NaN. Samples are equal if their bits are, so that the
/// same samples are, too, where something was off.
#[derive(Clone, Copy, Debug)]
pub struct ImuSample {
    /// Device time, microseconds.
    pub t_us: u64,
    /// Temperature, degrees Celsius.
    pub temperature: f32,
    /// Acceleration along x, y, z, in g.
    pub accelerometer: [f32; 3],
    /// Rotation about x, y, z, degrees per second.
    pub gyroscope: [f32; 3],
    /// Magnetic field along x, y, z, microtesla; zero where the unit has no magnetometer.
    pub magnetometer: [f32; 3],
}

impl ImuSample {
    /// Temperature, acceleration, rotation, magnetic field.
    pub(crate) fn values(&self) -> [f32; 10] {
        let Self {
            t_us: _,
            temperature,
            accelerometer: [ax, ay, az],
            gyroscope: [gx, gy, gz],
            magnetometer: [mx, my, mz],
        } = *self;
        [temperature, ax, ay, az, gx, gy, gz, mx, my, mz]
    }
}

impl PartialEq for ImuSample {
    fn eq(&self, other: &Self) -> bool {
        self.t_us == other.t_us && self.values().map(f32::to_bits) == other.values().map(f32::to_bits)
    }
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
    /// Samples of a pixel: 1 (grey), 3 (blue, green, red) or 4 (with alpha).
    pub channels: u8,
    /// Samples pixel by pixel and row by row; [`ApsFrame::bits`] of each count.
    pub pixels: Vec<u16>,
    /// Significant bits of a sample: 8, 10 or 16.
    pub bits: u8,
}

/// A mark in the stream of an iniVation sensor; the discriminants are those of AEDAT4's triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Mark {
    /// The device's clock was set to zero.
    TimestampReset = 0,
    /// The external input rose.
    ExternalRising = 1,
    /// The external input fell.
    ExternalFalling = 2,
    /// The external input pulsed.
    ExternalPulse = 3,
    /// The signal generator's output rose.
    GeneratorRising = 4,
    /// The signal generator's output fell.
    GeneratorFalling = 5,
    /// The readout of a frame began.
    FrameBegin = 6,
    /// The readout of a frame ended.
    FrameEnd = 7,
    /// The exposure of a frame began.
    ExposureBegin = 8,
    /// The exposure of a frame ended.
    ExposureEnd = 9,
}

impl Mark {
    /// All marks, by discriminant.
    pub const ALL: [Self; 10] = [
        Self::TimestampReset,
        Self::ExternalRising,
        Self::ExternalFalling,
        Self::ExternalPulse,
        Self::GeneratorRising,
        Self::GeneratorFalling,
        Self::FrameBegin,
        Self::FrameEnd,
        Self::ExposureBegin,
        Self::ExposureEnd,
    ];

    /// The mark with this discriminant.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The edge at an input of the sensor that the mark stands for, if it does: the external input is channel 0. A
    /// pulse counts as its rising edge.
    #[must_use]
    pub fn edge(self, t_us: u64) -> Option<Edge> {
        match self {
            Self::ExternalRising | Self::ExternalPulse => Some(Edge { t_us, channel: 0, rising: true }),
            Self::ExternalFalling => Some(Edge { t_us, channel: 0, rising: false }),
            _ => None,
        }
    }
}

/// Changes in columns of equal length, in the order of the stream.
#[derive(Clone, Copy, Debug)]
pub struct EventBatch<'a> {
    /// Device times, microseconds.
    pub t_us: &'a [u64],
    /// Columns.
    pub x: &'a [u16],
    /// Rows.
    pub y: &'a [u16],
    /// Polarities.
    pub on: &'a [bool],
}

impl EventBatch<'_> {
    /// The changes one by one.
    pub fn iter(&self) -> impl Iterator<Item = CdEvent> + '_ {
        self.t_us.iter().zip(self.x).zip(self.y.iter().zip(self.on)).map(|((&t_us, &x), (&y, &on))| CdEvent {
            t_us,
            x,
            y,
            on,
        })
    }
}

/// Where a decoder puts what it finds, in the order of the stream. What a sink does not name it ignores.
pub trait Sink {
    /// A change was detected.
    fn event(&mut self, event: CdEvent);

    /// What follows came in the packet of this number. Sessions tell it; files without packets do not.
    fn packet(&mut self, _sequence: u64) {}

    /// Changes were detected. Decoders hand events over in batches; a sink that wants columns takes them as they are.
    fn events(&mut self, batch: EventBatch<'_>) {
        batch.iter().for_each(|event| self.event(event));
    }

    /// An iniVation sensor marked a moment. Passes the edges of the external input on to [`Sink::edge`].
    fn mark(&mut self, t_us: u64, mark: Mark) {
        if let Some(edge) = mark.edge(t_us) {
            self.edge(edge);
        }
    }

    /// A trigger input changed.
    fn edge(&mut self, _edge: Edge) {}

    /// The inertial unit was read.
    fn imu(&mut self, _sample: ImuSample) {}

    /// A frame is complete.
    fn frame(&mut self, _frame: ApsFrame) {}

    /// The sensor reported on itself: a vendor subtype (EVT3 `OTHERS`: 0x014 events before, 0x016 events after the
    /// event-rate controller) and its payload. Reports come often: other than everything else, they may overtake up to
    /// a batch of events.
    fn monitor(&mut self, _t_us: u64, _subtype: u16, _payload: u64) {}

    /// Time is not continuous from here on: data was lost, or the device restarted its clock. What follows starts at
    /// `t_us` (which may lie before what came last, if the device restarted), and how long the gap was is unknown.
    fn discontinuity(&mut self, _t_us: u64) {}
}
