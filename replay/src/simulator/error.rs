//! What can go wrong when events are simulated.

/// What can go wrong when events are simulated.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum SimulatorError {
    /// A parameter has no meaning there.
    #[error("the event simulator's parameter {name} is {value}; choose a value from {from} to {to}")]
    OutOfRange {
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The smallest value accepted.
        from: f64,
        /// The largest value accepted.
        to: f64,
    },
    /// A parameter that v2e's model lacks.
    #[error("the event simulator's mode parity has no {name}; leave it at its default or choose the mode enhanced")]
    OnlyEnhanced {
        /// The parameter.
        name: &'static str,
    },
    /// A sensor without pixels, or with more than an event can address.
    #[error(
        "cannot simulate a sensor of {width} x {height} pixels; each side must be 1 to 65536, and both together 150 million at most"
    )]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// A frame of another size than the sensor's.
    #[error("frame {frame} has {found} values, but the sensor has {expected} pixels; resize the frames first")]
    FrameSize {
        /// Index of the frame, from 0.
        frame: u64,
        /// Values in the frame.
        found: usize,
        /// Pixels of the sensor.
        expected: usize,
    },
    /// A frame with a value that has no logarithm.
    #[error("frame {frame} has the luma {value} at column {x}, row {y}; luma must be finite and not negative")]
    BadLuma {
        /// Index of the frame, from 0.
        frame: u64,
        /// Column.
        x: u32,
        /// Row.
        y: u32,
        /// The value.
        value: f32,
    },
    /// A frame that is not later than the one before.
    #[error(
        "frame {frame} is at {t_ns} ns, but the frame before it at {previous_ns} ns; sort the frames by time and drop \
         duplicates"
    )]
    TimeNotIncreasing {
        /// Index of the frame, from 0.
        frame: u64,
        /// Its time, nanoseconds.
        t_ns: i64,
        /// The time of the frame before it, nanoseconds.
        previous_ns: i64,
    },
    /// A frame further from the others than the arithmetic allows.
    #[error(
        "frame {frame} is at {t_ns} ns, the one before it at {previous_ns} ns: more than an hour apart, or more than 100 \
         days after the first; check the unit of the times"
    )]
    TimeTooFar {
        /// Index of the frame, from 0.
        frame: u64,
        /// Its time, nanoseconds.
        t_ns: i64,
        /// The time of the frame before it, nanoseconds.
        previous_ns: i64,
    },
    /// The output is for another sensor.
    #[error(
        "the events are of a sensor of {found:?} pixels, but the simulator of one of {expected:?}; use one for each"
    )]
    OutputSize {
        /// Width and height of the output.
        found: [u32; 2],
        /// Width and height of the simulator.
        expected: [u32; 2],
    },
    /// More events than memory can be expected to hold.
    #[error("frame {frame} makes at least {events} events, above the limit of {limit}; raise the contrast thresholds")]
    TooManyEvents {
        /// Index of the frame, from 0.
        frame: u64,
        /// Events that the frame would make.
        events: u64,
        /// The limit.
        limit: u64,
    },
}
