//! The Gaussians, their motion and their optimisers on the device.

use wgpu::Buffer;

use super::{StageTimes, TrainError};
use crate::{
    config::{Config, FieldOptions, MotionModel},
    density::{Moments, Population},
    scene::Scene,
};
use erfgs_splat::{
    field::{Field, FieldConfig, HeadInit, Heads, Outputs, PlaneWeights, SpatialSmoothness, Tape, TimeAxis},
    gaussians::{CORE, Gaussians, sh_stride, sigmoid},
    gpu::{Gpu, GpuError},
    model::{Model as Drawn, Rendering},
    motion::{Bodies, ClockRow, FreeTime, Motion, MotionPlan, MotionRows, Shown, Supervision, bodies::Start},
    optimiser::{Adam, AdamBuffers, AdamConfig, decayed},
    raster::{Deltas, Gradients, RenderOptions, View, Wanted},
};

/// The gradient of a rendering by its image, and what it is for.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImageGradient<'a> {
    /// The gradient of the image.
    pub d_image: &'a Buffer,
    /// By whom.
    pub supervision: Supervision,
    /// What else is kept.
    pub wanted: Wanted<'a>,
}

/// Everything that learns.
#[derive(Debug)]
pub struct Model {
    /// The Gaussians and, in the fine stage, their motion.
    pub drawn: Drawn,
    /// How many of the Gaussians, to the last, are a static set, which is not learned.
    pub fixed: u32,
    /// How they move, as a file says it.
    pub plan: MotionPlan,
    rows: RowGradients,
    /// The box of the field, metres.
    pub field_box: [[f32; 3]; 2],
    /// Adam steps since the moments were zero.
    pub step: u32,
    sh_head: bool,
    pub(super) gradients: Gradients,
    /// Where gradients of events go that are not to be learned from; the statistics are those of `gradients`.
    aside: Option<Gradients>,
    pub(super) d_deltas: Option<Deltas>,
    adam: Adam,
    moments: [Buffer; 4],
}

/// Gradients and moments of what the motion model keeps for each dynamic Gaussian.
#[derive(Debug)]
struct RowGradients {
    gradients: Buffer,
    moments: [Buffer; 2],
}

impl RowGradients {
    fn new(gpu: &Gpu, Population { gaussians, moments }: &Population) -> Result<Self, GpuError> {
        Ok(Self {
            gradients: gpu.storage("gradient of the rows of motion", gaussians.motion.len() as u64 * 4)?,
            moments: [
                gpu.storage_from("first moment of motion", &moments.motion_first)?,
                gpu.storage_from("second moment of motion", &moments.motion_second)?,
            ],
        })
    }
}

impl Model {
    /// Puts a population on the device.
    ///
    /// # Errors
    /// [`TrainError::Raster`] and [`TrainError::Gpu`] where it does not fit.
    pub fn new(gpu: &Gpu, population: &Population) -> Result<Self, TrainError> {
        let drawn = Drawn::new(gpu, &population.gaussians)?;
        Ok(Self {
            fixed: 0,
            plan: MotionPlan::Still,
            rows: RowGradients::new(gpu, population)?,
            field_box: [[0.0; 3]; 2],
            step: 0,
            sh_head: false,
            gradients: Gradients::new(gpu, &drawn.gaussians)?,
            aside: None,
            d_deltas: None,
            adam: Adam::new(gpu),
            moments: upload_moments(gpu, &population.moments)?,
            drawn,
        })
    }

    /// Replaces the population; what is shared by all in the motion model stays.
    pub(super) fn replace(&mut self, gpu: &Gpu, population: &Population) -> Result<(), TrainError> {
        // Each buffer can then go as soon as there is another in its place.
        gpu.forget_groups();
        self.drawn.replace(gpu, &population.gaussians)?;
        self.gradients = Gradients::new(gpu, &self.drawn.gaussians)?;
        self.aside = self.aside.take().map(|_| self.beside(gpu)).transpose()?;
        self.moments = upload_moments(gpu, &population.moments)?;
        self.rows = RowGradients::new(gpu, population)?;
        self.size_deltas(gpu)
    }

