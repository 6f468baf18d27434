//! One iteration: render the batch, compare, go back, step.

use wgpu::Buffer;

use super::{
    TrainError, Trainer,
    follow::Part,
    model::{ImageGradient, plane_weights},
    samples::{self, Sample},
    sums::Sums,
};
use crate::{
    config::{Norm, Pairing},
    losses::{ColourChange, LossSum, Losses},
};
use erfgs_splat::{
    field::{Blend, Outputs, Tape},
    gpu::{Gpu, Shape, stored},
    model::Rendering,
    motion::{Motion, Supervision},
    raster::{RenderOptions, View, Wanted},
};

/// How many iterations before its own a frame is begun to be read that is not kept.
const READ_AHEAD: u32 = 16;

/// Buffers and kernels of an iteration.
#[derive(Debug)]
pub(super) struct Workspace {
    pub(super) losses: Losses,
    /// By sample of the iteration.
    pub(super) renderings: Vec<Vec<Rendering>>,
    pub(super) mean: Buffer,
    pub(super) count: Buffer,
    pub(super) gradients: [Buffer; 2],
    before: Tape,
    after: Tape,
    /// Whether a frame sample of this iteration looks past what moves.
    pub(super) looks_past: bool,
    /// Sums of the losses since the last row of the curve.
    pub sums: Sums,
}

impl Workspace {
    pub fn new(gpu: &Gpu, pixels: u32) -> Result<Self, TrainError> {
        let [image, count] = Self::sizes(pixels);
        let image = |label: &str| gpu.storage(label, image);
        Ok(Self {
            losses: Losses::new(gpu),
            renderings: Vec::new(),
            mean: image("mean of an exposure")?,
            count: gpu.storage("event counts", count)?,
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

    /// Bytes of an image, and of the counts of its pixels.
    fn sizes(pixels: u32) -> [u64; 2] {
        [16, 4].map(|each| u64::from(pixels) * each)
    }

    /// Bytes of the device's memory that it takes for images of so many pixels, beside its renderings.
    pub fn bytes(pixels: u32) -> u64 {
        let [image, count] = Self::sizes(pixels).map(stored);
        3 * image + count + 3 * LossSum::bytes(pixels)
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
        let parts = self.parts();
        self.read_ahead(&parts);
        for slot in 0..self.config.batch {
            match samples::draw(&self.scene, &self.config, &parts, stage, iteration, slot) {
                Sample::Frame(index) => self.learn_frame(index, slot)?,
                Sample::Event { view, from, to } => self.learn_events(view, [from, to], slot)?,
            }
        }
        if let Some(Sample::Event { view, from, to }) =
            samples::draw_besides(&self.scene, &self.config, &parts, stage, iteration)
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
        self.model.step(self.gpu, &self.config, self.scene.extent, decay, !parts.is_empty())?;
        self.times.lap(self.gpu, "Adam")?;
        self.learn_poses()?;
        self.learn_clocks()?;
        drop(held);
        self.times.passed(self.gpu.traffic().since(before));
        self.clock.iteration += 1;
        Ok(())
    }

    /// Has frames read that a later iteration of this stage will ask for.
    fn read_ahead(&mut self, parts: &[Part]) {
        let (pictures, now) = (&self.scene.pictures, self.schedule.done(&self.clock));
        if pictures.all_are_kept() {
            return;
        }
        pictures.forget_before(now);
        for slot in 0..self.config.batch {
            let then = self.clock.iteration + READ_AHEAD;
            if let Sample::Frame(index) = samples::draw(&self.scene, &self.config, parts, self.clock.stage, then, slot)
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
        let camera = events.view;
        let times = [from, to].map(|edge| self.seen_at(camera, self.scene.bins.edges[edge]));
        let tells = self.events_tell_clock(camera);
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
            let gradient = ImageGradient { d_image, supervision: Supervision::Events, wanted };
            self.model.backward_raster(gpu, &view, &options, rendering, gradient)?;
            self.times.lap(gpu, "raster backward")?;
            if slot == 1 {
                self.regularise_trajectory(times, sample)?;
                self.times.lap(gpu, "trajectory regulariser")?;
                self.regularise_colour(&view, options.sh_degree, sample);
                self.times.lap(gpu, "colour regulariser")?;
            }
            let clock = self.clocks.as_ref().filter(|_| tells).and_then(|clocks| clocks.row(camera));
            self.model.backward_motion(gpu, &self.work.renderings[sample][slot], Supervision::Events, clock)?;
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
