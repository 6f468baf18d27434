//! A recorded session and a calibrated rig, made into a dataset: frames with the times of their exposures, events on the
//! session's clock, each camera where the calibration put it.
//!
//! [`import_recording`] brings a session, its synchronisation and a rig file together by the names of streams and cameras
//! (`join.rs`). [`import`] is told of each stream what camera it is ([`Viewpoint`]) and how its times are told ([`Timing`]).

use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

use serde_json::json;

use super::{ImportError, common};
use crate::{Camera, CameraEvents, Dataset, DatasetError, Frame, Manifest, PoseSigma, Provenance, Split, layout};
use erfgs_base::{names::FileNames, progress::Progress};
use erfgs_events::npz;
use erfgs_scene::{Intrinsics, Modality, Pose, image::Resample};
use erfgs_session::{
    clock::{Epochs, Exposure},
    container::Session,
    source::Incident,
};

mod events;
mod exposures;
mod frames;
mod join;
mod notes;
mod times;

pub use join::{import_recording, window_ns};
pub use notes::SessionNote;

use events::Gathered;
use exposures::Overlaps;
use frames::Planned;

/// A camera of the rig and the stream that it recorded.
#[derive(Clone, Debug)]
pub struct Viewpoint {
    /// The stream.
    pub stream: String,
    /// The camera's name in the dataset: that of its files, as [`FileNames`] gives it.
    pub camera: String,
    /// Intrinsics of what it recorded.
    pub intrinsics: Intrinsics,
    /// Where it stood, world to camera.
    pub pose: Pose,
    /// How sure that is.
    pub pose_sigma: Option<PoseSigma>,
    /// How sure the times of its frames are as a whole, seconds.
    pub clock_sigma_s: Option<f64>,
    /// When it saw what it recorded.
    pub timing: Timing,
    /// Nominal contrast thresholds of ON and OFF events, natural logarithm of intensity.
    pub thresholds: [f64; 2],
}

/// From a stream's own times to the session's.
#[derive(Clone, Debug, Default)]
pub struct Timing {
    /// From the ticks of an event camera to session time; none of a camera that takes frames.
    pub epochs: Epochs,
    /// The exposure of each frame, session nanoseconds, by the number of its packet.
    pub frames: HashMap<u64, Exposure>,
    /// What to add to the camera's times, nanoseconds.
    pub offset_ns: i64,
}

/// What event cameras answer to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Response {
    /// The logarithm of light, as a photodiode's is; linear where its dark current outweighs the light.
    #[default]
    Light,
    /// The logarithm of display values, linear in the dark, as v2e's simulation has it: a session into which simulated events
    /// were played.
    Display,
}

impl Response {
    /// Below which level of 255 it is linear.
    fn lin_log_threshold(self) -> f64 {
        match self {
            Self::Light => 2.0,
            Self::Display => 20.0,
        }
    }
}

/// What of a session is imported.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionOptions {
    /// First and last instant, nanoseconds of session time; all of it where absent.
    pub window_ns: Option<[i64; 2]>,
    /// Import every n-th frame.
    pub every: usize,
    /// Size of the imported images, as a fraction of the camera's. With event cameras one half, one third and so on: so
    /// many pixels each way become one, whose contrast threshold is smaller by their number.
    pub scale: f64,
    /// Other sizes for cameras of these names: sensors of a rig may differ by far in their pixels.
    pub scales: BTreeMap<String, f64>,
    /// How images are resized.
    pub resample: Resample,
    /// Contrast thresholds of ON and OFF events, natural logarithm of intensity; what is usual for each camera's sensor where
    /// absent.
    pub thresholds: Option<[f64; 2]>,
    /// What event cameras answer to.
    pub response: Response,
    /// How many bits of samples of 16 count in frames of AEDAT 4; all where absent.
    pub bits: Option<u8>,
    /// Whether frames without colour are taken although other cameras see colours.
    pub grey: bool,
    /// Whether events of hot pixels are taken, too.
    pub hot_pixels: bool,
    /// Cameras that are left out.
    pub without: Vec<String>,
    /// Names of the test cameras; each eighth of four and more frame cameras where absent.
    pub test_cameras: Option<Vec<String>>,
    /// Threads to work with; one for each core where absent.
    pub jobs: Option<usize>,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self {
            window_ns: None,
            every: 1,
            scale: 1.0,
            scales: BTreeMap::new(),
            resample: Resample::Area,
            thresholds: None,
            response: Response::default(),
            bits: None,
            grey: false,
            hot_pixels: false,
            without: Vec::new(),
            test_cameras: None,
            jobs: None,
        }
    }
}

