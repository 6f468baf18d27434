//! Gaussians and their motion on the device, and how they are drawn.

use wgpu::Buffer;

use crate::{
    field::{FieldError, Outputs, Tape},
    gaussians::{CORE, Gaussians, sh_stride},
    gpu::{Gpu, GpuError},
    motion::{Motion, MotionRows, Shown},
    raster::{Frame, GaussianBuffers, RasterError, Rasteriser, RenderOptions, View},
};

/// Why a model could not be put on the device or drawn.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The rasteriser.
    #[error(transparent)]
    Raster(#[from] RasterError),
    /// The motion.
    #[error(transparent)]
    Field(#[from] FieldError),
}

/// A rendering and what its backward pass needs.
#[derive(Debug)]
pub struct Rendering {
    /// The image.
    pub frame: Frame,
    /// The deformation.
    pub tape: Tape,
}

impl Rendering {
    /// Room for a rendering.
    ///
    /// # Errors
    /// [`ModelError`] where the device has no room.
    pub fn new(gpu: &Gpu) -> Result<Self, ModelError> {
        Ok(Self { frame: Frame::new(gpu)?, tape: Tape::new(gpu)? })
    }

    /// Waits for the rendering, and whether it is complete. Where it is not, there is room for it now: draw again.
    ///
    /// # Errors
    /// [`ModelError`] where the device fails.
    pub fn is_complete(&mut self, gpu: &Gpu) -> Result<bool, ModelError> {
        match self.frame.check(gpu) {
            Err(RasterError::Overflow { .. }) => Ok(false),
            checked => Ok(checked.map(|()| true)?),
        }
    }

    /// The picture, copied to the host.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn picture(&self, gpu: &Gpu) -> Result<Rendered, GpuError> {
        let pixels = (self.frame.width * self.frame.height) as usize;
        let image: Vec<[f32; 4]> = gpu.download(&self.frame.image, pixels)?;
        let depth: Vec<f32> = match &self.frame.depth {
            Some(depth) => gpu.download(depth, pixels)?,
            None => vec![0.0; pixels],
        };
        let seen = |(depth, pixel): (f32, &[f32; 4])| if pixel[3] < 0.999 { depth / (1.0 - pixel[3]) } else { 0.0 };
        Ok(Rendered {
            rgb: image.iter().flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
            transmittance: image.iter().map(|pixel| pixel[3]).collect(),
            depth: depth.into_iter().zip(&image).map(seen).collect(),
        })
    }
}

/// A rendering, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// Red, green and blue of every pixel over the background; display values, not clamped.
    pub rgb: Vec<f32>,
    /// Light that passes every pixel, 0 to 1.
    pub transmittance: Vec<f32>,
    /// Mean depth of every pixel by opacity, metres; 0 where nothing is.
    pub depth: Vec<f32>,
}

impl Rendered {
    /// Red, green and blue of every pixel in eight bits.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        to_bytes(&self.rgb)
    }
}

