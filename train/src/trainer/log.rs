//! The rows of the curve, and what ends a training: numbers that are not finite, and pictures without anything in them.

use super::{Progress, TrainError, Trainer, Watch};
use crate::schedule::Stage;
use erfgs_base::cpu;
use erfgs_run::{CurveRow, CurveWriter};
use erfgs_splat::{motion::Motion, raster::View};

/// A photometric loss that pictures without anything in them may not have: five grey levels.
const FAR_OFF: f64 = 0.02;

const GAUSSIANS_COLOURS: &str = "colours of the Gaussians";
const TRAJECTORIES: &str = "trajectories and lives of the Gaussians";
const PATHS: &str = "paths of the bodies";
const CAMERAS_COLOURS: &str = "colours of the cameras";

impl Trainer<'_> {
    pub(super) fn log(
        &mut self,
        curve: &mut CurveWriter,
        evaluate: bool,
        watch: &mut dyn Watch,
    ) -> Result<(), TrainError> {
        let sums = &mut self.work.sums;
        let mean = |sum: f64, count: f64| (count > 0.0).then(|| sum / count);
        let rgb = mean(sums.rgb.take(self.gpu)?, std::mem::take(&mut sums.rgb_values));
        let event = mean(sums.event.take(self.gpu)?, std::mem::take(&mut sums.event_values));
        let trajectory = mean(std::mem::take(&mut sums.trajectory), std::mem::take(&mut sums.trajectory_samples));
        let colour = mean(sums.colour.take(self.gpu)?, std::mem::take(&mut sums.colour_samples));
        let plane = mean(std::mem::take(&mut sums.plane), std::mem::take(&mut sums.plane_samples));
        let iteration = self.schedule.done(&self.clock);
        for (what, value) in
            [("photometric loss", rgb), ("event loss", event), ("trajectory loss", trajectory), ("colour loss", colour)]
        {
            if value.is_some_and(|value| !value.is_finite()) {
                return Err(self.diverged(what));
            }
        }
        if let Some(loss) = rgb.filter(|&loss| loss > FAR_OFF)
            && self.sees_nothing()?
        {
            let lower = format!("learning_rate.scale={:e}", 0.5 * self.config.learning_rate.scale);
            return Err(TrainError::Vanished { iteration, loss, lower });
        }
        let quality = if evaluate { Some(self.evaluate_quickly()?) } else { None };
        let (psnr, dpsnr) = quality.map_or((None, None), |quality| (Some(quality.psnr), quality.dpsnr));
        curve.append(&CurveRow {
            iteration,
            stage: self.clock.stage.name().into(),
            wall_seconds: self.clock.seconds,
            loss_rgb: rgb,
            loss_event: event,
            loss_trajectory: trajectory,
            loss_colour: colour,
            loss_plane: plane,
            gaussians: u64::from(self.model.drawn.gaussians.count),
            dynamic: self.dynamic_count(),
            psnr,
            dpsnr,
            psnr_static: quality.and_then(|quality| quality.psnr_static),
            cpu_seconds: cpu::process_seconds().map(|_| self.clock.cpu_seconds),
        })?;
        watch.progress(&Progress { loss_rgb: rgb, loss_event: event, ..self.progress(psnr, dpsnr) });
        Ok(())
    }

    /// Whether no training camera shows any Gaussian at any of its frames. Before the fine stage nothing is said: what moves may be
    /// born with it.
    fn sees_nothing(&mut self) -> Result<bool, TrainError> {
        let count = self.model.drawn.gaussians.count as usize;
        let shown: Vec<[f32; 4]> = self.gpu.download(&self.model.gradients.screen, count)?;
        if self.clock.stage == Stage::Coarse || shown.iter().any(|row| row[3] > 0.0) {
            return Ok(false);
        }
        let looks: Vec<(View, f64)> =
            self.scene.frames.iter().map(|frame| (self.scene.views[frame.view].view, frame.t01)).collect();
        for (view, time) in looks {
            if self.render(&view, time)?.transmittance.iter().any(|&light| light < 0.99) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    pub(super) fn check_finite(&self) -> Result<(), TrainError> {
        let gaussians = &self.model.drawn.gaussians;
        let (rows, row_floats) = self.model.motion_values();
        let [(paths, path_floats), (nodes, node_floats)] =
            self.model.drawn.motion.as_ref().and_then(Motion::bodies).map_or([(rows, 0); 2], |bodies| bodies.values());
        for (what, buffer, floats) in [
            ("positions, scales, rotations and opacities of the Gaussians", &gaussians.core, gaussians.count * 12),
            (GAUSSIANS_COLOURS, &gaussians.sh, gaussians.count * erfgs_splat::raster::sh_stride(gaussians.sh_degree)),
            (TRAJECTORIES, rows, row_floats),
            (PATHS, paths, path_floats),
            (PATHS, nodes, node_floats),
            (CAMERAS_COLOURS, &self.colours.values, self.colours.floats()),
        ] {
            let mut commands = self.gpu.commands();
            self.finite.scan(&mut commands, buffer, floats);
            commands.submit();
            if self.finite.take(self.gpu)? > 0 {
                return Err(self.diverged(what));
            }
        }
        Ok(())
    }

    fn diverged(&self, what: &str) -> TrainError {
        let two = |key: &str, [first, last]: [f32; 2]| format!("{key}=[{:e},{:e}]", 0.5 * first, 0.5 * last);
        let rates = &self.config.learning_rate;
        let lower = match what {
            GAUSSIANS_COLOURS => format!("learning_rate.sh_dc={:e}", 0.5 * rates.sh_dc),
            TRAJECTORIES => format!("free_time.velocity={:e}", 0.5 * self.config.free_time.velocity),
            PATHS => two("bodies.path", self.config.bodies.path),
            CAMERAS_COLOURS => two("camera_colour.rate", self.config.camera_colour.rate),
            _ => two("learning_rate.position", rates.position),
        };
        TrainError::Diverged { what: what.into(), iteration: self.schedule.done(&self.clock), lower }
    }
}
