//! A driver as a [`Source`]: finds its camera, streams, and after the camera was lost finds the same one again.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc},
    thread::{self, JoinHandle},
    time::Duration,
};

use erfgs_session::source::{Counters, Description, Encoding, Incident, Outlet, Source, SourceError};
use serde_json::{Map, Value, json};

use super::{
    EventError, StreamConfig,
    stream::{Feed, Signal},
};
use crate::usb::{Budget, Bus, Fault, Flight, Identity, Stream, Transport, drain, memory_advice};

/// A model of event camera. One value is one camera while it is plugged in; dropping it gives the device free.
pub trait Driver: Send + Sized + 'static {
    /// Its settings.
    type Config: Clone + Send + Sync + 'static;
    /// Maker and model.
    const MODEL: &'static str;

    /// Whether a device on the bus may be one.
    fn is_candidate(identity: &Identity) -> bool;
    /// Makes sure that it is one and reads its serial number. Changes nothing on it.
    ///
    /// # Errors
    /// If it is another model, is used by another program or does not answer.
    fn connect(transport: Arc<dyn Transport>) -> Result<Self, EventError>;
    /// Its serial number.
    fn serial(&self) -> &str;
    /// The serial number that the settings ask for; empty: any.
    fn wanted_serial(config: &Self::Config) -> &str;
    /// Checks settings that need no camera.
    ///
    /// # Errors
    /// The first one out of range.
    fn validate(config: &Self::Config) -> Result<(), EventError>;
    /// How data is fetched.
    fn stream_config(config: &Self::Config) -> StreamConfig;
    /// The device.
    fn transport(&self) -> &Arc<dyn Transport>;
    /// Model, serial number, bus and address, for messages.
    fn name(&self) -> &str;
    /// Where data comes from.
    fn endpoint(&self) -> u8;
    /// Brings the camera into the state that the settings describe, silent.
    ///
    /// # Errors
    /// If it does not take them.
    fn configure(&mut self, config: &Self::Config) -> Result<(), EventError>;
    /// Settings as read back by the last [`Driver::configure`].
    fn settings(&self) -> &Map<String, Value>;
    /// How its data is encoded.
    fn encoding(&self) -> Encoding;
    /// Columns and rows, pixels.
    fn size(&self) -> (u32, u32);
    /// Order of its start among the sources of a rig.
    fn start_order(&self) -> i32;
    /// Lets it send. The transfers are in flight already.
    ///
    /// # Errors
    /// If it does not answer.
    fn run(&mut self) -> Result<(), EventError>;
    /// Stops it sending.
    ///
    /// # Errors
    /// If it does not answer.
    fn halt(&mut self) -> Result<(), EventError>;
    /// Powers the sensor down, before the camera is given free.
    ///
    /// # Errors
    /// If it does not answer.
    fn shut_down(&mut self) -> Result<(), EventError>;
    /// What it measures of itself.
    ///
    /// # Errors
    /// If it does not answer.
    fn readings(&mut self) -> Result<Vec<(String, f64)>, EventError>;
    /// Data that the device itself dropped since it was configured, as its last readings told.
    fn lost(&self) -> u64 {
        0
    }
}

/// How long to wait before looking for a lost camera again.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// A running camera sends time stamps even if nothing changes: after this long without data, something is wrong.
const SILENCE: Duration = Duration::from_secs(3);
/// Halts of the data endpoint without data in between after which the camera is opened anew.
const STALLS: u32 = 3;

/// An event camera as a source.
pub struct EventSource<D: Driver> {
    link: Arc<Link<D>>,
    description: Description,
    feed: Arc<Feed>,
    running: Option<Running>,
}

/// A supervisor at work.
struct Running {
    signals: mpsc::Sender<Signal>,
    thread: JoinHandle<Result<(), EventError>>,
}

/// What the source and its supervisor share.
struct Link<D: Driver> {
    bus: Arc<dyn Bus>,
    config: D::Config,
    serial: String,
    driver: Mutex<Option<D>>,
}

