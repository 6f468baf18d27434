//! What a field does, wherever its numbers live.

use std::fmt::Debug;

use wgpu::Buffer;

use super::{FieldError, Layout, Outputs, PlaneLosses, PlaneWeights, device::DeviceTape, host::HostTape};
use crate::{gpu::Gpu, optimiser::AdamConfig, raster::Deltas};

/// A field's layout and the box that its planes span.
#[derive(Debug)]
pub struct Domain {
    pub layout: Layout,
    /// Lower corner of the box, metres.
    pub origin: [f32; 3],
    /// 1 / extent of the box; 0 along an axis where it is flat.
    pub scale: [f32; 3],
}

/// Which pass a tape holds.
#[derive(Clone, Copy, Debug)]
pub struct Pass {
    pub what: Outputs,
    /// Row of the time planes, and the weight of the next one.
    pub time: (usize, f32),
}

/// What one forward pass leaves for its backward pass. Several may be alive at once; one may be used again and again.
///
/// It holds the coordinates and the grid features of the rows. On the host it also holds the activations of the MLP up to
/// 256 MiB (writing and reading them costs less than the products); otherwise the backward pass evaluates the hidden
/// layers again, block by block. A tape that is used again keeps its memory.
#[derive(Debug)]
pub struct Tape {
    /// The outputs of the pass.
    pub deltas: Deltas,
    /// The time of the pass, in [0, 1]; beside bodies that of what is free in time.
    pub(crate) t01: f32,
    /// That of bodies.
    pub(crate) body_t01: f32,
    /// Absent where nothing was computed: no rows, or no head.
    pub(super) pass: Option<Pass>,
    pub(super) host: HostTape,
    pub(super) device: Option<DeviceTape>,
}

impl Tape {
    /// An empty tape; a forward pass sizes it.
    ///
    /// # Errors
    /// [`FieldError::Gpu`].
    pub fn new(gpu: &Gpu) -> Result<Self, FieldError> {
        let deltas = Deltas::new(gpu, "deltas", 0, None)?;
        Ok(Self { deltas, t01: 0.0, body_t01: 0.0, pass: None, host: HostTape::default(), device: None })
    }

    /// Begins a pass of a model that computes no SH and leaves nothing but its deltas.
    pub(crate) fn begin_rows(&mut self, gpu: &Gpu, rows: u32, t01: f32) -> Result<(), FieldError> {
        (self.pass, self.t01) = (None, t01);
        self.fit(gpu, rows, None)
    }

    /// Replaces the buffers of the deltas where they do not fit.
    pub(super) fn fit(&mut self, gpu: &Gpu, rows: u32, sh_stride: Option<u32>) -> Result<(), FieldError> {
        if self.deltas.rows != rows || self.deltas.sh.is_some() != sh_stride.is_some() {
            self.deltas = Deltas::new(gpu, "deltas", rows, sh_stride)?;
        }
        Ok(())
    }
}

/// Gradients of a pass: those of the deltas come in, that of the means is added to columns 0..3 of the core.
#[derive(Clone, Copy, Debug)]
pub struct PassGradients<'a> {
    pub core: &'a Buffer,
    /// Present if the tape's deltas have SH.
    pub sh: Option<&'a Buffer>,
    pub d_core: &'a Buffer,
}

/// Parameters and both moments, in the order of the layout.
pub type Vectors = [Vec<f32>; 3];

/// A field's numbers and what is done with them.
pub trait Backend: Debug + Send + Sync {
    /// Fills the deltas of a tape whose pass is set and whose buffers fit.
    fn forward(&mut self, gpu: &Gpu, domain: &Domain, core: &Buffer, tape: &mut Tape) -> Result<(), FieldError>;

    /// Adds the gradients of a pass.
    fn backward(&mut self, gpu: &Gpu, domain: &Domain, tape: &Tape, d: &PassGradients<'_>) -> Result<(), FieldError>;

    /// Adds the gradients of the regularisers.
    fn regularise(&mut self, gpu: &Gpu, layout: &Layout, weights: &PlaneWeights) -> Result<PlaneLosses, FieldError>;

    /// Gradients that are not finite or were out of range.
    fn bad_gradients(&mut self, gpu: &Gpu) -> Result<u64, FieldError>;

    /// One step of Adam, `step` from 1, with rates for the planes and for the MLP. The gradients are zero afterwards.
    fn step(
        &mut self,
        gpu: &Gpu,
        layout: &Layout,
        rates: [f32; 2],
        config: &AdamConfig,
        step: u32,
    ) -> Result<(), FieldError>;

    /// Copies everything out.
    fn vectors(&self, gpu: &Gpu) -> Result<Vectors, FieldError>;

    /// Takes everything over; gradients are zero afterwards.
    fn replace(&mut self, gpu: &Gpu, layout: &Layout, vectors: Vectors) -> Result<(), FieldError>;

    /// The gradients of all parameters.
    #[cfg(test)]
    fn gradients(&self, gpu: &Gpu) -> Result<Vec<f32>, FieldError>;
}
