//! Learning from a frame: all of it, what moves in it, or what does not.

use std::sync::Arc;

use erfgs_base::random;

use super::{TrainError, Trainer, model::ImageGradient};
use crate::{
    config::{Config, MotionModel, Switch},
    losses::{Exposure, Part, Target},
    scene::TrainFrame,
    schedule::Stage,
};
use erfgs_splat::{
    motion::{Shown, Supervision},
    raster::{Region, View, Wanted},
};

const EXPOSURE: u64 = 0x6578_706f;
const JITTER: u64 = 0x6a69_7474;

/// The part of an image that a frame sample looks at.
enum Look {
    All,
    /// Where something moves in the view.
    Moving(Arc<Region>),
    /// Where nothing does.
    Still,
}

impl Trainer<'_> {
    /// What the frame sample of this iteration looks at in a view, part by part.
    fn parts_of(&self, view: usize) -> Vec<Look> {
        let Some(region) = self.regions.get(view).cloned().flatten() else { return vec![Look::All] };
        match self.clock.stage {
            Stage::Coarse if self.config.dynamic.coarse_without_moving => vec![Look::Still],
            Stage::Coarse => vec![Look::All],
            Stage::Fine if !self.clock.iteration.is_multiple_of(self.whole_image_every()) => vec![Look::Moving(region)],
            // Only that part of the image needs many renderings of an exposure.
            Stage::Fine if several(&self.config) && self.model.drawn.dynamic > 0 => {
                vec![Look::Still, Look::Moving(region)]
            }
            Stage::Fine => vec![Look::All],
        }
    }

    pub(super) fn learn_frame(&mut self, index: usize, batch_slot: u32) -> Result<(), TrainError> {
        let view = self.scene.frames[index].view;
        let looks = self.parts_of(view);
        self.work.looks_past |= matches!(looks[..], [Look::Still]);
        let View { width, height, .. } = self.scene.views[view].view;
        self.work.sums.rgb_values += 3.0 * f64::from(width * height);
        let parts = looks.len() as u32;
        (0..).zip(&looks).try_for_each(|(part, look)| self.learn_part(index, batch_slot, [part, parts], look))
    }

    /// Learns from a frame where `look` says, which is part `number` of as many.
    fn learn_part(
        &mut self,
        index: usize,
        batch_slot: u32,
        [number, parts]: [u32; 2],
        look: &Look,
    ) -> Result<(), TrainError> {
        let frame = &self.scene.frames[index];
        let pixels_taken = self.feed.frames.get(self.gpu, &self.scene.pictures, index)?;
        let drawn =
            random::uniform(random::key(self.config.seed, &[JITTER, self.clock.iteration.into(), batch_slot.into()]));
        let times = match look {
            // What stands still looks alike throughout an exposure.
            Look::Still => vec![frame.instant(self.config.blur.instant).into()],
            _ => exposure_times(&self.config, self.clock.stage, self.model.drawn.dynamic, frame, drawn),
        };
        let view = self.scene.views[frame.view].view;
        let options = self.options();
        let pixels = view.width * view.height;
        let linear = self.scene.linear_exposure && times.len() > 1;
        let weight = 1.0 / times.len() as f32;
        let scale = 1.0 / (3.0 * pixels as f32 * self.config.batch as f32);
        let gpu = self.gpu;
        let sample = self.work.room(gpu, batch_slot + number * (self.config.batch + 1), times.len())?;
        let part = match (look, self.feed.region(frame.view)) {
            (Look::Moving(_), Some(moving)) => Part::Within(moving),
            (Look::Still, Some(moving)) => Part::Outside(moving),
            (Look::All, _) | (_, None) => Part::All,
        };
        let region = match look {
            Look::Moving(region) => Some(region.clone()),
            Look::All | Look::Still => None,
        };
        let looks_at_all = region.is_none();
        for (slot, &time) in times.iter().enumerate() {
            let rendering = &mut self.work.renderings[sample][slot];
            rendering.frame.region.clone_from(&region);
            self.model.forward(gpu, &view, time, &options, rendering, &mut self.times)?;
        }
        // How many tiles they cover is asked for by the next iteration, while the device still goes back through this one.
        if number + 1 == parts {
            gpu.flush();
        }
        let coarse = self.clock.stage == Stage::Coarse;
        let run_share = self.share();
        let learns_pose = looks_at_all && self.learns_poses(run_share);
        let work = &mut self.work;
        let mut commands = gpu.commands();
        let [d_mean, d_linear] = &work.gradients;
        let mean = match &work.renderings[sample][..times.len()] {
            [only] => &only.frame.image,
            several => {
                for (slot, rendering) in several.iter().enumerate() {
                    let image = &rendering.frame.image;
                    let first = slot == 0;
                    work.losses.accumulate(gpu, &mut commands, pixels, image, &work.mean, first, weight, linear);
                }
                &work.mean
            }
        };
        // In display light the gradient of every rendering is the same share of that of the mean.
        let only = (self.config.blur.one_gradient && times.len() > 1).then(|| {
            let key = [EXPOSURE, self.clock.iteration.into(), batch_slot.into()];
            let drawn = random::uniform(random::key(self.config.seed, &key)) * times.len() as f64;
            (drawn as usize).min(times.len() - 1)
        });
        let scale = if only.is_some() { scale * times.len() as f32 } else { scale };
        let share = if linear { 1.0 } else { weight };
        let (target, sum) = (Target { frame: &pixels_taken, part }, &work.sums.rgb);
        let exposure = Exposure { pixels, mean, linear_light: linear, view: frame.view, colours: &self.colours };
        work.losses.photometric(gpu, &mut commands, &exposure, &target, d_mean, sum, scale * share);
        // What moves is told by its neighbours in time, too: the colour of a camera is learned from all of its image.
        let learned = &self.config.camera_colour;
        if self.colours_differ && looks_at_all && run_share >= f64::from(learned.from) {
            self.colours.step(gpu, &mut commands, frame.view, pixels, learned, run_share);
        }
        commands.submit();
        self.times.lap(gpu, "photometric loss")?;
        for slot in 0..times.len() {
            if only.is_some_and(|only| only != slot) {
                continue;
            }
            let rendering = &work.renderings[sample][slot];
            let d_image = if linear {
                let mut commands = gpu.commands();
                let image = &rendering.frame.image;
                work.losses.spread(gpu, &mut commands, pixels, image, d_mean, d_linear, weight);
                commands.submit();
                d_linear
            } else {
                d_mean
            };
            let supervision = Supervision::Frame(if only.is_some() { 1.0 } else { weight });
            let pose = self.poses.as_ref().filter(|_| learns_pose).map(|poses| poses.row(frame.view));
            let gradient = ImageGradient { d_image, supervision, wanted: Wanted { statistics: true, pose } };
            self.model.backward_raster(gpu, &view, &options, rendering, gradient)?;
            self.times.lap(gpu, "raster backward")?;
            let tells = !coarse && self.config.camera_time.due(run_share);
            let clock = self.clocks.as_ref().filter(|_| tells).and_then(|clocks| clocks.row(frame.view));
            self.model.backward_motion(gpu, rendering, supervision, clock)?;
            self.times.lap(gpu, "motion backward")?;
        }
        Ok(())
    }
}

