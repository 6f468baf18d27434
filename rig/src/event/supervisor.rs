//! Keeps a started camera streaming: ends halts, finds it again after it was lost, stops it.

use std::{
    sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc},
    time::Duration,
};

use erfgs_session::source::{Incident, Outlet};

use super::{
    Driver, EventError,
    stream::{Feed, Signal},
};
use crate::usb::{Bus, Fault, Flight, Stream, drain, memory_advice};

/// How long to wait before looking for a lost camera again.
const LOOK_AGAIN: Duration = Duration::from_millis(250);
/// A running camera sends time stamps even if nothing changes: after this long without data, something is wrong.
const SILENCE: Duration = Duration::from_secs(3);
/// Halts of the data endpoint without data in between after which the camera is opened anew.
const STALLS: u32 = 3;

/// What the source and its supervisor share.
pub(super) struct Link<D: Driver> {
    pub(super) bus: Arc<dyn Bus>,
    pub(super) config: Mutex<D::Config>,
    pub(super) serial: String,
    pub(super) driver: Mutex<Option<D>>,
}

impl<D: Driver> Link<D> {
    /// The settings as they stand.
    pub(super) fn config(&self) -> MutexGuard<'_, D::Config> {
        self.config.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn driver(&self) -> MutexGuard<'_, Option<D>> {
        self.driver.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Finds the camera with this serial number (empty: the only one there is).
pub(super) fn find<D: Driver>(bus: &dyn Bus, serial: &str) -> Result<D, EventError> {
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

/// Drops what the camera still holds from an earlier run, which would come first and with times of another clock; then
/// puts transfers in flight and lets the camera send.
pub(super) fn begin<D: Driver>(
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
pub(super) struct Supervisor<D: Driver> {
    pub(super) link: Arc<Link<D>>,
    pub(super) feed: Arc<Feed>,
    pub(super) outlet: Arc<dyn Outlet>,
    pub(super) flight: Flight,
    pub(super) signals: mpsc::Sender<Signal>,
    pub(super) inbox: mpsc::Receiver<Signal>,
    pub(super) stream: Option<Box<dyn Stream>>,
}

impl<D: Driver> Supervisor<D> {
    fn warn(&self, message: String) {
        tracing::warn!("{message}");
        self.outlet.report(Incident::Warning { message });
    }

    /// Works until it is told to stop.
    pub(super) fn run(mut self) -> Result<(), EventError> {
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
                self.warn(format!(
                    "{}: the stream was interrupted and continues; data was lost: {fault}",
                    driver.name()
                ));
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
        let mut last_warning = None;
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
                        if last_warning.as_ref() != Some(&message) {
                            self.warn(format!("{name}: connected again, but not working yet: {message}"));
                            last_warning = Some(message);
                        }
                    }
                },
            }
        }
    }

    fn reopen(&mut self) -> Result<(), EventError> {
        let mut driver: D = find(self.link.bus.as_ref(), &self.link.serial)?;
        let config = self.link.config().clone();
        driver.configure(&config)?;
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
