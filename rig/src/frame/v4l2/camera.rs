use std::{
    io,
    path::Path,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::{Duration, Instant},
};

use bytes::Bytes;
use erfgs_session::source::{Counters, Description, Incident, Outlet, Packet, Source, SourceError};
use serde_json::{Map, Value, json};

use super::{
    controls,
    find::{choose, fourcc_text, list},
    stamp::{is_damaged, stamp},
    sys::{Node, NodeStream, StreamFormat},
};
use crate::{
    frame::{
        FoundCamera, FrameConfig, FrameError,
        check::{is_cut, without_padding},
        encoding_of, fourccs,
        retry::pause,
    },
    host_time::host_ns,
    not_applied::NotApplied,
};

/// How long one wait for a frame lasts, ms: the patience of `stop`.
const WAIT_MS: i32 = 100;

/// How cameras are listed: for tests with cameras of their own.
type List = Arc<dyn Fn() -> Result<Vec<FoundCamera>, FrameError> + Send + Sync>;

/// A V4L2 camera as a [`Source`] of frames.
pub struct PreciseCamera {
    config: FrameConfig,
    description: Description,
    found: FoundCamera,
    list: List,
    ready: Option<Ready>,
    state: Arc<State>,
    thread: Option<JoinHandle<()>>,
}

/// A camera that is open and set.
struct Ready {
    node: Arc<Node>,
    format: StreamFormat,
}

#[derive(Default)]
struct State {
    stopping: AtomicBool,
    counters: Mutex<Counters>,
}

impl State {
    fn counters(&self) -> MutexGuard<'_, Counters> {
        // Plain numbers: what another thread left is whole.
        self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl PreciseCamera {
    /// Opens the camera that the configuration means, and sets it.
    ///
    /// # Errors
    /// If there is no such camera, or it cannot do what is asked.
    pub fn open(config: &FrameConfig) -> Result<Self, FrameError> {
        Self::open_among(config, list)
    }

    /// As [`PreciseCamera::open`], among the cameras that `list` gives, now and whenever the camera was lost.
    ///
    /// # Errors
    /// As [`PreciseCamera::open`].
    pub fn open_among(
        config: &FrameConfig,
        list: impl Fn() -> Result<Vec<FoundCamera>, FrameError> + Send + Sync + 'static,
    ) -> Result<Self, FrameError> {
        config.check()?;
        let found = choose(&config.id, &config.camera, list()?)?;
        let (ready, mut settings) = prepare(config, &found)?;
        settings.extend(uvc_parameters(Path::new("/sys/module/uvcvideo/parameters")));
        let description = Description {
            id: config.id.clone(),
            model: found.name.clone(),
            serial: found.serial.clone(),
            encoding: config.format.into(),
            width: ready.format.width,
            height: ready.format.height,
            start_order: 0,
            settings,
        };
        Ok(Self {
            config: config.clone(),
            description,
            found,
            list: Arc::new(list),
            ready: Some(ready),
            state: Arc::default(),
            thread: None,
        })
    }
}

/// What decides about stamps of UVC cameras on this machine, at this moment.
fn uvc_parameters(folder: &Path) -> Map<String, Value> {
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).ok().map(|text| json!(text.trim()));
    ["clock", "hwtimestamps", "quirks", "timeout"]
        .into_iter()
        .filter_map(|name| Some((format!("uvcvideo_{name}"), read(name)?)))
        .collect()
}

