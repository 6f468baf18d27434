//! What a variant consists of, before any file is touched.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
    path::{Path, PathBuf},
};

use erfgs_base::random;
use erfgs_dataset::{Camera, Frame, Manifest, Split, VariantStep, layout};
use erfgs_scene::Modality;
use serde_json::{Value, json};

use super::{BlurOptions, Edge, EventOnly, Label, VariantError, VariantOptions, Window};

const EVENT_ONLY: u64 = random::purpose("variant event-only cameras");

/// How one file of the variant comes to be.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Job {
    /// The same bytes as a file of the source.
    Link(PathBuf),
    /// The mean of some frames of a camera of the source.
    Blur { camera: usize, frames: Range<usize> },
    /// What moves in any of some frames of a camera of the source.
    Mask { camera: usize, frames: Range<usize> },
    /// The events of a camera of the source.
    Simulate { camera: usize },
}

/// What is to be made.
pub(super) struct Plan {
    /// The cameras of the variant, in the source's order. Those whose events are to be simulated have none yet.
    pub(super) cameras: Vec<Camera>,
    /// The files of the variant, relative to its folder.
    pub(super) jobs: BTreeMap<PathBuf, Job>,
    /// The steps that are added to the manifest.
    pub(super) steps: Vec<VariantStep>,
    /// Whether the source's points are kept.
    pub(super) points: bool,
    pub(super) name: String,
}

impl Plan {
    pub(super) fn new(source: &Manifest, options: &VariantOptions) -> Result<Self, VariantError> {
        let one = |option, value: u32| match value {
            0 => Err(VariantError::Option { option, value: "0".into(), remedy: "choose 1 or more" }),
            _ => Ok(()),
        };
        one("the subsampling", options.subsample)?;
        one("the number of averaged frames", options.blur.frames)?;
        let event_only = choose(source, options)?;
        let mut plan =
            Self { cameras: Vec::new(), jobs: BTreeMap::new(), steps: Vec::new(), points: true, name: String::new() };
        let (mut simulated, mut blinded) = (Vec::new(), Vec::new());
        for (index, camera) in source.cameras.iter().enumerate() {
            let blind = event_only.contains(&index);
            let mut made = camera.clone();
            if blind {
                made.frames.clear();
                blinded.push(camera.name.as_str());
            } else if camera.split == Split::Train && camera.modality.has_frames() {
                made.frames = plan.frames(index, camera, options)?;
            } else {
                plan.carry(&camera.frames)?;
            }
            let wanted = blind || (options.keep_rgb_events && camera.split == Split::Train);
            if let Some(events) = &camera.events {
                plan.add(&events.file, Job::Link(events.file.clone()))?;
            } else if wanted {
                plan.add(&layout::events(&camera.name), Job::Simulate { camera: index })?;
                simulated.push(camera.name.as_str());
            }
            made.modality = match (made.frames.is_empty(), camera.events.is_some() || wanted) {
                (true, _) => Modality::Event,
                (false, true) => Modality::Both,
                (false, false) => Modality::Rgb,
            };
            plan.cameras.push(made);
        }
        plan.finish(source, options, &simulated, &blinded)?;
        Ok(plan)
    }

    /// The kept frames of a training camera.
    fn frames(&mut self, index: usize, camera: &Camera, options: &VariantOptions) -> Result<Vec<Frame>, VariantError> {
        let mut kept = Vec::new();
        for at in (0..camera.frames.len()).step_by(options.subsample as usize) {
            if options.blur.frames == 1 {
                kept.push(camera.frames[at].clone());
            } else if let Some(window) = window(at, camera.frames.len(), &options.blur) {
                kept.push(self.blurred(index, camera, at, window, options.blur.label)?);
            }
        }
        if options.blur.frames == 1 {
            self.carry(&kept)?;
        }
        if kept.is_empty() {
            return Err(VariantError::NoFrames { camera: camera.name.clone(), frames: camera.frames.len() });
        }
        Ok(kept)
    }

