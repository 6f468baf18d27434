//! One iteration: render the batch, compare, go back, step.

use std::sync::Arc;

use erfgs_base::random;
use wgpu::Buffer;

use super::{
    TrainError, Trainer,
    model::{Said, plane_weights},
    samples::{self, Sample},
};
use crate::{
    checkpoint::LossSums,
    config::{MotionModel, Norm, Pairing, Switch},
    losses::{ColourChange, Exposure, LossSum, Losses, Part, Target},
    scene::TrainFrame,
    schedule::Stage,
};
use erfgs_splat::{
    field::{Blend, Outputs, Tape},
    gpu::{Gpu, Shape},
    model::Rendering,
    motion::{Motion, Witness},
    raster::{Region, RenderOptions, View, Wanted},
};

const EXPOSURE: u64 = 0x6578_706f;
const JITTER: u64 = 0x6a69_7474;
/// How many iterations before its own a frame is begun to be read that is not kept.
const READ_AHEAD: u32 = 16;

/// Buffers and kernels of an iteration.
#[derive(Debug)]
pub(super) struct Workspace {
    pub(super) losses: Losses,
    /// By sample of the iteration.
    pub(super) renderings: Vec<Vec<Rendering>>,
    mean: Buffer,
    pub(super) count: Buffer,
    pub(super) gradients: [Buffer; 2],
    before: Tape,
    after: Tape,
    /// Whether a frame sample of this iteration looks past what moves.
    looks_past: bool,
    /// Sums of the losses since the last row of the curve.
    pub sums: Sums,
}

/// Sums of the losses, and of how many samples.
#[derive(Debug)]
pub(super) struct Sums {
    pub rgb: LossSum,
    pub rgb_values: f64,
    pub event: LossSum,
    pub event_values: f64,
    pub trajectory: f64,
    pub trajectory_samples: f64,
    pub colour: LossSum,
    pub colour_samples: f64,
    pub plane: f64,
    pub plane_samples: f64,
}

impl Sums {
    /// As they stand; `None` where nothing was added since the last row of the curve, or what was is no number.
    pub fn state(&self, gpu: &Gpu) -> Result<Option<LossSums>, TrainError> {
        let counts = [
            self.rgb_values,
            self.event_values,
            self.trajectory,
            self.trajectory_samples,
            self.colour_samples,
            self.plane,
            self.plane_samples,
        ];
        if counts.iter().all(|&count| count == 0.0) || counts.iter().any(|count| !count.is_finite()) {
            return Ok(None);
        }
        let [rgb, event, colour] = [&self.rgb, &self.event, &self.colour].map(|sum| sum.partial(gpu));
        Ok(Some(LossSums { counts, partial: [rgb?, event?, colour?] }))
    }

    /// Goes on from there. Sums over pictures of another size are left alone: the next row of the curve is then a mean over what
    /// follows.
    pub fn restore(&mut self, gpu: &Gpu, state: &LossSums) {
        let [rgb, event, colour] = &state.partial;
        let fits = [(&self.rgb, rgb), (&self.event, event), (&self.colour, colour)]
            .map(|(sum, partial)| sum.restore(gpu, partial));
        if fits != [true; 3] {
            return;
        }
        [
            self.rgb_values,
            self.event_values,
            self.trajectory,
            self.trajectory_samples,
            self.colour_samples,
            self.plane,
            self.plane_samples,
        ] = state.counts;
    }
}

/// The part of an image that a frame sample looks at.
enum Look {
    All,
    /// Where something moves in the view.
    Moving(Arc<Region>),
    /// Where nothing does.
    Still,
}

impl Workspace {
    pub fn new(gpu: &Gpu, pixels: u32) -> Result<Self, TrainError> {
        let image = |label: &str| gpu.storage(label, u64::from(pixels) * 16);
        Ok(Self {
            losses: Losses::new(gpu),
            renderings: Vec::new(),
            mean: image("mean of an exposure")?,
            count: gpu.storage("event counts", u64::from(pixels) * 4)?,
            gradients: [image("gradient of an image")?, image("gradient of a later image")?],
            before: Tape::new(gpu)?,
            after: Tape::new(gpu)?,
            looks_past: false,
            sums: Sums {
                rgb: LossSum::new(gpu, pixels)?,
                rgb_values: 0.0,
                event: LossSum::new(gpu, pixels)?,
                event_values: 0.0,
                trajectory: 0.0,
                trajectory_samples: 0.0,
                colour: LossSum::new(gpu, pixels)?,
                colour_samples: 0.0,
                plane: 0.0,
                plane_samples: 0.0,
            },
        })
    }

