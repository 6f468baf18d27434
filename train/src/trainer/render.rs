//! Rendering of the learned scene.

use super::{TrainError, Trainer, model::Rendering};
use crate::scene::near_plane;
use erfgs_splat::raster::{LOW_PASS, View};

/// A rendering, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Red, green and blue of every pixel over the background; display values, not clamped.
    pub rgb: Vec<f32>,
    /// Light that passes every pixel, 0 to 1.
    pub transmittance: Vec<f32>,
    /// Mean depth of every pixel by opacity, metres; 0 where nothing is.
    pub depth: Vec<f32>,
}

impl Trainer<'_> {
    /// Renders the scene from `view` at `t01` (0 is the start of the recording, 1 its end).
    ///
    /// # Errors
    /// [`TrainError`] where the device fails.
    pub fn render(&mut self, view: &View, t01: f64) -> Result<Rendered, TrainError> {
        let options = erfgs_splat::raster::RenderOptions {
            depth: true,
            near: self.near(view),
            low_pass: self.low_pass(view),
            ..self.options()
        };
        let rendering = match &mut self.viewer {
            Some(rendering) => rendering,
            empty => empty.insert(Rendering::new(self.gpu)?),
        };
        self.model.forward(self.gpu, view, t01, &options, rendering, &mut self.times)?;
        let frame = &rendering.frame;
        let pixels = (view.width * view.height) as usize;
        let image: Vec<[f32; 4]> = self.gpu.download(&frame.image, pixels)?;
        let depth: Vec<f32> = match &frame.depth {
            Some(depth) => self.gpu.download(depth, pixels)?,
            None => vec![0.0; pixels],
        };
        let seen = |(depth, pixel): (f32, &[f32; 4])| if pixel[3] < 0.999 { depth / (1.0 - pixel[3]) } else { 0.0 };
        Ok(Rendered {
            rgb: image.iter().flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
            transmittance: image.iter().map(|pixel| pixel[3]).collect(),
            depth: depth.into_iter().zip(&image).map(seen).collect(),
        })
    }

    /// The low pass of a picture that may be larger than those of the cameras.
    fn low_pass(&self, view: &View) -> f32 {
        let focal = self.scene.views.iter().map(|own| own.view.fx).fold(0.0, f32::max);
        let larger = if focal > 0.0 { (view.fx / focal).max(1.0) } else { 1.0 };
        LOW_PASS * larger * larger
    }

    /// The near plane, metres. A training camera with frames is rendered as it was trained; in front of any other, event cameras
    /// without frames among them, lie Gaussians that no frame could see through or past.
    #[must_use]
    pub fn near(&self, view: &View) -> f32 {
        let trained = |index: usize| self.scene.views[index].view == *view && self.scene.has_frames(index);
        if (0..self.scene.views.len()).any(trained) {
            return self.config.near_m;
        }
        near_plane(&self.scene.points, view, self.config.near_share, self.config.near_m)
    }
}
