//! Training beside what stands still in all windows of a take.

use super::{TrainError, TrainOptions, Trainer, grow::thin};
use crate::{
    config::{Config, MotionModel},
    density::{Moments, Population},
    scene::{MotionMasks, Point, Scene, classify},
    schedule::Clock,
    static_set::StaticSet,
};
use erfgs_run::LeftOut;
use erfgs_splat::{gaussians::Gaussians, gpu::Gpu};

/// A frame shows something else where it differs from the static set by more than this (of 1), in the mean of a square.
const UNLIKE: f32 = 0.1;
/// Such a square reaches to either side for this share of the width of the picture.
const REACH: f32 = 0.01;
/// Where it is thin, a pixel alone differs by more than this.
const UNLIKE_ALONE: f32 = 0.25;

impl<'a> Trainer<'a> {
    /// A run that takes what stands still from `set`. It has no coarse stage: nothing is left to be learned in one.
    ///
    /// # Errors
    /// [`TrainError`] where the device has no room, or a field is to move everything.
    pub fn within(
        gpu: &'a Gpu,
        scene: Scene,
        config: Config,
        options: &TrainOptions,
        set: &StaticSet,
    ) -> Result<Self, TrainError> {
        config.validate()?;
        let refused = |reason: &str| TrainError::StaticSet { reason: reason.into() };
        match config.motion {
            MotionModel::HexPlane | MotionModel::Auto => {
                return Err(refused(
                    "a deformation field has no separate moving Gaussians; train with --motion free-time",
                ));
            }
            MotionModel::FreeTime | MotionModel::Bodies | MotionModel::Still => {}
        }
        if config.coarse_iterations > 0 {
            return Err(refused("its windows have no coarse stage; give --iterations 0+N"));
        }
        let config = Config { static_set: Some(set.sha256()), ..config };
        let gaussians = set.gaussians.with_sh_degree(config.sh.max_degree);
        let moments = Moments::zero(&gaussians);
        let population = Population { gaussians, moments };
        let names: Vec<String> = scene.views.iter().map(|view| view.name.clone()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let takes_frames: Vec<bool> = (0..scene.views.len()).map(|view| scene.has_frames(view)).collect();
        let mut trainer = Self::assemble(gpu, scene, config, options, &population, Clock::default(), &[])?;
        trainer.model.fixed = population.gaussians.len() as u32;
        trainer.restore_poses(set.poses(&names))?;
        if let Some(colours) = set.colours(&names, &takes_frames).filter(|_| trainer.colours_differ) {
            trainer.colours.restore(gpu, &colours);
        }
        trainer.find_regions()?;
        Ok(trainer)
    }

    /// What stands still when the fine stage begins: Gaussians of the static set where frames show something else at some instant, and
    /// points where they always do, both of which learn; then all others of the set.
    pub(super) fn fit_static_set(&mut self, population: &Population) -> Result<Population, TrainError> {
        let count = population.gaussians.len();
        let means: Vec<[f32; 3]> = (0..count).map(|index| population.gaussians.mean(index)).collect();
        let points = self.scene.still_points();
        let places: Vec<[f32; 3]> = points.iter().map(|(place, _)| *place).collect();
        let share = self.config.dynamic.share;
        let (mut sometimes, mut always) = (vec![false; count], vec![true; points.len()]);
        for masks in self.unlike()? {
            let at = |places: &[[f32; 3]]| classify(&self.scene, &masks, places, share);
            sometimes.iter_mut().zip(at(&means)).for_each(|(sometimes, now)| *sometimes |= now);
            always.iter_mut().zip(at(&places)).for_each(|(always, now)| *always &= now);
        }
        let (mut order, fixed): (Vec<usize>, Vec<usize>) = (0..count).partition(|&index| sometimes[index]);
        self.model.fixed = fixed.len() as u32;
        let anew = order.len();
        order.extend(fixed);
        let points: Vec<Point> =
            points.into_iter().zip(always).filter(|(_, always)| *always).map(|(point, _)| point).collect();
        let points = thin(&points, self.config.init.max_points as usize);
        let own = Gaussians::from_points(&points, self.config.sh.max_degree, self.config.init.opacity);
        self.left_out.push(LeftOut {
            what: "what stands still".into(),
            why: format!(
                "{} of {count} Gaussians of the static set agree with the frames; {anew} Gaussians and {} points are learned again \
                 where the frames differ",
                self.model.fixed,
                points.len()
            ),
            saves: format!("the coarse stage, and learning {} Gaussians", self.model.fixed),
        });
        let mut still = population.select(&order, 0).with_dynamic(&own);
        still.gaussians.dynamic = 0;
        Ok(still)
    }

    /// Pixels of the cameras with frames where these show something else than the static set: at the beginning of the window, in its
    /// middle and at its end. What stands there differs for most cameras then; what passes before it for few.
    fn unlike(&mut self) -> Result<[MotionMasks; 3], TrainError> {
        let colours = self.colour_state()?;
        let mut masks = [const { Vec::new() }; 3];
        for camera in (0..self.scene.views.len()).filter(|camera| self.scene.has_frames(*camera)).collect::<Vec<_>>() {
            let frames: Vec<usize> = self.scene.frames_of(camera).collect();
            let [Some(&first), Some(&middle), Some(&last)] =
                [frames.first(), frames.get(frames.len() / 2), frames.last()]
            else {
                continue;
            };
            let (view, time) = (self.scene.views[camera].view, self.scene.frames[middle].t01);
            let [gain, offset] = colours.of(camera);
            let mut rendered = self.render(&view, time)?.rgb;
            for pixel in rendered.chunks_exact_mut(3) {
                pixel.iter_mut().zip(gain.iter().zip(offset)).for_each(|(value, (gain, offset))| {
                    *value = (gain * *value + offset).clamp(0.0, 1.0);
                });
            }
            for (masks, frame) in masks.iter_mut().zip([first, middle, last]) {
                masks.push((camera, differ(&rendered, &self.scene.pictures.get(frame)?, view.width as usize)));
            }
        }
        Ok(masks.map(|masks| MotionMasks { masks }))
    }
}

/// Where a frame (RGBA, of which nothing is compared where A is 0) differs from a rendering (RGB of 1) in the mean of squares.
fn differ(rendered: &[f32], frame: &[u32], width: usize) -> Vec<bool> {
    let reach = (REACH * width as f32).ceil() as usize;
    let mut other = vec![false; frame.len()];
    for channel in 0..3 {
        let difference = |(pixel, recorded): (usize, &u32)| {
            let recorded = recorded.to_le_bytes();
            if recorded[3] == 0 { 0.0 } else { f32::from(recorded[channel]) / 255.0 - rendered[3 * pixel + channel] }
        };
        let differences: Vec<f32> = frame.iter().enumerate().map(difference).collect();
        let means = means_around(&differences, width, reach);
        for (other, (mean, own)) in other.iter_mut().zip(means.into_iter().zip(differences)) {
            *other |= mean.abs() > UNLIKE || own.abs() > UNLIKE_ALONE;
        }
    }
    other
}

/// The mean of each value's square, which reaches `reach` pixels to either side, of which those outside the picture are nothing.
fn means_around(values: &[f32], width: usize, reach: usize) -> Vec<f32> {
    let height = values.len() / width.max(1);
    // Sums over all that is above and left of a pixel's lower right corner.
    let mut sums = vec![0.0_f64; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += f64::from(values[y * width + x]);
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
        }
    }
    let area = (2 * reach + 1).pow(2) as f64;
    let mean = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let [left, top] = [x, y].map(|at| at.saturating_sub(reach));
        let (right, bottom) = ((x + reach + 1).min(width), (y + reach + 1).min(height));
        let at = |x: usize, y: usize| sums[y * (width + 1) + x];
        ((at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top)) / area) as f32
    };
    (0..width * height).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_differs_where_a_square_or_a_pixel_much_and_where_it_is_known() {
        let width = 40;
        let rendered = vec![0.5; 3 * width * width];
        let grey = u32::from_le_bytes([128, 128, 128, 255]);
        let mut frame = vec![grey; width * width];
        assert!(differ(&rendered, &frame, width).iter().all(|differs| !differs));
        // A pixel that differs a little may be noise, or an edge that lies a little beside.
        frame[5 * width + 5] = u32::from_le_bytes([190, 128, 128, 255]);
        assert!(differ(&rendered, &frame, width).iter().all(|differs| !differs));
        frame[5 * width + 5] = u32::from_le_bytes([200, 128, 128, 255]);
        assert_eq!(differ(&rendered, &frame, width).iter().filter(|differs| **differs).count(), 1, "a rod is as thin");
        for y in 20..26 {
            for x in 20..26 {
                frame[y * width + x] = u32::from_le_bytes([128, 128, 180, 255]);
                frame[y * width + x - 15] = u32::from_le_bytes([0, 0, 0, 0]);
            }
        }
        let differs = differ(&rendered, &frame, width);
        assert!(differs[23 * width + 23] && !differs[23 * width + 8] && !differs[30 * width + 30]);
    }

    #[test]
    fn a_square_counts_what_is_outside_the_picture_as_nothing() {
        let values: Vec<f32> = (0..20).map(|value| value as f32).collect();
        let means = means_around(&values, 5, 1);
        assert!((means[6] - 6.0).abs() < 1e-6);
        assert!((means[0] - (0.0 + 1.0 + 5.0 + 6.0) / 9.0).abs() < 1e-6);
        assert!((means[19] - (13.0 + 14.0 + 18.0 + 19.0) / 9.0).abs() < 1e-6);
        assert_eq!(means_around(&[], 0, 2), Vec::<f32>::new());
        assert_eq!(means_around(&values, 5, 0), values);
    }
}
