//! Cameras through nokhwa: every system, with less known of each frame. Arrival is stamped by the host alone; lost
//! frames are not seen, and a camera that dies is not noticed before it is unplugged.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError, Sender},
    },
    thread,
    time::Duration,
};

use erfgs_scene::pixel::PixelFormat;
use erfgs_session::source::{Counters, Description, Incident, Outlet, Packet, Source, SourceError, names};
use nokhwa::{
    Camera,
    pixel_format::RgbFormat,
    utils::{ApiBackend, CameraFormat, CameraIndex, FrameFormat, RequestedFormat, RequestedFormatType, Resolution},
};
use serde_json::{Map, Value, json};

use super::{FoundCamera, FrameConfig, FrameError, Lock, check::is_cut, config::NamedLock};
use crate::{host_time::host_ns, not_applied::NotApplied};

/// How long `stop` waits for a frame under way; a dead camera never gives one.
const STOP_WAIT: Duration = Duration::from_secs(2);
const SYSTEM: &str = "nokhwa";

/// The cameras that nokhwa knows of. On Linux, nodes of metadata are among them: [`super::list`] is better there.
///
/// # Errors
/// If the system does not list them.
pub fn list() -> Result<Vec<FoundCamera>, FrameError> {
    let cameras = nokhwa::query(ApiBackend::Auto).map_err(|error| FrameError::List { reason: error.to_string() })?;
    Ok(cameras
        .into_iter()
        .map(|camera| FoundCamera {
            name: camera.human_name(),
            serial: String::new(),
            bus: camera.misc(),
            node: camera.index().as_string().into(),
            driver: SYSTEM.into(),
            formats: Vec::new(),
            link: None,
            problem: None,
        })
        .collect())
}

/// A camera of any system as a [`Source`] of frames.
pub struct PortableCamera {
    config: FrameConfig,
    description: Description,
    index: CameraIndex,
    state: Arc<State>,
    /// The thread says that it has ended by dropping its end.
    running: Option<Receiver<()>>,
}

#[derive(Default)]
struct State {
    stopping: AtomicBool,
    counters: Mutex<Counters>,
}

fn failed(config: &FrameConfig, doing: &'static str) -> impl FnOnce(nokhwa::NokhwaError) -> FrameError {
    let id = config.id.clone();
    move |error| FrameError::Portable { id, system: SYSTEM, doing, reason: error.to_string() }
}

/// The encodings that nokhwa has a name for. What its YUYV is on systems that send UYVY is not known, so that there is none.
const FORMATS: [(PixelFormat, FrameFormat); 6] = [
    (PixelFormat::Mjpeg, FrameFormat::MJPEG),
    (PixelFormat::Yuyv, FrameFormat::YUYV),
    (PixelFormat::Nv12, FrameFormat::NV12),
    (PixelFormat::Grey8, FrameFormat::GRAY),
    (PixelFormat::Rgb8, FrameFormat::RAWRGB),
    (PixelFormat::Bgr8, FrameFormat::RAWBGR),
];

fn frame_format(config: &FrameConfig) -> Result<FrameFormat, FrameError> {
    let found = FORMATS.iter().find(|(encoding, _)| *encoding == config.format);
    found.map(|(_, format)| *format).ok_or_else(|| FrameError::Config {
        id: config.id.clone(),
        problem: format!(
            "the portable backend has no {}; take backend \"precise\" (Linux), or one of {}",
            config.format,
            names(FORMATS.iter().map(|(encoding, _)| (*encoding).into()))
        ),
    })
}

impl PortableCamera {
    /// Opens the camera once, to see that it can do what is asked, and closes it.
    ///
    /// # Errors
    /// If there is no such camera, or it cannot.
    pub fn open(config: &FrameConfig) -> Result<Self, FrameError> {
        config.check()?;
        let locks = [config.exposure_us, config.gain, config.white_balance_k, config.focus];
        if locks.iter().any(|lock| matches!(lock, Lock::At(_))) {
            return Err(FrameError::Config {
                id: config.id.clone(),
                problem:
                    "the portable backend sets no exposure, gain, white balance or focus, since their units differ \
                          between systems: set them in the camera's own program, and leave them at \"hold\" here"
                        .into(),
            });
        }
        frame_format(config)?;
        let index = choose(config)?;
        let camera = prepare(config, &index)?;
        let description = Description {
            id: config.id.clone(),
            model: camera.info().human_name(),
            serial: String::new(),
            encoding: config.format.into(),
            width: config.width,
            height: config.height,
            start_order: 0,
            settings: described(config, &camera),
        };
        Ok(Self { config: config.clone(), description, index, state: Arc::default(), running: None })
    }
}

