//! The event simulator: frames in, events out.

mod config;
mod error;

pub use config::{Mode, SimulatorConfig, camera_key};
pub use error::SimulatorError;

use erfgs_session::Events;

/// A grey frame, row-major, 0 (black) to 255 (white), display-referred unless the configuration says otherwise.
#[derive(Clone, Copy, Debug)]
pub enum Luma<'a> {
    /// Whole grey levels.
    U8(&'a [u8]),
    /// Any grey levels, not negative; above 255 is brighter than white.
    F32(&'a [f32]),
}

/// An event sensor that is fed frames.
pub struct Simulator {
    size: [u32; 2],
}

impl Simulator {
    /// A sensor of `width` x `height` pixels. `camera_key` (see [`camera_key`]) tells its random numbers from those of
    /// other cameras of the same seed.
    ///
    /// # Errors
    /// If the size is zero or too large for event addresses, or the configuration is invalid.
    pub fn new(width: u32, height: u32, config: &SimulatorConfig, camera_key: u64) -> Result<Self, SimulatorError> {
        config.validate()?;
        let _ = camera_key;
        Ok(Self { size: [width, height] })
    }

    /// Feeds the frame at `t_ns` (nanoseconds on the session clock) and appends the events since the frame before to
    /// `out`, ordered by time, then row, then column. The first frame makes none.
    ///
    /// # Errors
    /// If the frame has the wrong size or a value without logarithm, its time is not later than the one before, or it
    /// makes too many events; the simulator and `out` are then as before the call.
    pub fn step(&mut self, luma: Luma<'_>, t_ns: i64, out: &mut Events) -> Result<(), SimulatorError> {
        todo!("{luma:?} {t_ns} {out:?} {:?}", self.size)
    }
}