    /// Starts the fine stage's motion; a field spans `field_box`.
    pub(super) fn start_motion(
        &mut self,
        gpu: &Gpu,
        config: &Config,
        scene: &Scene,
        field_box: [[f32; 3]; 2],
    ) -> Result<(), TrainError> {
        let intervals = scene.intervals();
        let (plan, motion) = match config.motion {
            MotionModel::HexPlane | MotionModel::Auto => {
                let field = field_config(&config.field, self.drawn.gaussians.sh_degree, scene.frame_times.len());
                let motion = Motion::HexPlane(Box::new(Field::new(gpu, &field, field_box, config.seed)?));
                (MotionPlan::HexPlane { field, aabb: field_box }, Some(motion))
            }
            MotionModel::FreeTime => {
                let options = config.free_time.clone();
                let motion = FreeTime::new(gpu, &options, intervals as f32, scene.extent)?;
                (MotionPlan::FreeTime { options, intervals }, Some(Motion::FreeTime(Box::new(motion))))
            }
            MotionModel::Bodies => {
                let start = scene.bodies(config)?;
                let seconds = scene.recording().length();
                let options = config.free_time.clone();
                let lengths = [seconds, intervals];
                let motion = Bodies::new(gpu, &start, &config.bodies, &options, lengths, scene.extent)?;
                let Start { names, nodes, knots, .. } = start;
                let plan = MotionPlan::Bodies { options, intervals, seconds, names, nodes, knots };
                (plan, Some(Motion::Bodies(Box::new(motion))))
            }
            MotionModel::Still => (MotionPlan::Still, None),
        };
        self.plan = plan;
        self.drawn.set_motion(gpu, motion)?;
        let free = matches!(config.motion, MotionModel::FreeTime | MotionModel::Bodies);
        let events_move_only = free && config.free_time.events_move_only;
        self.aside = events_move_only.then(|| self.beside(gpu)).transpose()?;
        self.field_box = field_box;
        self.sh_head = matches!(self.drawn.motion, Some(Motion::HexPlane(_))) && config.field.sh_head;
        self.size_deltas(gpu)
    }

    /// Gradients that share nothing but the statistics with those that are learned from.
    fn beside(&self, gpu: &Gpu) -> Result<Gradients, TrainError> {
        Ok(Gradients { screen: self.gradients.screen.clone(), ..Gradients::new(gpu, &self.drawn.gaussians)? })
    }

    fn size_deltas(&mut self, gpu: &Gpu) -> Result<(), TrainError> {
        self.d_deltas = match &self.drawn.motion {
            Some(_) if self.drawn.dynamic > 0 => {
                let stride = self.sh_head.then(|| sh_stride(self.drawn.gaussians.sh_degree) as u32);
                Some(Deltas::new(gpu, "gradient of the deltas", self.drawn.dynamic, stride)?)
            }
            _ => None,
        };
        Ok(())
    }

    /// The Gaussians and their moments, copied to the host.
    ///
    /// # Errors
    /// [`TrainError::Gpu`].
    pub fn population(&self, gpu: &Gpu) -> Result<Population, TrainError> {
        let gaussians = self.drawn.gaussians(gpu)?;
        let read = |buffer: &Buffer, like: &[f32]| gpu.download::<f32>(buffer, like.len());
        let [core_first, core_second, sh_first, sh_second] = &self.moments;
        let [motion_first, motion_second] = &self.rows.moments;
        let moments = Moments {
            core_first: read(core_first, &gaussians.core)?,
            core_second: read(core_second, &gaussians.core)?,
            sh_first: read(sh_first, &gaussians.sh)?,
            sh_second: read(sh_second, &gaussians.sh)?,
            motion_first: read(motion_first, &gaussians.motion)?,
            motion_second: read(motion_second, &gaussians.motion)?,
        };
        Ok(Population { gaussians, moments })
    }

    /// The means as they stand at `t01`, metres; not a number where a Gaussian is not there then.
    pub(super) fn means_at(&mut self, gpu: &Gpu, gaussians: &Gaussians, t01: f64) -> Result<Vec<[f32; 3]>, TrainError> {
        /// What is fainter than this share of its opacity has gone.
        const THERE: f32 = 0.1;
        let mut means: Vec<[f32; 3]> = (0..gaussians.len()).map(|index| gaussians.mean(index)).collect();
        let mut tape = Tape::new(gpu)?;
        if self.drawn.deform(gpu, t01, &mut tape, Outputs::PositionOnly)? {
            let deltas: Vec<f32> = gpu.download(&tape.deltas.core, self.drawn.dynamic as usize * CORE)?;
            let comes_and_goes = self.drawn.row_floats > 0;
            for ((mean, delta), core) in
                means.iter_mut().zip(deltas.chunks_exact(CORE)).zip(gaussians.core.chunks_exact(CORE))
            {
                for axis in 0..3 {
                    mean[axis] += delta[axis];
                }
                if comes_and_goes && sigmoid(core[10] + delta[10]) < THERE * sigmoid(core[10]) {
                    *mean = [f32::NAN; 3];
                }
            }
        }
        Ok(means)
    }