/// The camera that a configuration means: by place, name or index.
fn choose(config: &FrameConfig) -> Result<CameraIndex, FrameError> {
    let cameras = list()?;
    let wanted = config.camera.trim_start_matches("/dev/video");
    let means = |camera: &&FoundCamera| {
        wanted.is_empty()
            || [&camera.bus, &camera.name].into_iter().any(|text| *text == config.camera)
            || camera.node.as_os_str() == wanted
    };
    let found: Vec<_> = cameras.iter().filter(means).collect();
    let [camera] = found[..] else {
        let names = cameras.iter().map(|camera| format!("{} ({})", camera.name, camera.node.display()));
        let names = names.collect::<Vec<_>>().join("; ");
        let problem = match (found.is_empty(), config.camera.as_str()) {
            (true, "") => "none is plugged in".to_owned(),
            (false, "") => "several are plugged in; name one as `camera`".to_owned(),
            (true, wanted) => format!("none is {wanted:?}"),
            (false, wanted) => format!("several are {wanted:?}; name one by its place"),
        };
        let found = if names.is_empty() { "none".to_owned() } else { names };
        return Err(FrameError::Find { id: config.id.clone(), problem, found });
    };
    let text = camera.node.display().to_string();
    Ok(text.parse().map_or(CameraIndex::String(text), CameraIndex::Index))
}

fn prepare(config: &FrameConfig, index: &CameraIndex) -> Result<Camera, FrameError> {
    let format = frame_format(config)?;
    let wanted = CameraFormat::new(Resolution::new(config.width, config.height), format, config.rate_hz.round() as u32);
    let request = RequestedFormat::new::<RgbFormat>(RequestedFormatType::Closest(wanted));
    let mut camera = Camera::new(index.clone(), request).map_err(failed(config, "open it"))?;
    let got = camera.camera_format();
    if (got.format(), got.resolution()) != (format, wanted.resolution()) {
        let formats = camera.compatible_camera_formats().unwrap_or_default();
        return Err(FrameError::Format {
            id: config.id.clone(),
            node: index.as_string(),
            asked: wanted.to_string(),
            offered: got.to_string(),
            formats: formats.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
        });
    }
    Ok(camera)
}

/// What the camera says of itself, controls included.
fn described(config: &FrameConfig, camera: &Camera) -> Map<String, Value> {
    let controls = camera.camera_controls().unwrap_or_default();
    let controls = controls.iter().map(|control| (control.name().to_owned(), json!(control.value().to_string())));
    settings(config, camera.frame_rate(), controls.collect())
}

/// The settings of a camera that gives `rate_hz` frames a second, and what it did not take.
fn settings(config: &FrameConfig, rate_hz: u32, controls: Map<String, Value>) -> Map<String, Value> {
    let automatic =
        [config.exposure_us, config.gain, config.white_balance_k, config.focus].contains(&Lock::Named(NamedLock::Auto));
    let mut missed = NotApplied::default();
    missed.compare("rate_hz", config.rate_hz.round(), rate_hz.into());
    let mut settings = Map::from_iter([
        ("backend".to_owned(), json!("nokhwa")),
        ("rate_hz".to_owned(), json!(rate_hz)),
        ("asked_rate_hz".to_owned(), json!(config.rate_hz)),
        ("triggered".to_owned(), json!(config.triggered)),
        ("automatic_allowed".to_owned(), json!(automatic)),
        ("controls".to_owned(), Value::Object(controls)),
    ]);
    missed.tell(&mut settings);
    settings.extend(config.raw.map(|raw| ("raw".to_owned(), json!(raw))));
    settings
}

