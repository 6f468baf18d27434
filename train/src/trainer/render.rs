//! Rendering of the learned scene.

use super::{TrainError, Trainer};
use erfgs_splat::{
    model::{Rendered, Rendering},
    near_plane_beside,
    raster::{RenderOptions, View},
    trained::low_pass,
};

impl Trainer<'_> {
    /// Renders the scene from `view` at `t01` (0 is the start of the recording, 1 its end).
    ///
    /// # Errors
    /// [`TrainError`] where the device fails.
    pub fn render(&mut self, view: &View, t01: f64) -> Result<Rendered, TrainError> {
        let cameras = self.scene.views.iter().map(|own| &own.view);
        let (near, low_pass) = (self.near(view), low_pass(cameras, view));
        let options = RenderOptions { depth: true, near, low_pass, ..self.options() };
        let rendering = match &mut self.viewer {
            Some(rendering) => rendering,
            empty => empty.insert(Rendering::new(self.gpu)?),
        };
        loop {
            self.model.forward(self.gpu, view, t01, &options, rendering, &mut self.times)?;
            if rendering.is_complete(self.gpu)? {
                return Ok(rendering.picture(self.gpu)?);
            }
        }
    }

    /// The near plane, metres: [`near_plane_beside`].
    #[must_use]
    pub fn near(&self, view: &View) -> f32 {
        let trained = (0..self.scene.views.len()).filter(|&index| self.scene.has_frames(index));
        let trained = trained.map(|index| &self.scene.views[index].view);
        let points = self.scene.points.iter().map(|(place, _)| place);
        near_plane_beside(trained, points, view, self.config.near_share, self.config.near_m)
    }
}
