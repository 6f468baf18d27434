//! A device that several recorders get one after the other, so that it need not be opened for each recording.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use erfgs_session::source::{Counters, Description, Outlet, Source, SourceError};

/// A device.
#[derive(Clone)]
pub struct SharedSource {
    source: Arc<Mutex<Box<dyn Source>>>,
    description: Description,
}

impl SharedSource {
    pub fn new(source: Box<dyn Source>) -> Self {
        let description = source.description().clone();
        Self { source: Arc::new(Mutex::new(source)), description }
    }

    fn lock(&self) -> MutexGuard<'_, Box<dyn Source>> {
        self.source.lock().unwrap_or_else(PoisonError::into_inner)
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
        let started = source.start(outlet);
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
