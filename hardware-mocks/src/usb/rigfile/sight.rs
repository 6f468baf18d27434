//! What a device of a rig file looks at: a pattern, the stage, a recorded file, or a camera of a dataset.

use std::{path::Path, sync::Arc};

use erfgs_dataset::{Camera, Dataset};
use erfgs_events::{Columns, Event, Events};
use erfgs_session::container::Recording;

use super::{DeviceFile, Kind, RigError};
use crate::usb::{
    U3vFaults,
    scene::{EventScene, FrameScene, Pattern, PatternFrames, Picture, TakeEvents, TakeFrames},
};
use erfgs_stage::{EventOptions, RigCamera, RigOptions, Stage, StageError, StageOptions, StageView};

/// Columns and rows.
type Size = [u16; 2];

impl DeviceFile {
    /// Looks whether the fields go together.
    pub(super) fn check(&self) -> Result<(), RigError> {
        let wrong = |what: &str| Err(RigError::Field { name: self.name.clone(), what: what.to_owned() });
        let sights = [self.stage, self.raw.is_some(), self.events.is_some(), self.dataset.is_some()];
        if sights.into_iter().filter(|&there| there).count() > 1 {
            return wrong("it looks at one thing: keep one of stage, raw, events and dataset");
        }
        if self.dataset.is_some() != self.camera.is_some() {
            return wrong("dataset and camera go together: name the folder and the camera in it");
        }
        let frames = !self.formats.is_empty() || !self.sizes.is_empty() || !self.rates_hz.is_empty() || self.triggered;
        match self.kind {
            Kind::Davis346 | Kind::Uvc | Kind::U3v if self.raw.is_some() => {
                wrong("raw is sent word for word by an evk4; an events file is played by a davis346, too")
            }
            Kind::Uvc | Kind::U3v if self.events.is_some() => wrong("events are for event cameras; leave them out"),
            Kind::Uvc | Kind::U3v if self.sync.is_some() || self.latency_ms != 0 || self.queue_mib.is_some() => {
                wrong("sync, latency_ms and queue_mib are for event cameras; leave them out")
            }
            Kind::Evk4 | Kind::Davis346 if frames => {
                wrong("formats, sizes, rates_hz and triggered are for a frame camera; leave them out")
            }
            Kind::U3v if !self.formats.is_empty() || !self.rates_hz.is_empty() => {
                wrong("a u3v has all its formats and rates; leave formats and rates_hz out")
            }
            Kind::Evk4 | Kind::Davis346 | Kind::Uvc if self.blocks != U3vFaults::default() => {
                wrong("blocks are of a u3v; leave them out")
            }
            Kind::Evk4 | Kind::Uvc | Kind::U3v if self.slave => wrong("slave is for a davis346; leave it out"),
            _ => Ok(()),
        }
    }

    /// The events of an event camera, `number` in the rig.
    pub(super) fn event_scene(&self, number: usize, size: Size) -> Result<Box<dyn EventScene>, RigError> {
        if self.stage {
            let camera = stage_camera(RigOptions { rgb: 0, event: number + 1, ..rig(size) }, number)?;
            let stage = stage();
            let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera)?;
            return Ok(Box::new(TakeEvents::record(&view, 500_000, &EventOptions::default(), number as u64)?));
        }
        if let Some(path) = &self.events {
            let events = read_events(path, size)?;
            let first = events.t_us.first().copied().unwrap_or(0);
            let last = events.t_us.last().copied().unwrap_or(0);
            return play(events, [first, last], path, size);
        }
        if let Some((path, name)) = self.recorded() {
            let dataset = Dataset::load(path)?;
            let camera = camera(&dataset, name)?;
            let Some(events) = dataset.read_events(camera)? else {
                return Err(unsuited(path, format!("its camera {name} has no events")));
            };
            let first = dataset.manifest.span_ns[0] / 1000;
            return play(events, [first, first + lap_ns(&dataset) / 1000 - 1], path, size);
        }
        Ok(Box::new(Pattern::new(size[0], size[1], self.rate_hz)))
    }

    /// The frames of a camera, `number` in the rig.
    pub(super) fn frame_scene(&self, number: usize, size: Size) -> Result<Box<dyn FrameScene>, RigError> {
        if self.stage {
            let camera = stage_camera(RigOptions { rgb: number + 1, event: 0, ..rig(size) }, number)?;
            let stage = stage();
            let view = StageView::new(&stage, &camera.intrinsics, &camera.world_to_camera)?;
            return Ok(Box::new(TakeFrames::film(&view, 15, 33_333_333, 5_000_000)));
        }
        // A DAVIS346 plays the events of a dataset, which come without its frames.
        let Some((path, name)) = self.recorded().filter(|_| self.kind != Kind::Davis346) else {
            return Ok(Box::new(PatternFrames::new()));
        };
        let dataset = Dataset::load(path)?;
        let camera = camera(&dataset, name)?;
        let picture = |frame| -> Result<Arc<Picture>, RigError> {
            let image = dataset.read_image(camera, frame)?;
            Ok(Arc::new(Picture { width: image.width, height: image.height, rgb: image.data }))
        };
        let pictures: Vec<_> = camera.frames.iter().map(picture).collect::<Result<_, _>>()?;
        if pictures.is_empty() {
            return Err(unsuited(path, format!("its camera {name} has no frames")));
        }
        let period_ns = lap_ns(&dataset) / pictures.len() as i64;
        Ok(Box::new(TakeFrames::new(pictures, period_ns)))
    }

    /// The dataset and the name of the camera in it that are played.
    fn recorded(&self) -> Option<(&Path, &str)> {
        Some((self.dataset.as_deref()?, self.camera.as_deref()?))
    }
}

