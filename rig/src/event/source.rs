//! A driver as a [`Source`].

use std::{
    sync::{Arc, Mutex, mpsc},
    thread::{self, JoinHandle},
};

use erfgs_session::source::{Counters, Description, Incident, Knob, Outlet, Source, SourceError};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Map, Value, json};

use super::{
    Driver, EventError,
    stream::{Feed, Signal},
    supervisor::{Link, Supervisor, begin, find},
};
use crate::usb::{Budget, Bus, Flight, memory_advice};

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

/// The transfers of a stream: those that are wanted, and once it runs those that there are.
fn stream_settings(flight: Flight) -> Value {
    json!({ "transfers": flight.transfers, "transfer_bytes": flight.bytes })
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
        let mut settings = driver.settings().clone();
        settings.insert("stream".into(), stream_settings(D::stream_config(&config).flight()));
        let description = Description {
            id: id.into(),
            model: D::MODEL.into(),
            serial: driver.serial().into(),
            encoding: driver.encoding(),
            width,
            height,
            start_order: driver.start_order(),
            settings,
        };
        let serial = driver.serial().to_owned();
        let link = Arc::new(Link { bus, config: Mutex::new(config), serial, driver: Mutex::new(Some(driver)) });
        Ok(Self { link, description, feed: Arc::new(Feed::default()), running: None })
    }

    fn name(&self) -> String {
        format!("{} {}", D::MODEL, self.description.serial)
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
            let config = self.link.config().clone();
            driver.configure(&config)?;
            *guard = Some(driver);
        }
        let Some(driver) = guard.as_mut() else {
            return Err(
                EventError::NotFound { model: D::MODEL, serial: self.link.serial.clone(), others: Vec::new() }.into()
            );
        };
        let wanted = D::stream_config(&self.link.config()).flight();
        let flight = Budget::on(&*self.link.bus).fit(wanted);
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
        if let Some(advice) = driver.transport().identity().speed.advice() {
            outlet.report(Incident::Warning { message: format!("{}: {advice}", driver.name()) });
        }
        self.feed.reset();
        let (signals, inbox) = mpsc::channel();
        let stream = begin(driver, flight, &self.feed, &outlet, &signals)?;
        drop(guard);
        let granted = stream_settings(Flight { transfers: stream.granted(), ..flight });
        self.description.settings.insert("stream".into(), granted);
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

    fn knobs(&self) -> Vec<Knob> {
        D::knobs(&self.link.config())
    }

    fn adjust(&mut self, wanted: &Map<String, Value>) -> Result<(), SourceError> {
        if let Some(fixed) = wanted.keys().find(|name| !D::ADJUSTABLE.contains(&name.as_str())) {
            let allowed = format!("while the camera runs: {}", D::ADJUSTABLE.join(", "));
            return Err(EventError::setting(fixed, &wanted[fixed.as_str()], allowed).into());
        }
        let before = self.link.config().clone();
        let config = changed(&before, wanted).map_err(|error| format!("{}: {error}", self.name()))?;
        D::validate(&config)?;
        let mut guard = self.link.driver();
        let Some(driver) = guard.as_mut() else {
            return Err(format!("{} is not connected at the moment: try again when it is back", self.name()).into());
        };
        if let Err(error) = driver.adjust(&config) {
            // What stood before, as far as the camera takes it.
            let _ = driver.adjust(&before);
            return Err(error.into());
        }
        let usb = self.description.settings.remove("stream");
        self.description.settings = driver.settings().clone();
        self.description.settings.extend(usb.map(|usb| ("stream".to_owned(), usb)));
        drop(guard);
        // A camera that comes back is configured so, too.
        *self.link.config() = config;
        Ok(())
    }
}

/// A configuration with some of its settings changed; tables are changed entry by entry, and what is `null` takes its default.
fn changed<C: Serialize + DeserializeOwned>(config: &C, changed: &Map<String, Value>) -> Result<C, serde_json::Error> {
    fn merge(into: &mut Map<String, Value>, changed: &Map<String, Value>) {
        for (name, value) in changed {
            match (into.get_mut(name), value) {
                (_, Value::Null) => drop(into.remove(name)),
                (Some(Value::Object(into)), Value::Object(changed)) => merge(into, changed),
                // Entries that are null in a table that was off take their defaults, too.
                (_, Value::Object(changed)) => {
                    let mut table = Map::new();
                    merge(&mut table, changed);
                    into.insert(name.clone(), table.into());
                }
                (_, value) => drop(into.insert(name.clone(), value.clone())),
            }
        }
    }
    let mut settings = serde_json::to_value(config)?;
    if let Value::Object(settings) = &mut settings {
        merge(settings, changed);
    }
    serde_json::from_value(settings)
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