impl<D: Driver> Link<D> {
    fn driver(&self) -> MutexGuard<'_, Option<D>> {
        self.driver.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Finds the camera with this serial number (empty: the only one there is).
fn find<D: Driver>(bus: &dyn Bus, serial: &str) -> Result<D, EventError> {
    let listed = bus.list().map_err(|source| EventError::Transport {
        camera: D::MODEL.into(),
        step: "look for cameras".into(),
        source,
    })?;
    let mut found = Vec::new();
    let mut others = Vec::new();
    let mut refusal = None;
    for identity in listed.iter().filter(|identity| D::is_candidate(identity)) {
        let opened = bus.open(identity).map_err(|source| EventError::Transport {
            camera: D::MODEL.into(),
            step: "open".into(),
            source,
        });
        match opened.and_then(D::connect) {
            Ok(camera) if camera.serial() == serial => return Ok(camera),
            Ok(camera) if serial.is_empty() => found.push(camera),
            Ok(camera) => others.push(format!("{identity} with serial number {}", camera.serial())),
            Err(error) => {
                others.push(error.to_string());
                refusal = Some(error);
            }
        }
    }
    match (found.len(), refusal, others.len()) {
        (1, ..) => found.pop().ok_or(EventError::NotFound { model: D::MODEL, serial: serial.into(), others }),
        // The only candidate has an error of its own to tell.
        (0, Some(error), 1) if serial.is_empty() => Err(error),
        (0, ..) => Err(EventError::NotFound { model: D::MODEL, serial: serial.into(), others }),
        _ => {
            let serials = found.iter().map(|camera| camera.serial().to_owned()).collect();
            Err(EventError::Ambiguous { model: D::MODEL, serials })
        }
    }
}

impl<D: Driver> EventSource<D> {
    /// Finds the camera that `config` asks for and brings it into the state that it describes. `id` is the stream's
    /// name within the rig.
    ///
    /// # Errors
    /// If a setting is out of range, the camera is not found, another program has it, or it does not take a setting.
    pub fn open(bus: Arc<dyn Bus>, id: &str, config: D::Config) -> Result<Self, EventError> {
        D::validate(&config)?;
        let mut driver: D = find(bus.as_ref(), D::wanted_serial(&config))?;
        driver.configure(&config)?;
        let (width, height) = driver.size();
        let description = Description {
            id: id.into(),
            model: D::MODEL.into(),
            serial: driver.serial().into(),
            encoding: driver.encoding(),
            width,
            height,
            start_order: driver.start_order(),
            settings: driver.settings().clone(),
        };
        let serial = driver.serial().to_owned();
        let link = Arc::new(Link { bus, config, serial, driver: Mutex::new(Some(driver)) });
        Ok(Self { link, description, feed: Arc::new(Feed::default()), running: None })
    }

    fn name(&self) -> String {
        format!("{} {}", D::MODEL, self.description.serial)
    }
}

/// Drops what the camera still holds from an earlier run, which would come first and with times of another clock; then
/// puts transfers in flight and lets the camera send.
fn begin<D: Driver>(
    driver: &mut D,
    flight: Flight,
    feed: &Arc<Feed>,
    outlet: &Arc<dyn Outlet>,
    signals: &mpsc::Sender<Signal>,
) -> Result<Box<dyn Stream>, EventError> {
    let (transport, endpoint) = (driver.transport().as_ref(), driver.endpoint());
    drain(transport, endpoint, Duration::from_millis(50), Duration::from_secs(2))
        .and_then(|_| transport.clear_halt(endpoint))
        .map_err(|source| EventError::Transport {
            camera: driver.name().into(),
            step: "drop old data".into(),
            source,
        })?;
    let stream = resume(driver, flight, feed, outlet, signals)?;
    driver.run()?;
    Ok(stream)
}

/// Puts transfers in flight for a camera that sends already.
fn resume<D: Driver>(
    driver: &D,
    flight: Flight,
    feed: &Arc<Feed>,
    outlet: &Arc<dyn Outlet>,
    signals: &mpsc::Sender<Signal>,
) -> Result<Box<dyn Stream>, EventError> {
    let receiver = feed.receiver(Arc::clone(outlet), signals.clone());
    let stream = driver.transport().stream(driver.endpoint(), flight, receiver).map_err(|source| {
        EventError::Transport { camera: driver.name().into(), step: "start the stream".into(), source }
    })?;
    if stream.granted() < flight.transfers {
        outlet.report(Incident::Warning {
            message: format!(
                "{}: the kernel granted {} of {} transfers: {}",
                driver.name(),
                stream.granted(),
                flight.transfers,
                memory_advice()
            ),
        });
    }
    Ok(stream)
}

/// Keeps a started source running until it is told to stop.
struct Supervisor<D: Driver> {
    link: Arc<Link<D>>,
    feed: Arc<Feed>,
    outlet: Arc<dyn Outlet>,
    flight: Flight,
    signals: mpsc::Sender<Signal>,
    inbox: mpsc::Receiver<Signal>,
    stream: Option<Box<dyn Stream>>,
}

impl<D: Driver> Supervisor<D> {
    fn warn(&self, message: String) {
        tracing::warn!("{message}");
        self.outlet.report(Incident::Warning { message });
    }

