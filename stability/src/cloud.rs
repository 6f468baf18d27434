//! Clouds of Gaussians before a camera, rendered on the device and by the twin.

use erfgs_base::random::{key, normal, purpose, range};
use erfgs_splat::{
    raster::{Frame, GaussianBuffers, Gradients, RasterError, RenderOptions, View, Wanted, sh_stride},
    reference::raster::Gaussians,
};

use crate::{Bench, Measured, Refusal};

/// Gaussians and a camera.
#[derive(Clone, Debug)]
pub struct Cloud {
    /// Rows of mean, log-scale, quaternion, opacity logit, and a number that is not used.
    pub core: Vec<f64>,
    /// Rows of colour coefficients, of degree 0.
    pub sh: Vec<f64>,
    /// The camera.
    pub view: View,
    /// How to render.
    pub options: RenderOptions,
}

impl Cloud {
    /// `count` Gaussians 1.5 to 4 m before a camera of 40 x 30 pixels that looks along z, about three pixels wide.
    #[must_use]
    pub fn random(seed: u64, count: u64) -> Self {
        let (width, height, focal) = (40_u32, 30_u32, 36.0_f32);
        let view = View {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 19.3,
            cy: 15.8,
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
        };
        let (mut core, mut sh) = (Vec::new(), Vec::new());
        for index in 0..count {
            let at = |word: u64| key(seed, &[purpose("stability cloud"), index, word]);
            let z = range(at(0), 1.5, 4.0);
            let pixel = [range(at(1), 0.0, f64::from(width)), range(at(2), 0.0, f64::from(height))];
            let centre = [f64::from(view.cx), f64::from(view.cy)];
            let mean: [f64; 2] = std::array::from_fn(|axis| (pixel[axis] - centre[axis]) / f64::from(focal) * z);
            let size = (3.0 * z / f64::from(focal)).ln();
            core.extend([mean[0], mean[1], z]);
            core.extend([3, 4, 5].map(|word| size + 0.5 * normal(at(word))));
            core.extend([6, 7, 8, 9].map(|word| normal(at(word))));
            core.extend([range(at(10), -1.5, 1.5), 0.0]);
            sh.extend([20, 21, 22].map(|word| range(at(word), -1.5, 1.5)));
            sh.push(0.0);
        }
        let options = RenderOptions { background: [0.2, 0.5, 0.9], sh_degree: 0, ..RenderOptions::default() };
        // Numbers that single precision holds: what is lost before the rasteriser is no error of it.
        let held = |values: Vec<f64>| values.into_iter().map(|x| f64::from(x as f32)).collect();
        Self { core: held(core), sh: held(sh), view, options }
    }

    /// With every row changed.
    #[must_use]
    pub fn changed(mut self, change: impl Fn(usize, &mut [f64])) -> Self {
        self.core.chunks_exact_mut(12).enumerate().for_each(|(index, row)| change(index, row));
        self.core.iter_mut().for_each(|x| *x = f64::from(*x as f32));
        self
    }

    /// The picture by the twin: colour and transmittance, row by row.
    #[must_use]
    pub fn twin(&self) -> Vec<f64> {
        let gaussians = Gaussians { sh_degree: 0, core: self.core.clone(), sh: self.sh.clone() };
        let image = gaussians.render(&self.view, &self.options);
        image.pixels.iter().flat_map(|pixel| pixel.to_array()).collect()
    }

    /// The picture by the device, and how many numbers of its gradients are not finite.
    ///
    /// # Errors
    /// Of the rasteriser.
    pub fn render(&self, bench: &Bench) -> Result<(Vec<f64>, u64), Refusal> {
        let (gpu, rasteriser) = (&bench.gpu, &bench.rasteriser);
        let narrow = |values: &[f64]| values.iter().map(|x| *x as f32).collect::<Vec<f32>>();
        let gaussians = GaussianBuffers::from_slices(gpu, 0, &narrow(&self.core), &narrow(&self.sh))?;
        let (view, options) = (&self.view, &self.options);
        let mut frame = Frame::new(gpu)?;
        loop {
            rasteriser.forward(gpu, &gaussians, None, view, options, &mut frame)?;
            match frame.check(gpu) {
                Err(RasterError::Overflow { .. }) => {}
                other => break other?,
            }
        }
        let pixels = (view.width * view.height) as usize;
        let image: Vec<[f32; 4]> = gpu.download(&frame.image, pixels)?;
        let d_image = gpu.storage_from("gradient of a picture", &vec![[0.4_f32, -0.3, 0.5, 0.2]; pixels])?;
        let gradients = Gradients::new(gpu, &gaussians)?;
        rasteriser.backward(
            gpu,
            &gaussians,
            None,
            view,
            options,
            &frame,
            &d_image,
            &gradients,
            None,
            Wanted { statistics: true, pose: None },
        )?;
        let count = gaussians.count as usize;
        let mut not_finite = 0;
        for (buffer, floats) in [
            (&gradients.core, 12 * count),
            (&gradients.sh, sh_stride(0) as usize * count),
            (&gradients.screen, 4 * count),
        ] {
            let values: Vec<f32> = gpu.download(buffer, floats)?;
            not_finite += values.iter().filter(|value| !value.is_finite()).count() as u64;
        }
        Ok((image.as_flattened().iter().copied().map(f64::from).collect(), not_finite))
    }

    /// The device's picture against another.
    ///
    /// # Errors
    /// Of the rasteriser.
    pub fn against(&self, bench: &Bench, truth: Vec<f64>) -> Result<Measured, Refusal> {
        let (picture, not_finite) = self.render(bench)?;
        Ok(Measured::between(picture, truth).and(Measured { error: 0.0, not_finite }))
    }
}
