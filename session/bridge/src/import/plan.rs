//! What a session is made of: a file in TOML that a person writes or completes.

use std::path::{Path, PathBuf};

use erfgs_base::{
    FileError,
    plausible::{EXPOSURE, INSTANT, Quantity, RATE},
};
use serde::Deserialize;

use super::PlanError;

/// The files of a session, and how their times belong together.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Event cameras.
    #[serde(default)]
    pub events: Vec<Events>,
    /// Frame cameras.
    #[serde(default)]
    pub frames: Vec<Frames>,
    /// Where paths begin: the folder of the plan.
    #[serde(skip)]
    pub folder: PathBuf,
}

/// An event camera.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Events {
    /// The name of its stream.
    pub id: String,
    /// Its file.
    pub file: PathBuf,
    /// Columns and rows of its sensor, where the file does not say.
    pub size: Option<[u16; 2]>,
    /// What the columns of a text are, as `--columns` takes it.
    pub columns: Option<String>,
    /// When the first item of the file was, seconds of session time.
    pub starts_s: Option<f64>,
    /// An event camera above whose clock it counts on: the times in both files have one zero.
    pub clock_of: Option<String>,
    /// An event camera above that saw the same pulses at its trigger input: the first pulse of both files is one.
    pub pulses_of: Option<String>,
}

/// A frame camera.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frames {
    /// The name of its stream.
    pub id: String,
    /// A folder of pictures.
    pub folder: Option<PathBuf>,
    /// A video.
    pub video: Option<PathBuf>,
    /// Frames a second, from `starts_s` on.
    pub fps: Option<f64>,
    /// When the first frame was, seconds of session time; 0 without it.
    pub starts_s: Option<f64>,
    /// A text with the time of each frame.
    pub times: Option<PathBuf>,
    /// Which column of that text has the times, by its name, which ends in `_s`, `_ms`, `_us` or `_ns`.
    pub column: Option<String>,
    /// What of an exposure `fps` and `times` mark.
    pub marks: Option<Mark>,
    /// The event camera at whose trigger input each frame has a pulse.
    pub pulses_of: Option<String>,
    /// Which of its pulses is that of the first frame, from 0; needed where there are more pulses than frames.
    pub first_pulse: Option<usize>,
    /// Which edge of the pulse begins the exposure.
    pub edge: Option<Begin>,
    /// How long each frame was exposed, microseconds. Without it, as long as its pulse.
    pub exposure_us: Option<f64>,
}

/// A moment of an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mark {
    /// Its start.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// An edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Begin {
    /// From low to high.
    Rising,
    /// From high to low.
    Falling,
}

impl Plan {
    /// Reads a plan.
    ///
    /// # Errors
    /// If it cannot be read, or something in it is not understood or contradicts something else.
    pub fn load(path: &Path) -> Result<Self, PlanError> {
        let text = std::fs::read_to_string(path).map_err(FileError::when("read", path))?;
        let wrong = |what: String| PlanError::Plan { path: path.to_owned(), what };
        let mut plan: Self = toml::from_str(&text).map_err(|error| wrong(error.to_string().trim_end().to_owned()))?;
        plan.folder = path.parent().unwrap_or(Path::new("")).to_owned();
        plan.check().map_err(wrong)?;
        Ok(plan)
    }

    fn check(&self) -> Result<(), String> {
        if self.events.is_empty() && self.frames.is_empty() {
            return Err("it has neither [[events]] nor [[frames]]".into());
        }
        for (at, events) in self.events.iter().enumerate() {
            events.check(&self.events[..at]).map_err(|what| format!("[[events]] {}: {what}", events.id))?;
        }
        for frames in &self.frames {
            frames.check(&self.events).map_err(|what| format!("[[frames]] {}: {what}", frames.id))?;
        }
        Ok(())
    }
}

/// Says of exactly one of some fields that it is there.
fn one_of(fields: &[(&str, bool)]) -> Result<(), String> {
    let given: Vec<&str> = fields.iter().filter(|(_, is_there)| *is_there).map(|(name, _)| *name).collect();
    let names: Vec<&str> = fields.iter().map(|(name, _)| *name).collect();
    match given[..] {
        [_] => Ok(()),
        [] => Err(format!("give one of {}", names.join(", "))),
        _ => Err(format!("give one of {}, not several", given.join(", "))),
    }
}

fn event_camera(name: &str, events: &[Events], which: &str) -> Result<(), String> {
    if events.iter().any(|events| events.id == name) {
        return Ok(());
    }
    let known: Vec<&str> = events.iter().map(|events| events.id.as_str()).collect();
    Err(format!("'{name}' is no [[events]] {which}; there are: {}", known.join(", ")))
}

/// Whether a number of the plan can be what it is for; `unit` of them are one of the quantity's own.
fn can_be(name: &str, value: Option<f64>, quantity: Quantity, unit: f64) -> Result<(), String> {
    value.map_or(Ok(()), |value| quantity.check(value / unit).map(drop)).map_err(|wrong| format!("{name}: {wrong}"))
}

impl Events {
    fn check(&self, above: &[Self]) -> Result<(), String> {
        can_be("starts_s", self.starts_s, INSTANT, 1.0)?;
        let fields = [
            ("starts_s", self.starts_s.is_some()),
            ("clock_of", self.clock_of.is_some()),
            ("pulses_of", self.pulses_of.is_some()),
        ];
        if !above.is_empty() || fields.iter().any(|(_, is_there)| *is_there) {
            one_of(&fields).map_err(|what| format!("{what}: how its times belong to those of the streams above"))?;
        }
        let others = [&self.clock_of, &self.pulses_of];
        others.into_iter().flatten().try_for_each(|name| event_camera(name, above, "above it"))
    }
}

impl Frames {
    fn check(&self, events: &[Events]) -> Result<(), String> {
        one_of(&[("folder", self.folder.is_some()), ("video", self.video.is_some())])?;
        can_be("starts_s", self.starts_s, INSTANT, 1.0)?;
        can_be("fps", self.fps, RATE, 1.0)?;
        can_be("exposure_us", self.exposure_us, EXPOSURE, 1e6)?;
        let how =
            [("fps", self.fps.is_some()), ("times", self.times.is_some()), ("pulses_of", self.pulses_of.is_some())];
        one_of(&how).map_err(|what| format!("{what}: when its frames were taken"))?;
        let only = |name: &str, is_there: bool, with: &str, holds: bool| match is_there && !holds {
            true => Err(format!("{name} is about {with}, which is not there")),
            false => Ok(()),
        };
        only("starts_s", self.starts_s.is_some(), "fps", self.fps.is_some())?;
        only("column", self.column.is_some(), "times", self.times.is_some())?;
        only("first_pulse", self.first_pulse.is_some(), "pulses_of", self.pulses_of.is_some())?;
        only("edge", self.edge.is_some(), "pulses_of", self.pulses_of.is_some())?;
        only("marks", self.marks.is_some(), "fps or times", self.pulses_of.is_none())?;
        if self.exposure_us == Some(0.0) {
            return Err("exposure_us is 0; leave it out where it is not known".into());
        }
        if self.exposure_us.is_some() && self.pulses_of.is_none() && self.marks.is_none() {
            return Err("say with marks = \"start\", \"middle\" or \"end\" what of an exposure the times mark".into());
        }
        if self.edge == Some(Begin::Falling) && self.exposure_us.is_none() {
            return Err("edge = \"falling\" needs exposure_us: a pulse is as long as it is high".into());
        }
        self.pulses_of.iter().try_for_each(|name| event_camera(name, events, "of the plan"))
    }
}