/// Opens a camera and sets format, rate and controls.
fn prepare(config: &FrameConfig, found: &FoundCamera) -> Result<(Ready, Map<String, Value>), FrameError> {
    let node_name = found.node.display().to_string();
    let fail = |doing: &str, source: io::Error| {
        let advice = match source.raw_os_error() {
            Some(libc::EBUSY) => ". Another program uses it: close that first",
            Some(libc::EACCES) => ". Are you in the group that may use it (video)?",
            _ => "",
        };
        FrameError::Camera { id: config.id.clone(), node: node_name.clone(), doing: doing.to_owned(), source, advice }
    };
    let node = Node::open(&found.node).map_err(|error| fail("open", error))?;
    let capabilities = node.capabilities().map_err(|error| fail("say what it is", error))?;

    let (width, height) = (config.width, config.height);
    let offered = node.formats();
    let known = fourccs(config.format).iter().map(|code| u32::from_le_bytes(**code));
    let asked = known.clone().find(|code| offered.contains(code)).or(known.clone().next());
    let asked = asked.ok_or_else(|| fail("name its format", io::ErrorKind::Unsupported.into()))?;
    let format = node.set_format(asked, width, height).map_err(|error| fail("set its format", error))?;
    if !known.clone().any(|code| code == format.fourcc) || (format.width, format.height) != (width, height) {
        let describe = |f: u32, w, h| format!("{} of {w} x {h} pixels", fourcc_text(f));
        return Err(FrameError::Format {
            id: config.id.clone(),
            node: node_name,
            asked: describe(asked, width, height),
            offered: describe(format.fourcc, format.width, format.height),
            formats: offered.into_iter().map(format_text).collect::<Vec<_>>().join(", "),
        });
    }
    let mut missed = NotApplied::default();
    let mut settings = controls::lock(&node, config, &mut missed)?;
    // Some cameras (triggered ones, loop devices) have no rate of their own.
    let interval = node.set_interval(1000, (config.rate_hz * 1000.0).round() as u32).ok();
    let rate = interval.filter(|interval| interval.0 > 0).map(|(n, d)| f64::from(d) / f64::from(n));
    let device_settings = json!({
        "backend": "v4l2",
        "driver": capabilities.driver,
        "kernel": format!("{}.{}.{}", capabilities.version >> 16, capabilities.version >> 8 & 255, capabilities.version & 255),
        "bus": capabilities.bus,
        "node": found.node,
        "fourcc": fourcc_text(format.fourcc),
        "stride_bytes": format.stride,
        "rate_hz": rate,
        "asked_rate_hz": config.rate_hz,
        "triggered": config.triggered,
    });
    if let Value::Object(device_settings) = device_settings {
        settings.extend(device_settings);
    }
    if let Some(rate) = rate.filter(|&rate| is_another(rate, config.rate_hz)) {
        missed.compare("rate_hz", config.rate_hz, rate);
    }
    missed.tell(&mut settings);
    settings.extend(config.raw.map(|raw| ("raw".to_owned(), json!(raw))));
    Ok((Ready { node: Arc::new(node), format }, settings))
}

/// A four-character code, and the name of the format in `RIG.toml` if it has one.
fn format_text(fourcc: u32) -> String {
    let code = fourcc_text(fourcc);
    encoding_of(fourcc).map_or(code.clone(), |encoding| format!("{code} (format = \"{encoding}\")"))
}

/// Whether a rate is another than was asked for, by more than the way in which drivers count intervals.
fn is_another(rate_hz: f64, asked_hz: f64) -> bool {
    (rate_hz - asked_hz).abs() > 0.01 * asked_hz
}

impl Source for PreciseCamera {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        if self.thread.is_some() {
            return Ok(());
        }
        let ready = match self.ready.take() {
            Some(ready) => ready,
            None => prepare(&self.config, &self.found)?.0,
        };
        let stream = begin(&self.config, &self.found, &ready)?;
        let rate = self.description.settings.get("rate_hz").and_then(Value::as_f64);
        if let Some(rate) = rate.filter(|&rate| is_another(rate, self.config.rate_hz)) {
            let asked = self.config.rate_hz;
            let message = format!("camera {} gives {rate:.2} frames a second, not {asked}", self.config.id);
            outlet.report(Incident::Warning { message });
        }
        self.state = Arc::default();
        let watch = Watch {
            identity: identity(&self.config, &self.found),
            config: self.config.clone(),
            list: self.list.clone(),
            outlet,
            state: self.state.clone(),
            sequence: 0,
            discontinuity: false,
        };
        self.thread =
            Some(thread::Builder::new().name(self.config.id.clone()).spawn(move || watch.run(stream, ready.format))?);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let Some(thread) = self.thread.take() else { return Ok(()) };
        self.state.stopping.store(true, Ordering::Relaxed);
        thread.join().map_err(|_| format!("the thread of camera {} has panicked", self.config.id).into())
    }

    fn counters(&self) -> Counters {
        *self.state.counters()
    }
}

impl Drop for PreciseCamera {
    fn drop(&mut self) {
        if let Err(error) = self.stop() {
            tracing::warn!("while closing camera {}: {error}", self.config.id);
        }
    }
}

/// By what a camera is found again, wherever its node is then: its place if the configuration names that (cameras of one
/// batch may share a serial number), else its serial number, else its place.
fn identity(config: &FrameConfig, found: &FoundCamera) -> String {
    let named = (config.camera == found.bus).then_some(&found.bus);
    let by = named.into_iter().chain([&found.serial, &found.bus]).find(|text| !text.is_empty());
    by.cloned().unwrap_or_else(|| found.node.display().to_string())
}

