//! `erfgs train`: from a dataset to a run.

mod arguments;
mod begin;
mod follow;
mod live;
mod memory;
mod names;
mod summary;
mod trial;

use erfgs_dataset::{Dataset, Split};
use erfgs_points::{CloudOptions, Method as CloudMethod};
use erfgs_run::RunFolder;
use erfgs_scene::Modality;
use erfgs_splat::{gpu::Gpu, ply::write_ply};
use erfgs_train::{
    checkpoint::Checkpoint,
    config::{Config, Method},
    scene::{Flicker, Scene},
    schedule::Clock,
    static_set::StaticSet,
    trainer::{Outcome, TrainError, TrainOptions, Trainer},
    trial::Setting,
};

pub use self::{
    arguments::{Arguments, check},
    names::{MethodName, PresetName},
};

use self::{
    arguments::{bytes_of, shell_word},
    follow::Follow,
    live::Live,
    summary::{Summary, describe},
};
use crate::{
    dataset::points,
    errors::Stopped,
    interrupt::stop_flag,
    terminal::{Terminal, bytes},
};

/// Trains.
pub fn run(arguments: &Arguments, terminal: &Terminal) -> anyhow::Result<()> {
    let folder = RunFolder::new(&arguments.out);
    if !folder.checkpoint_file().is_file() {
        // What is wrong with the words is said before anything is begun.
        arguments.settings()?;
    }
    let mut dataset = Dataset::load(&arguments.dataset)?;
    let _alone = begin::alone(&folder, terminal)?;
    let checkpoint = begin::checkpoint(&folder, arguments.resume)?;
    let mut config = match &checkpoint {
        Some(checkpoint) => arguments.settings_after(&checkpoint.config)?,
        None => arguments.settings()?,
    };
    let static_set = arguments.static_set.as_ref().map(|run| StaticSet::open(&RunFolder::open(run)?)).transpose()?;
    let random = arguments.init == Some(CloudMethod::Random);
    if dataset.manifest.points.is_none() && !random && checkpoint.is_none() {
        terminal.note("the dataset has no initial points yet: making them");
        let method = arguments.init.unwrap_or_default();
        points::make(&mut dataset, &CloudOptions { method, ..CloudOptions::default() }, terminal)?;
    }
    let has_events = dataset.cameras(Split::Train).any(|camera| camera.modality != Modality::Rgb);
    if config.method == Method::ErfGs && !has_events {
        terminal.note("no training camera has events: ERF-GS trains on the frames alone");
    }
    let without_points = random || dataset.manifest.points.is_none();
    let static_set = begin::settle(&mut config, &dataset, without_points, static_set, checkpoint.as_ref(), terminal)?;
    let options = arguments.options();
    let mut tried = trial::known(&dataset, &config, options.budget, &folder)?;
    if let Some(tried) = &tried {
        trial::take(&mut config, &dataset, tried);
    }
    if let Some(checkpoint) = &checkpoint {
        let identity = |config: &Config| Trainer::identity(&dataset, config, options.budget);
        let stands = begin::same(&folder, &identity(&checkpoint.config)?, &identity(&config)?, arguments.change)?;
        if let Some(version) = stands.other_version() {
            terminal.note(format!("the run was begun with erfgs {version}; this is {}", env!("CARGO_PKG_VERSION")));
        }
        // A run of an earlier version is saved again, with what drawing it takes.
        if stands.is_finished(&folder) && checkpoint.record.is_some() {
            terminal.note(format!("{} is finished: nothing is left to do", folder.root().display()));
            let summary = Summary::of_finished(&folder)?;
            return terminal.result(&summary, || describe(&summary));
        }
    }
    let memory = arguments.memory.map(bytes_of);
    let gpu = arguments.adapter.open()?;
    let begun = checkpoint.is_some();
    if !begun && tried.is_none() {
        let (static_set, device_memory) = (static_set.as_ref(), options.device_memory);
        let setting = Setting { gpu: &gpu, dataset: &dataset, config: &config, static_set, memory, device_memory };
        tried = trial::make(&setting, options.budget, &folder, terminal)?;
        if let Some(tried) = &tried {
            trial::take(&mut config, &dataset, tried);
        }
    }
    let scene = Scene::load_within(dataset, &config, without_points, memory, folder.root())?;
    note_deviations(&scene, terminal);
    let mut trainer = match (checkpoint, &static_set) {
        (Some(checkpoint), _) => Trainer::resume(&gpu, scene, Checkpoint { config, ..checkpoint }, &options)?,
        (None, Some(set)) => Trainer::within(&gpu, scene, config, &options, set)?,
        (None, None) => Trainer::new(&gpu, scene, config, &options)?,
    };
    for line in memory::describe(&trainer.device_memory()?, &gpu.info.name, gpu.shares_memory()) {
        terminal.note(line);
    }
    let [most, all] = trainer.device_room();
    if all > most {
        let [most, all] = [most, all].map(bytes);
        terminal.note(format!(
            "frames and events need {all} on the device: {most} of them stay there (--device-memory), the others are uploaded when they \
             are used"
        ));
    }
    if let Some(tried) = tried.filter(|_| !begun && !arguments.deterministic) {
        trainer.clock = Clock::after([tried.seconds, tried.cpu_seconds]);
    }
    drive(arguments, terminal, &gpu, trainer, &folder, &options)
}