fn rig([width, height]: Size) -> RigOptions {
    RigOptions { width: width.into(), height: height.into(), test: 0, ..RigOptions::default() }
}

fn stage() -> Stage {
    Stage::new(StageOptions { samples_per_axis: 1, ..StageOptions::default() })
}

fn stage_camera(options: RigOptions, number: usize) -> Result<RigCamera, StageError> {
    Ok(options.cameras(1)?.swap_remove(number))
}

fn unsuited(path: &Path, what: String) -> RigError {
    RigError::Unsuited { path: path.to_owned(), what }
}

fn camera<'a>(dataset: &'a Dataset, name: &str) -> Result<&'a Camera, RigError> {
    dataset.camera(name).ok_or_else(|| {
        let names: Vec<_> = dataset.manifest.cameras.iter().map(|camera| camera.name.as_str()).collect();
        unsuited(&dataset.root, format!("it has no camera {name}; there are {}", names.join(", ")))
    })
}

/// How long a dataset is until it begins again: its span, and from its last frame to the next.
fn lap_ns(dataset: &Dataset) -> i64 {
    let [first, last] = dataset.manifest.span_ns;
    let frames = dataset.manifest.cameras.iter().map(|camera| camera.frames.len()).max().unwrap_or(0);
    let span = last.saturating_sub(first).max(1000);
    span + if frames > 1 { span / (frames as i64 - 1) } else { 0 }
}

/// Any event file, in order of time.
fn read_events(path: &Path, [width, height]: Size) -> Result<Events, RigError> {
    let mut columns = Columns::default();
    Recording::open(path, None)
        .and_then(|mut recording| recording.decode_events(0, &mut columns, |_| {}))
        .map_err(|error| unsuited(path, error.to_string()))?;
    let mut events = Events::new(width.into(), height.into());
    let mut order: Vec<usize> = (0..columns.len()).collect();
    order.sort_by_key(|&index| columns.t_us[index]);
    for index in order {
        let t_us = columns.t_us[index].try_into().unwrap_or(i64::MAX);
        events.push(Event { t_us, x: columns.x[index], y: columns.y[index], on: columns.on[index] });
    }
    Ok(events)
}

/// Plays events of a span of time, microseconds, again and again.
fn play(mut events: Events, [first, last]: [i64; 2], path: &Path, size: Size) -> Result<Box<dyn EventScene>, RigError> {
    if events.is_empty() {
        return Err(unsuited(path, "it has no events".into()));
    }
    if let Some(event) = events.iter().find(|event| event.x >= size[0] || event.y >= size[1]) {
        let (Event { x, y, .. }, [width, height]) = (event, size);
        return Err(unsuited(path, format!("an event at ({x}, {y}) is outside of the {width} x {height} pixels")));
    }
    events.t_us.iter_mut().for_each(|t| *t -= first);
    let length = (last - first).max(0).unsigned_abs() + 1;
    Ok(Box::new(TakeEvents::new(Arc::new(events), length)))
}