fn begin(config: &FrameConfig, found: &FoundCamera, ready: &Ready) -> Result<NodeStream, FrameError> {
    NodeStream::start(ready.node.clone(), config.buffers).map_err(|source| FrameError::Camera {
        id: config.id.clone(),
        node: found.node.display().to_string(),
        doing: "stream".into(),
        advice: match source.raw_os_error() {
            Some(libc::EBUSY) => ". Another program uses it: close that first",
            Some(libc::ENOSPC) => {
                ". The USB bus has no bandwidth left: use another controller, MJPEG, or fewer pixels or frames a second"
            }
            Some(libc::ENOMEM) => ". Give fewer buffers",
            _ => "",
        },
        source,
    })
}

/// The thread that takes frames and brings a lost camera back.
struct Watch {
    identity: String,
    config: FrameConfig,
    list: List,
    outlet: Arc<dyn Outlet>,
    state: Arc<State>,
    sequence: u64,
    discontinuity: bool,
}

impl Watch {
    fn stopping(&self) -> bool {
        self.state.stopping.load(Ordering::Relaxed)
    }

    fn run(mut self, mut stream: NodeStream, mut format: StreamFormat) {
        while let Err(reason) = self.stream(&mut stream, format) {
            drop(stream);
            self.outlet.report(Incident::Lost { reason });
            let Some(back) = self.bring_back() else { return };
            (stream, format) = back;
            self.discontinuity = true;
            self.state.counters().reconnections += 1;
            self.outlet.report(Incident::Back);
        }
    }

    /// Takes frames until the owner stops (`Ok`), or the camera is lost.
    fn stream(&mut self, stream: &mut NodeStream, format: StreamFormat) -> Result<(), String> {
        tracing::debug!("camera {} streams into {} buffers", self.config.id, stream.buffers());
        let timeout = Duration::from_millis(u64::from(self.config.timeout_ms));
        let mut last = Instant::now();
        let mut expected: Option<u32> = None;
        while !self.stopping() {
            let frame = stream.next(WAIT_MS).map_err(|error| self.lost(&error))?;
            let host_ns = host_ns();
            let Some(frame) = frame else {
                if last.elapsed() > timeout && !self.config.triggered {
                    let (id, ms) = (&self.config.id, self.config.timeout_ms);
                    return Err(format!(
                        "camera {id} has given no frame for {ms} ms; it is opened anew. Check its cable"
                    ));
                }
                continue;
            };
            last = Instant::now();
            // A driver that counts backwards has started anew: nothing is known to be lost then.
            let missing = expected.map_or(0, |expected| frame.sequence.wrapping_sub(expected));
            expected = Some(frame.sequence.wrapping_add(1));
            if missing < u32::MAX / 2 {
                self.state.counters().lost += u64::from(missing);
            }
            if frame.used == 0 {
                // A transfer that failed whole: the kernel gives the buffer back empty.
                self.state.counters().errors += 1;
            } else {
                self.deliver(host_ns, stream, &frame, format);
            }
            stream.give_back(frame).map_err(|error| self.lost(&error))?;
        }
        Ok(())
    }

    fn lost(&self, error: &io::Error) -> String {
        let id = &self.config.id;
        match error.raw_os_error() {
            Some(libc::ENODEV) => format!("camera {id} is unplugged; plug it in again"),
            _ => format!("camera {id} fails: {error}; it is opened anew"),
        }
    }

    fn deliver(&mut self, host_ns: i64, stream: &NodeStream, frame: &super::sys::Filled, format: StreamFormat) {
        let encoding = self.config.format;
        let raw = stream.bytes(frame);
        let payload = match without_padding(encoding, format.width, format.stride, raw) {
            Some(rows) if encoding != erfgs_scene::pixel::PixelFormat::Mjpeg => Bytes::from(rows),
            _ => Bytes::copy_from_slice(raw),
        };
        let damaged = is_damaged(frame) || is_cut(encoding, format.width, format.height, &payload);
        let bytes = payload.len() as u64;
        let packet = Packet {
            sequence: self.sequence,
            host_ns,
            discontinuity: std::mem::take(&mut self.discontinuity),
            damaged,
            stamp: Some(stamp(frame)),
            payload,
        };
        self.sequence += 1;
        let taken = self.outlet.send(packet);
        self.state.counters().deliver(bytes, damaged, taken);
    }

    /// Looks for the same camera until it is there again, or the owner stops.
    fn bring_back(&self) -> Option<(NodeStream, StreamFormat)> {
        while !self.stopping() {
            let back =
                (self.list)().and_then(|cameras| choose(&self.config.id, &self.identity, cameras)).and_then(|found| {
                    let (ready, _) = prepare(&self.config, &found)?;
                    Ok((begin(&self.config, &found, &ready)?, ready.format))
                });
            match back {
                Ok(back) => return Some(back),
                Err(error) => tracing::debug!("not back yet: {error}"),
            }
            pause(|| self.stopping());
        }
        None
    }
}
