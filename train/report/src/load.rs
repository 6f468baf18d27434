//! Reading the runs.

use std::{collections::BTreeSet, fs};

use erfgs_dataset::{Manifest, Split};
use erfgs_scene::Modality;

use erfgs_run::{Curve, Metrics, PerView, RunError, RunFolder, RunInfo};

/// Everything that the page shows of one run.
pub(super) struct Run {
    pub folder: RunFolder,
    /// What the run is called in tables and legends; unique.
    pub label: String,
    pub info: RunInfo,
    pub config: Option<toml::Table>,
    pub curve: Curve,
    pub metrics: Option<Metrics>,
    pub views: Vec<PerView>,
    pub dataset: Option<Manifest>,
}

impl Run {
    /// The evaluation of a view.
    pub fn view(&self, camera: &str, index: u32) -> Option<&PerView> {
        self.views.iter().find(|view| view.camera == camera && view.index == index)
    }
}

/// The runs over one dataset, and what is to be said about them.
pub(super) struct Scene {
    /// Name of the dataset; unique.
    pub name: String,
    /// Stands before the names of sections, so that they are unique on the page.
    pub prefix: String,
    pub runs: Vec<Run>,
    pub notes: Vec<String>,
}

impl Scene {
    /// The views that all evaluated runs share: camera, index, time.
    pub fn common_views(&self) -> Vec<(&str, u32, i64)> {
        let mut evaluated = self.runs.iter().filter(|run| !run.views.is_empty());
        let Some(first) = evaluated.next() else { return Vec::new() };
        let others: Vec<&Run> = evaluated.collect();
        let shared = |view: &&PerView| others.iter().all(|run| run.view(&view.camera, view.index).is_some());
        first.views.iter().filter(shared).map(|view| (view.camera.as_str(), view.index, view.t_ns)).collect()
    }

    /// The first dataset that is known.
    pub fn dataset(&self) -> Option<&Manifest> {
        self.runs.iter().find_map(|run| run.dataset.as_ref())
    }

    /// Times and exposures of the frames that training saw, nanoseconds, in order of time.
    pub fn rgb_frames(&self) -> Vec<(i64, [i64; 2])> {
        let Some(dataset) = self.dataset() else { return Vec::new() };
        let trains =
            dataset.cameras.iter().filter(|camera| camera.split == Split::Train && camera.modality != Modality::Event);
        let times: BTreeSet<_> =
            trains.flat_map(|camera| camera.frames.iter().map(|frame| (frame.t_ns, frame.exposure_ns))).collect();
        times.into_iter().collect()
    }

    /// How DPSNR is called: with the kind of its masks where all runs agree.
    pub fn dpsnr_name(&self) -> String {
        let kinds: BTreeSet<String> =
            self.runs.iter().filter_map(|run| Some(run.metrics.as_ref()?.dpsnr_mask.to_string())).collect();
        match kinds.first() {
            Some(kind) if kinds.len() == 1 => format!("DPSNR ({kind} masks)"),
            _ => "DPSNR".into(),
        }
    }
}

/// Reads the runs and groups them by dataset, in the order in which the datasets come. What is missing becomes a note.
pub(super) fn load(folders: &[RunFolder]) -> Result<Vec<Scene>, RunError> {
    let mut scenes: Vec<Scene> = Vec::new();
    for (folder, label) in folders.iter().zip(labels(folders)) {
        let (run, notes) = load_run(folder, label)?;
        let found = scenes.iter_mut().find(|scene| scene.runs.first().is_some_and(|first| same_dataset(first, &run)));
        if let Some(scene) = found {
            scene.notes.extend(notes);
            scene.runs.push(run);
            continue;
        }
        let same_name =
            scenes.iter().filter(|scene| dataset_name(&scene.runs[0].info) == dataset_name(&run.info)).count();
        let name = match same_name {
            0 => dataset_name(&run.info),
            others => format!("{} ({})", dataset_name(&run.info), others + 1),
        };
        scenes.push(Scene { name, prefix: String::new(), runs: vec![run], notes });
    }
    for scene in &mut scenes {
        compare(scene);
    }
    if scenes.len() > 1 {
        let names: Vec<String> = scenes.iter().map(|scene| scene.name.clone()).collect();
        scenes[0].notes.insert(
            0,
            format!(
                "The runs are over different datasets ({}): they are compared within a dataset alone.",
                names.join(", ")
            ),
        );
        for (at, scene) in scenes.iter_mut().enumerate() {
            scene.prefix = format!("scene-{}-", at + 1);
        }
    }
    Ok(scenes)
}

