//! The event loss of one rendering. An event camera tells changes, so that the light of a pixel is known at all times once it is known
//! at one. That one level a pixel is learned beside the scene: the median, over all times that were rendered, of what the rendering says
//! of it. Where a pixel sees what stands still for most of the time, that is right soon, and what passes it is told in full: by one
//! rendering, not by the difference of two that may both be wrong.

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

use super::{LossSum, Losses, Sensor, threads_for, unit};
use erfgs_splat::gpu::{Commands, Gpu, GpuError, stored};

pub(super) const EVENT_LEVEL: &str = include_str!("event_level.wgsl");

/// The first renderings of a pixel make its level, as their mean, and are not held against it.
pub const FIRST: u32 = 8;

/// Later ones move it by at most this, [units](super::unit) of error: it then is a running median.
pub const RATE: f32 = 0.1;

/// Half the width of what is no error, units of error: since its last event a pixel of a threshold of one unit may have changed by one
/// either way, and by half on average. Those of finer sensors know more; but holding renderings to that costs more than it brings.
pub const DEAD: f32 = 0.5;

/// How steep the logarithm is in the middle of display values, where an error counts as one: the change of log intensity by so much of
/// a grey. In the dark the same change of log intensity is less of what is seen, and less is to be gained by being right there.
pub const SLOPE: f32 = 2.0;

/// Beyond white it counts as where the logarithm is so many times as steep as that.
pub const FLATTEST: f32 = 0.25;

/// [`SLOPE`] for a sensor; the logarithm of linear light is as many times steeper as its unit is larger.
#[must_use]
pub fn slope(sensor: &Sensor) -> f32 {
    SLOPE * unit(sensor.linear_light) / unit(false)
}

/// What the kernel is told as it is made.
pub(super) fn constants() -> String {
    format!("const FIRST = {FIRST}.0;\nconst FLATTEST = {FLATTEST:?};\n")
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct EventLevelParameters {
    pixels: u32,
    threads: u32,
    linear_light: u32,
    lin_log: f32,
    inverse_threshold: f32,
    scale: f32,
    rate: f32,
    dead: f32,
    slope: f32,
    unused: [u32; 3],
}

/// The levels of an event camera's pixels.
#[derive(Debug)]
pub struct Levels {
    values: Buffer,
    pixels: usize,
}

impl Levels {
    /// Levels that nothing is known of yet.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, pixels: usize) -> Result<Self, GpuError> {
        Self::restore(gpu, &vec![0.0; 2 * pixels])
    }

    /// Bytes of the device's memory that they take.
    #[must_use]
    pub fn bytes(pixels: usize) -> u64 {
        stored(8 * pixels as u64)
    }

    /// Levels as [`Levels::read`] gave them.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn restore(gpu: &Gpu, values: &[f32]) -> Result<Self, GpuError> {
        Ok(Self { values: gpu.storage_from("levels of pixels", values)?, pixels: values.len() / 2 })
    }

    /// Of each pixel, row by row, the level (log intensity at the beginning, contrast thresholds) and in how many renderings it was seen.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        gpu.download(&self.values, 2 * self.pixels)
    }
}

impl Losses {
    /// Adds the event loss of a rendering to `loss`, writes the gradient of `scale` times that to `d_image`, and moves the levels; see
    /// `event_level.wgsl`. `count` is each pixel's signed event count since the beginning, or [`super::LEFT_OUT`].
    #[expect(clippy::too_many_arguments, reason = "where it reads, where it writes, and how much")]
    pub fn event_level(
        &self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        image: &Buffer,
        count: &Buffer,
        levels: &Levels,
        d_image: &Buffer,
        loss: &LossSum,
        scale: f32,
        sensor: &Sensor,
    ) {
        let pixels = levels.pixels as u32;
        let threads = threads_for(pixels).min(loss.threads);
        let parameters = EventLevelParameters {
            pixels,
            threads,
            linear_light: sensor.linear_light.into(),
            lin_log: sensor.lin_log,
            inverse_threshold: 1.0 / sensor.threshold,
            scale,
            rate: RATE / sensor.worth(),
            dead: DEAD / sensor.worth(),
            slope: slope(sensor),
            unused: [0; 3],
        };
        let parameters = gpu.uniform("event level", &parameters);
        let bindings = [&parameters, image, count, &levels.values, d_image, &loss.partial];
        commands.dispatch(&self.event_level, &bindings, threads.div_ceil(64));
    }
}
