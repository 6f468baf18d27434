//! The event simulator: frames in, events out.
//!
//! Two models of a pixel, see [`Mode`]. Both take the logarithm of the grey level (a line below level 20), pass it
//! through a low-pass whose bandwidth grows with intensity, and compare it with a reference: where the difference reaches
//! a contrast threshold, the pixel makes an event and the reference follows.
//!
//! Random numbers are named by seed, camera, frame and pixel, and work is cut into blocks of rows whose size does not
//! depend on the machine, so that the same frames give the same bytes with any number of threads.

mod collect;
mod config;
mod enhanced;
mod error;
mod lin_log;
mod noise;
mod parity;

pub use config::{Mode, SimulatorConfig, camera_key};
pub use error::SimulatorError;
pub use lin_log::{lin_log, linear_of_srgb, srgb_of_linear};

use std::ops::Range;

use erfgs_base::plausible::SENSOR;
use erfgs_events::Events;

use self::{enhanced::Enhanced, noise::Noise, parity::Parity};

/// A grey frame, row-major, 0 (black) to 255 (white), display-referred unless the configuration says otherwise.
#[derive(Clone, Copy, Debug)]
pub enum Luma<'a> {
    /// Whole grey levels.
    U8(&'a [u8]),
    /// Any grey levels, not negative; above 255 is brighter than white.
    F32(&'a [f32]),
}

impl Luma<'_> {
    fn len(self) -> usize {
        match self {
            Self::U8(levels) => levels.len(),
            Self::F32(levels) => levels.len(),
        }
    }
}

/// An event sensor that is fed frames.
pub struct Simulator {
    size: [u32; 2],
    model: Model,
    frames: u64,
    first_ns: i64,
    previous_ns: i64,
}

enum Model {
    /// v2e computes in `f32` without the low-pass.
    Parity32(Parity<f32>),
    /// v2e computes in `f64` with the low-pass.
    Parity64(Parity<f64>),
    Enhanced(Enhanced),
}

impl Simulator {
    /// A sensor of `width` x `height` pixels. `camera_key` (see [`camera_key`]) tells its random numbers from those of
    /// other cameras of the same seed.
    ///
    /// # Errors
    /// If the size is zero or too large for event addresses, or the configuration is invalid.
    pub fn new(width: u32, height: u32, config: &SimulatorConfig, camera_key: u64) -> Result<Self, SimulatorError> {
        config.validate()?;
        let sides = 1..=1 << 16;
        let pixels = f64::from(width) * f64::from(height);
        if !sides.contains(&width) || !sides.contains(&height) || !SENSOR.holds(pixels) {
            return Err(SimulatorError::Size { width, height });
        }
        let noise = Noise::new(config.seed, camera_key);
        let (w, h) = (width as usize, height as usize);
        let model = match config.mode {
            Mode::Parity if config.cutoff_hz > 0.0 => Model::Parity64(Parity::new(w, h, config, noise)),
            Mode::Parity => Model::Parity32(Parity::new(w, h, config, noise)),
            Mode::Enhanced => Model::Enhanced(Enhanced::new(w, h, config, noise)),
        };
        Ok(Self { size: [width, height], model, frames: 0, first_ns: 0, previous_ns: 0 })
    }

    /// Feeds the frame at `t_ns` (nanoseconds on the session clock) and appends the events since the frame before to
    /// `out`, ordered by time, then row, then column. The first frame makes none.
    ///
    /// # Errors
    /// If the frame has the wrong size or a value without logarithm, its time is not later than the one before or more
    /// than an hour later, or it makes too many events. `out` is then as before the call, and so is the simulator,
    /// except that it cannot go on after [`SimulatorError::TooManyEvents`].
    pub fn step(&mut self, luma: Luma<'_>, t_ns: i64, out: &mut Events) -> Result<(), SimulatorError> {
        self.check(luma, t_ns, out)?;
        if self.frames == 0 {
            self.first_ns = t_ns;
            match &mut self.model {
                Model::Parity32(model) => model.first(luma),
                Model::Parity64(model) => model.first(luma),
                Model::Enhanced(model) => model.first(luma),
            }
        } else {
            let interval =
                Interval { frame: self.frames, first_ns: self.first_ns, previous_ns: self.previous_ns, now_ns: t_ns };
            match &mut self.model {
                Model::Parity32(model) => model.step(luma, &interval, out)?,
                Model::Parity64(model) => model.step(luma, &interval, out)?,
                Model::Enhanced(model) => model.step(luma, &interval, out)?,
            }
        }
        self.previous_ns = t_ns;
        self.frames += 1;
        Ok(())
    }

