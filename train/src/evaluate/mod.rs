//! Evaluation on held-out cameras: metrics, pictures, event frames.

mod masks;
mod parts;
mod pictures;
mod split;

use std::time::Instant;

use erfgs_dataset::Dataset;
use erfgs_scene::image::ImageRgb8;

pub use masks::HeldOutMasks;

use parts::Parts;
use split::{When, when};

use crate::{
    metrics::{Dpsnr, Lpips, MaskedError, Picture, masked_error, psnr, ssim, to_unit},
    scene::{HeldOutFrame, SceneError},
    trainer::{TrainError, Trainer},
};
use erfgs_run::{LpipsKind, LpipsScaling, Metrics, PerView, RunFolder};

/// What an evaluation does besides figures.
#[derive(Debug, Default)]
pub struct EvaluateOptions<'a> {
    /// LPIPS with the weights that the user supplies.
    pub lpips: Option<(&'a Lpips, LpipsScaling)>,
    /// Write every n-th held-out frame of a camera as pictures (0: none).
    pub picture_stride: u32,
}

/// What a look during training finds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quality {
    /// Mean PSNR, dB.
    pub psnr: f64,
    /// Mean PSNR over moving pixels, dB.
    pub dpsnr: Option<f64>,
    /// Mean PSNR over pixels that stand still, dB.
    pub psnr_static: Option<f64>,
}

