//! Pictures of an evaluation: renderings beside the truth, rendered event frames beside measured ones.

use erfgs_events::palette;
use erfgs_scene::image::{ImageGrey8, ImageRgb8};

use crate::trainer::{TrainError, Trainer};
use erfgs_run::{PerView, RunFolder};
use erfgs_splat::model::to_bytes;

/// Event frames written for every event camera.
const EVENT_FRAMES: usize = 3;

pub(super) fn write_frame(
    run: &RunFolder,
    view: &PerView,
    rendered: &[f32],
    truth: &ImageRgb8,
    mask: &[bool],
) -> Result<(), TrainError> {
    let rendered = ImageRgb8 { width: truth.width, height: truth.height, data: to_bytes(rendered) };
    let mask = mask.iter().map(|&moves| if moves { 255 } else { 0 }).collect();
    let mask = ImageGrey8 { width: truth.width, height: truth.height, data: mask };
    rendered.write_png(&run.render_file(&view.camera, view.index)?)?;
    truth.write_png(&run.truth_file(&view.camera, view.index)?)?;
    mask.write_png(&run.mask_file(&view.camera, view.index)?)?;
    Ok(())
}

impl Trainer<'_> {
    /// Writes measured and rendered event frames over one RGB interval, at a few times of every event camera.
    pub(super) fn write_event_frames(&mut self, run: &RunFolder) -> Result<(), TrainError> {
        let bins = self.scene.bins.len();
        let step = self.scene.bins.per_interval.max(1);
        for index in 0..self.scene.events.len() {
            for picture in 0..EVENT_FRAMES {
                let start = (bins.saturating_sub(step)) * picture / (EVENT_FRAMES - 1).max(1);
                let end = (start + step).min(bins);
                let events = &self.scene.events[index];
                let (view, sensor) = (events.view, events.sensor);
                let measured = events.between(start, end)?;
                let [from, to] = [start, end].map(|edge| self.scene.bins.edges[edge]);
                let (before, after) = (self.render_view(view, from)?, self.render_view(view, to)?);
                let rendered: Vec<f32> = before
                    .as_chunks::<3>()
                    .0
                    .iter()
                    .zip(after.as_chunks::<3>().0)
                    .map(|(before, after)| (sensor.lin_log(after) - sensor.lin_log(before)) / sensor.threshold)
                    .collect();
                let scene_view = &self.scene.views[view];
                let size = [scene_view.view.width, scene_view.view.height];
                let number = start as u32;
                let file = run.measured_events_file(&scene_view.name, number)?;
                picture_of(&measured, size).write_png(&file)?;
                picture_of(&rendered, size).write_png(&run.rendered_events_file(&scene_view.name, number)?)?;
            }
        }
        Ok(())
    }
}

/// Signed counts of events, in the colours of all event pictures; full colour at four thresholds.
fn picture_of(counts: &[f32], [width, height]: [u32; 2]) -> ImageRgb8 {
    let weight = |count: f32| if count.abs() < 0.5 { 0.0 } else { count.abs() / 4.0 };
    let data = counts.iter().flat_map(|&count| palette::blend(palette::STILL, count > 0.0, weight(count)));
    ImageRgb8 { width, height, data: data.collect() }
}