    fn run(mut self) -> Result<(), EventError> {
        let mut stalls = 0;
        let mut packets = self.feed.packets();
        let mut silent = false;
        loop {
            match self.inbox.recv_timeout(SILENCE) {
                Ok(Signal::Stop) | Err(mpsc::RecvTimeoutError::Disconnected) => return self.stop(),
                Ok(Signal::Ended(fault)) => {
                    self.feed.broke();
                    self.stream = None;
                    stalls = if self.feed.packets() == packets { stalls + 1 } else { 1 };
                    packets = self.feed.packets();
                    let resumed = stalls <= STALLS && self.clear(&fault);
                    if !resumed && !self.recover(&fault) {
                        return Ok(());
                    }
                }
                Err(mpsc::RecvTimeoutError::Timeout) => {
                    let quiet = self.feed.packets() == packets;
                    if quiet && !silent {
                        let name = format!("{} {}", D::MODEL, self.link.serial);
                        self.warn(format!("{name}: no data for {SILENCE:?}. Check its clock role and its cable"));
                    }
                    silent = quiet;
                    packets = self.feed.packets();
                }
            }
        }
    }

    /// Ends a halt of the endpoint and goes on; `false` if that is not what happened or does not help.
    fn clear(&mut self, fault: &Fault) -> bool {
        if !matches!(fault, Fault::Stall | Fault::Overflow | Fault::Io(_)) {
            return false;
        }
        let link = Arc::clone(&self.link);
        let guard = link.driver();
        let Some(driver) = guard.as_ref() else { return false };
        if driver.transport().clear_halt(driver.endpoint()).is_err() {
            return false;
        }
        match resume(driver, self.flight, &self.feed, &self.outlet, &self.signals) {
            Ok(stream) => {
                self.stream = Some(stream);
                self.warn(format!("{}: the stream broke and goes on; data was lost: {fault}", driver.name()));
                true
            }
            Err(_) => false,
        }
    }

    /// Looks for the camera until it is back, then configures and starts it again; `false` if told to stop meanwhile.
    fn recover(&mut self, fault: &Fault) -> bool {
        let name = format!("{} {}", D::MODEL, self.link.serial);
        tracing::warn!("{name}: lost: {fault}");
        self.outlet.report(Incident::Lost { reason: format!("{name}: {fault}") });
        *self.link.driver() = None;
        let mut told = None;
        loop {
            match self.inbox.recv_timeout(LOOK_AGAIN) {
                Ok(Signal::Stop) | Err(mpsc::RecvTimeoutError::Disconnected) => return false,
                // The end of a stream that was given up.
                Ok(Signal::Ended(_)) => {}
                Err(mpsc::RecvTimeoutError::Timeout) => match self.reopen() {
                    Ok(()) => {
                        self.feed.reconnected();
                        tracing::info!("{name}: back");
                        self.outlet.report(Incident::Back);
                        return true;
                    }
                    Err(EventError::NotFound { .. }) => {}
                    Err(error) => {
                        // Said once: a camera that is being plugged in may refuse for a moment, and again and again.
                        let message = error.to_string();
                        if told.as_ref() != Some(&message) {
                            self.warn(format!("{name}: it is there but does not come back yet: {message}"));
                            told = Some(message);
                        }
                    }
                },
            }
        }
    }