impl Source for PortableCamera {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        if self.running.is_some() {
            return Ok(());
        }
        self.state = Arc::default();
        let (opened, open) = mpsc::channel();
        let (ended, running) = mpsc::channel::<()>();
        let (config, index, state) = (self.config.clone(), self.index.clone(), self.state.clone());
        // Cameras of some systems belong to the thread that opens them.
        thread::Builder::new().name(config.id.clone()).spawn(move || {
            let _ended = ended;
            stream(&config, &index, &state, &*outlet, &opened);
        })?;
        open.recv().map_err(|_| format!("the thread of camera {} has ended before it began", self.config.id))??;
        self.running = Some(running);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let Some(running) = self.running.take() else { return Ok(()) };
        self.state.stopping.store(true, Ordering::Relaxed);
        match running.recv_timeout(STOP_WAIT) {
            Err(RecvTimeoutError::Disconnected) | Ok(()) => Ok(()),
            // Its thread sends nothing any more, and ends when a frame comes, or with the program.
            Err(RecvTimeoutError::Timeout) => {
                Err(format!("camera {} has stopped sending frames and cannot be closed; unplug it", self.config.id)
                    .into())
            }
        }
    }

    fn counters(&self) -> Counters {
        *self.state.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for PortableCamera {
    fn drop(&mut self) {
        if let Err(error) = self.stop() {
            tracing::warn!("{error}");
        }
    }
}

fn stream(
    config: &FrameConfig,
    index: &CameraIndex,
    state: &State,
    outlet: &dyn Outlet,
    opened: &Sender<Result<(), FrameError>>,
) {
    let camera = prepare(config, index).and_then(|mut camera| {
        camera.open_stream().map_err(failed(config, "stream"))?;
        Ok(camera)
    });
    let mut camera = match camera {
        Ok(camera) => {
            let _ = opened.send(Ok(()));
            camera
        }
        Err(error) => {
            let _ = opened.send(Err(error));
            return;
        }
    };
    let encoding = config.format;
    let mut sequence = 0;
    while !state.stopping.load(Ordering::Relaxed) {
        let frame = camera.frame();
        let host_ns = host_ns();
        if state.stopping.load(Ordering::Relaxed) {
            break;
        }
        let frame = match frame {
            Ok(frame) => frame,
            Err(error) => {
                let reason = format!("camera {} fails: {error}; plug it in again, and record anew", config.id);
                return outlet.report(Incident::Lost { reason });
            }
        };
        let payload = frame.buffer_bytes();
        let bytes = payload.len() as u64;
        let damaged = is_cut(encoding, config.width, config.height, &payload);
        // nokhwa's stamp is a wall time made from the kernel's by two readings of the clocks: no clock of ours.
        let packet = Packet { sequence, host_ns, discontinuity: false, damaged, stamp: None, payload };
        sequence += 1;
        let taken = outlet.send(packet);
        state.counters.lock().unwrap_or_else(PoisonError::into_inner).deliver(bytes, damaged, taken);
    }
    if let Err(error) = camera.stop_stream() {
        tracing::debug!("while camera {} is stopped: {error}", config.id);
    }
}

#[cfg(test)]
mod tests {
    use erfgs_scene::pixel::{BayerOrder, RawLook, Samples};

    use super::*;

    #[test]
    fn another_rate_than_asked_for_is_told_as_not_applied() {
        let config = FrameConfig { rate_hz: 29.97, ..FrameConfig::default() };
        // nokhwa knows whole frames a second alone.
        assert!(!settings(&config, 30, Map::new()).contains_key("not_applied"));
        let slow = settings(&config, 15, Map::from_iter([("Gain".into(), json!("3"))]));
        assert_eq!(slow["not_applied"], json!(["rate_hz = 30 (it has 15)"]));
        assert_eq!((&slow["rate_hz"], &slow["controls"]["Gain"]), (&json!(15), &json!("3")));
        assert_eq!((&slow["automatic_allowed"], slow.get("raw")), (&json!(false), None));
        let config = FrameConfig { gain: Lock::Named(NamedLock::Auto), raw: Some(RawLook::default()), ..config };
        let automatic = settings(&config, 30, Map::new());
        assert_eq!((&automatic["automatic_allowed"], &automatic["raw"]["black_level"]), (&json!(true), &json!(0.0)));
    }

    #[test]
    fn formats_that_the_library_does_not_know_are_refused_before_a_camera_is_looked_for() {
        for format in [PixelFormat::Grey10, PixelFormat::Uyvy, PixelFormat::Bayer(BayerOrder::Rggb, Samples::Bits8)] {
            let error = frame_format(&FrameConfig { format, ..FrameConfig::default() }).unwrap_err().to_string();
            assert!(error.contains(&format!("has no {format}; take backend")) && error.contains("bgr8"), "{error}");
        }
        assert_eq!(frame_format(&FrameConfig::default()).unwrap(), FrameFormat::MJPEG);
    }
}
