//! Sums of the losses since the last row of the curve.

use super::TrainError;
use crate::{checkpoint::LossSums, losses::LossSum};
use erfgs_splat::gpu::Gpu;

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
