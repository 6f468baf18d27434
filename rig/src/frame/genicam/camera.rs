use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
};

use bytes::Bytes;
use erfgs_session::source::{Counters, Description, Outlet, Source, SourceError};
use serde_json::{Map, Value, json};

use super::{
    frames::Shape,
    link::{Device, Identity, Link},
    watch::Watch,
};
use crate::{
    frame::{FrameConfig, FrameError, Lock, NamedLock},
    genicam::{Chunk, GenicamError, Wish, Wishes, apply, chunk_values},
    not_applied::NotApplied,
};

/// A machine-vision camera as a [`Source`] of frames.
pub struct GenicamCamera<L: Link> {
    link: Arc<L>,
    config: FrameConfig,
    description: Description,
    identity: Identity,
    state: Arc<State<L::Device>>,
    ready: Option<Ready<L::Device>>,
    thread: Option<JoinHandle<Option<Ready<L::Device>>>>,
}

/// A camera that is open and set.
pub(super) struct Ready<D: Device> {
    pub device: Arc<Mutex<D>>,
    pub intake: D::Intake,
    pub shape: Shape,
}

/// What the source and the thread of its stream share.
pub(super) struct State<D> {
    pub stopping: AtomicBool,
    pub counters: Mutex<Counters>,
    pub seen: Mutex<Readings<D>>,
}

/// What the thread of the stream has seen, for readings.
pub(super) struct Readings<D> {
    pub counts: Vec<(&'static str, u64)>,
    pub chunks: Vec<(u32, Bytes)>,
    pub device: Option<Arc<Mutex<D>>>,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // Plain values: what another thread left is whole.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<D: Device> Ready<D> {
    pub fn begin(&mut self) -> Result<(), GenicamError> {
        lock(&self.device).begin(&mut self.intake)
    }

    fn seen(&self) -> Readings<D> {
        Readings { counts: Vec::new(), chunks: Vec::new(), device: Some(Arc::clone(&self.device)) }
    }
}

impl<L: Link> GenicamCamera<L> {
    /// Opens the camera that the configuration means, and sets it.
    ///
    /// # Errors
    /// If there is no such camera, another program has it, or it cannot do what is asked.
    pub fn open(link: L, config: &FrameConfig) -> Result<Self, FrameError> {
        config.check()?;
        let (ready, settings) = prepare(&link, config)?;
        let identity = lock(&ready.device).identity();
        let description = Description {
            id: config.id.clone(),
            model: identity.label.clone(),
            serial: identity.serial.clone(),
            encoding: config.format.into(),
            width: config.width,
            height: config.height,
            start_order: 0,
            settings,
        };
        let state = Arc::new(State {
            stopping: AtomicBool::new(false),
            counters: Mutex::default(),
            seen: Mutex::new(ready.seen()),
        });
        let (link, config, ready) = (Arc::new(link), config.clone(), Some(ready));
        Ok(Self { link, config, description, identity, state, ready, thread: None })
    }
}

fn wish(lock: Lock) -> Wish {
    match lock {
        Lock::Named(NamedLock::Hold) => Wish::Hold,
        Lock::Named(NamedLock::Auto) => Wish::Auto,
        Lock::At(value) => Wish::At(value),
    }
}

/// A camera that was opened, and its settings as read back.
type Prepared<D> = (Ready<D>, Map<String, Value>);

/// Takes control of the camera that is meant, sets it, and prepares its stream.
pub(super) fn prepare<L: Link>(link: &L, config: &FrameConfig) -> Result<Prepared<L::Device>, FrameError> {
    let mut device = link.open(config)?;
    let camera = device.identity().full();
    let fail = |source: GenicamError| FrameError::Genicam {
        id: config.id.clone(),
        camera: camera.clone(),
        source: source.into(),
    };
    let more = config.genicam.clone().unwrap_or_default();
    let wishes = Wishes {
        format: config.format,
        size: [config.width, config.height],
        rate_hz: config.rate_hz,
        exposure_us: wish(config.exposure_us),
        gain: wish(config.gain),
        white_balance: wish(config.white_balance_k),
        triggered: config.triggered,
        more: &more,
    };
    let mut missed = NotApplied::default();
    let mut settings = apply(device.features(), &wishes, &mut missed).map_err(fail)?;
    let (size, tick_hz) = ([config.width, config.height], device.tick_hz());
    let shape = Shape { format: config.format, size, tick_hz, order: L::ORDER };
    let intake = device.prepare(&more, shape.bytes()).map_err(fail)?;
    let common_settings = json!({
        "backend": L::BACKEND,
        "tick_hz": tick_hz,
        "asked_rate_hz": config.rate_hz,
        "triggered": config.triggered,
    });
    if let Value::Object(common_settings) = common_settings {
        settings.extend(common_settings);
    }
    settings.extend(config.raw.map(|raw| ("raw".to_owned(), json!(raw))));
    device.tell(&intake, &more, &mut settings, &mut missed);
    missed.tell(&mut settings);
    Ok((Ready { device: Arc::new(Mutex::new(device)), intake, shape }, settings))
}

impl<L: Link> Source for GenicamCamera<L> {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        if self.thread.is_some() {
            return Ok(());
        }
        let mut ready = match self.ready.take() {
            // It may have been lost, or restarted, since it was opened.
            Some(ready) if lock(&ready.device).lost().is_none() => ready,
            lost => {
                // One that is still open would be another program's.
                drop(lost);
                lock(&self.state.seen).device = None;
                prepare(&*self.link, &self.config)?.0
            }
        };
        ready.begin().map_err(|source| FrameError::Genicam {
            id: self.config.id.clone(),
            camera: self.description.model.clone(),
            source: source.into(),
        })?;
        self.state.stopping.store(false, Ordering::Relaxed);
        *lock(&self.state.counters) = Counters::default();
        *lock(&self.state.seen) = ready.seen();
        let watch = Watch {
            link: Arc::clone(&self.link),
            config: self.config.clone(),
            identity: self.identity.clone(),
            outlet,
            state: Arc::clone(&self.state),
            sequence: 0,
            discontinuity: false,
        };
        let thread = thread::Builder::new().name(self.config.id.clone()).spawn(move || watch.run(ready))?;
        self.thread = Some(thread);
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let Some(thread) = self.thread.take() else { return Ok(()) };
        self.state.stopping.store(true, Ordering::Relaxed);
        self.ready = thread.join().map_err(|_| format!("the thread of camera {} has panicked", self.config.id))?;
        let Some(ready) = &mut self.ready else { return Ok(()) };
        let ended = lock(&ready.device).end(&mut ready.intake);
        ended.map_err(|error| format!("camera {} does not end its stream: {error}", self.config.id).into())
    }

