//! The draft of a plan, from what is in a folder.

use std::{
    fmt::Write as _,
    path::{Path, PathBuf},
};

use erfgs_base::{FileError, names::FileNames, order::natural};
use erfgs_events::EventFileHints;
use erfgs_scene::{
    image::{self, pictures},
    video::{FrameTimes, Video},
};
use erfgs_session::{
    container::{EventFileRecording, plain_id},
    source::Encoding,
};

use super::{PlanError, events::pulses_of};

/// Files of events.
const EVENTS: [&str; 12] = ["raw", "dat", "aedat", "aedat4", "es", "csv", "txt", "zip", "npz", "npy", "h5", "hdf5"];
/// Videos that cameras write.
const VIDEOS: [&str; 6] = ["mp4", "mkv", "avi", "mov", "webm", "m4v"];
/// Fewer pulses, or frames, are alike by chance.
const FEWEST: u64 = 8;

/// A plan that a person completes.
#[derive(Clone, Debug)]
pub struct Draft {
    /// In TOML.
    pub text: String,
    /// Event files in it.
    pub events: usize,
    /// Streams of frames in it.
    pub frames: usize,
    /// Files and folders that it leaves out, and why where that is known.
    pub left_out: Vec<String>,
}

struct EventFile {
    id: String,
    name: String,
    about: String,
    pulses: u64,
}

struct FrameFiles {
    id: String,
    name: String,
    is_video: bool,
    about: String,
    count: u64,
    rate: Option<f64>,
}

/// Looks at the files of a folder, and drafts the plan of a session of them.
///
/// # Errors
/// If the folder cannot be read.
pub fn draft(folder: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<Draft, PlanError> {
    let failed = |source| PlanError::Io(FileError::when("read", folder)(source));
    let mut entries: Vec<(String, PathBuf)> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if !name.starts_with('.') {
            entries.push((name, entry.path()));
        }
    }
    entries.sort_by(|(a, _), (b, _)| natural(a, b));
    let (mut events, mut frames, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    let mut ids = FileNames::default();
    for (at, (name, path)) in entries.iter().enumerate() {
        progress(at as u64, entries.len() as u64);
        let id = ids.give(&plain_id(&path.file_stem().unwrap_or_default().to_string_lossy()));
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if path.is_dir() {
            match of_folder(&id, name, path) {
                Ok(found) => frames.push(found),
                Err(why) => left_out.push(format!("{name}: {why}")),
            }
        } else if VIDEOS.contains(&extension.as_str()) {
            frames.push(of_video(&id, name, path));
        } else if EVENTS.contains(&extension.as_str()) {
            match of_events(&id, name, path) {
                Ok(found) => events.push(found),
                Err(why) => left_out.push(format!("{name}: {why}")),
            }
        } else {
            left_out.push(name.clone());
        }
    }
    let text = written(&events, &frames, &left_out);
    Ok(Draft { text, events: events.len(), frames: frames.len(), left_out })
}

fn of_events(id: &str, name: &str, path: &Path) -> Result<EventFile, String> {
    let recording = EventFileRecording::open(path, &EventFileHints::default()).map_err(|error| error.to_string())?;
    let stream = recording.summary().streams.first().ok_or("it holds no events")?;
    let description = &stream.description;
    let Encoding::Events(encoding) = description.encoding else { return Err("it holds no events".into()) };
    let pulses = pulses_of(&recording).map_err(|error| error.to_string())?.len();
    let seconds = recording.summary().span_ns().map_or(0, |[_, last]| last) as f64 * 1e-9;
    let (width, height) = (description.width, description.height);
    let about = format!("{encoding}, {width}x{height}, {seconds:.3} s, {pulses} pulses at its trigger input");
    Ok(EventFile { id: id.to_owned(), name: name.to_owned(), about, pulses: pulses as u64 })
}

fn of_folder(id: &str, name: &str, path: &Path) -> Result<FrameFiles, String> {
    let found = pictures(path).map_err(|error| error.to_string())?;
    let first = found.first().ok_or("there is no PNG or JPEG file in it")?;
    let [width, height] = image::size(first).map_err(|error| error.to_string())?;
    let count = found.len() as u64;
    let about = format!("{count} pictures, {width}x{height}");
    Ok(FrameFiles { id: id.to_owned(), name: name.to_owned(), is_video: false, about, count, rate: None })
}

fn of_video(id: &str, name: &str, path: &Path) -> FrameFiles {
    let count = Video::probe(path).map_or(0, |probe| probe.frames);
    let rate = FrameTimes::of(path).map(|times| times.rate());
    let about = match rate {
        Some(rate) => format!("{count} frames, shown at {rate:.3} a second"),
        None => format!("{count} frames"),
    };
    FrameFiles { id: id.to_owned(), name: name.to_owned(), is_video: true, about, count, rate }
}

/// A text of TOML.
fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

fn written(events: &[EventFile], frames: &[FrameFiles], left_out: &[String]) -> String {
    let mut text = String::from(
        "# What a session is made of. Paths begin at this file. Take the # from one of the lines that say when, and complete it.\n\
         # Then: erfgs import import.toml --out take.mcap\n",
    );
    for (at, file) in events.iter().enumerate() {
        let EventFile { id, name, about, pulses } = file;
        let _ = write!(text, "\n# {about}\n[[events]]\nid = {}\nfile = {}\n", quoted(id), quoted(name));
        let Some(first) = events[..at].first() else {
            text.push_str("starts_s = 0.0            # when its first event was\n");
            continue;
        };
        let alike = events[..at].iter().find(|other| other.pulses == *pulses && *pulses >= FEWEST);
        if let Some(other) = alike.or(events[..at].iter().find(|other| other.pulses > 0 && *pulses > 0)) {
            let mark = if alike.is_some() { "" } else { "# " };
            let _ = writeln!(
                text,
                "{mark}pulses_of = {}    # both saw the same pulses, from the first on",
                quoted(&other.id)
            );
        }
        let _ = write!(
            text,
            "# clock_of = {}    # both clocks began together: synchronised event cameras\n\
             # starts_s = 0.0    # when its first event was\n",
            quoted(&first.id),
        );
    }
    for FrameFiles { id, name, is_video, about, count, rate } in frames {
        let key = if *is_video { "video" } else { "folder" };
        let _ = write!(text, "\n# {about}\n[[frames]]\nid = {}\n{key} = {}\n", quoted(id), quoted(name));
        let alike = events.iter().find(|file| file.pulses == *count && *count >= FEWEST);
        if let Some(file) = alike.or(events.iter().find(|file| file.pulses > 0)) {
            let _ = writeln!(
                text,
                "{}pulses_of = {}    # a frame for each of its {} pulses",
                if alike.is_some() { "" } else { "# " },
                quoted(&file.id),
                file.pulses
            );
        }
        let _ = write!(
            text,
            "# times = \"times.csv\"    # below a line of names, one of them t_s, t_ms, t_us or t_ns\n\
             # fps = {:?}\n\
             # marks = \"start\"    # what of an exposure times and fps mark: start, middle or end\n\
             # exposure_us = 5000    # with pulses: from the edge on; without it, as long as each pulse\n",
            rate.unwrap_or(30.0)
        );
    }
    if !left_out.is_empty() {
        text.push_str("\n# Not used:\n");
        for what in left_out {
            let _ = writeln!(text, "# {}", what.replace(['\n', '\r'], " "));
        }
    }
    text
}
