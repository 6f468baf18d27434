//! Losses of rendered pixels, and their gradients: photometric (with the model of an exposure) and event; and of colours.
//!
//! Each thread adds to a sum of its own, which the host adds up when it wants the value, so that results do not depend
//! on the order of the threads.

mod colour;
pub(crate) mod level;

use bytemuck::{Pod, Zeroable};
use erfgs_scene::srgb;
use wgpu::Buffer;

pub use self::{colour::ColourChange, level::Levels};
use crate::{
    cameras::colour::CameraColours,
    config::{EarlConfig, Norm, Quantise},
    kernels::{kernel, threads_for},
};
use erfgs_splat::{
    gpu::{Commands, Gpu, GpuError, Kernel, stored},
    raster::HARMONICS,
};

const ACCUMULATE: &str = include_str!("accumulate.wgsl");
const EVENT: &str = include_str!("event.wgsl");
const LIN_LOG: &str = include_str!("lin_log.wgsl");
const PHOTOMETRIC: &str = include_str!("photometric.wgsl");
const SPREAD: &str = include_str!("spread.wgsl");
const TRANSFER: &str = include_str!("transfer.wgsl");

/// A frame that an exposure is compared with.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Its pixels, as [`packed`] makes them.
    pub frame: &'a Buffer,
    /// Which of them.
    pub part: Part<'a>,
}

/// The part of an image that is compared. A bit for each pixel, row by row, the lowest of a word first, says which are within.
#[derive(Clone, Copy, Debug)]
pub enum Part<'a> {
    /// All of it.
    All,
    /// What is within.
    Within(&'a Buffer),
    /// What is not.
    Outside(&'a Buffer),
}

/// The pixels of a frame (red in the lowest byte) as they are stored and as the device has them: red, green and blue, a byte each, pixel by
/// pixel.
#[must_use]
pub fn packed(pixels: &[u32]) -> Vec<u8> {
    let mut bytes = vec![0; (3 * pixels.len()).next_multiple_of(4)];
    for (colour, pixel) in bytes.as_chunks_mut::<3>().0.iter_mut().zip(pixels) {
        let [red, green, blue, _] = pixel.to_le_bytes();
        *colour = [red, green, blue];
    }
    bytes
}

/// A rendered exposure and who saw it.
#[derive(Clone, Copy, Debug)]
pub struct Exposure<'a> {
    /// Pixels of the image.
    pub pixels: u32,
    /// The image; in linear light if `linear_light`, else in display values.
    pub mean: &'a Buffer,
    /// See `mean`.
    pub linear_light: bool,
    /// Which camera saw it.
    pub view: usize,
    /// How the cameras show colours.
    pub colours: &'a CameraColours,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct AccumulateParameters {
    pixels: u32,
    first: u32,
    linear_light: u32,
    weight: f32,
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct PhotometricParameters {
    pixels: u32,
    threads: u32,
    linear_light: u32,
    scale: f32,
    view: u32,
    part: u32,
    unused: [u32; 2],
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SpreadParameters {
    pixels: u32,
    weight: f32,
    unused: [u32; 2],
}

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct EventParameters {
    pixels: u32,
    threads: u32,
    quantise: u32,
    norm: u32,
    confidence: u32,
    linear_light: u32,
    lin_log: f32,
    inverse_threshold: f32,
    scale: f32,
    unused: [u32; 3],
}

/// The event count that leaves a pixel out of the event loss.
pub const LEFT_OUT: f32 = f32::MAX;

/// How a sensor turns light into events.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Contrast threshold, natural-log intensity.
    pub threshold: f32,
    /// Grey level (of 255) below which the response is linear.
    pub lin_log: f32,
    /// Whether it is the luminance of linear light whose logarithm is taken, and not the luma of display values.
    pub linear_light: bool,
}

/// The error that counts as one, natural-log intensity: 0.2 in display values, the usual threshold of simulators; 0.45 in
/// linear light, which is the same visible contrast.
#[must_use]
pub fn unit(linear_light: bool) -> f32 {
    if linear_light { 0.45 } else { 0.2 }
}

impl Sensor {
    /// What an error of one threshold is worth. A weight of the event loss then means the same for all sensors: one with half the
    /// threshold would otherwise ask twice as much of the scene.
    #[must_use]
    pub fn worth(&self) -> f32 {
        self.threshold / unit(self.linear_light)
    }

    /// Lin-log intensity of a display colour (0 to 1, red, green, blue), as `event.wgsl` computes it.
    #[must_use]
    pub fn lin_log(&self, colour: &[f32; 3]) -> f32 {
        let sum = |weights: [f32; 3], light: fn(f32) -> f32| -> f32 {
            colour.iter().zip(weights).map(|(&value, weight)| weight * light(value)).sum()
        };
        let x = 255.0
            * match self.linear_light {
                true => sum([0.2126, 0.7152, 0.0722], srgb::decode),
                false => sum([0.299, 0.587, 0.114], |value| value),
            };
        if x <= self.lin_log { x * self.lin_log.ln() / self.lin_log } else { x.ln() }
    }
}

/// The kernels of the losses.
#[derive(Debug)]
pub struct Losses {
    accumulate: Kernel,
    photometric: Kernel,
    spread: Kernel,
    event: Kernel,
    event_level: Kernel,
    colour: Kernel,
}

/// A sum that threads add to.
#[derive(Debug)]
pub struct LossSum {
    partial: Buffer,
    threads: u32,
}

impl LossSum {
    /// Zero, for images of `pixels` pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub fn new(gpu: &Gpu, pixels: u32) -> Result<Self, GpuError> {
        let threads = threads_for(pixels);
        Ok(Self { partial: gpu.storage("loss", Self::bytes(pixels))?, threads })
    }

    /// Bytes of the device's memory that it takes.
    #[must_use]
    pub fn bytes(pixels: u32) -> u64 {
        stored(u64::from(threads_for(pixels)) * 4)
    }

    /// The sum so far, which starts again at zero.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn take(&self, gpu: &Gpu) -> Result<f64, GpuError> {
        let sum = gpu.read(&[(&self.partial, self.threads as usize)], |slices: &[&[f32]]| {
            slices[0].iter().map(|&value| f64::from(value)).sum()
        })?;
        let mut commands = gpu.commands();
        commands.clear(&self.partial);
        commands.submit();
        Ok(sum)
    }

    /// What each thread has added so far.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn partial(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        gpu.download(&self.partial, self.threads as usize)
    }

    /// Goes on from what threads had added; `false` where they were not as many.
    #[must_use]
    pub fn restore(&self, gpu: &Gpu, partial: &[f32]) -> bool {
        let fits = partial.len() == self.threads as usize;
        if fits {
            gpu.upload(&self.partial, 0, partial);
        }
        fits
    }
}

