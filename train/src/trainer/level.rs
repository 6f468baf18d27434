//! Learning from an event camera at one time, against the levels of its pixels.

use super::{TrainError, Trainer, model::ImageGradient};
use crate::{config::Pairing, losses::Levels, scene::Scene};
use erfgs_splat::{gpu::Gpu, motion::Supervision, raster::Wanted};

/// The levels of the pixels of the event cameras, where `earl.pairing` asks for them: from what a checkpoint `saved`, or unknown where it
/// saved none.
///
/// # Errors
/// [`TrainError::Levels`] where the checkpoint is of other event cameras.
pub(super) fn levels(
    gpu: &Gpu,
    scene: &Scene,
    pairing: Pairing,
    saved: &[Vec<f32>],
) -> Result<Vec<Levels>, TrainError> {
    if pairing != Pairing::Level {
        return Ok(Vec::new());
    }
    let views = scene.events.iter().map(|events| &scene.views[events.view].view);
    let pixels: Vec<usize> = views.map(|view| view.width as usize * view.height as usize).collect();
    if saved.is_empty() || pixels.is_empty() {
        return Ok(pixels.into_iter().map(|pixels| Levels::new(gpu, pixels)).collect::<Result<_, _>>()?);
    }
    if !saved.iter().map(Vec::len).eq(pixels.iter().map(|pixels| 2 * pixels)) {
        let [saved, pixels] = [saved.iter().map(|levels| levels.len() / 2).sum(), pixels.iter().sum()];
        return Err(TrainError::Levels { saved, pixels });
    }
    Ok(saved.iter().map(|saved| Levels::restore(gpu, saved)).collect::<Result<_, _>>()?)
}

impl Trainer<'_> {
    /// Renders event view `index` at edge `to` and compares it with what the camera says of the light there.
    pub(super) fn learn_level(&mut self, index: usize, to: usize, number: u32) -> Result<(), TrainError> {
        let (gpu, options) = (self.gpu, self.event_options(index));
        let events = &self.scene.events[index];
        let view = self.scene.views[events.view].view;
        let region = self.regions.get(events.view).cloned().flatten();
        let camera = events.view;
        let time = self.seen_at(camera, self.scene.bins.edges[to]);
        let sample = self.work.room(gpu, number, 1)?;
        let rendering = &mut self.work.renderings[sample][0];
        rendering.frame.region = region;
        self.model.forward(gpu, &view, time, &options, rendering, &mut self.times)?;
        // As for frames.
        gpu.flush();
        let pixels = view.width * view.height;
        let scale = self.config.event_weight() * events.sensor.worth() / (pixels as f32 * self.event_batch());
        let work = &mut self.work;
        let mut commands = gpu.commands();
        let (image, d_image, sum) = (&work.renderings[sample][0].frame.image, &work.gradients[0], &work.sums.event);
        let (count, levels) = (&work.count, &self.levels[index]);
        let (edges, within) = ([events.covers[0], to], self.feed.region(events.view));
        self.feed.events.count(gpu, &mut commands, index, events, edges, within, count)?;
        work.losses.event_level(gpu, &mut commands, image, count, levels, d_image, sum, scale, &events.sensor);
        commands.submit();
        self.times.lap(gpu, "event loss")?;
        work.sums.event_values += f64::from(pixels);
        let rendering = &self.work.renderings[sample][0];
        let wanted = Wanted { statistics: true, pose: None };
        let gradient = ImageGradient { d_image: &self.work.gradients[0], supervision: Supervision::Events, wanted };
        self.model.backward_raster(gpu, &view, &options, rendering, gradient)?;
        self.times.lap(gpu, "raster backward")?;
        let tells = self.events_tell_clock(camera);
        let clock = self.clocks.as_ref().filter(|_| tells).and_then(|clocks| clocks.row(camera));
        self.model.backward_motion(gpu, rendering, Supervision::Events, clock)?;
        self.times.lap(gpu, "motion backward")?;
        Ok(())
    }
}