    /// Where the field takes these canonical places by `t01`, metres; where they are, without a field.
    pub(super) fn carried(&mut self, gpu: &Gpu, canonical: &[[f32; 3]], t01: f64) -> Result<Vec<[f32; 3]>, TrainError> {
        let mut places = canonical.to_vec();
        let Some(field) = self.drawn.motion.as_mut().and_then(Motion::field_mut).filter(|_| !canonical.is_empty())
        else {
            return Ok(places);
        };
        let mut core = vec![0.0_f32; canonical.len() * CORE];
        core.chunks_exact_mut(CORE).zip(canonical).for_each(|(row, place)| row[..3].copy_from_slice(place));
        let core = gpu.storage_from("canonical places", &core)?;
        let mut tape = Tape::new(gpu)?;
        field.forward(gpu, &core, canonical.len() as u32, t01 as f32, &mut tape, Outputs::PositionOnly)?;
        let deltas: Vec<f32> = gpu.download(&tape.deltas.core, canonical.len() * CORE)?;
        for (place, delta) in places.iter_mut().zip(deltas.chunks_exact(CORE)) {
            for axis in 0..3 {
                place[axis] += delta[axis];
            }
        }
        Ok(places)
    }

    /// What the motion model keeps for the Gaussians, and how many floats that is.
    pub(super) fn motion_values(&self) -> (&Buffer, u32) {
        (&self.drawn.rows, self.drawn.dynamic * self.drawn.row_floats as u32)
    }

    /// Renders `view` at a time in [0, 1].
    pub(super) fn forward(
        &mut self,
        gpu: &Gpu,
        view: &View,
        time: impl Into<Shown>,
        options: &RenderOptions,
        rendering: &mut Rendering,
        times: &mut StageTimes,
    ) -> Result<(), TrainError> {
        let deformed = self.drawn.deform(gpu, time, &mut rendering.tape, Outputs::All)?;
        if deformed {
            times.lap(gpu, "motion forward")?;
        }
        self.drawn.draw(gpu, view, options, rendering, deformed)?;
        Ok(times.lap(gpu, "raster forward")?)
    }

    /// The gradients of a rendering from those of its pixels, as far as the deltas.
    pub(super) fn backward_raster(
        &self,
        gpu: &Gpu,
        view: &View,
        options: &RenderOptions,
        rendering: &Rendering,
        gradient: ImageGradient<'_>,
    ) -> Result<(), TrainError> {
        let gradients = self.gradients_of(gradient.supervision);
        let deltas = self.d_deltas.as_ref().map(|_| &rendering.tape.deltas);
        self.drawn.rasteriser().backward(
            gpu,
            &self.drawn.gaussians,
            deltas,
            view,
            options,
            &rendering.frame,
            gradient.d_image,
            gradients,
            self.d_deltas.as_ref(),
            gradient.wanted,
        )?;
        Ok(())
    }

    /// Where the gradients of a rendering go.
    fn gradients_of(&self, supervision: Supervision) -> &Gradients {
        match (supervision, &self.aside) {
            (Supervision::Events, Some(aside)) => aside,
            _ => &self.gradients,
        }
    }

    /// Passes the gradients of the deltas on to the motion, and to the clock of a camera where that is asked for.
    pub(super) fn backward_motion(
        &mut self,
        gpu: &Gpu,
        rendering: &Rendering,
        supervision: Supervision,
        clock: Option<ClockRow<'_>>,
    ) -> Result<(), TrainError> {
        let d_core = self.gradients_of(supervision).core.clone();
        let Drawn { gaussians, dynamic, motion, rows, .. } = &mut self.drawn;
        if let (Some(motion), Some(d_deltas)) = (motion, &self.d_deltas) {
            let (core, count, gradients) = (&gaussians.core, *dynamic, &self.rows.gradients);
            let rows = MotionRows { core, count, values: rows, gradients };
            motion.backward(gpu, rows, &rendering.tape, d_deltas, &d_core, supervision)?;
            if let Some(clock) = clock {
                motion.clock(gpu, rows, &rendering.tape, d_deltas, clock);
            }
        }
        Ok(())
    }

    /// How many of the Gaussians, from the first, learn.
    pub(super) fn learning(&self) -> u32 {
        self.drawn.gaussians.count - self.fixed
    }

    /// Sets the gradients of an iteration to zero.
    pub(super) fn clear_gradients(&self, gpu: &Gpu) {
        let mut commands = gpu.commands();
        commands.clear(&self.gradients.core);
        commands.clear(&self.gradients.sh);
        commands.clear(&self.gradients.screen);
        commands.clear(&self.rows.gradients);
        commands.submit();
        if let Some(bodies) = self.drawn.motion.as_ref().and_then(Motion::bodies) {
            bodies.clear_gradients(gpu);
        }
    }