impl Trainer<'_> {
    /// Renders `view` (an index into the scene's views) at `t01`; RGB in [0, 1], row-major.
    ///
    /// # Errors
    /// [`TrainError`] where the device fails.
    pub fn render_view(&mut self, view: usize, t01: f64) -> Result<Vec<f32>, TrainError> {
        let view = self.scene.views[view].view;
        Ok(self.render(&view, t01)?.rgb)
    }

    /// Evaluates on all held-out frames, and writes metrics and pictures into the run folder.
    ///
    /// # Errors
    /// [`TrainError`] where a frame cannot be read, a file not be written, or the device fails.
    pub fn evaluate(
        &mut self,
        run: &RunFolder,
        options: &EvaluateOptions<'_>,
        on_progress: &mut dyn FnMut(usize, usize),
    ) -> Result<Metrics, TrainError> {
        let masks = HeldOutMasks::new(&self.scene)?;
        let fast = masks.fast(&self.scene)?;
        let held_out = self.scene.held_out.clone();
        let mut views = Vec::with_capacity(held_out.len());
        let mut dpsnr = Dpsnr::default();
        let mut parts = Parts::default();
        let mut seconds = 0.0;
        for (done, frame) in held_out.iter().enumerate() {
            on_progress(done, held_out.len());
            let started = Instant::now();
            let rendered = self.render_view(frame.view, frame.t01)?;
            seconds += started.elapsed().as_secs_f64();
            let truth = read(&self.scene.dataset, frame)?;
            let mask = masks.of(frame);
            let (shown, unit) = (clamped(&rendered), to_unit(&truth.data));
            let a = Picture::new(truth.width, truth.height, &shown)?;
            let b = Picture::new(truth.width, truth.height, &unit)?;
            let (view, error) = self.compare(frame, [a, b], mask, options)?;
            dpsnr.add(error);
            parts.add(when(&self.scene, frame.t01), frame.view, [a, b], [mask, &fast[done]], error)?;
            let index = frame.index as u32;
            if options.picture_stride > 0 && index.is_multiple_of(options.picture_stride) {
                pictures::write_frame(run, &view, &rendered, &truth, mask)?;
            }
            views.push(view);
        }
        on_progress(held_out.len(), held_out.len());
        if options.picture_stride > 0 {
            self.write_event_frames(run)?;
        }
        let mean = |value: &dyn Fn(&PerView) -> f64| views.iter().map(value).sum::<f64>() / views.len().max(1) as f64;
        let lpips = views.iter().map(|view| view.lpips).sum::<Option<f64>>().map(|sum| sum / views.len().max(1) as f64);
        let metrics = Metrics {
            psnr: mean(&|view| view.psnr),
            dpsnr: dpsnr.mean(),
            dpsnr_pooled: dpsnr.pooled(),
            dpsnr_mask: masks.kind,
            psnr_static: parts.psnr_static(),
            psnr_fast: parts.psnr_fast(),
            at_frames: parts.part(When::AtFrame),
            between_frames: parts.part(When::Between),
            outside_frames: parts.part(When::Outside),
            colour_corrected: parts.colour_corrected(),
            ssim: mean(&|view| view.ssim),
            lpips: if options.lpips.is_some() { lpips } else { None },
            lpips_kind: options.lpips.map(|(lpips, scaling)| LpipsKind { net: lpips.net(), scaling }),
            train_psnr: self.train_psnr()?,
            iterations: self.iterations_done(),
            train_seconds: self.clock.seconds,
            train_cpu_seconds: (self.clock.cpu_seconds > 0.0).then_some(self.clock.cpu_seconds),
            gaussians: u64::from(self.model.drawn.gaussians.count),
            bytes: self.model.bytes(),
            render_fps: if seconds > 0.0 { held_out.len() as f64 / seconds } else { 0.0 },
        };
        run.write_metrics(&metrics)?;
        run.write_per_view(&views)?;
        Ok(metrics)
    }

    /// The quality over the held-out frames that the configuration picks for looks during training.
    pub(crate) fn evaluate_quickly(&mut self) -> Result<Quality, TrainError> {
        if self.held_out_masks.is_none() {
            self.held_out_masks = Some(HeldOutMasks::new(&self.scene)?);
        }
        let frames = self.looked_at();
        let (mut sum, mut dpsnr, mut still) = (0.0, Dpsnr::default(), Dpsnr::default());
        for frame in &frames {
            let rendered = self.render_view(frame.view, frame.t01)?;
            let truth = read(&self.scene.dataset, frame)?;
            let unit = to_unit(&truth.data);
            let (a, b) = (clamped(&rendered), Picture::new(truth.width, truth.height, &unit)?);
            let a = Picture::new(truth.width, truth.height, &a)?;
            sum += psnr(a, b)?;
            if let Some(masks) = &self.held_out_masks {
                let mask = masks.of(frame);
                dpsnr.add(masked_error(a, b, mask)?);
                still.add(masked_error(a, b, &mask.iter().map(|moves| !moves).collect::<Vec<_>>())?);
            }
        }
        Ok(Quality { psnr: sum / frames.len().max(1) as f64, dpsnr: dpsnr.mean(), psnr_static: still.mean() })
    }

    /// Every n-th held-out frame of each camera, and of those as many as are wanted: the cameras in turn, each at times of its own.
    fn looked_at(&self) -> Vec<HeldOutFrame> {
        let evaluation = &self.config.evaluation;
        let every = |frame: &&HeldOutFrame| frame.index.is_multiple_of(evaluation.frame_stride as usize);
        let frames: Vec<HeldOutFrame> = self.scene.held_out.iter().filter(every).cloned().collect();
        match evaluation.frames as usize {
            0 => frames,
            wanted => spread(&frames, wanted),
        }
    }

    fn compare(
        &self,
        frame: &HeldOutFrame,
        [a, b]: [Picture<'_>; 2],
        mask: &[bool],
        options: &EvaluateOptions<'_>,
    ) -> Result<(PerView, MaskedError), TrainError> {
        let error = masked_error(a, b, mask)?;
        let lpips = options.lpips.map(|(lpips, scaling)| lpips.distance(a, b, scaling)).transpose()?;
        let view = PerView {
            camera: self.scene.views[frame.view].name.clone(),
            index: frame.index as u32,
            t_ns: frame.t_ns,
            psnr: psnr(a, b)?,
            dpsnr: error.psnr(),
            ssim: ssim(a, b)?,
            lpips,
            moving_pixels: error.pixels,
        };
        Ok((view, error))
    }

    /// PSNR over one frame of every training camera, each at another time, in the colours of that camera and without the
    /// model of the exposure.
    fn train_psnr(&mut self) -> Result<Option<f64>, TrainError> {
        let mut chosen = Vec::new();
        for view in 0..self.scene.views.len() {
            let of_view: Vec<usize> = self.scene.frames_of(view).collect();
            if !of_view.is_empty() {
                chosen.push(of_view[view % of_view.len()]);
            }
        }
        let colours = self.colour_state()?;
        let mut sum = 0.0;
        for &index in &chosen {
            let (view, t01) = (self.scene.frames[index].view, self.scene.frames[index].t01);
            let [gain, offset] = colours.of(view);
            let mut rendered = self.render_view(view, t01)?;
            for pixel in rendered.as_chunks_mut::<3>().0 {
                *pixel = std::array::from_fn(|c| gain[c] * pixel[c] + offset[c]);
            }
            let rendered = clamped(&rendered);
            let pixels = self.scene.pictures.get(index)?;
            let bytes = pixels.iter().flat_map(|pixel| pixel.to_le_bytes().into_iter().take(3));
            let truth = to_unit(&bytes.collect::<Vec<u8>>());
            let size = self.scene.views[view].view;
            let a = Picture::new(size.width, size.height, &rendered)?;
            sum += psnr(a, Picture::new(size.width, size.height, &truth)?)?;
        }
        Ok((!chosen.is_empty()).then(|| sum / chosen.len() as f64))
    }
}