impl SessionOptions {
    /// The size of a camera's images, as a fraction of the camera's.
    pub(super) fn scale_of(&self, view: &Viewpoint) -> f64 {
        self.scales.get(&view.camera).copied().unwrap_or(self.scale)
    }

    /// How many pixels of an event camera become one, each way.
    fn merged(&self, view: &Viewpoint) -> u32 {
        (1.0 / self.scale_of(view)).round().max(1.0) as u32
    }
}

/// Makes the dataset `out` of what `views` recorded in `session`. `note` is told what is left out.
///
/// # Errors
/// If an option makes no sense, a stream is missing or has another size than its camera, nothing lies within the window, or
/// the session cannot be read or the dataset not be written.
pub fn import(
    session: &mut Session,
    views: &[Viewpoint],
    options: &SessionOptions,
    out: &Path,
    note: &mut dyn FnMut(SessionNote),
    progress: &mut dyn FnMut(Progress),
) -> Result<Dataset, ImportError> {
    check(options, views)?;
    let streams = streams(session, views)?;
    let building = DatasetError::new_folder(out)?;

    let window = options.window_ns.unwrap_or([i64::MIN, i64::MAX]);
    let descriptions: Vec<_> =
        streams.iter().map(|&stream| session.summary().streams[stream].description.clone()).collect();
    let colours = descriptions.iter().any(|d| d.encoding.is_frames() && !d.encoding.is_grey());
    let grey = options.grey || !colours;
    let mut plans: Vec<Planned> = Vec::new();
    for (view, (viewpoint, description)) in views.iter().zip(&descriptions).enumerate() {
        if !description.encoding.is_frames() {
            continue;
        }
        if description.encoding.is_grey() && !grey {
            note(SessionNote::NoColours { stream: viewpoint.stream.clone() });
            continue;
        }
        let planned = Planned::new(view, &viewpoint.timing, window, options.every.max(1));
        tell_overlaps(&viewpoint.stream, planned.overlaps, note);
        plans.push(planned);
    }
    let first_ns = plans.iter().filter_map(Planned::first_ns).min();
    let mut gathered: Vec<(usize, Gathered)> = Vec::new();
    let mut undated = Vec::new();
    for (view, (viewpoint, description)) in views.iter().zip(&descriptions).enumerate() {
        if !description.encoding.is_events() {
            continue;
        }
        let window = [first_ns.unwrap_or(window[0]).max(window[0]), window[1]];
        let found = events::gather(
            session,
            streams[view],
            viewpoint,
            window,
            events::Taking { merged: options.merged(viewpoint), hot_pixels: options.hot_pixels },
            (grey, options.bits),
            progress,
        )?;
        match found {
            Some(found) => {
                if let Some(pixel) = found.hot_pixels.first() {
                    let (stream, pixels) = (viewpoint.stream.clone(), found.hot_pixels.len() as u64);
                    let hottest = ([pixel.x, pixel.y], pixel.rate_hz.round() as u64);
                    note(SessionNote::HotPixels { stream, pixels, hottest });
                }
                gathered.push((view, found));
            }
            None => {
                undated.push(view);
                note(SessionNote::NoClock { stream: viewpoint.stream.clone() });
            }
        }
    }
    // Without frame cameras the first event or picture of an event camera is the beginning.
    let starts = gathered.iter().filter_map(|(_, found)| found.first_ns());
    let zero_ns = first_ns.or(starts.min()).ok_or_else(|| nothing(session, options))?;

    let mut written = frames::write(session, &streams, views, &plans, options, building.path(), progress)?;
    for (view, found) in &mut gathered {
        let mut pictures = std::mem::take(&mut found.pictures);
        if !pictures.is_empty() {
            tell_overlaps(&views[*view].stream, exposures::part_pictures(&mut pictures), note);
            let merged = options.merged(&views[*view]);
            written.push(frames::write_pictures(*view, &views[*view], pictures, merged, building.path())?);
        }
    }
    times::share(&mut written);
    for one in written.iter().filter(|one| one.lost > 0) {
        note(SessionNote::LostFrames { stream: views[one.view].stream.clone(), frames: one.lost });
    }
    for one in &written {
        let stream = &views[one.view].stream;
        for gap in frames::gaps(&one.frames, &written) {
            note(SessionNote::NoFrames {
                stream: stream.clone(),
                frames: gap.frames,
                between: gap.between,
                why: lost(session, stream),
            });
        }
    }
    let last_ns = written.iter().filter_map(|one| one.frames.last().map(|frame| frame.exposure_ns[1])).max();
    let last_ns = last_ns.or(gathered.iter().filter_map(|(_, found)| found.last_ns()).max()).unwrap_or(zero_ns);
    // A single instant has no length.
    let span_ns = [0, (last_ns - zero_ns).max(1_000_000)];

    let mut cameras = Vec::new();
    for (view, viewpoint) in views.iter().enumerate() {
        let own = written.iter_mut().find(|one| one.view == view);
        let mut frames = own.map(|one| std::mem::take(&mut one.frames)).unwrap_or_default();
        for frame in &mut frames {
            frame.t_ns -= zero_ns;
            frame.exposure_ns = frame.exposure_ns.map(|t_ns| t_ns - zero_ns);
        }
        let own = gathered.iter_mut().find(|(of, _)| *of == view).map(|(_, found)| found);
        let events = match own {
            Some(found) => {
                let (events, covers_ns) = found.finish(zero_ns, span_ns[1]);
                let lacks = [covers_ns[0], span_ns[1] - covers_ns[1]].into_iter().max().unwrap_or(0);
                if lacks > UNTOLD_NS {
                    note(SessionNote::EventsOfPart {
                        stream: viewpoint.stream.clone(),
                        part: [zero_ns + covers_ns[0], zero_ns + covers_ns[1]],
                        of: [zero_ns, zero_ns + span_ns[1]],
                        why: lost(session, &viewpoint.stream),
                    });
                }
                for what in std::mem::take(&mut found.damage) {
                    note(SessionNote::Damage { stream: viewpoint.stream.clone(), what });
                }
                let file = layout::events(&viewpoint.camera);
                let failed =
                    |source| ImportError::Events { camera: viewpoint.stream.clone(), source: Box::new(source) };
                npz::write_events(&building.path().join(&file), &events).map_err(failed)?;
                let merged = options.merged(viewpoint);
                let [threshold_on, threshold_off] =
                    viewpoint.thresholds.map(|threshold| threshold / f64::from(merged * merged));
                Some(CameraEvents {
                    file,
                    count: events.len() as u64,
                    threshold_on,
                    threshold_off,
                    lin_log_threshold: options.response.lin_log_threshold(),
                    linear_light: options.response == Response::Light,
                    covers_ns,
                    simulator: None,
                })
            }
            None => None,
        };
        let modality = match (frames.is_empty(), events.is_some()) {
            (false, true) => Modality::Both,
            (false, false) => Modality::Rgb,
            (true, true) => Modality::Event,
            (true, false) => {
                let left_out = descriptions[view].encoding.is_grey() && !grey;
                let lost = written.iter().any(|one| one.view == view && one.lost > 0);
                if !left_out && !lost && !undated.contains(&view) {
                    note(SessionNote::Nothing { stream: viewpoint.stream.clone() });
                }
                continue;
            }
        };
        let intrinsics = scaled(&viewpoint.intrinsics, options.scale_of(viewpoint));
        cameras.push(Camera {
            name: viewpoint.camera.clone(),
            modality,
            split: Split::Train,
            intrinsics,
            world_to_camera: viewpoint.pose,
            pose_sigma: viewpoint.pose_sigma,
            clock_sigma_s: viewpoint.clock_sigma_s,
            frames,
            events,
        });
    }
    split(&mut cameras, options)?;
    if cameras.is_empty() {
        return Err(nothing(session, options));
    }
    let mut manifest = manifest(session, cameras, [zero_ns, zero_ns + span_ns[1]], options);
    let hot = gathered.iter().filter(|(_, found)| !found.hot_pixels.is_empty()).map(|(view, found)| {
        let places: Vec<[u16; 2]> = found.hot_pixels.iter().map(|pixel| [pixel.x, pixel.y]).collect();
        (views[*view].camera.clone(), json!(places))
    });
    let hot: serde_json::Map<String, serde_json::Value> = hot.collect();
    if !hot.is_empty() {
        manifest.provenance.options.insert("without_hot_pixels".to_owned(), hot.into());
    }
    let dataset = Dataset::new(building.path(), manifest);
    Ok(dataset.complete(building, out)?)
}