    fn check(&self, luma: Luma<'_>, t_ns: i64, out: &Events) -> Result<(), SimulatorError> {
        const HOUR_NS: i64 = 3_600_000_000_000;
        const LONGEST_NS: i64 = 100 * 24 * HOUR_NS;
        let [width, height] = self.size;
        let frame = self.frames;
        if [out.width, out.height] != self.size {
            return Err(SimulatorError::OutputSize { found: [out.width, out.height], expected: self.size });
        }
        let expected = width as usize * height as usize;
        if luma.len() != expected {
            return Err(SimulatorError::FrameSize { frame, found: luma.len(), expected });
        }
        if let Luma::F32(levels) = luma {
            let good = |level: f32| level.is_finite() && level >= 0.0;
            if let Some(at) = levels.iter().position(|&level| !good(level)) {
                let (x, y) = ((at % width as usize) as u32, (at / width as usize) as u32);
                return Err(SimulatorError::BadLuma { frame, x, y, value: levels[at] });
            }
        }
        if frame > 0 {
            let previous_ns = self.previous_ns;
            if t_ns <= previous_ns {
                return Err(SimulatorError::TimeNotIncreasing { frame, t_ns, previous_ns });
            }
            let far = |from: i64, longest: i64| t_ns.checked_sub(from).is_none_or(|span| span > longest);
            if far(previous_ns, HOUR_NS) || far(self.first_ns, LONGEST_NS) {
                return Err(SimulatorError::TimeTooFar { frame, t_ns, previous_ns });
            }
        }
        Ok(())
    }
}

/// Pixels that are worked on at once: few enough for registers and the first cache, enough to vectorise.
const CHUNK: usize = 64;

/// The indices of the flags that are set; at most [`CHUNK`] flags.
fn set(flags: &[bool]) -> impl Iterator<Item = usize> {
    let mut mask = flags.iter().enumerate().fold(0_u64, |mask, (index, &flag)| mask | u64::from(flag) << index);
    std::iter::from_fn(move || {
        let index = mask.trailing_zeros() as usize;
        mask &= mask.wrapping_sub(1);
        (index < CHUNK).then_some(index)
    })
}

/// The rows of each block of a sensor.
fn blocks(width: usize, height: usize) -> impl Iterator<Item = Range<usize>> {
    const PIXELS: usize = 8192;
    let rows = PIXELS.div_ceil(width);
    (0..height).step_by(rows).map(move |start| start..height.min(start + rows))
}

/// The time between two frames.
struct Interval {
    /// Index of the later frame.
    frame: u64,
    first_ns: i64,
    previous_ns: i64,
    now_ns: i64,
}

impl Interval {
    /// Events that one interval may make. 12 bytes each on the way, 13 in the output.
    const MOST_EVENTS: u64 = 1 << 27;

    fn check_count(&self, events: u64) -> Result<(), SimulatorError> {
        if events <= Self::MOST_EVENTS {
            return Ok(());
        }
        Err(SimulatorError::TooManyEvents { frame: self.frame, events, limit: Self::MOST_EVENTS })
    }

    /// The time before, seconds since the first frame.
    fn previous_s(&self) -> f64 {
        (self.previous_ns - self.first_ns) as f64 * 1e-9
    }

    /// The time now, seconds since the first frame.
    fn now_s(&self) -> f64 {
        (self.now_ns - self.first_ns) as f64 * 1e-9
    }

    /// The length, seconds.
    fn delta_s(&self) -> f64 {
        self.now_s() - self.previous_s()
    }

    /// Seconds since the first frame in microseconds on the session clock, to the nearest.
    fn us_of_seconds(&self, seconds: f64) -> i64 {
        let (whole, rest) = (self.first_ns.div_euclid(1000), self.first_ns.rem_euclid(1000));
        whole + (seconds * 1e6 + rest as f64 * 1e-3).round() as i64
    }
}