    /// One step of Adam over everything; `progress` says how far the decay of the learning rates is, `follows` whether bodies are followed.
    pub(super) fn step(
        &mut self,
        gpu: &Gpu,
        config: &Config,
        extent: f32,
        progress: f64,
        follows: bool,
    ) -> Result<(), TrainError> {
        self.step += 1;
        let rates = &config.learning_rate;
        let adam = AdamConfig { epsilon: rates.adam_epsilon, ..AdamConfig::default() };
        let position = extent * decayed(rates.position, progress);
        let (scale, rotation) = (rates.scale, rates.rotation);
        let core_rates: [f32; CORE] = [
            position,
            position,
            position,
            scale,
            scale,
            scale,
            rotation,
            rotation,
            rotation,
            rotation,
            rates.opacity,
            0.0,
        ];
        let mut sh_rates = vec![rates.sh_rest; sh_stride(self.drawn.gaussians.sh_degree)];
        sh_rates[..3].fill(rates.sh_dc);
        let free = &config.free_time;
        let mut row_rates = free.rates(position);
        row_rates.resize(self.drawn.row_floats.max(row_rates.len()), 0.0);
        let [core_first, core_second, sh_first, sh_second] = &self.moments;
        let [row_first, row_second] = &self.rows.moments;
        let count = self.learning();
        let dynamic = self.drawn.dynamic;
        let of_rows = (&self.drawn.rows, &self.rows.gradients, row_first, row_second, &row_rates[..], dynamic);
        let has_rows = self.drawn.row_floats > 0 && dynamic > 0;
        let mut commands = gpu.commands();
        for (parameters, gradients, first_moment, second_moment, rates, rows) in [
            (&self.drawn.gaussians.core, &self.gradients.core, core_first, core_second, &core_rates[..], count),
            (&self.drawn.gaussians.sh, &self.gradients.sh, sh_first, sh_second, &sh_rates[..], count),
        ]
        .into_iter()
        .chain(has_rows.then_some(of_rows))
        .filter(|(.., rows)| *rows > 0)
        {
            let buffers = AdamBuffers {
                parameters,
                gradients,
                first_moment,
                second_moment,
                rows,
                stride: rates.len() as u32,
                mask: None,
            };
            self.adam.step(&mut commands, &buffers, rates, &adam, self.step)?;
        }
        commands.submit();
        if let Some(field) = self.drawn.motion.as_mut().and_then(Motion::field_mut).filter(|_| dynamic > 0) {
            let planes = extent * decayed(rates.planes, progress);
            let network = extent * decayed(rates.network, progress);
            field.step(gpu, planes, network, &adam)?;
        }
        if let Some(bodies) = self.drawn.motion.as_mut().and_then(Motion::bodies_mut).filter(|_| dynamic > 0) {
            bodies.step(gpu, progress, follows, adam.epsilon)?;
        }
        Ok(())
    }

    /// Bytes of the parameters, as a checkpoint without moments would hold them.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let Drawn { gaussians, dynamic, motion, row_floats, .. } = &self.drawn;
        let row = CORE + sh_stride(gaussians.sh_degree);
        let field = motion.as_ref().and_then(Motion::field);
        let (planes, network) = field.map_or((0, 0), Field::parameters);
        let rows = u64::from(*dynamic) * *row_floats as u64;
        4 * (u64::from(gaussians.count) * row as u64 + rows + planes as u64 + network as u64)
    }
}

/// The regularisers of the planes, as strong as `times` iterations.
pub(super) fn plane_weights(options: &FieldOptions, times: f32) -> PlaneWeights {
    PlaneWeights {
        space: times * options.weight_spatial,
        time: times * options.weight_time,
        time_l1: times * options.weight_l1_time,
        form: SpatialSmoothness::SecondDifference,
    }
}

pub(super) fn field_config(options: &FieldOptions, sh_degree: u32, frame_times: usize) -> FieldConfig {
    let rows = match options.time_resolution {
        0 => (2 * frame_times as u32).clamp(8, 300),
        rows => rows,
    };
    FieldConfig {
        levels: options.levels.clone(),
        features: options.features,
        spatial_resolution: [options.spatial_resolution; 3],
        time_resolution: rows,
        width: options.width,
        depth: options.depth,
        heads: Heads {
            position: true,
            scale: options.scale_head,
            rotation: options.rotation_head,
            opacity: options.opacity_head,
            sh: options.sh_head,
        },
        sh_stride: sh_stride(sh_degree) as u32,
        time_axis: if options.upper_half_time { TimeAxis::UpperHalf } else { TimeAxis::Full },
        head_init: if options.zero_heads { HeadInit::ZeroLast } else { HeadInit::Xavier },
    }
}

fn upload_moments(gpu: &Gpu, moments: &Moments) -> Result<[Buffer; 4], GpuError> {
    Ok([
        gpu.storage_from("first moment of core", &moments.core_first)?,
        gpu.storage_from("second moment of core", &moments.core_second)?,
        gpu.storage_from("first moment of sh", &moments.sh_first)?,
        gpu.storage_from("second moment of sh", &moments.sh_second)?,
    ])
}
