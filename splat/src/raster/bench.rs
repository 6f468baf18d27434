//! How long each stage takes.

use std::time::Instant;

use erfgs_base::random::{key, normal, purpose, uniform};

use super::{Frame, GaussianBuffers, Gradients, RasterError, Rasteriser, RenderOptions, View, Wanted, sh_stride};
use crate::gpu::Gpu;

const PURPOSE: u64 = purpose("rasteriser bench");

/// What to render.
#[derive(Clone, Copy, Debug)]
pub struct BenchScene {
    /// Number of Gaussians, all of them in view.
    pub gaussians: u32,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Median standard deviation of a splat, pixels.
    pub sigma_px: f64,
    /// Degree of the colours' spherical harmonics, 0 to 3.
    pub sh_degree: u32,
}

impl Default for BenchScene {
    fn default() -> Self {
        Self { gaussians: 30_000, width: 320, height: 180, sigma_px: 1.5, sh_degree: 3 }
    }
}

/// Milliseconds of wall time: the best of several runs, each with a wait for the device at its end.
#[derive(Clone, Debug)]
pub struct BenchResult {
    /// Milliseconds by stage, in the order in which they run.
    pub stages: Vec<(&'static str, f64)>,
    /// A whole forward pass.
    pub forward_ms: f64,
    /// A whole backward pass.
    pub backward_ms: f64,
    /// Tile intersections of the image.
    pub intersections: u32,
}

impl BenchScene {
    /// The camera.
    #[must_use]
    pub fn view(&self) -> View {
        View {
            width: self.width,
            height: self.height,
            fx: self.width as f32,
            fy: self.width as f32,
            cx: 0.5 * self.width as f32,
            cy: 0.5 * self.height as f32,
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
        }
    }

    /// Gaussians spread over the view at depths of 1 to 5 m, with log-normal sizes and mixed opacities.
    ///
    /// # Errors
    /// [`RasterError::Gpu`].
    pub fn gaussians(&self, gpu: &Gpu) -> Result<GaussianBuffers, RasterError> {
        let view = self.view();
        let mut core = Vec::with_capacity(12 * self.gaussians as usize);
        let stride = sh_stride(self.sh_degree) as usize;
        let mut sh = Vec::with_capacity(stride * self.gaussians as usize);
        for index in 0..u64::from(self.gaussians) {
            let random = |word: u64| key(1, &[PURPOSE, index, word]);
            let z = 1.0 + 4.0 * uniform(random(0));
            let pixel = [uniform(random(1)) * f64::from(view.width), uniform(random(2)) * f64::from(view.height)];
            let focal = f64::from(view.fx);
            let mean = [(pixel[0] - f64::from(view.cx)) / focal * z, (pixel[1] - f64::from(view.cy)) / focal * z, z];
            let log_size = (self.sigma_px * z / focal).ln() + 0.5 * normal(random(3));
            core.extend(mean);
            core.extend([4, 5, 6].map(|word| log_size + 0.4 * normal(random(word))));
            core.extend([7, 8, 9, 10].map(|word| normal(random(word))));
            core.extend([1.5 * normal(random(11)), 0.0]);
            sh.extend((0..stride as u64).map(|k| if k < 3 { 1.0 } else { 0.2 } * normal(random(100 + k))));
        }
        let to_f32 = |values: Vec<f64>| values.into_iter().map(|x| x as f32).collect::<Vec<f32>>();
        GaussianBuffers::from_slices(gpu, self.sh_degree, &to_f32(core), &to_f32(sh))
    }
}

/// Renders and differentiates `scene` `repeats` times.
///
/// # Errors
/// [`RasterError`].
pub fn bench(gpu: &Gpu, scene: &BenchScene, repeats: u32) -> Result<BenchResult, RasterError> {
    let rasteriser = Rasteriser::new(gpu)?;
    let gaussians = scene.gaussians(gpu)?;
    let view = scene.view();
    let options = RenderOptions { sh_degree: scene.sh_degree, ..RenderOptions::default() };
    let gradients = Gradients::new(gpu, &gaussians)?;
    let ones = vec![[1.0f32, 0.5, -0.5, 0.1]; (view.width * view.height) as usize];
    let d_image = gpu.storage_from("d_image", &ones)?;
    let mut frame = Frame::new(gpu)?;

    let mut stages: Vec<(&'static str, f64)> = Vec::new();
    let (mut forward_ms, mut backward_ms) = (f64::MAX, f64::MAX);
    for _ in 0..repeats.max(1) {
        let start = Instant::now();
        rasteriser.forward(gpu, &gaussians, None, &view, &options, &mut frame)?;
        frame.check(gpu)?;
        forward_ms = forward_ms.min(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        let wanted = Wanted { statistics: true, pose: None };
        rasteriser.backward(gpu, &gaussians, None, &view, &options, &frame, &d_image, &gradients, None, wanted)?;
        gpu.wait("differentiating")?;
        backward_ms = backward_ms.min(start.elapsed().as_secs_f64() * 1e3);
        let timed = rasteriser.by_stage(gpu, &gaussians, &view, &options, &mut frame, &d_image, &gradients)?;
        if stages.is_empty() {
            stages = timed;
        } else {
            for (best, (_, ms)) in stages.iter_mut().zip(timed) {
                best.1 = best.1.min(ms);
            }
        }
    }
    // The host makes as much room as it counts, a device has room for more.
    let intersections = frame.settle(gpu)?.unwrap_or(frame.room);
    Ok(BenchResult { stages, forward_ms, backward_ms, intersections })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{AdapterChoice, Shape};

    #[test]
    fn both_shapes_count_the_same_intersections() {
        let scene = BenchScene { gaussians: 1000, width: 96, height: 64, ..BenchScene::default() };
        let [host, device] = [Shape::Cpu, Shape::Gpu].map(|shape| {
            let gpu = Gpu::open(&AdapterChoice { name: None, shape: Some(shape) }).expect("an adapter");
            bench(&gpu, &scene, 1).expect("renderings").intersections
        });
        // They may round differently at the border of a tile.
        assert!(host > 1000 && host.abs_diff(device) <= host / 500, "{host} and {device}");
    }
}
