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
    motion::{Bodies, ClockRow, FreeTime, Motion, MotionRows, Witness},
    optimiser::decayed,
    optimiser::{Adam, AdamBuffers, AdamConfig},
    raster::{Deltas, Frame, GaussianBuffers, Gradients, Rasteriser, RenderOptions, View, Wanted},
};

/// A rendering and what its backward pass needs.
#[derive(Debug)]
pub(super) struct Rendering {
    /// The image.
    pub frame: Frame,
    /// The deformation.
    pub tape: Tape,
}

/// What was said of the pixels of a rendering.
#[derive(Clone, Copy, Debug)]
pub(super) struct Said<'a> {
    /// The gradient of the image.
    pub d_image: &'a Buffer,
    /// By whom.
    pub witness: Witness,
    /// What else is kept.
    pub wanted: Wanted<'a>,
}

impl Rendering {
    /// Room for a rendering.
    pub fn new(gpu: &Gpu) -> Result<Self, TrainError> {
        Ok(Self { frame: Frame::new(gpu)?, tape: Tape::new(gpu)? })
    }
}

/// Everything that learns.
#[derive(Debug)]
pub struct Model {
    /// The Gaussians' parameters.
    pub gaussians: GaussianBuffers,
    /// How many of them, from the first, move.
    pub dynamic: u32,
    /// How many of them, to the last, are a static set, which is not learned.
    pub fixed: u32,
    /// How they move, in the fine stage.
    pub motion: Option<Motion>,
    rows: RowBuffers,
    /// The box of the field, metres.
    pub field_box: [[f32; 3]; 2],
    /// Adam steps since the moments were zero.
    pub step: u32,
    sh_head: bool,
    pub(super) gradients: Gradients,
    /// Where gradients of events go that are not to be learned from; the statistics are those of `gradients`.
    aside: Option<Gradients>,
    pub(super) d_deltas: Option<Deltas>,
    rasteriser: Rasteriser,
    adam: Adam,
    moments: [Buffer; 4],
}

/// What the motion model keeps for each dynamic Gaussian, on the device: rows of `floats`.
#[derive(Debug)]
struct RowBuffers {
    floats: usize,
    values: Buffer,
    gradients: Buffer,
    moments: [Buffer; 2],
}

impl RowBuffers {
    fn new(gpu: &Gpu, population: &Population) -> Result<Self, GpuError> {
        let Population { gaussians, moments } = population;
        Ok(Self {
            floats: gaussians.motion_floats,
            values: gpu.storage_from("rows of motion", &gaussians.motion)?,
            gradients: gpu.storage("gradient of the rows of motion", gaussians.motion.len() as u64 * 4)?,
            moments: [
                gpu.storage_from("first moment of motion", &moments.motion_first)?,
                gpu.storage_from("second moment of motion", &moments.motion_second)?,
            ],
        })
    }

    fn with<'a>(&'a self, core: &'a Buffer, count: u32) -> MotionRows<'a> {
        MotionRows { core, count, values: &self.values, gradients: &self.gradients }
    }
}

impl Model {
    /// Puts a population on the device.
    ///
    /// # Errors
    /// [`TrainError::Raster`] and [`TrainError::Gpu`] where it does not fit.
    pub fn new(gpu: &Gpu, population: &Population) -> Result<Self, TrainError> {
        let gaussians = upload(gpu, &population.gaussians)?;
        Ok(Self {
            dynamic: population.gaussians.dynamic as u32,
            fixed: 0,
            motion: None,
            rows: RowBuffers::new(gpu, population)?,
            field_box: [[0.0; 3]; 2],
            step: 0,
            sh_head: false,
            gradients: Gradients::new(gpu, &gaussians)?,
            aside: None,
            d_deltas: None,
            rasteriser: Rasteriser::new(gpu)?,
            adam: Adam::new(gpu),
            moments: upload_moments(gpu, &population.moments)?,
            gaussians,
        })
    }