    fn blurred(
        &mut self,
        index: usize,
        camera: &Camera,
        at: usize,
        frames: Range<usize>,
        label: Label,
    ) -> Result<Frame, VariantError> {
        let (first, last) = (&camera.frames[frames.start], &camera.frames[frames.end - 1]);
        let exposure_ns = [first.exposure_ns[0], last.exposure_ns[1].max(first.exposure_ns[1])];
        let t_ns = match label {
            Label::Frame => camera.frames[at].t_ns,
            Label::Mid => exposure_ns[0] + (exposure_ns[1] - exposure_ns[0]) / 2,
        };
        let file = camera.frames[at].file.with_extension("png");
        let mask = camera.frames[frames.clone()].iter().any(|frame| frame.mask.is_some());
        let mask = mask.then(|| Path::new("masks").join(&camera.name).join(file.file_name().unwrap_or_default()));
        self.add(&file, Job::Blur { camera: index, frames: frames.clone() })?;
        if let Some(mask) = &mask {
            self.add(mask, Job::Mask { camera: index, frames })?;
        }
        Ok(Frame { file, t_ns, exposure_ns, mask })
    }

    /// Files of frames that do not change.
    fn carry(&mut self, frames: &[Frame]) -> Result<(), VariantError> {
        for file in frames.iter().flat_map(|frame| std::iter::once(&frame.file).chain(&frame.mask)) {
            self.add(file, Job::Link(file.clone()))?;
        }
        Ok(())
    }

    fn add(&mut self, file: &Path, job: Job) -> Result<(), VariantError> {
        match self.jobs.get(file) {
            Some(other) if *other != job => Err(VariantError::SameFile { file: file.to_owned() }),
            _ => {
                self.jobs.insert(file.to_owned(), job);
                Ok(())
            }
        }
    }

    fn finish(
        &mut self,
        source: &Manifest,
        options: &VariantOptions,
        simulated: &[&str],
        blinded: &[&str],
    ) -> Result<(), VariantError> {
        let blur = &options.blur;
        let step = |step: &str, parameters: Value| {
            let parameters = parameters.as_object().cloned().unwrap_or_default().into_iter().collect();
            VariantStep { step: step.to_owned(), parameters }
        };
        if !simulated.is_empty() {
            let config = super::seeded(options);
            let parameters = json!({ "cameras": simulated, "simulator": config, "frames": "all of the source" });
            self.steps.push(step("simulate", parameters));
        }
        if options.subsample > 1 {
            self.steps.push(VariantStep::subsample(options.subsample));
        }
        if blur.frames > 1 {
            let parameters = json!({
                "frames": blur.frames, "window": blur.window, "edge": blur.edge, "rounding": blur.rounding,
                "linear_light": blur.linear_light, "label": blur.label,
            });
            self.steps.push(step(VariantStep::BLUR, parameters));
        }
        if !blinded.is_empty() {
            let parameters = json!({ "cameras": blinded, "asked_for": options.event_only, "seed": options.seed });
            self.steps.push(step("event_only", parameters));
        }
        let changed = options.subsample > 1 || blur.frames > 1 || !blinded.is_empty();
        self.points = source.points.is_some() && (options.keep_points || !changed);
        if source.points.is_some() && changed {
            self.steps.push(step("points", json!({ "kept": options.keep_points })));
        }
        if let (true, Some(points)) = (self.points, &source.points) {
            self.add(&points.file, Job::Link(points.file.clone()))?;
            if let Some(bodies) = &source.bodies {
                self.add(&bodies.file, Job::Link(bodies.file.clone()))?;
            }
        }
        let suffix = match (blinded.is_empty(), blur.frames > 1, options.subsample > 1) {
            (false, _, _) => "-dv",
            (true, true, _) => "-mb",
            (true, false, true) => "-ts",
            (true, false, false) => "",
        };
        self.name = options.name.clone().unwrap_or_else(|| format!("{}{suffix}", source.name));
        Ok(())
    }
}