/// 8-bit values of a picture in [0, 1]: rounded to nearest, clamped; not-a-number becomes 0.
#[must_use]
pub fn to_bytes(rgb: &[f32]) -> Vec<u8> {
    rgb.iter().map(|&value| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect()
}

/// Gaussians and their motion on the device.
#[derive(Debug)]
pub struct Model {
    /// The Gaussians' parameters.
    pub gaussians: GaussianBuffers,
    /// How many of them, from the first, move.
    pub dynamic: u32,
    /// How they move; nothing where they stand still.
    pub motion: Option<Motion>,
    /// What the motion model keeps for each dynamic Gaussian.
    pub rows: Buffer,
    /// Floats of a row of that.
    pub row_floats: usize,
    rasteriser: Rasteriser,
    nothing: Buffer,
}

impl Model {
    /// Puts Gaussians on the device that stand still.
    ///
    /// # Errors
    /// [`ModelError`] where they do not fit.
    pub fn new(gpu: &Gpu, gaussians: &Gaussians) -> Result<Self, ModelError> {
        Ok(Self {
            gaussians: upload(gpu, gaussians)?,
            dynamic: gaussians.dynamic as u32,
            motion: None,
            rows: gpu.storage_from("rows of motion", &gaussians.motion)?,
            row_floats: gaussians.motion_floats,
            rasteriser: Rasteriser::new(gpu)?,
            nothing: gpu.storage("nothing", 4)?,
        })
    }

    /// Replaces the Gaussians; what all share of the motion stays.
    ///
    /// # Errors
    /// [`ModelError`] where they do not fit.
    pub fn replace(&mut self, gpu: &Gpu, gaussians: &Gaussians) -> Result<(), ModelError> {
        self.gaussians = upload(gpu, gaussians)?;
        self.dynamic = gaussians.dynamic as u32;
        self.rows = gpu.storage_from("rows of motion", &gaussians.motion)?;
        self.row_floats = gaussians.motion_floats;
        self.hang(gpu)
    }

    /// Has the Gaussians move so from now on.
    ///
    /// # Errors
    /// [`ModelError`] where the device has no room.
    pub fn set_motion(&mut self, gpu: &Gpu, motion: Option<Motion>) -> Result<(), ModelError> {
        self.motion = motion;
        self.hang(gpu)
    }

    /// Tells bodies which Gaussians there are.
    fn hang(&mut self, gpu: &Gpu) -> Result<(), ModelError> {
        if let Some(bodies) = self.motion.as_mut().and_then(Motion::bodies_mut) {
            let rows: Vec<f32> = gpu.download(&self.rows, self.dynamic as usize * self.row_floats)?;
            bodies.hang(gpu, &rows)?;
        }
        Ok(())
    }

    /// The Gaussians, copied to the host.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn gaussians(&self, gpu: &Gpu) -> Result<Gaussians, GpuError> {
        let count = self.gaussians.count as usize;
        let read = |buffer: &Buffer, floats: usize| gpu.download::<f32>(buffer, floats);
        Ok(Gaussians {
            sh_degree: self.gaussians.sh_degree,
            dynamic: self.dynamic as usize,
            core: read(&self.gaussians.core, count * CORE)?,
            sh: read(&self.gaussians.sh, count * sh_stride(self.gaussians.sh_degree))?,
            motion_floats: self.row_floats,
            motion: read(&self.rows, self.dynamic as usize * self.row_floats)?,
        })
    }

    /// The Gaussians as they stand at `t01`, for export.
    ///
    /// # Errors
    /// [`ModelError`] where the device fails.
    pub fn gaussians_at(&mut self, gpu: &Gpu, t01: f64) -> Result<Gaussians, ModelError> {
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
    /// [`ModelError`] where the device fails.
    pub fn gaussians_still(&mut self, gpu: &Gpu) -> Result<Gaussians, ModelError> {
        match &self.motion {
            Some(Motion::FreeTime(_) | Motion::Bodies(_)) => self.gaussians_at(gpu, 0.5),
            Some(Motion::HexPlane(_)) | None => Ok(self.gaussians(gpu)?),
        }
    }

    /// Evaluates the motion at a time in [0, 1]; says whether there is any.
    ///
    /// # Errors
    /// [`ModelError`] where the device fails.
    pub fn deform(
        &mut self,
        gpu: &Gpu,
        time: impl Into<Shown>,
        tape: &mut Tape,
        what: Outputs,
    ) -> Result<bool, ModelError> {
        let Some(motion) = self.motion.as_mut().filter(|_| self.dynamic > 0) else { return Ok(false) };
        let (core, values) = (&self.gaussians.core, &self.rows);
        let rows = MotionRows { core, count: self.dynamic, values, gradients: &self.nothing };
        motion.forward(gpu, rows, time, tape, what)?;
        Ok(true)
    }

    /// Draws the Gaussians from `view`, where `deformed` as [`Self::deform`] has left it on the rendering's tape.
    ///
    /// # Errors
    /// [`ModelError`] where the device fails.
    pub fn draw(
        &self,
        gpu: &Gpu,
        view: &View,
        options: &RenderOptions,
        rendering: &mut Rendering,
        deformed: bool,
    ) -> Result<(), ModelError> {
        let deltas = deformed.then_some(&rendering.tape.deltas);
        Ok(self.rasteriser.forward(gpu, &self.gaussians, deltas, view, options, &mut rendering.frame)?)
    }

    /// What draws them, for the way back.
    #[must_use]
    pub fn rasteriser(&self) -> &Rasteriser {
        &self.rasteriser
    }
}

fn upload(gpu: &Gpu, gaussians: &Gaussians) -> Result<GaussianBuffers, RasterError> {
    GaussianBuffers::from_slices(gpu, gaussians.sh_degree, &gaussians.core, &gaussians.sh)
}