    /// Makes room for so many renderings of the iteration's sample `number`; says where they are. A graphics processor has room for those
    /// of each: what one covered is asked for when it is drawn anew, which would wait for what is still held back in the same iteration.
    pub(super) fn room(&mut self, gpu: &Gpu, number: u32, count: usize) -> Result<usize, TrainError> {
        let sample = match gpu.shape {
            Shape::Gpu => number as usize,
            Shape::Cpu => 0,
        };
        if self.renderings.len() <= sample {
            self.renderings.resize_with(sample + 1, Vec::new);
        }
        while self.renderings[sample].len() < count {
            self.renderings[sample].push(Rendering::new(gpu)?);
        }
        Ok(sample)
    }
}

impl Trainer<'_> {
    /// Runs the next iteration of the stage.
    pub(super) fn iterate(&mut self) -> Result<(), TrainError> {
        self.feed.fill(self.gpu, &self.scene, self.config.earl.enabled)?;
        let before = self.gpu.traffic();
        // A software driver computes on the host's cores, and its lists are made by the host: there is nothing to wait for together.
        let together = self.gpu.shape == Shape::Gpu && !self.times.waits();
        let held = together.then(|| self.gpu.hold_back());
        self.model.clear_gradients(self.gpu);
        let (stage, iteration) = (self.clock.stage, self.clock.iteration);
        self.follow()?;
        let part = self.part();
        self.read_ahead();
        for slot in 0..self.config.batch {
            match samples::draw(&self.scene, &self.config, part.as_ref(), stage, iteration, slot) {
                Sample::Frame(index) => self.learn_frame(index, slot)?,
                Sample::Event { view, from, to } => self.learn_events(view, [from, to], slot)?,
            }
        }
        if let Some(Sample::Event { view, from, to }) =
            samples::draw_besides(&self.scene, &self.config, part.as_ref(), stage, iteration)
        {
            self.learn_events(view, [from, to], self.config.batch)?;
        }
        let every = self.config.field.regularise_every;
        if iteration.is_multiple_of(every)
            && let Some(field) =
                self.model.drawn.motion.as_mut().and_then(Motion::field_mut).filter(|_| self.model.drawn.dynamic > 0)
        {
            let weights = plane_weights(&self.config.field, every as f32);
            let losses = field.regularise(self.gpu, &weights)?;
            let one = plane_weights(&self.config.field, 1.0);
            self.work.sums.plane += f64::from(one.space) * losses.space
                + f64::from(one.time) * losses.time
                + f64::from(one.time_l1) * losses.time_l1;
            self.work.sums.plane_samples += 1.0;
        }
        let mut commands = self.gpu.commands();
        // What lies behind things that move is in a picture of which that part is left out, but nothing is said of it.
        let looks_past = std::mem::take(&mut self.work.looks_past);
        self.statistics.add(self.gpu, &mut commands, &self.model.gradients.screen, looks_past);
        commands.submit();
        self.times.lap(self.gpu, "plane regularisers and statistics")?;
        let decay = match (self.config.learning_rate.decay_steps, self.schedule.budget.is_none()) {
            (0, _) | (_, false) => self.schedule.progress(&self.clock),
            (steps, true) => f64::from(iteration) / f64::from(steps),
        };
        self.model.step(self.gpu, &self.config, self.scene.extent, decay, part.is_some())?;
        self.times.lap(self.gpu, "Adam")?;
        self.learn_poses()?;
        self.learn_clocks()?;
        drop(held);
        self.times.passed(self.gpu.traffic().since(before));
        self.clock.iteration += 1;
        Ok(())
    }

    /// Has frames read that a later iteration of this stage will ask for.
    fn read_ahead(&mut self) {
        let (pictures, now) = (&self.scene.pictures, self.schedule.done(&self.clock));
        let part = self.part();
        if pictures.all_are_kept() {
            return;
        }
        pictures.forget_before(now);
        for slot in 0..self.config.batch {
            let then = self.clock.iteration + READ_AHEAD;
            if let Sample::Frame(index) =
                samples::draw(&self.scene, &self.config, part.as_ref(), self.clock.stage, then, slot)
                && !self.feed.frames.keep(index)
            {
                pictures.expect(index, now + u64::from(READ_AHEAD));
            }
        }
    }

    /// How the scene is drawn as it stands.
    #[must_use]
    pub fn options(&self) -> RenderOptions {
        let raised = match self.config.static_set {
            // It has all of its colours.
            Some(_) => 3,
            None => (self.schedule.done(&self.clock) / u64::from(self.config.sh.raise_every)).min(3) as u32,
        };
        RenderOptions {
            background: self.config.background,
            sh_degree: self.model.drawn.gaussians.sh_degree.min(raised),
            near: self.config.near_m,
            near_sigmas: self.config.near_sigmas,
            ..RenderOptions::default()
        }
    }

    /// Of how many frame samples of the fine stage one looks at the whole image.
    pub(super) fn whole_image_every(&self) -> u32 {
        /// What a static set leaves to be learned is nearly all in the parts where something moves.
        const RARER: u32 = 4;
        match (self.config.dynamic.whole_image_every, &self.config.static_set) {
            (every, Some(_)) if every > 1 => every.saturating_mul(RARER),
            (every, _) => every,
        }
    }

    /// What the frame sample of this iteration looks at in a view, part by part.
    fn parts_of(&self, view: usize) -> Vec<Look> {
        let Some(region) = self.regions.get(view).cloned().flatten() else { return vec![Look::All] };
        let exposures = self.config.motion == MotionModel::Bodies && self.config.bodies.exposure > 1;
        match self.clock.stage {
            Stage::Coarse if self.config.dynamic.coarse_without_moving => vec![Look::Still],
            Stage::Coarse => vec![Look::All],
            Stage::Fine if !self.clock.iteration.is_multiple_of(self.whole_image_every()) => vec![Look::Moving(region)],
            // Only that part of the image needs many renderings of an exposure.
            Stage::Fine if exposures && self.model.drawn.dynamic > 0 => vec![Look::Still, Look::Moving(region)],
            Stage::Fine => vec![Look::All],
        }
    }

    fn learn_frame(&mut self, index: usize, batch_slot: u32) -> Result<(), TrainError> {
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
            Look::Still => vec![frame.instant(self.config.blur.instant)],
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
            let witness = Witness::Frame(if only.is_some() { 1.0 } else { weight });
            let pose = self.poses.as_ref().filter(|_| learns_pose).map(|poses| poses.row(frame.view));
            let said = Said { d_image, witness, wanted: Wanted { statistics: true, pose } };
            self.model.backward_raster(gpu, &view, &options, rendering, said)?;
            self.times.lap(gpu, "raster backward")?;
            let tells = !coarse && self.config.camera_time.due(run_share);
            let clock = self.clocks.as_ref().filter(|_| tells).map(|clocks| clocks.row(frame.view));
            self.model.backward_motion(gpu, rendering, witness, clock)?;
            self.times.lap(gpu, "motion backward")?;
        }
        Ok(())
    }

    /// The same where the events of a camera are learned from.
    pub(super) fn event_options(&self, index: usize) -> RenderOptions {
        RenderOptions { still_learn: self.config.earl.still_learn, near: self.event_near[index], ..self.options() }
    }

    /// How many samples share the weight of an event sample.
    pub(super) fn event_batch(&self) -> f32 {
        if self.config.earl.share > 0.0 { 1.0 } else { self.config.batch as f32 }
    }

    fn learn_events(&mut self, index: usize, [from, to]: [usize; 2], number: u32) -> Result<(), TrainError> {
        if self.config.earl.pairing == Pairing::Level {
            return self.learn_level(index, to, number);
        }
        let gpu = self.gpu;
        let events = &self.scene.events[index];
        let view: View = self.scene.views[events.view].view;
        let options = self.event_options(index);
        let pixels = view.width * view.height;
        let times = [self.scene.bins.edges[from], self.scene.bins.edges[to]];
        let region = self.regions.get(events.view).cloned().flatten();
        let sample = self.work.room(gpu, number, 2)?;
        for (slot, &time) in times.iter().enumerate() {
            let rendering = &mut self.work.renderings[sample][slot];
            rendering.frame.region.clone_from(&region);
            self.model.forward(gpu, &view, time, &options, rendering, &mut self.times)?;
        }
        // How many tiles they cover is asked for by the next iteration, while the device still goes back through this one.
        gpu.flush();
        let sensor = events.sensor;
        let worth = match self.config.earl.norm {
            Norm::L1 => sensor.worth(),
            Norm::L2 => sensor.worth().powi(2),
        };
        let scale = self.config.event_weight() * worth / (pixels as f32 * self.event_batch());
        let work = &mut self.work;
        let [before, after] = [0, 1].map(|slot| &work.renderings[sample][slot].frame.image);
        let [d_before, d_after] = &work.gradients;
        let (count, sum) = (&work.count, &work.sums.event);
        let mut commands = gpu.commands();
        let within = self.feed.region(events.view);
        self.feed.events.count(gpu, &mut commands, index, events, [from, to], within, count)?;
        work.losses.event(
            gpu,
            &mut commands,
            pixels,
            before,
            after,
            count,
            d_before,
            d_after,
            sum,
            scale,
            &sensor,
            &self.config.earl,
        );
        commands.submit();
        self.times.lap(gpu, "event loss")?;
        work.sums.event_values += f64::from(pixels);
        // The released code counts the render at t for density control, not the one at t'.
        for (slot, statistics) in [(0, true), (1, false)] {
            let rendering = &self.work.renderings[sample][slot];
            let d_image = &self.work.gradients[slot];
            let wanted = Wanted { statistics, pose: None };
            let said = Said { d_image, witness: Witness::Events, wanted };
            self.model.backward_raster(gpu, &view, &options, rendering, said)?;
            self.times.lap(gpu, "raster backward")?;
            if slot == 1 {
                self.regularise_trajectory(times, sample)?;
                self.times.lap(gpu, "trajectory regulariser")?;
                self.regularise_colour(&view, options.sh_degree, sample);
                self.times.lap(gpu, "colour regulariser")?;
            }
            self.model.backward_motion(gpu, &self.work.renderings[sample][slot], Witness::Events, None)?;
            self.times.lap(gpu, "motion backward")?;
        }
        Ok(())
    }

    /// Pulls the means at t' towards the straight line between their places at the frame times around it.
    fn regularise_trajectory(&mut self, times: [f64; 2], sample: usize) -> Result<(), TrainError> {
        let weight = self.config.earl.weight_trajectory / self.event_batch();
        let frame_times = &self.scene.frame_times;
        let next = frame_times.partition_point(|&time| time < times[1] - 1e-9);
        if weight == 0.0 || next == 0 || next >= frame_times.len() || self.model.drawn.dynamic == 0 {
            return Ok(());
        }
        let (start, end) = (frame_times[next - 1], frame_times[next]);
        if (end - times[1]).abs() < 1e-9 || end <= start {
            return Ok(());
        }
        let gpu = self.gpu;
        // The trajectories of a model without a field are smooth as they are.
        if self.model.drawn.motion.as_ref().and_then(Motion::field).is_none() {
            return Ok(());
        }
        let anchored = self.config.earl.pairing == Pairing::FrameAnchored && (start - times[0]).abs() < 1e-9;
        if !anchored {
            self.model.drawn.deform(gpu, start, &mut self.work.before, Outputs::PositionOnly)?;
        }
        self.model.drawn.deform(gpu, end, &mut self.work.after, Outputs::PositionOnly)?;
        let (Some(field), Some(d_deltas)) =
            (self.model.drawn.motion.as_ref().and_then(Motion::field), self.model.d_deltas.as_ref())
        else {
            return Ok(());
        };
        let before = if anchored { &self.work.renderings[sample][0].tape.deltas } else { &self.work.before.deltas };
        let blend = ((times[1] - start) / (end - start)) as f32;
        let reference = Blend { before, after: &self.work.after.deltas, blend };
        let loss = field.trajectory_loss(gpu, &self.work.renderings[sample][1].tape, reference, weight, d_deltas)?;
        self.work.sums.trajectory += loss;
        self.work.sums.trajectory_samples += 1.0;
        Ok(())
    }

    /// Pulls the colours at t' towards those at t, as the event camera sees them, where the field deforms colour.
    fn regularise_colour(&mut self, view: &View, sh_degree: u32, sample: usize) {
        let weight = self.config.earl.weight_colour / self.event_batch();
        let Some(d_deltas) = self.model.d_deltas.as_ref().filter(|_| weight > 0.0) else { return };
        let work = &mut self.work;
        let [before, after] = [0, 1].map(|slot| &work.renderings[sample][slot].tape.deltas);
        let gaussians = &self.model.drawn.gaussians;
        let change = ColourChange { gaussians, before, after, centre: view.centre(), sh_degree };
        let (d_sh, sum) = (&self.model.gradients.sh, &work.sums.colour);
        let mut commands = self.gpu.commands();
        if work.losses.colour(self.gpu, &mut commands, &change, d_sh, d_deltas, sum, weight) {
            commands.submit();
            work.sums.colour_samples += 1.0;
        }
    }
}

/// The times that a frame is rendered at: over its exposure where the blur model is on, else one instant. `drawn`, in [0, 1), says where
/// in its share each is that is drawn at random.
fn exposure_times(
    config: &crate::config::Config,
    stage: Stage,
    dynamic: u32,
    frame: &TrainFrame,
    drawn: f64,
) -> Vec<f64> {
    let [start, end] = frame.exposure;
    let moves = stage == Stage::Fine && end > start && dynamic > 0;
    if moves && config.motion == MotionModel::Bodies && config.bodies.exposure > 1 {
        // What goes far in an exposure would be learned as so many sharp things, were they always at the same places.
        let samples = config.bodies.exposure;
        let share = |k: u32| (f64::from(k) + drawn) / f64::from(samples);
        return (0..samples).map(|k| start + (end - start) * share(k)).collect();
    }
    let samples = config.blur.samples;
    if moves && config.blur.model != Switch::Off && samples > 1 {
        return (0..samples).map(|k| start + (end - start) * f64::from(k) / f64::from(samples - 1)).collect();
    }
    vec![frame.instant(config.blur.instant)]
}
