//! The passes over bodies: where their Gaussians are at a time, and what that teaches paths, nodes and clocks.

use bytemuck::{Pod, Zeroable};
use wgpu::Buffer;

use super::Bodies;
use crate::{
    field::{FieldError, Tape},
    gpu::Gpu,
    motion::{ClockRow, MotionRows, Shown, Supervision},
    raster::Deltas,
};

/// How softly a body appears and vanishes, seconds.
pub const SOFTNESS: f32 = 0.012;

/// The uniform `Moment` of `shared.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Moment {
    rows: u32,
    bodies: u32,
    nodes: u32,
    knots: u32,
    stretch: f32,
    seconds: f32,
    softness: f32,
    path: f32,
    rigid: f32,
    away: f32,
    alike: f32,
    loose: f32,
}

impl Bodies {
    fn moment(&self, rows: u32, t01: f32, path: f32, share: f32) -> Moment {
        let [bodies, nodes, knots] = self.counts;
        let each = share / nodes.max(1) as f32;
        let squared = each / (self.extent * self.extent).max(1e-12);
        Moment {
            rows,
            bodies,
            nodes,
            knots,
            stretch: (f64::from(t01) * self.stretches) as f32,
            seconds: (f64::from(t01) * self.seconds) as f32,
            softness: SOFTNESS,
            path,
            rigid: squared * self.options.rigid,
            away: squared * self.options.away,
            alike: each * self.options.alike,
            loose: self.options.loose,
        }
    }

    /// Fills `tape.deltas` for the dynamic rows at a time.
    pub(in crate::motion) fn forward(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        time: Shown,
        tape: &mut Tape,
    ) -> Result<(), FieldError> {
        if self.hung.some_are_free {
            self.free.forward(gpu, rows, time.free_t01 as f32, tape)?;
        } else {
            tape.begin_rows(gpu, rows.count, time.free_t01 as f32)?;
        }
        tape.body_t01 = time.t01 as f32;
        let moment = gpu.uniform("motion", &self.moment(rows.count, tape.body_t01, 0.0, 0.0));
        let mut commands = gpu.commands();
        commands.dispatch(
            &self.kernels.poses,
            &[&moment, &self.control.values, &self.other.values, &self.poses],
            self.entities().div_ceil(self.threads),
        );
        commands.dispatch(
            &self.kernels.carry,
            &[&moment, rows.core, rows.values, &self.poses, &self.other.values, &tape.deltas.core],
            rows.count.div_ceil(self.rows_a_group),
        );
        commands.submit();
        Ok(())
    }

    /// Adds the gradients of the pass on `tape` to those of paths and rows, and to `d_core`; and those of what holds nodes together where
    /// the supervision is a frame.
    pub(in crate::motion) fn backward(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        tape: &Tape,
        d_deltas: &Deltas,
        d_core: &Buffer,
        supervision: Supervision,
    ) -> Result<(), FieldError> {
        if self.hung.some_are_free {
            self.free.backward(gpu, rows, tape, d_deltas, d_core, supervision)?;
        }
        let (path, share) = match supervision {
            Supervision::Frame(share) => (1.0, share),
            Supervision::Events => (0.0, 0.0),
        };
        let moment = gpu.uniform("motion", &self.moment(tape.deltas.rows, tape.body_t01, path, share));
        let counts = gpu.uniform("chunks", &[self.hung.chunk_count, 0, 0, 0]);
        let (control, other, hung) = (&self.control, &self.other, &self.hung);
        let mut commands = gpu.commands();
        // Another pass may have been since.
        commands.dispatch(
            &self.kernels.poses,
            &[&moment, &control.values, &other.values, &self.poses],
            self.entities().div_ceil(self.threads),
        );
        commands.dispatch(
            &self.kernels.carry_backward,
            &[&moment, rows.core, rows.values, &self.poses, &other.values, &d_deltas.core, d_core, &hung.shares],
            rows.count.div_ceil(self.rows_a_group),
        );
        commands.dispatch(
            &self.kernels.chunks,
            &[&counts, &hung.chunks, &hung.items, &hung.shares, &hung.partial],
            hung.chunk_count.div_ceil(self.threads),
        );
        commands.dispatch(
            &self.kernels.settle,
            &[
                &moment,
                &hung.runs,
                &hung.partial,
                &self.poses,
                &other.values,
                &self.neighbours,
                &control.values,
                &control.gradients,
                &other.gradients,
                &self.d_poses,
            ],
            self.entities().div_ceil(self.threads),
        );
        commands.submit();
        Ok(())
    }

    /// Adds to a camera's row the gradient of the time, RGB intervals, of the pass on `tape`, which was the last to be gone back through.
    pub(in crate::motion) fn clock(
        &self,
        gpu: &Gpu,
        rows: MotionRows<'_>,
        tape: &Tape,
        d_deltas: &Deltas,
        to: ClockRow<'_>,
    ) {
        if self.hung.some_are_free {
            self.free.clock(gpu, rows, tape, d_deltas, to);
        }
        let moment = gpu.uniform("motion", &self.moment(0, tape.body_t01, 0.0, 0.0));
        let interval = (self.stretches / f64::from(self.intervals)) as f32;
        // Where some rows are free, their clock has counted it.
        let renderings = if self.hung.some_are_free { 0.0_f32 } else { 1.0 };
        let row = gpu.uniform("row of a camera", &[to.row, interval.to_bits(), renderings.to_bits(), 0]);
        let mut commands = gpu.commands();
        let bindings = [&moment, &row, &self.control.values, &self.d_poses, to.sums];
        commands.dispatch(&self.kernels.clock, &bindings, 1);
        commands.submit();
    }
}
