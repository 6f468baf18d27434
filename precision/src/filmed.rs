//! A small film of the stage that trainings are held against, with initial points as any recording gets them.

use std::{path::Path, sync::OnceLock};

use erfgs_base::scratch::Scratch;
use erfgs_dataset::Dataset;
use erfgs_points::{CloudOptions, Method, attach, initial_cloud};
use erfgs_stage::{FilmOptions, RigOptions, film};

use crate::{Result, Size};

/// A film, made when it is first asked for.
#[derive(Debug)]
pub(crate) struct Filmed {
    options: FilmOptions,
    with_points: bool,
    made: OnceLock<std::result::Result<(Scratch, Dataset), String>>,
}

impl Filmed {
    /// To be filmed with `options`, and to have initial points or not.
    pub fn new(options: FilmOptions, with_points: bool) -> Self {
        Self { options, with_points, made: OnceLock::new() }
    }

    /// For trainings: RGB cameras with a true exposure, event cameras beside them, and held-out cameras that see what is between.
    pub fn to_train_on(size: Size) -> Self {
        let ([width, height], [rgb, event, test], duration_ns) = match size {
            Size::Small => ([40, 30], [4, 1, 1], 200_000_000),
            Size::Full => ([96, 72], [8, 3, 2], 400_000_000),
        };
        let options = FilmOptions {
            rig: RigOptions { width, height, rgb, event, test, ..RigOptions::default() },
            // Another stage than those that defaults were chosen on.
            seed: 5,
            duration_ns,
            rgb_fps: 20.0,
            exposure_ns: 10_000_000,
            test_fps: 80.0,
            truth_points: 0,
            ..FilmOptions::default()
        };
        Self::new(options, true)
    }

    /// How it is filmed.
    pub fn options(&self) -> &FilmOptions {
        &self.options
    }

    /// The film.
    pub fn dataset(&self) -> Result<&Dataset> {
        let made = self.made.get_or_init(|| self.make().map_err(|error| error.to_string()));
        made.as_ref().map(|(_, dataset)| dataset).map_err(|error| error.clone().into())
    }

    fn make(&self) -> Result<(Scratch, Dataset)> {
        let folder = Scratch::new()?;
        let mut dataset = film(&folder.path().join("ds"), &self.options, &|_| {})?.dataset;
        if self.with_points {
            let options = CloudOptions { method: Method::Sweep, ..CloudOptions::default() };
            let points = cloud(&dataset, &options, folder.path())?;
            attach(&mut dataset, &points)?;
        }
        Ok((folder, dataset))
    }
}

/// The initial points of a film.
pub(crate) fn cloud(dataset: &Dataset, options: &CloudOptions, work: &Path) -> Result<erfgs_points::Cloud> {
    Ok(initial_cloud(dataset, options, work, &|_, _, _| {})?)
}