    fn reopen(&mut self) -> Result<(), EventError> {
        let mut driver: D = find(self.link.bus.as_ref(), &self.link.serial)?;
        driver.configure(&self.link.config)?;
        self.feed.mark_gap();
        self.stream = Some(begin(&mut driver, self.flight, &self.feed, &self.outlet, &self.signals)?);
        *self.link.driver() = Some(driver);
        Ok(())
    }

    /// Stops the camera first, so that what it sent until then still arrives.
    fn stop(&mut self) -> Result<(), EventError> {
        let mut guard = self.link.driver();
        let halted = guard.as_mut().map_or(Ok(()), |driver| {
            let halted = driver.halt();
            driver.transport().wait(Duration::from_millis(20));
            halted
        });
        drop(guard);
        if let Some(mut stream) = self.stream.take() {
            stream.stop();
        }
        halted
    }
}

impl<D: Driver> Source for EventSource<D> {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        if self.running.is_some() {
            return Err(EventError::Running { camera: self.name() }.into());
        }
        let mut guard = self.link.driver();
        if guard.is_none() {
            // It was lost while it ran, and stopped before it was back.
            let mut driver: D = find(self.link.bus.as_ref(), &self.link.serial)?;
            driver.configure(&self.link.config)?;
            *guard = Some(driver);
        }
        let Some(driver) = guard.as_mut() else {
            return Err(
                EventError::NotFound { model: D::MODEL, serial: self.link.serial.clone(), others: Vec::new() }.into()
            );
        };
        let cameras =
            self.link.bus.list().map_or(1, |all| all.iter().filter(|it| super::list::is_event_camera(it)).count());
        let wanted = D::stream_config(&self.link.config).flight();
        let flight = Budget::of_machine(cameras).fit(wanted);
        if flight != wanted {
            outlet.report(Incident::Warning {
                message: format!(
                    "{}: {} transfers in flight of the {} wanted: {}",
                    driver.name(),
                    flight.transfers,
                    wanted.transfers,
                    memory_advice()
                ),
            });
        }
        self.feed.reset();
        let (signals, inbox) = mpsc::channel();
        let stream = begin(driver, flight, &self.feed, &outlet, &signals)?;
        drop(guard);
        let usb = json!({ "transfers": stream.granted(), "transfer_bytes": flight.bytes });
        self.description.settings.insert("stream".into(), usb);
        let supervisor = Supervisor {
            link: Arc::clone(&self.link),
            feed: Arc::clone(&self.feed),
            outlet,
            flight,
            signals: signals.clone(),
            inbox,
            stream: Some(stream),
        };
        let thread = thread::Builder::new()
            .name(format!("event camera {}", self.description.id))
            .spawn(move || supervisor.run())
            .map_err(|_| EventError::Threads { camera: self.name() })?;
        self.running = Some(Running { signals, thread });
        Ok(())
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        let Some(Running { signals, thread }) = self.running.take() else { return Ok(()) };
        // It fails only if the supervisor has ended, which the join tells.
        let _ = signals.send(Signal::Stop);
        match thread.join() {
            Ok(result) => Ok(result?),
            Err(_) => Err(EventError::Threads { camera: self.name() }.into()),
        }
    }

    fn counters(&self) -> Counters {
        let lost = self.link.driver.try_lock().ok().and_then(|guard| guard.as_ref().map(Driver::lost));
        self.feed.counters(lost)
    }

    fn readings(&mut self) -> Vec<(String, f64)> {
        let mut guard = self.link.driver();
        guard.as_mut().and_then(|driver| driver.readings().ok()).unwrap_or_default()
    }
}

impl<D: Driver> Drop for EventSource<D> {
    fn drop(&mut self) {
        // Nobody is left to tell; the camera is given free in any case.
        let _ = self.stop();
        if let Some(driver) = self.link.driver().as_mut() {
            let _ = driver.shut_down();
        }
    }
}