fn tell_overlaps(stream: &str, overlaps: Option<Overlaps>, note: &mut dyn FnMut(SessionNote)) {
    let Some(Overlaps { frames, longest_ns, apart_ns }) = overlaps else { return };
    note(SessionNote::Overlaps { stream: stream.to_owned(), frames, longest_ns, apart_ns });
}

/// Events that lack no more than this at an end of a dataset are not worth words, nanoseconds.
const UNTOLD_NS: i64 = 20_000_000;

/// What the session says of the loss of a stream.
fn lost(session: &Session, stream: &str) -> Option<String> {
    session.summary().totals.incidents.iter().filter(|entry| entry.stream == stream).find_map(|entry| {
        match &entry.incident {
            Incident::Lost { reason } => Some(reason.clone()),
            _ => None,
        }
    })
}

/// Refuses what makes no sense.
fn check(options: &SessionOptions, views: &[Viewpoint]) -> Result<(), ImportError> {
    if let Some(scale) =
        std::iter::once(&options.scale).chain(options.scales.values()).find(|s| !(**s > 0.0 && **s <= 16.0))
    {
        return Err(ImportError::Options(format!("--scale {scale} makes no image; give a fraction such as 0.5")));
    }
    if let Some(name) = options.scales.keys().find(|name| views.iter().all(|view| view.camera != **name)) {
        let known: Vec<&str> = views.iter().map(|view| view.camera.as_str()).collect();
        return Err(ImportError::Options(format!(
            "--scale-of {name}: no camera of this name is imported; there are {}",
            known.join(", ")
        )));
    }
    if let Some([from, to]) = options.window_ns
        && from >= to
    {
        return Err(ImportError::Options(format!(
            "the window from {:.3} s to {:.3} s is empty; give a later end",
            from as f64 * 1e-9,
            to as f64 * 1e-9
        )));
    }
    let mut names = FileNames::default();
    if let Some(view) = views.iter().find(|view| names.give(&view.camera) != view.camera) {
        let (camera, stream) = (view.camera.escape_debug(), view.stream.escape_debug());
        let what = format!(
            "the camera of stream {stream} cannot be called '{camera}': its files could not be told from others"
        );
        return Err(ImportError::Options(what));
    }
    let events = views.iter().filter(|view| !view.timing.epochs.are_undated());
    for view in events {
        let k = &view.intrinsics;
        let scale = options.scale_of(view);
        let merged = (1.0 / scale).round().max(1.0);
        let whole = [k.width, k.height].iter().all(|side| side.is_multiple_of(merged as u32));
        if (scale * merged - 1.0).abs() > 1e-6 || !whole {
            return Err(ImportError::Options(format!(
                "camera {}: events of {} x {} pixels cannot be scaled by {scale}; take one half, one third and so on, of \
                 which both sides are multiples (--scale-of {} for this camera alone)",
                view.stream, k.width, k.height, view.camera
            )));
        }
    }
    Ok(())
}