    fn counters(&self) -> Counters {
        *lock(&self.state.counters)
    }

    fn readings(&mut self) -> Vec<(String, f64)> {
        let seen = lock(&self.state.seen);
        let counts = seen.counts.iter().map(|(name, count)| ((*name).to_owned(), *count as f64));
        let mut readings: Vec<(String, f64)> = counts.collect();
        let (device, chunks) = (seen.device.clone(), seen.chunks.clone());
        drop(seen);
        let Some(device) = device else { return readings };
        let mut device = lock(&device);
        if device.lost().is_none() && device.features().has("DeviceTemperature") {
            let celsius = device.features().number("DeviceTemperature").ok();
            readings.extend(celsius.map(|celsius| ("temperature_c".to_owned(), celsius)));
        }
        if !chunks.is_empty() {
            let chunks: Vec<Chunk<'_>> = chunks.iter().map(|(id, data)| Chunk { id: *id, data }).collect();
            let features = device.features();
            features.attach(&chunks);
            let names = self.config.genicam.as_ref().map_or(&[][..], |more| &more.chunks);
            readings.extend(
                chunk_values(features, names).into_iter().map(|(name, value)| (format!("chunk {name}"), value)),
            );
        }
        readings
    }
}

impl<L: Link> Drop for GenicamCamera<L> {
    fn drop(&mut self) {
        if let Err(error) = self.stop() {
            tracing::warn!("while closing camera {}: {error}", self.config.id);
        }
    }
}