impl Losses {
    /// Compiles the kernels.
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            accumulate: kernel(gpu, "accumulate", &[TRANSFER, ACCUMULATE]),
            photometric: kernel(gpu, "photometric", &[TRANSFER, PHOTOMETRIC]),
            spread: kernel(gpu, "spread", &[TRANSFER, SPREAD]),
            event: kernel(gpu, "event", &[TRANSFER, LIN_LOG, EVENT]),
            event_level: kernel(gpu, "event level", &[&level::constants(), TRANSFER, LIN_LOG, level::EVENT_LEVEL]),
            colour: kernel(gpu, "colour", &[HARMONICS, colour::COLOUR]),
        }
    }

    /// Adds `weight` times `image` to the exposure `mean`, or starts it anew.
    #[expect(clippy::too_many_arguments, reason = "one argument a binding")]
    pub fn accumulate(
        &self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        pixels: u32,
        image: &Buffer,
        mean: &Buffer,
        first: bool,
        weight: f32,
        linear_light: bool,
    ) {
        let parameters =
            AccumulateParameters { pixels, first: first.into(), linear_light: linear_light.into(), weight };
        let parameters = gpu.uniform("accumulate", &parameters);
        commands.dispatch(&self.accumulate, &[&parameters, image, mean], pixels.div_ceil(64));
    }

    /// Writes the gradient of `scale * sum |shown - frame|` with respect to the exposure to `d_mean`, keeps those of its
    /// camera's gain and offset, and adds the sum to `loss`. `shown` is the exposure as the camera shows it, the frame is in
    /// display values; what is no part of the `target` is left out.
    #[expect(clippy::too_many_arguments, reason = "one argument a binding")]
    pub fn photometric(
        &self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        exposure: &Exposure<'_>,
        target: &Target<'_>,
        d_mean: &Buffer,
        loss: &LossSum,
        scale: f32,
    ) {
        let Exposure { pixels, mean, linear_light, view, colours } = *exposure;
        let threads = threads_for(pixels).min(loss.threads);
        let (part, within) = match target.part {
            Part::All => (0, target.frame),
            Part::Within(region) => (1, region),
            Part::Outside(region) => (2, region),
        };
        let parameters = PhotometricParameters {
            pixels,
            threads,
            linear_light: linear_light.into(),
            scale,
            view: view as u32,
            part,
            unused: [0; 2],
        };
        let parameters = gpu.uniform("photometric", &parameters);
        let bindings =
            [&parameters, mean, target.frame, within, &colours.values, d_mean, &loss.partial, &colours.partial];
        commands.dispatch(&self.photometric, &bindings, threads.div_ceil(64));
    }

    /// The gradient of one rendering from that of the exposure in linear light, of which it is the share `weight`.
    #[expect(clippy::too_many_arguments, reason = "one argument a binding")]
    pub fn spread(
        &self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        pixels: u32,
        image: &Buffer,
        d_mean: &Buffer,
        d_image: &Buffer,
        weight: f32,
    ) {
        let parameters = gpu.uniform("spread", &SpreadParameters { pixels, weight, unused: [0; 2] });
        commands.dispatch(&self.spread, &[&parameters, image, d_mean, d_image], pixels.div_ceil(64));
    }

    /// The event loss between renderings `before` and `after`; see `event.wgsl`. Gradients are of `scale` times the sum.
    #[expect(clippy::too_many_arguments, reason = "one argument a binding")]
    pub fn event(
        &self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        pixels: u32,
        before: &Buffer,
        after: &Buffer,
        count: &Buffer,
        d_before: &Buffer,
        d_after: &Buffer,
        loss: &LossSum,
        scale: f32,
        sensor: &Sensor,
        config: &EarlConfig,
    ) {
        let threads = threads_for(pixels).min(loss.threads);
        let parameters = EventParameters {
            pixels,
            threads,
            quantise: match config.quantise {
                Quantise::TruncateSte => 0,
                Quantise::DeadZone => 1,
                Quantise::None => 2,
            },
            norm: match config.norm {
                Norm::L1 => 0,
                Norm::L2 => 1,
            },
            confidence: config.confidence.into(),
            linear_light: sensor.linear_light.into(),
            lin_log: sensor.lin_log,
            inverse_threshold: 1.0 / sensor.threshold,
            scale,
            unused: [0; 3],
        };
        let parameters = gpu.uniform("event", &parameters);
        let bindings = [&parameters, before, after, count, d_before, d_after, &loss.partial];
        commands.dispatch(&self.event, &bindings, threads.div_ceil(64));
    }
}

#[cfg(test)]
mod tests;
