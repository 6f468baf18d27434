//! What `run.json` has of a training.

use super::{TrainError, Trainer};
use crate::{
    config::{Config, ConfigError},
    scene::SceneView,
    schedule::Budget,
};
use erfgs_dataset::Dataset;
use erfgs_run::{CameraColour, CameraPose, CameraTime, Identity, RunFolder, RunInfo};
use erfgs_splat::motion::Motion;

impl Trainer<'_> {
    /// What a run with this scene, configuration and budget is.
    ///
    /// # Errors
    /// [`TrainError::Config`] where the configuration cannot be written.
    pub fn identity(dataset: &Dataset, config: &Config, budget: Budget) -> Result<Identity, TrainError> {
        Ok(Identity {
            dataset_sha256: dataset.sha256(),
            config: toml::Table::try_from(config).map_err(ConfigError::from)?,
            budget: [budget.seconds, budget.cpu_seconds],
            version: env!("CARGO_PKG_VERSION").into(),
        })
    }

    pub(super) fn write_info(&self, run: &RunFolder) -> Result<(), TrainError> {
        let budget = self.schedule.budget;
        Ok(run.write_info(&RunInfo {
            format: RunInfo::FORMAT.into(),
            format_version: RunInfo::FORMAT_VERSION,
            method: match self.config.method {
                crate::config::Method::FourDgs => "4dgs".into(),
                crate::config::Method::ErfGs => "erf-gs".into(),
            },
            preset: match self.config.preset {
                crate::config::Preset::Paper => "paper".into(),
                crate::config::Preset::ReleasedCode => "released-code".into(),
                crate::config::Preset::Default => "default".into(),
            },
            dataset: self.scene.dataset.root.clone(),
            dataset_name: self.scene.dataset.manifest.name.clone(),
            dataset_sha256: Some(self.scene.dataset.sha256()),
            adapter: self.gpu.info.name.clone(),
            driver: format!("{} {}", self.gpu.info.driver, self.gpu.info.driver_info),
            version: env!("CARGO_PKG_VERSION").into(),
            seed: self.config.seed,
            minutes: budget.seconds.map(|seconds| seconds / 60.0),
            cpu_minutes: budget.cpu_seconds.map(|seconds| seconds / 60.0),
            identity: Some(Self::identity(&self.scene.dataset, &self.config, budget)?.sha256()),
            // Whoever writes what comes after the training says that it is there.
            finished: false,
            left_out: self.left_out.clone(),
            bodies: self.body_names(),
            camera_colours: self.camera_colours()?,
            camera_poses: self.camera_poses(),
            camera_times: self.camera_times(),
        })?)
    }

    /// What the bodies are called that carry Gaussians by now.
    fn body_names(&self) -> Vec<String> {
        self.model.drawn.motion.as_ref().and_then(Motion::bodies).map_or(Vec::new(), |bodies| bodies.names().to_vec())
    }

    /// Where the cameras were found to stand, beside their calibration; nothing where that is not learned.
    #[must_use]
    pub fn camera_poses(&self) -> Vec<CameraPose> {
        self.poses.as_ref().map_or(Vec::new(), |poses| poses.found(&self.scene))
    }

    /// How much later the cameras are found to have taken their frames than these say; nothing where that is not learned.
    #[must_use]
    pub fn camera_times(&self) -> Vec<CameraTime> {
        self.clocks.as_ref().map_or(Vec::new(), |clocks| clocks.found(&self.scene))
    }

    /// The gains and offsets of the cameras that have learned any.
    fn camera_colours(&self) -> Result<Vec<CameraColour>, TrainError> {
        let state = self.colour_state()?;
        let learned = self.scene.views.iter().enumerate().filter(|(view, _)| state.steps[*view] > 0);
        let colour = |(view, of): (usize, &SceneView)| {
            let [gain, offset] = state.of(view);
            CameraColour { camera: of.name.clone(), gain, offset }
        };
        Ok(learned.map(colour).collect())
    }
}
