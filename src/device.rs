//! Opening the device and a run.

use std::path::{Path, PathBuf};

use anyhow::Context;
use erfgs_dataset::Dataset;
use erfgs_run::RunFolder;
use erfgs_splat::{
    gpu::{AdapterChoice, Gpu, Shape, run_canary},
    trained::{Reconstruction, TrainedError, TrainedScene},
};
use erfgs_train::{
    checkpoint::Checkpoint,
    scene::Scene,
    trainer::{TrainOptions, Trainer},
};

/// Which adapter; every command that computes on the device takes it.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Adapter {
    /// Use the first graphics adapter whose name contains this (ignoring case); see `erfgs doctor`.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
}

impl Adapter {
    /// Opens the adapter and makes sure that it computes right.
    pub fn open(&self) -> anyhow::Result<Gpu> {
        self.open_as(None)
    }

    /// The same with the kernels in this shape, whatever the adapter is.
    pub fn open_as(&self, shape: Option<Shape>) -> anyhow::Result<Gpu> {
        let gpu = Gpu::open(&AdapterChoice { name: self.adapter.clone(), shape })?;
        run_canary(&gpu)?;
        Ok(gpu)
    }
}

/// A run that was trained, and what to open it with.
#[derive(Clone, Debug, clap::Args)]
pub struct TrainedRun {
    /// The run folder, as `erfgs train --out` wrote it.
    pub run: PathBuf,
    /// The dataset, where it is no longer where the run was trained on it.
    #[arg(long, value_name = "DATASET")]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    adapter: Adapter,
}

impl TrainedRun {
    /// A run by its folder.
    pub fn new(run: &Path, dataset: Option<&Path>, adapter: &Adapter) -> Self {
        Self { run: run.to_owned(), dataset: dataset.map(Path::to_owned), adapter: adapter.clone() }
    }

    /// The run folder.
    pub fn folder(&self) -> anyhow::Result<RunFolder> {
        Ok(RunFolder::open(&self.run)?)
    }

    /// Which adapter it is opened with.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// The device, for [`Self::scene`] and [`Self::trainer`].
    pub fn device(&self) -> anyhow::Result<Gpu> {
        self.adapter.open()
    }

    /// What the run learned, drawn without its dataset; a run of an earlier version is opened with it.
    pub fn scene<'a>(&self, gpu: &'a Gpu, folder: &RunFolder) -> anyhow::Result<TrainedScene<'a>> {
        match Reconstruction::read(folder.root()) {
            Err(error @ TrainedError::NoRecord { .. }) => {
                let trainer = self.trainer(gpu, folder).with_context(|| error.to_string())?;
                Ok(TrainedScene::new(gpu, trainer.reconstruction()?)?)
            }
            learned => Ok(TrainedScene::new(gpu, learned?)?),
        }
    }

    /// The recording that the run was trained on, where it is still there.
    pub fn dataset(&self, folder: &RunFolder) -> anyhow::Result<Dataset> {
        let trained_on = folder.read_info()?.dataset;
        let path: &Path = self.dataset.as_deref().unwrap_or(&trained_on);
        Dataset::load(path).with_context(|| {
            format!("cannot open the dataset of run {}; if it has moved, name it with --dataset", self.run.display())
        })
    }

    /// The run, to be measured.
    pub fn trainer<'a>(&self, gpu: &'a Gpu, folder: &RunFolder) -> anyhow::Result<Trainer<'a>> {
        let dataset = self.dataset(folder)?;
        let checkpoint = Checkpoint::load(&folder.checkpoint_file())?;
        // The initial points play no part any more.
        let without_points = dataset.manifest.points.is_none();
        let scene = Scene::load_within(dataset, &checkpoint.config, without_points, None, folder.root())?;
        Ok(Trainer::resume(gpu, scene, checkpoint, &TrainOptions::default())?)
    }
}
