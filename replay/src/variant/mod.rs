//! Dataset variants: fewer frames (`-ts`), blurred frames (`-mb`), viewpoints that are event cameras (`-dv`).

mod blur;
mod error;
mod events;
mod options;
mod plan;

pub use error::VariantError;
pub use events::luma_u8;
pub use options::{BlurOptions, Edge, EventOnly, Label, Rounding, VariantOptions, Window};

use std::{
    ops::Range,
    path::{Path, PathBuf},
    sync::mpsc,
};

use erfgs_base::{FileError, Progress, atomic::NewFolder, copy_file};
use erfgs_dataset::{CameraEvents, Dataset, DatasetError, Frame};
use rayon::prelude::*;

use self::plan::{Job, Plan};
use crate::simulator::SimulatorConfig;

/// Makes a variant of `source` in the new folder `out` and returns it. The folder appears whole or not at all.
///
/// Events are simulated first, from the source's frames at their full rate; then the training cameras lose frames, what
/// remains is blurred with the frames that the source has in between, and the event-only cameras lose all frames. Test
/// cameras stay as they are. Events that the source already has are carried over and never simulated again. Files that do
/// not change are hard links where the file system has them. The manifest records every step with its parameters.
///
/// # Errors
/// If an option has no meaning for the source, a file cannot be read or written, or `out` is not empty.
pub fn variant(
    source: &Dataset,
    options: &VariantOptions,
    out: &Path,
    progress: &mut dyn FnMut(Progress),
) -> Result<Dataset, VariantError> {
    let write = |source| DatasetError::from(FileError { doing: "write", path: out.to_owned(), source });
    if out.exists() && std::fs::read_dir(out).map_err(write)?.next().is_some() {
        return Err(VariantError::NotEmpty { path: out.to_owned() });
    }
    let config = seeded(options);
    config.validate()?;
    let plan = Plan::new(&source.manifest, options)?;

    let building = NewFolder::begin(out).map_err(write)?;
    let work = Work { source, options, config, root: building.path() };
    let simulated = work.all(&plan, progress)?;

    let mut manifest = source.manifest.clone();
    manifest.name = plan.name;
    manifest.seed = options.seed;
    manifest.variant.extend(plan.steps);
    manifest.cameras = plan.cameras;
    for (camera, events) in simulated {
        manifest.cameras[camera].events = Some(events);
    }
    if !plan.points {
        manifest.points = None;
        manifest.bodies = None;
    }
    if options.blur.frames > 1 {
        manifest.linear_exposure = options.blur.linear_light;
    }
    let mut made = Dataset::new(building.path(), manifest);
    made.hash_files()?;
    made.save()?;
    made.validate()?;
    building.finish().map_err(write)?;
    made.root = out.to_owned();
    Ok(made)
}

/// The simulator's parameters with the variant's seed.
fn seeded(options: &VariantOptions) -> SimulatorConfig {
    SimulatorConfig { seed: options.seed, ..options.simulator.clone() }
}

/// What all jobs share.
struct Work<'a> {
    source: &'a Dataset,
    options: &'a VariantOptions,
    config: SimulatorConfig,
    /// The folder of the variant.
    root: &'a Path,
}

impl Work<'_> {
    /// Does all jobs, and returns the event files that were simulated, by camera.
    fn all(&self, plan: &Plan, progress: &mut dyn FnMut(Progress)) -> Result<Vec<(usize, CameraEvents)>, VariantError> {
        let mut jobs: Vec<(&PathBuf, &Job)> = plan.jobs.iter().collect();
        // A simulation takes as long as all the rest: those first.
        jobs.sort_by_key(|(_, job)| !matches!(job, Job::Simulate { .. }));
        let total = jobs.len() as u64;
        let (sender, receiver) = mpsc::channel();
        std::thread::scope(|scope| {
            let worker = scope.spawn(|| {
                let done = jobs
                    .into_par_iter()
                    .map_with(sender, |sender, (file, job)| {
                        let made = self.one(file, job);
                        // Nobody listens any more if the caller's callback panicked; the files are made all the same.
                        let _ = sender.send(());
                        made
                    })
                    .collect::<Vec<_>>();
                // The first error in the order of the jobs, whatever thread met one first.
                done.into_iter().filter_map(Result::transpose).collect::<Result<Vec<_>, _>>()
            });
            for (done, ()) in (1..).zip(receiver) {
                progress(Progress { what: "files", done, total });
            }
            worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    fn one(&self, file: &Path, job: &Job) -> Result<Option<(usize, CameraEvents)>, VariantError> {
        let to = self.root.join(file);
        match job {
            Job::Link(from) => self.link(&self.source.path(from)?, &to)?,
            Job::Blur { camera, frames } => self.blur(*camera, frames, &to)?,
            Job::Mask { camera, frames } => self.mask(*camera, frames, &to)?,
            Job::Simulate { camera } => {
                let source = &self.source.manifest.cameras[*camera];
                let (events, description) = events::simulate(self.source, source, &self.config)?;
                events::write(&to, source, &events)?;
                return Ok(Some((*camera, description)));
            }
        }
        Ok(None)
    }

    fn link(&self, from: &Path, to: &Path) -> Result<(), VariantError> {
        if let Some(folder) = to.parent() {
            std::fs::create_dir_all(folder).map_err(FileError::when("write", to)).map_err(DatasetError::from)?;
        }
        // Another file system, or one without links, takes a copy.
        if std::fs::hard_link(from, to).is_err() {
            copy_file(from, to).map_err(DatasetError::from)?;
        }
        Ok(())
    }

    fn frames(&self, camera: usize, frames: &Range<usize>) -> &[Frame] {
        &self.source.manifest.cameras[camera].frames[frames.clone()]
    }

    fn blur(&self, index: usize, frames: &Range<usize>, to: &Path) -> Result<(), VariantError> {
        let camera = &self.source.manifest.cameras[index];
        let mut mean = blur::Mean::new(self.options.blur, camera.intrinsics.width, camera.intrinsics.height);
        for frame in self.frames(index, frames) {
            mean.add(&self.source.read_image(camera, frame)?);
        }
        let name = camera.name.clone();
        Ok(mean.finish().write_png(to).map_err(|source| DatasetError::Image { camera: name, source })?)
    }

    fn mask(&self, index: usize, frames: &Range<usize>, to: &Path) -> Result<(), VariantError> {
        let camera = &self.source.manifest.cameras[index];
        let masks =
            self.frames(index, frames).iter().filter_map(|frame| self.source.read_mask(camera, frame).transpose());
        let Some(mask) = blur::union(masks.collect::<Result<Vec<_>, _>>()?.into_iter()) else { return Ok(()) };
        let name = camera.name.clone();
        Ok(mask.write_png(to).map_err(|source| DatasetError::Image { camera: name, source })?)
    }
}