fn load_run(folder: &RunFolder, label: String) -> Result<(Run, Vec<String>), RunError> {
    let mut notes = Vec::new();
    let folder = RunFolder::open(folder.root())?;
    let info = folder.read_info()?;
    let config = present(folder.read_config())?;
    let metrics = present(folder.read_metrics())?;
    let views = present(folder.read_per_view())?.unwrap_or_default();
    if metrics.is_none() || views.is_empty() {
        notes.push(format!("{label}: not evaluated yet; `erfgs eval` fills in what is missing here."));
    }
    let curve = present(folder.read_curve())?;
    match &curve {
        None => notes.push(format!("{label}: has no curve.csv, so that its training cannot be plotted.")),
        Some(Curve { cut: Some(cut), .. }) => {
            notes.push(format!("{label}: curve.csv was cut off while it was written ({cut}); that line is left out."))
        }
        Some(_) => {}
    }
    let dataset = dataset(&folder, &info, &label, &mut notes)?;
    Ok((Run { folder, label, info, config, curve: curve.unwrap_or_default(), metrics, views, dataset }, notes))
}

fn same_dataset(a: &Run, b: &Run) -> bool {
    match (&a.info.dataset_sha256, &b.info.dataset_sha256) {
        (Some(a), Some(b)) => a == b,
        _ => (&a.info.dataset_name, &a.info.dataset) == (&b.info.dataset_name, &b.info.dataset),
    }
}

fn present<T>(read: Result<T, RunError>) -> Result<Option<T>, RunError> {
    match read {
        Err(RunError::Missing { .. }) => Ok(None),
        read => read.map(Some),
    }
}

/// The manifest: the run's own copy or, without one, the dataset's, if it is still where it was.
fn dataset(
    folder: &RunFolder,
    info: &RunInfo,
    label: &str,
    notes: &mut Vec<String>,
) -> Result<Option<Manifest>, RunError> {
    if let Some(manifest) = present(folder.read_dataset())? {
        return Ok(Some(manifest));
    }
    let elsewhere =
        fs::read(info.dataset.join("dataset.json")).ok().and_then(|text| serde_json::from_slice(&text).ok());
    if elsewhere.is_none() {
        notes.push(format!(
            "{label}: neither the run nor '{}' holds dataset.json, so that cameras and RGB frame times are unknown.",
            info.dataset.display()
        ));
    }
    Ok(elsewhere)
}

/// Folder names; where they repeat, the whole paths.
fn labels(folders: &[RunFolder]) -> Vec<String> {
    let names: Vec<String> = folders.iter().map(RunFolder::name).collect();
    let unique = |name: &String| names.iter().filter(|other| *other == name).count() == 1;
    let label = |(at, name): (usize, &String)| {
        if unique(name) {
            return name.clone();
        }
        let path = folders[at].root().display().to_string();
        let repeats = folders[..at].iter().filter(|other| other.root() == folders[at].root()).count();
        if repeats == 0 { path } else { format!("{path} ({})", repeats + 1) }
    };
    names.iter().enumerate().map(label).collect()
}

/// Notes what makes runs hard to compare.
fn compare(scene: &mut Scene) {
    let [first, others @ ..] = scene.runs.as_slice() else { return };
    let mut notes = Vec::new();
    for other in others {
        if let (Some(a), Some(b)) = (&first.metrics, &other.metrics) {
            if a.dpsnr_mask != b.dpsnr_mask {
                notes.push(format!(
                    "DPSNR of {} uses {} masks and that of {} uses {} masks: they are different quantities.",
                    first.label, a.dpsnr_mask, other.label, b.dpsnr_mask
                ));
            }
            if let (Some(one), Some(two)) = (a.lpips_kind, b.lpips_kind)
                && one != two
            {
                notes.push(format!(
                    "LPIPS of {} is that of {one} and LPIPS of {} that of {two}: they are different quantities.",
                    first.label, other.label
                ));
            }
        }
        let views = |run: &Run| run.views.iter().map(|view| (view.camera.clone(), view.index)).collect::<BTreeSet<_>>();
        if !first.views.is_empty() && !other.views.is_empty() && views(first) != views(other) {
            notes.push(format!(
                "{} and {} were evaluated on different frames; side by side stand those that they share.",
                first.label, other.label
            ));
        }
    }
    scene.notes.extend(notes);
}

/// The dataset's name or, without one, the last component of its folder.
fn dataset_name(info: &RunInfo) -> String {
    if !info.dataset_name.is_empty() {
        return info.dataset_name.clone();
    }
    info.dataset.file_name().map_or_else(|| "unnamed".into(), |name| name.to_string_lossy().into_owned())
}