/// Says what of the dataset is not taken as it lies there.
fn note_deviations(scene: &Scene, terminal: &Terminal) {
    if !scene.pictures.all_are_kept() {
        let [kept, all] = scene.pictures.bytes().map(bytes);
        terminal.note(format!(
            "frames need {all}: {kept} of them are kept in memory (--memory), the others are read during the training"
        ));
    }
    if scene.events_filed {
        let events: u64 = scene.events.iter().map(|events| events.count).sum();
        terminal.note(format!("{events} events are kept in temporary files, because --memory has no room for them"));
    }
    if let Some(Flicker { hz, share, .. }) = &scene.flicker {
        terminal.note(format!(
            "the light flickers at {hz:.1} Hz for {:.0} % of the event cameras' pixels: event bins begin and end at the peaks of the \
             light (earl.flicker). Steady light allows shorter bins and shows more of fast motion",
            100.0 * share
        ));
    }
    for events in &scene.events {
        let camera = &scene.dataset.manifest.cameras[events.view];
        let (file, camera) = (&camera.events, &camera.name);
        let stated = file.as_ref().map(|file| file.threshold_on / file.threshold_off);
        if let Some((measured, stated)) = events.measured_ratio.zip(stated) {
            terminal.note(format!(
                "camera {camera}: measured ON/OFF threshold ratio {measured:.2}; the stated {stated:.2} is ignored (earl.balance)"
            ));
        }
        if events.drift != 0.0 {
            let drift = events.drift;
            terminal.note(format!(
                "camera {camera}: leak and noise events add up to {drift:+.1} contrast thresholds per pixel; they are subtracted \
                 (earl.balance)"
            ));
        }
    }
}

fn drive(
    arguments: &Arguments,
    terminal: &Terminal,
    gpu: &Gpu,
    mut trainer: Trainer<'_>,
    folder: &RunFolder,
    options: &TrainOptions,
) -> anyhow::Result<()> {
    let stop = stop_flag("the iteration ends, then a checkpoint is saved")?;
    let live = arguments.live.map(|address| Live::start(address, &trainer, folder, terminal)).transpose()?;
    let mut watch =
        Follow { bar: terminal.progress("training"), live, stop, first: None, last: None, quality: (None, None) };
    let outcome = trainer.run(folder, options, stop, &mut watch);
    let Follow { bar, live, last, quality, .. } = watch;
    drop(bar);
    if let Some(live) = live {
        live.end(&mut trainer, &outcome);
    }
    if let Err(TrainError::Scene(_)) = &outcome {
        let command = arguments.resume_command();
        terminal.note(format!("a checkpoint is saved; once the file can be read again, continue with: {command}"));
    }
    let outcome = outcome?;
    let gaussians = trainer.model.drawn.gaussians_still(gpu)?;
    write_ply(&folder.point_cloud_file(), &gaussians)?;
    if outcome == Outcome::Finished {
        folder.finish()?;
    }
    let done = trainer.iterations_done();
    let summary = Summary {
        run: folder.root(),
        finished: outcome == Outcome::Finished,
        iterations: done,
        train_seconds: trainer.clock.seconds,
        cpu_seconds: trainer.clock.cpu_seconds,
        gaussians: trainer.model.drawn.gaussians.count.into(),
        dynamic: last.map_or(0, |last| last.dynamic.into()),
        psnr: quality.0,
        dpsnr: quality.1,
        camera_poses: trainer.camera_poses(),
        camera_times: trainer.camera_times(),
        left_out: trainer.left_out().to_vec(),
    };
    terminal.result(&summary, || describe(&summary))?;
    if outcome == Outcome::Stopped {
        let command = arguments.resume_command();
        return Err(Stopped(format!("stopped after {done} iterations; go on with: {command}")).into());
    }
    terminal.note(format!("measure it with: erfgs eval {}", shell_word(folder.root())));
    Ok(())
}
