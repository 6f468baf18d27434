//! The colour regulariser of the event-assisted loss (`L_creg` of ERF-GS): colours change little between two times.

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

use super::{LossSum, Losses};
use erfgs_splat::{
    gpu::{Commands, Gpu},
    raster::{Deltas, GaussianBuffers, sh_stride},
};

pub(super) const COLOUR: &str = include_str!("colour.wgsl");

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ColourParameters {
    centre: [f32; 3],
    scale: f32,
    rows: u32,
    threads: u32,
    stride: u32,
    degree: u32,
    share: f32,
    unused: [u32; 3],
}

/// Gaussians deformed to two times, as one camera sees them.
#[derive(Clone, Copy, Debug)]
pub struct ColourChange<'a> {
    /// The Gaussians before deformation.
    pub gaussians: &'a GaussianBuffers,
    /// Their deformation at the earlier time.
    pub before: &'a Deltas,
    /// Their deformation at the later time.
    pub after: &'a Deltas,
    /// Centre of the camera in the world, metres.
    pub centre: [f32; 3],
    /// SH degree in use, at most the allocated one.
    pub sh_degree: u32,
}

impl Losses {
    /// Adds `mean |c(t') - c(t)|` over the deformed Gaussians and the channels to `loss`, and the gradient of `weight`
    /// times that to `d_sh` (of the Gaussians) and to the SH of `d_deltas` (of the deformation at t').
    ///
    /// `c = max(0, 0.5 + sum of coefficients times harmonics)` towards the deformed mean. `c(t)` is a constant, and so
    /// are the directions: nothing moves for the sake of its colour.
    ///
    /// Returns whether there was anything to do: not without deformed Gaussians, nor where colours are not deformed.
    #[expect(clippy::too_many_arguments, reason = "where it reads, where it writes, and how much")]
    pub fn colour(
        &self,
        gpu: &Gpu,
        commands: &mut Commands<'_>,
        change: &ColourChange<'_>,
        d_sh: &Buffer,
        d_deltas: &Deltas,
        loss: &LossSum,
        weight: f32,
    ) -> bool {
        let ColourChange { gaussians, before, after, centre, sh_degree } = *change;
        let rows = before.rows.min(after.rows).min(d_deltas.rows).min(gaussians.count);
        let (Some(before_sh), Some(after_sh), Some(d_delta_sh)) = (&before.sh, &after.sh, &d_deltas.sh) else {
            return false;
        };
        if rows == 0 {
            return false;
        }
        let share = 1.0 / (3.0 * rows as f32);
        let threads = rows.min(loss.threads);
        let parameters = ColourParameters {
            centre,
            scale: weight * share,
            rows,
            threads,
            stride: sh_stride(gaussians.sh_degree),
            degree: sh_degree.min(gaussians.sh_degree),
            share,
            unused: [0; 3],
        };
        let parameters = gpu.uniform("colour", &parameters);
        let bindings = [
            &parameters,
            &gaussians.core,
            &gaussians.sh,
            &before.core,
            before_sh,
            &after.core,
            after_sh,
            d_sh,
            d_delta_sh,
            &loss.partial,
        ];
        commands.dispatch(&self.colour, &bindings, threads.div_ceil(64));
        true
    }
}