/// Whether what moves is rendered at several instants of an exposure.
fn several(config: &Config) -> bool {
    config.motion == MotionModel::Bodies && config.bodies.exposure > 1
}

/// The times that a frame is rendered at: over its exposure where the blur model is on, else one instant. `drawn`, in [0, 1), says where
/// in its share each is that is drawn at random.
fn exposure_times(config: &Config, stage: Stage, dynamic: u32, frame: &TrainFrame, drawn: f64) -> Vec<Shown> {
    let [start, end] = frame.exposure;
    let moves = stage == Stage::Fine && end > start && dynamic > 0;
    if moves && several(config) {
        // What goes far in an exposure would be learned as so many sharp things, were they always at the same places.
        let samples = config.bodies.exposure;
        let share = |k: u32| (f64::from(k) + drawn) / f64::from(samples);
        let free_t01 = frame.instant(config.blur.instant);
        let shown = |k: u32| Shown { t01: start + (end - start) * share(k), free_t01 };
        return (0..samples).map(shown).collect();
    }
    let samples = config.blur.samples;
    if moves && config.blur.model != Switch::Off && samples > 1 {
        let at = |k: u32| start + (end - start) * f64::from(k) / f64::from(samples - 1);
        return (0..samples).map(|k| at(k).into()).collect();
    }
    vec![frame.instant(config.blur.instant).into()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Method, Preset};

    #[test]
    fn bodies_are_shown_throughout_an_exposure_and_what_is_free_at_one_instant_of_it() {
        let frame = TrainFrame { view: 0, index: 0, t01: 0.2, exposure: [0.2, 0.3] };
        let mut config = Config { motion: MotionModel::Bodies, ..Config::preset(Method::ErfGs, Preset::Default) };
        let times = |config: &Config, stage: Stage, dynamic: u32| exposure_times(config, stage, dynamic, &frame, 0.5);
        let fine = times(&config, Stage::Fine, 9);
        assert_eq!(fine.len(), config.bodies.exposure as usize);
        assert!(fine.windows(2).all(|pair| pair[0].t01 < pair[1].t01));
        assert!(fine.iter().all(|shown| shown.t01 > 0.2 && shown.t01 < 0.3));
        let instant = frame.instant(config.blur.instant);
        assert!(fine.iter().all(|shown| shown.free_t01 == instant));
        for once in [times(&config, Stage::Coarse, 9), times(&config, Stage::Fine, 0)] {
            assert_eq!(once, [instant.into()]);
        }
        config.motion = MotionModel::FreeTime;
        assert_eq!(times(&config, Stage::Fine, 9), [instant.into()]);
    }
}