/// The frames that are averaged for frame `at` of `count`; none where the frame is to be left out.
fn window(at: usize, count: usize, blur: &BlurOptions) -> Option<Range<usize>> {
    let frames = blur.frames as usize;
    let before = match blur.window {
        Window::Forward => 0,
        Window::Centred => (frames - 1) / 2,
    };
    let complete = at >= before && at - before + frames <= count;
    match blur.edge {
        Edge::Drop if !complete => None,
        _ => Some(at.saturating_sub(before)..count.min(at + frames - before)),
    }
}

/// The indices of the cameras that lose their frames.
fn choose(source: &Manifest, options: &VariantOptions) -> Result<BTreeSet<usize>, VariantError> {
    let candidate = |camera: &Camera| camera.split == Split::Train && camera.modality.has_frames();
    let candidates: Vec<usize> = (0..source.cameras.len()).filter(|&at| candidate(&source.cameras[at])).collect();
    let chosen: BTreeSet<usize> = match &options.event_only {
        EventOnly::None => BTreeSet::new(),
        EventOnly::Count(count) => {
            let key = random::key(options.seed, &[EVENT_ONLY]);
            let order = random::permutation(key, candidates.len());
            order.into_iter().take(*count as usize).map(|at| candidates[at]).collect()
        }
        EventOnly::Names(names) => {
            let find = |name: &String| {
                let refuse = |why| VariantError::NotACandidate {
                    camera: name.clone(),
                    why,
                    candidates: candidates
                        .iter()
                        .map(|&at| source.cameras[at].name.as_str())
                        .collect::<Vec<_>>()
                        .join(", "),
                };
                match source.cameras.iter().position(|camera| camera.name == *name) {
                    None => Err(refuse("the dataset has no such camera")),
                    Some(at) if source.cameras[at].split == Split::Test => Err(refuse("it is a test camera")),
                    Some(at) if !candidates.contains(&at) => Err(refuse("it has no frames to lose")),
                    Some(at) => Ok(at),
                }
            };
            names.iter().map(find).collect::<Result<_, _>>()?
        }
    };
    let too_many = match options.event_only {
        EventOnly::Count(count) => count as usize >= candidates.len() && count > 0,
        _ => !chosen.is_empty() && chosen.len() >= candidates.len(),
    };
    if too_many {
        let value = match options.event_only {
            EventOnly::Count(count) => count as usize,
            _ => chosen.len(),
        };
        let value = format!("{value} of {} training cameras with frames", candidates.len());
        let remedy = "leave at least one camera its frames";
        return Err(VariantError::Option { option: "the number of event-only cameras", value, remedy });
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_run_forward_or_both_ways_and_stop_at_the_ends() {
        let blur = |frames, window, edge| BlurOptions { frames, window, edge, ..BlurOptions::default() };
        let forward = blur(3, Window::Forward, Edge::Drop);
        assert_eq!(window(40, 45, &forward), Some(40..43));
        assert_eq!(window(42, 45, &forward), Some(42..45));
        assert_eq!(window(43, 45, &forward), None);
        assert_eq!(window(44, 45, &blur(3, Window::Forward, Edge::Shorten)), Some(44..45));
        let centred = blur(3, Window::Centred, Edge::Drop);
        assert_eq!(window(0, 45, &centred), None);
        assert_eq!(window(1, 45, &centred), Some(0..3));
        assert_eq!(window(0, 45, &blur(3, Window::Centred, Edge::Shorten)), Some(0..2));
        assert_eq!(window(4, 45, &blur(4, Window::Centred, Edge::Drop)), Some(3..7));
        assert_eq!(window(0, 2, &blur(5, Window::Forward, Edge::Shorten)), Some(0..2));
    }
}
