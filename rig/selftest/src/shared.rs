//! A device that several recorders get one after the other, so that it need not be opened for each recording.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use erfgs_session::source::{Counters, Description, Incident, Outlet, Packet, Source, SourceError};

/// Different warnings that are kept of a driver.
const MAX_WARNINGS: usize = 64;

/// A device.
#[derive(Clone)]
pub struct SharedSource {
    source: Arc<Mutex<Box<dyn Source>>>,
    description: Description,
    warnings: Arc<Mutex<Vec<String>>>,
}

/// Passes on what a driver sends, and keeps what it warns of: in a recording the recorder's own warnings stand beside them.
struct Listener {
    outlet: Arc<dyn Outlet>,
    warnings: Arc<Mutex<Vec<String>>>,
}

impl Outlet for Listener {
    fn send(&self, packet: Packet) -> bool {
        self.outlet.send(packet)
    }

    fn report(&self, incident: Incident) {
        if let Incident::Warning { message } = &incident {
            let mut warnings = self.warnings.lock().unwrap_or_else(PoisonError::into_inner);
            if !warnings.contains(message) && warnings.len() < MAX_WARNINGS {
                warnings.push(message.clone());
            }
        }
        self.outlet.report(incident);
    }
}

impl SharedSource {
    pub fn new(source: Box<dyn Source>) -> Self {
        let description = source.description().clone();
        Self { source: Arc::new(Mutex::new(source)), description, warnings: Arc::default() }
    }

    fn lock(&self) -> MutexGuard<'_, Box<dyn Source>> {
        self.source.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What its driver has warned of, each once.
    pub fn warnings(&self) -> Vec<String> {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What the device is now.
    pub fn now(&self) -> Description {
        self.lock().description().clone()
    }
}

impl Source for SharedSource {
    fn description(&self) -> &Description {
        &self.description
    }

    fn start(&mut self, outlet: Arc<dyn Outlet>) -> Result<(), SourceError> {
        let mut source = self.source.lock().unwrap_or_else(PoisonError::into_inner);
        let started = source.start(Arc::new(Listener { outlet, warnings: Arc::clone(&self.warnings) }));
        // What was granted is known once it runs.
        self.description = source.description().clone();
        started
    }

    fn stop(&mut self) -> Result<(), SourceError> {
        self.lock().stop()
    }

    fn counters(&self) -> Counters {
        self.lock().counters()
    }

    fn readings(&mut self) -> Vec<(String, f64)> {
        self.lock().readings()
    }
}