/// The number of each view's stream.
fn streams(session: &Session, views: &[Viewpoint]) -> Result<Vec<usize>, ImportError> {
    let find = |view: &Viewpoint| {
        let (stream, recorded) = session.stream(&view.stream)?;
        let (d, k) = (&recorded.description, &view.intrinsics);
        if [d.width, d.height] != [k.width, k.height] {
            let what = format!(
                "it recorded {} x {} pixels, but the calibration is for {} x {}; calibrate it at the recorded size",
                d.width, d.height, k.width, k.height
            );
            return Err(ImportError::Camera { camera: view.stream.clone(), path: session.path().to_owned(), what });
        }
        Ok(stream)
    };
    views.iter().map(find).collect()
}

fn nothing(session: &Session, options: &SessionOptions) -> ImportError {
    let what = match options.window_ns {
        Some([from, to]) => format!(
            "no camera of the rig recorded anything between {:.3} and {:.3} s; choose another window (erfgs info tells how \
             long the session is)",
            from as f64 * 1e-9,
            to as f64 * 1e-9
        ),
        None => "no camera of the rig recorded data with known times; run erfgs sync on the session".to_owned(),
    };
    ImportError::Malformed { path: session.path().to_owned(), what }
}

fn scaled(intrinsics: &Intrinsics, scale: f64) -> Intrinsics {
    let [width, height] =
        [intrinsics.width, intrinsics.height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
    intrinsics.resized(width, height)
}

/// Test cameras as named, or each eighth of the cameras with frames where there are four and more.
fn split(cameras: &mut [Camera], options: &SessionOptions) -> Result<(), ImportError> {
    if let Some(tested) = &options.test_cameras {
        let names: Vec<&str> = cameras.iter().map(|camera| camera.name.as_str()).collect();
        let splits = common::splits(&names, tested)?;
        cameras.iter_mut().zip(splits).for_each(|(camera, split)| camera.split = split);
    } else if cameras.iter().filter(|camera| camera.modality.has_frames()).count() >= FEWEST_SPLIT {
        let with_frames = cameras.iter_mut().filter(|camera| camera.modality == Modality::Rgb);
        with_frames.step_by(8).for_each(|camera| camera.split = Split::Test);
    }
    Ok(())
}

/// With fewer frame cameras none can be spared for testing.
const FEWEST_SPLIT: usize = 4;

/// `window_ns`: what it spans of the session.
fn manifest(session: &Session, cameras: Vec<Camera>, window_ns: [i64; 2], options: &SessionOptions) -> Manifest {
    let name = session.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut given: BTreeMap<String, serde_json::Value> = BTreeMap::new();
    given.extend(options.window_ns.map(|window| ("window_s".to_owned(), json!(window.map(|t| t as f64 * 1e-9)))));
    given.insert("every".to_owned(), json!(options.every));
    given.insert("scale".to_owned(), json!(options.scale));
    given.extend((!options.scales.is_empty()).then(|| ("scales".to_owned(), json!(options.scales))));
    given.extend((options.response == Response::Display).then(|| ("response".to_owned(), json!("display"))));
    given.extend(options.test_cameras.as_ref().map(|names| ("test_cameras".to_owned(), json!(names))));
    Manifest {
        format: Manifest::FORMAT.to_owned(),
        version: Manifest::VERSION,
        name: name.clone(),
        provenance: Provenance {
            importer: "session".to_owned(),
            name,
            options: given,
            zero_ns: Some(window_ns[0]),
            erfgs: env!("CARGO_PKG_VERSION").to_owned(),
        },
        span_ns: [0, window_ns[1] - window_ns[0]],
        seed: 0,
        linear_exposure: true,
        variant: Vec::new(),
        points: None,
        bodies: None,
        cameras,
        sha256: BTreeMap::new(),
    }
}

/// Frames of a view, times still on the session's clock.
pub(super) struct Written {
    /// The view.
    pub view: usize,
    /// The frames that were written, in order of time.
    pub frames: Vec<Frame>,
    /// Planned ones that are damaged or not in the file.
    pub lost: usize,
}