    /// Replaces the population; what is shared by all in the motion model stays.
    pub(super) fn replace(&mut self, gpu: &Gpu, population: &Population) -> Result<(), TrainError> {
        self.gaussians = upload(gpu, &population.gaussians)?;
        self.dynamic = population.gaussians.dynamic as u32;
        self.gradients = Gradients::new(gpu, &self.gaussians)?;
        self.aside = self.aside.take().map(|_| self.beside(gpu)).transpose()?;
        self.moments = upload_moments(gpu, &population.moments)?;
        self.rows = RowBuffers::new(gpu, population)?;
        self.hang(gpu)?;
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
        self.motion = match config.motion {
            MotionModel::HexPlane | MotionModel::Auto => {
                let field_config = field_config(&config.field, self.gaussians.sh_degree, scene.frame_times.len());
                Some(Motion::HexPlane(Box::new(Field::new(gpu, &field_config, field_box, config.seed)?)))
            }
            MotionModel::FreeTime => {
                let intervals = scene.intervals() as f32;
                Some(Motion::FreeTime(Box::new(FreeTime::new(gpu, &config.free_time, intervals, scene.extent)?)))
            }
            MotionModel::Bodies => {
                let start = scene.bodies(config)?;
                let lengths = [scene.recording().length(), scene.intervals()];
                let (bodies, free) = (&config.bodies, &config.free_time);
                Some(Motion::Bodies(Box::new(Bodies::new(gpu, &start, bodies, free, lengths, scene.extent)?)))
            }
            MotionModel::Still => None,
        };
        self.hang(gpu)?;
        let free = matches!(config.motion, MotionModel::FreeTime | MotionModel::Bodies);
        let events_move_only = free && config.free_time.events_move_only;
        self.aside = events_move_only.then(|| self.beside(gpu)).transpose()?;
        self.field_box = field_box;
        self.sh_head = matches!(self.motion, Some(Motion::HexPlane(_))) && config.field.sh_head;
        self.size_deltas(gpu)
    }

    /// Says to bodies which Gaussians there are.
    fn hang(&mut self, gpu: &Gpu) -> Result<(), TrainError> {
        if let Some(bodies) = self.motion.as_mut().and_then(Motion::bodies_mut) {
            let rows: Vec<f32> = gpu.download(&self.rows.values, self.dynamic as usize * self.rows.floats)?;
            bodies.hang(gpu, &rows)?;
        }
        Ok(())
    }

    /// Gradients that share nothing but the statistics with those that are learned from.
    fn beside(&self, gpu: &Gpu) -> Result<Gradients, TrainError> {
        Ok(Gradients { screen: self.gradients.screen.clone(), ..Gradients::new(gpu, &self.gaussians)? })
    }

    fn size_deltas(&mut self, gpu: &Gpu) -> Result<(), TrainError> {
        self.d_deltas = match &self.motion {
            Some(_) if self.dynamic > 0 => {
                let stride = self.sh_head.then(|| sh_stride(self.gaussians.sh_degree) as u32);
                Some(Deltas::new(gpu, "gradient of the deltas", self.dynamic, stride)?)
            }
            _ => None,
        };
        Ok(())
    }

    /// The Gaussians, copied to the host.
    ///
    /// # Errors
    /// [`TrainError::Gpu`].
    pub fn gaussians(&self, gpu: &Gpu) -> Result<Gaussians, TrainError> {
        let count = self.gaussians.count as usize;
        let read = |buffer: &Buffer, floats: usize| gpu.download::<f32>(buffer, floats);
        Ok(Gaussians {
            sh_degree: self.gaussians.sh_degree,
            dynamic: self.dynamic as usize,
            core: read(&self.gaussians.core, count * CORE)?,
            sh: read(&self.gaussians.sh, count * sh_stride(self.gaussians.sh_degree))?,
            motion_floats: self.rows.floats,
            motion: read(&self.rows.values, self.dynamic as usize * self.rows.floats)?,
        })
    }