/// As an 8-bit picture would hold it, since that is what the method's own evaluation reads.
/// So many of the frames, which lie camera by camera: at times that are spread over the recording, each of one camera. Times that
/// several cameras share would mostly be those of training frames, or mostly others.
fn spread(frames: &[HeldOutFrame], wanted: usize) -> Vec<HeldOutFrame> {
    if frames.len() <= wanted {
        return frames.to_vec();
    }
    let cameras: Vec<&[HeldOutFrame]> = frames.chunk_by(|a, b| a.view == b.view).collect();
    let chosen = (0..wanted).map(|k| {
        let frames = cameras[k % cameras.len()];
        frames[(2 * k + 1) * frames.len() / (2 * wanted)].clone()
    });
    chosen.collect()
}

fn clamped(rgb: &[f32]) -> Vec<f32> {
    to_unit(&erfgs_splat::model::to_bytes(rgb))
}

fn read(dataset: &Dataset, frame: &HeldOutFrame) -> Result<ImageRgb8, TrainError> {
    let camera = &dataset.manifest.cameras[frame.view];
    Ok(dataset.read_image(camera, &camera.frames[frame.index]).map_err(SceneError::from)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_at_times_all_over_and_a_quarter_of_them_where_each_fourth_frame_is_trained_on() {
        let frame =
            |view: usize, index: usize| HeldOutFrame { view, index, t_ns: index as i64, t01: index as f64 / 44.0 };
        let frames: Vec<HeldOutFrame> = (0..4).flat_map(|view| (0..45).map(move |index| frame(view, index))).collect();
        let looks = spread(&frames, 16);
        let mut times: Vec<usize> = looks.iter().map(|frame| frame.index).collect();
        assert_eq!(times.iter().filter(|index| **index % 4 == 0).count(), 4, "{times:?}");
        assert!((0..4).all(|view| looks.iter().filter(|frame| frame.view == view).count() == 4));
        times.dedup();
        assert_eq!((times.len(), times[0], times[15]), (16, 1, 43));
        assert_eq!(spread(&frames[..7], 16), frames[..7]);
        // Cameras of one frame each.
        let single: Vec<HeldOutFrame> = (0..5).map(|view| frame(view, 0)).collect();
        assert_eq!(spread(&single, 3), single[..3]);
    }
}