    /// The Gaussians and their moments, copied to the host.
    ///
    /// # Errors
    /// [`TrainError::Gpu`].
    pub fn population(&self, gpu: &Gpu) -> Result<Population, TrainError> {
        let gaussians = self.gaussians(gpu)?;
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
        if self.deform(gpu, t01, &mut tape, Outputs::PositionOnly)? {
            let deltas: Vec<f32> = gpu.download(&tape.deltas.core, self.dynamic as usize * CORE)?;
            let comes_and_goes = self.rows.floats > 0;
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
        let Some(field) = self.motion.as_mut().and_then(Motion::field_mut).filter(|_| !canonical.is_empty()) else {
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

    /// The Gaussians as they stand at `t01`, for export.
    ///
    /// # Errors
    /// [`TrainError`] where the device fails.
    pub fn gaussians_at(&mut self, gpu: &Gpu, t01: f64) -> Result<Gaussians, TrainError> {
        let mut gaussians = self.gaussians(gpu)?;
        let mut tape = Tape::new(gpu)?;
        if !self.deform(gpu, t01, &mut tape, Outputs::All)? {
            return Ok(gaussians);
        }
        let rows = self.dynamic as usize;
        let add = |to: &mut [f32], deltas: Vec<f32>| to.iter_mut().zip(deltas).for_each(|(to, delta)| *to += delta);
        add(&mut gaussians.core, gpu.download(&tape.deltas.core, rows * CORE)?);
        if let Some(sh) = &tape.deltas.sh {
            add(&mut gaussians.sh, gpu.download(sh, rows * sh_stride(self.gaussians.sh_degree))?);
        }
        Ok(gaussians)
    }

    /// The Gaussians of one moment that stand for all: as they are stored, or, where each is stored at an instant of its
    /// own, as they stand in the middle of the recording.
    ///
    /// # Errors
    /// [`TrainError`] where the device fails.
    pub fn gaussians_still(&mut self, gpu: &Gpu) -> Result<Gaussians, TrainError> {
        match &self.motion {
            Some(Motion::FreeTime(_) | Motion::Bodies(_)) => self.gaussians_at(gpu, 0.5),
            Some(Motion::HexPlane(_)) | None => self.gaussians(gpu),
        }
    }

    /// What the motion model keeps for the Gaussians, and how many floats that is.
    pub(super) fn motion_values(&self) -> (&Buffer, u32) {
        (&self.rows.values, self.dynamic * self.rows.floats as u32)
    }

    /// Evaluates the motion at `t01`; says whether there is any.
    pub(super) fn deform(&mut self, gpu: &Gpu, t01: f64, tape: &mut Tape, what: Outputs) -> Result<bool, TrainError> {
        let Some(motion) = self.motion.as_mut().filter(|_| self.dynamic > 0) else { return Ok(false) };
        let rows = self.rows.with(&self.gaussians.core, self.dynamic);
        motion.forward(gpu, rows, t01 as f32, tape, what)?;
        Ok(true)
    }

    /// Renders `view` at `t01`.
    pub(super) fn forward(
        &mut self,
        gpu: &Gpu,
        view: &View,
        t01: f64,
        options: &RenderOptions,
        rendering: &mut Rendering,
        times: &mut StageTimes,
    ) -> Result<(), TrainError> {
        let deltas = if self.deform(gpu, t01, &mut rendering.tape, Outputs::All)? {
            times.lap(gpu, "motion forward")?;
            Some(&rendering.tape.deltas)
        } else {
            None
        };
        self.rasteriser.forward(gpu, &self.gaussians, deltas, view, options, &mut rendering.frame)?;
        Ok(times.lap(gpu, "raster forward")?)
    }

    /// The gradients of a rendering from those of its pixels, as far as the deltas.
    pub(super) fn backward_raster(
        &self,
        gpu: &Gpu,
        view: &View,
        options: &RenderOptions,
        rendering: &Rendering,
        said: Said<'_>,
    ) -> Result<(), TrainError> {
        let gradients = self.gradients_of(said.witness);
        let deltas = self.d_deltas.as_ref().map(|_| &rendering.tape.deltas);
        self.rasteriser.backward(
            gpu,
            &self.gaussians,
            deltas,
            view,
            options,
            &rendering.frame,
            said.d_image,
            gradients,
            self.d_deltas.as_ref(),
            said.wanted,
        )?;
        Ok(())
    }

    /// Where the gradients of a rendering go.
    fn gradients_of(&self, witness: Witness) -> &Gradients {
        match (witness, &self.aside) {
            (Witness::Events, Some(aside)) => aside,
            _ => &self.gradients,
        }
    }

    /// Passes the gradients of the deltas on to the motion, and to the clock of a camera where that is asked for.
    pub(super) fn backward_motion(
        &mut self,
        gpu: &Gpu,
        rendering: &Rendering,
        witness: Witness,
        clock: Option<ClockRow<'_>>,
    ) -> Result<(), TrainError> {
        let d_core = self.gradients_of(witness).core.clone();
        if let (Some(motion), Some(d_deltas)) = (&mut self.motion, &self.d_deltas) {
            let rows = self.rows.with(&self.gaussians.core, self.dynamic);
            motion.backward(gpu, rows, &rendering.tape, d_deltas, &d_core, witness)?;
            if let Some(clock) = clock {
                motion.clock(gpu, rows, &rendering.tape, d_deltas, clock);
            }
        }
        Ok(())
    }

    /// How many of the Gaussians, from the first, learn.
    pub(super) fn learning(&self) -> u32 {
        self.gaussians.count - self.fixed
    }

    /// Sets the gradients of an iteration to zero.
    pub(super) fn clear_gradients(&self, gpu: &Gpu) {
        let mut commands = gpu.commands();
        commands.clear(&self.gradients.core);
        commands.clear(&self.gradients.sh);
        commands.clear(&self.gradients.screen);
        commands.clear(&self.rows.gradients);
        commands.submit();
        if let Some(bodies) = self.motion.as_ref().and_then(Motion::bodies) {
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
        let mut sh_rates = vec![rates.sh_rest; sh_stride(self.gaussians.sh_degree)];
        sh_rates[..3].fill(rates.sh_dc);
        let free = &config.free_time;
        let mut row_rates = free.rates(position);
        row_rates.resize(self.rows.floats.max(row_rates.len()), 0.0);
        let [core_first, core_second, sh_first, sh_second] = &self.moments;
        let [row_first, row_second] = &self.rows.moments;
        let count = self.learning();
        let of_rows = (&self.rows.values, &self.rows.gradients, row_first, row_second, &row_rates[..], self.dynamic);
        let has_rows = self.rows.floats > 0 && self.dynamic > 0;
        let mut commands = gpu.commands();
        for (parameters, gradients, first_moment, second_moment, rates, rows) in [
            (&self.gaussians.core, &self.gradients.core, core_first, core_second, &core_rates[..], count),
            (&self.gaussians.sh, &self.gradients.sh, sh_first, sh_second, &sh_rates[..], count),
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
        if let Some(field) = self.motion.as_mut().and_then(Motion::field_mut).filter(|_| self.dynamic > 0) {
            let planes = extent * decayed(rates.planes, progress);
            let network = extent * decayed(rates.network, progress);
            field.step(gpu, planes, network, &adam)?;
        }
        if let Some(bodies) = self.motion.as_mut().and_then(Motion::bodies_mut).filter(|_| self.dynamic > 0) {
            bodies.step(gpu, progress, follows, adam.epsilon)?;
        }
        Ok(())
    }

    /// Bytes of the parameters, as a checkpoint without moments would hold them.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let row = CORE + sh_stride(self.gaussians.sh_degree);
        let field = self.motion.as_ref().and_then(Motion::field);
        let (planes, network) = field.map_or((0, 0), Field::parameters);
        let rows = u64::from(self.dynamic) * self.rows.floats as u64;
        4 * (u64::from(self.gaussians.count) * row as u64 + rows + planes as u64 + network as u64)
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

fn field_config(options: &FieldOptions, sh_degree: u32, frame_times: usize) -> FieldConfig {
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

fn upload(gpu: &Gpu, gaussians: &Gaussians) -> Result<GaussianBuffers, TrainError> {
    Ok(GaussianBuffers::from_slices(gpu, gaussians.sh_degree, &gaussians.core, &gaussians.sh)?)
}

fn upload_moments(gpu: &Gpu, moments: &Moments) -> Result<[Buffer; 4], GpuError> {
    Ok([
        gpu.storage_from("first moment of core", &moments.core_first)?,
        gpu.storage_from("second moment of core", &moments.core_second)?,
        gpu.storage_from("first moment of sh", &moments.sh_first)?,
        gpu.storage_from("second moment of sh", &moments.sh_second)?,
    ])
}
